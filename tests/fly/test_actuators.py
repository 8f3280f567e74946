"""How commands are followed: limits, lag and delay, against other integrators and obvious counts."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.fly import Actuator, Below, Entry, Lander, Model, Normal, fly
from marsedl.montecarlo.flights import Flight


class State(NamedTuple):
    place: float = 0.0
    speed: float = 0.0
    pushed: float = 0.0  # integral of what pushes


class Push(NamedTuple):
    push: float


class Gain(NamedTuple):
    gain: float = 1.0


class Memory(NamedTuple):
    calls: float = 0.0


def rates(state, command: Push) -> State:
    return State(state.speed, command.push - 0.1 * state.place, command.push)


def square(time, law: Gain = Gain()):  # noqa: B008
    """Up and down, longer and longer."""
    return law.gain * (1.0 if np.sin(0.4 * time + 0.03 * time * time) > 0.0 else -0.7)


MODEL = Model(Flight(rates), quantities={"push": ("m/s^2", "push"), "place": ("m", "place"), "speed": ("m/s", "speed")})


def cart(actuator, law=square, **options):
    given = {"end_time": 20.0, "substeps": 4, "history": 0.25, "trials": 1, "compiled": False, "law": law}
    model = Model(MODEL.flight, quantities=MODEL.quantities, actuators={"push": actuator})
    return fly(model, {}, **given | options)


# ---- motion ----------------------------------------------------------------------------------------------------------

TIMES = np.arange(0.0, 20.0, 0.25)
COMMANDS = np.array([square(float(second)) for second in range(20)])


def in_small_steps(actuator, step):
    """The slow, obvious form: toward the target with the speed from which it still stops there, one small step a time.

    Its error is of the first order in the step.
    """
    place = value = COMMANDS[0]
    speed, values = 0.0, []
    every = round(0.25 / step)
    for number in range(round(20.0 / step)):
        if number % every == 0:
            values.append(value)
        ahead = COMMANDS[int(number * step + 1e-9)] - place
        wanted = np.sign(ahead) * min(actuator.rate, np.sqrt(2.0 * actuator.acceleration * abs(ahead)))
        speed += np.clip(wanted - speed, -actuator.acceleration * step, actuator.acceleration * step)
        place += speed * step
        value += (place - value) * step / actuator.lag if actuator.lag else place - value
    return np.array(values)


@pytest.mark.parametrize("lag", [0.0, 0.4])
@pytest.mark.parametrize(("rate", "acceleration"), [(0.5, 0.6), (10.0, 0.6)])
def test_limits_of_rate_and_acceleration_and_lag_are_those_of_small_steps(rate, acceleration, lag):
    actuator = Actuator(rate=rate, acceleration=acceleration, lag=lag)
    history = cart(actuator).replay(0).history
    flown, commanded = (history[name].values[:-1] for name in ("push", "commanded_push"))
    np.testing.assert_array_equal(commanded, np.repeat(COMMANDS, 4))
    errors = [np.abs(in_small_steps(actuator, step) - flown).max() for step in (1e-2, 1e-3)]
    assert errors[1] < 5e-3 and errors[1] < 0.2 * errors[0]
    assert np.abs(np.diff(flown)).max() <= rate * 0.25 * (1.0 + 1e-12)


def cart_of_scipy(pushed_at, breaks):
    """The cart at 20 s, integrated from one break to the next; pushed_at: function of time and number of the piece."""
    state = np.zeros(3)
    for number, (begin, end) in enumerate(pairwise(breaks)):

        def slope(time, state, number=number):
            push = pushed_at(time, number)
            return [state[1], push - 0.1 * state[0], push]

        state = solve_ivp(slope, (begin, end), state, rtol=1e-11, atol=1e-12, max_step=0.1).y[:, -1]
    return state


def test_a_rate_and_a_lag_fly_as_scipy_flies_them():
    rate, lag, begins = 0.37, 0.4, [COMMANDS[0]]
    for command in COMMANDS:
        begins.append(begins[-1] + np.clip(command - begins[-1], -rate, rate))

    def limited(time, period):
        return begins[period] + np.clip(
            COMMANDS[period] - begins[period], -rate * (time - period), rate * (time - period)
        )

    exact = cart_of_scipy(limited, np.arange(21.0))
    errors = [
        np.abs(cart(Actuator(rate=rate), substeps=n, history=None).numbers[1:4, 0] - exact).max() for n in (10, 40)
    ]
    assert errors[0] < 1e-3 and errors[1] < 0.2 * errors[0]  # corners of the ramps lie within steps

    value, state = COMMANDS[0], np.zeros(3)
    for period, command in enumerate(COMMANDS):

        def slope(time, state, command=command):
            return [state[1], state[3] - 0.1 * state[0], state[3], (command - state[3]) / lag]

        *state, value = solve_ivp(slope, (period, period + 1.0), [*state, value], rtol=1e-11, atol=1e-12).y[:, -1]
    final = cart(Actuator(lag=lag), substeps=32).final
    np.testing.assert_allclose([final[name][0] for name in ("place", "speed", "pushed")], state, atol=1e-6)
    np.testing.assert_allclose(final["push"], value, rtol=1e-9)


def test_a_lag_that_is_much_shorter_than_a_period_is_over_at_once():
    history = cart(Actuator(lag=1e-4)).replay(0).history
    np.testing.assert_allclose(history["push"].loc[0.25::4], COMMANDS, rtol=1e-15)


# ---- delay -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0.25, 1.0, 1.75, 3.0])
def test_a_delayed_law_is_the_law_with_shifted_commands(delay):
    delayed = cart(Actuator(delay=delay))
    shifted = cart(
        Actuator(), law=lambda time: square(float(np.floor(max(time - delay, 0.0)))), period=0.25, substeps=1
    )
    for name in ("place", "speed", "pushed", "push"):
        np.testing.assert_array_equal(delayed.final[name], shifted.final[name])
    flown = delayed.replay(0).history
    assert (flown["commanded_push"].values[:-1] == np.repeat(COMMANDS, 4)).all()
    assert (flown["push"].values[round(4 * delay) : -1] == np.repeat(COMMANDS, 4)[: 80 - round(4 * delay)]).all()


def test_before_the_first_command_arrives_it_rests_where_it_starts():
    flown = cart(Actuator(delay=1.5, rate=2.0, start=0.25)).replay(0).history
    assert (flown["push"].loc[:1.5] == 0.25).all()
    np.testing.assert_allclose(flown["push"].loc[1.75], 0.25 - 0.25 * 2.0)  # to -0.7


def counting(memory: Memory) -> tuple[Push, Memory]:
    return Push(0.1 * memory.calls), Memory(memory.calls + 1.0)


@pytest.mark.parametrize("delay", [0.0, 0.5, 2.0])
def test_a_law_is_asked_once_a_period_and_remembers(delay):
    flown = cart(Actuator(delay=delay), law=counting, end_time=5.0).replay(0).history
    np.testing.assert_allclose(flown["commanded_push"].loc[:4.0:4], 0.1 * np.arange(5))


# ---- counts, and what stays as it is ---------------------------------------------------------------------------------


@pytest.mark.parametrize("actuator", [Actuator(rate=0.8), Actuator(rate=0.8, acceleration=2.0), Actuator(low=-0.5)])
def test_saturated_periods_are_those_in_which_the_command_is_not_reached(actuator):
    flights = cart(actuator)
    history = flights.replay(0).history.loc[0.0:20.0:4]
    flown, commanded = (history[name].values for name in ("push", "commanded_push"))
    reached = flown[1:] if actuator.rate else flown[:-1]
    missed = np.abs(reached - commanded[:-1]) > 1e-9
    assert flights.final["saturated_push"] == missed.sum() and 0 < missed.sum() < 20


def test_what_follows_at_once_is_the_flight_without_actuators():
    plain = fly(MODEL, {}, end_time=20.0, substeps=4, trials=1, compiled=False, law=square)
    at_once = cart(Actuator())
    for name, numbers in plain.final.items():
        np.testing.assert_array_equal(at_once.final[name], numbers)
    assert not Entry(115.0).model().actuators and not Lander(9e3, 220.0).model().actuators


class Awkward(NamedTuple):
    time: float
    p: float


def rates_of_awkward_names(state, command: Awkward) -> State:
    return State(state.speed, command.p, command.time)


def test_names_of_commands_are_free_and_others_are_followed_at_once():
    model = Model(Flight(rates_of_awkward_names), actuators={"p": Actuator(rate=1.0), "time": Actuator(delay=1.0)})
    final = fly(model, {}, law=lambda time: (time, 0.5 * time), end_time=4.0, trials=1, compiled=False).final
    np.testing.assert_allclose([final["pushed"][0], final["p"][0], final["time"][0]], [0.0 + 0.0 + 1.0 + 2.0, 1.5, 2.0])
    alone = Model(Flight(rates_of_awkward_names), actuators={"p": Actuator(rate=1.0)})
    final = fly(alone, {}, law=lambda time: (time, 0.5 * time), end_time=4.0, trials=1, compiled=False).final
    np.testing.assert_allclose([final["pushed"][0], final["time"][0]], [0.0 + 1.0 + 2.0 + 3.0, 3.0])


# ---- compiled --------------------------------------------------------------------------------------------------------

HARD = Actuator(rate=0.8, acceleration=1.5, lag=0.3, delay=1.25, low=-0.6)
MANY = {"compiled": True, "trials": 300, "seed": 3, "history": None}


def steering(sensed, memory, law: Gain = Gain()) -> tuple[Push, Memory]:  # noqa: B008
    return Push(-law.gain * (0.3 * sensed.place + sensed.speed) + 0.01 * memory.calls), Memory(memory.calls + 1.0)


def steered(law=steering, **options):
    model = Model(MODEL.flight, quantities=MODEL.quantities, actuators={"push": HARD})
    return fly(model, {"place": Normal(0.0, 2.0), "speed": Normal(0.0, 0.5)}, law=law, end_time=20.0, **MANY | options)


@pytest.fixture(scope="module")
def flown():
    return steered()


def test_threads_chunks_and_python_have_the_same_bits(flown):
    import numba

    threads = numba.get_num_threads()
    for count in {1, min(2, threads)}:
        numba.set_num_threads(count)
        np.testing.assert_array_equal(steered().numbers, flown.numbers)
    numba.set_num_threads(threads)
    np.testing.assert_array_equal(steered(trials=13).extended(300).numbers, flown.numbers)
    np.testing.assert_array_equal(steered(trials=3, compiled=False).numbers, flown.numbers[:, :3])
    assert flown.replay(299).final == flown.replay(299, in_python=True).final
    assert 0 < (flown.final["saturated_push"] > 0.0).sum() < 300


def test_a_law_of_a_number_alone_flies_compiled_as_in_python():
    def alone(time, speed):
        return 1 if time < 5.0 else -speed

    numbers = [steered(alone, trials=2, compiled=compiled).numbers for compiled in (True, False)]
    np.testing.assert_array_equal(*numbers)


# ---- vehicles --------------------------------------------------------------------------------------------------------

CAPSULE = {"altitude_km": 60.0, "velocity": 5500.0, "flight_path_angle_deg": -14.0}


def reversal(velocity):
    return 1.2 if velocity > 4500.0 else -1.2


def test_an_entry_flies_its_bank_as_scipy_flies_it():
    from marsedl.fly import dynamics

    vehicle = Entry(115.0, 0.24, bank_rate_deg=10.0, lag=0.5, delay=2.0)
    flights = fly(vehicle, CAPSULE, law=reversal, trigger=Below("velocity", 3500.0), end_time=90.0, trials=1,
                  substeps=8, history=7.0, compiled=False)  # fmt: skip
    one, p, rate = flights.replay(0), flights.campaign.p, np.deg2rad(10.0)
    reversed_at = one.history.index[one.history["commanded_bank"] < 0.0][0] + 2.0
    assert one.history["bank"].loc[reversed_at] == 1.2

    def bank(time):
        ramp, end = max(time - reversed_at, 0.0), 2.4 / rate

        def lagged(s):  # of a ramp behind a lag
            return 1.2 - rate * (s - 0.5 + 0.5 * np.exp(-s / 0.5))

        return lagged(ramp) if ramp < end else -1.2 + (lagged(end) + 1.2) * np.exp(-(ramp - end) / 0.5)

    def slope(time, numbers):
        state = dynamics.EntryState(*numbers)
        found = dynamics.look_up(state, np.zeros(2), p)
        return dynamics.entry_rates(state, found, dynamics.Bank(bank(time)), dynamics.EntryVehicle(115.0, 0.24), p)

    start = [flights.campaign.start.means[k] for k in range(6)]
    scipy = solve_ivp(slope, (0.0, one.final["end_time"]), start, rtol=1e-11, atol=1e-9, max_step=0.25)
    for row, name in enumerate(dynamics.EntryState._fields):
        np.testing.assert_allclose(one.final[name], scipy.y[row, -1], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(one.final["bank"], bank(one.final["end_time"]), rtol=1e-9)
    assert one.final["velocity"] == pytest.approx(3500.0) and one.history["bank"].iloc[-1] == one.final["bank"]
    assert one.final["saturated_bank"] == np.ceil(one.final["end_time"] - reversed_at) < 13  # of 2.4 rad / 10 deg/s
    data = flights.to_xarray()
    last = data[["bank_history", "commanded_bank_history"]].isel(trial=0, time=int(one.final["end_time"] // 7.0) + 1)
    assert last["bank_history"] == one.final["bank"] and last["commanded_bank_history"] == -1.2
    assert data["saturated_bank"].attrs["long_name"].startswith("guidance periods in which limits kept bank")


LANDS = {"downrange": 0.0, "altitude": 1000.0, "downrange_velocity": 0.0, "vertical_velocity": -10.0, "mass": 900.0}


def throttled(altitude):
    return (1000.0, 9900.0) if altitude < 900.0 else (1000.0, 1000.0)


def test_a_lander_throttles_and_tilts_as_scipy_flies_it():
    from marsedl.fly import dynamics

    vehicle = Lander(
        9000.0, 220.0, smallest_thrust=2000.0, throttle_rate=3000.0, tilt_rate_deg=10.0, largest_tilt_deg=30
    )
    flights = fly(vehicle, LANDS, law=throttled, end_time=15.0, trials=1, substeps=20, compiled=False)
    one, p = flights.replay(0), flights.campaign.p
    begun = one.history.index[one.history["commanded_thrust_vertical"] == 9900.0][0]
    after, tilt = np.arctan2(1000.0, 9900.0), np.deg2rad(30.0)  # 45 degrees are commanded before

    def thrust(time):
        given = 2000.0 + np.clip(3000.0 * (time - begun), 0.0, 7000.0)  # from and to the limits
        angle = tilt - np.clip(np.deg2rad(10.0) * (time - begun), 0.0, tilt - after)
        return dynamics.Thrust(given * np.sin(angle), given * np.cos(angle))

    def slope(time, numbers):
        body = dynamics.LanderVehicle(220.0, 2000.0, 9000.0, 1.0)
        state, calm = dynamics.LanderState(*numbers), dynamics.Disturbance(0.0, 0.0)
        return dynamics.lander_rates(state, state, 1e-3, thrust(time), body, calm, p)

    scipy = solve_ivp(slope, (0.0, 15.0), [*LANDS.values()], rtol=1e-10, atol=1e-9, max_step=0.02)
    for row, name in enumerate(LANDS):
        np.testing.assert_allclose(one.final[name], scipy.y[row, -1], rtol=1e-5, atol=1e-3)
    for name, number in thrust(15.0)._asdict().items():
        np.testing.assert_allclose(one.final[name], number, rtol=1e-12)
    assert one.final["max_command"] == np.hypot(1000.0, 9900.0)
    # Cut at both ends, but for what fits: the thrust always, the tilt until it is commanded within its limits.
    assert one.final["saturated_thrust"] == 15.0
    assert one.final["saturated_tilt"] == begun + 2.0  # 24.2 degrees at 10 a second


@pytest.mark.parametrize("substeps", [1, 7])
def test_a_throttled_lander_burns_no_more_propellant_than_it_has(substeps):
    vehicle = Lander(9000.0, 220.0, throttle_rate=3000.0, lag=0.2, dry_mass=890.0, gravity=0.0, ground=None)
    with pytest.warns(UserWarning, match="out of propellant"):
        flights = fly(
            vehicle,
            LANDS,
            law=lambda time: (0.0, 2000.0 + 1000.0 * (time % 3.0)),
            end_time=15.0,
            trials=1,
            substeps=substeps,
            compiled=False,
        )
    masses = flights.replay(0).history["mass"]
    assert masses.min() >= 890.0 * (1.0 - 1e-9) and flights.final["mass"] <= 890.0 * (1.0 + 1e-9)
    speed = 220.0 * 9.80665 * np.log(900.0 / 890.0) - 10.0  # whatever the thrust was
    np.testing.assert_allclose(flights.final["vertical_velocity"], speed, rtol=1e-6 / substeps**2)  # thrust has kinks


def test_thrust_that_is_off_stays_off():
    vehicle = Lander(9000.0, 220.0, smallest_thrust=2000.0, throttle_rate=4000.0)
    history = fly(vehicle, LANDS, law=lambda time: (0.0, 4000.0 * (time < 2.0)), end_time=5.0, trials=1,
                  compiled=False).replay(0).history["thrust_vertical"]  # fmt: skip
    np.testing.assert_allclose(history.loc[[1.0, 2.0, 2.25, 2.5, 2.75]], [4000.0, 4000.0, 3000.0, 2000.0, 2000.0])
    assert (history.loc[3.0:] == 0.0).all()


@pytest.mark.parametrize(
    ("actuators", "told"),
    [
        ({"push": Actuator(rate=-1.0)}, "actuator of 'push': rate is -1.0; give a positive number"),
        ({"push": Actuator(rate=Normal(1.0, 0.1))}, "rate is Normal.*; give a positive number"),
        ({"push": Actuator(lag=-0.1)}, "lag is -0.1 s; give a number of seconds, at least 0"),
        ({"push": Actuator(delay=0.3)}, "a delay of 0.3 s is no multiple of the integration step, 0.25 s"),
        ({"push": Actuator(delay=60.0)}, "a delay of 60 s is 60 guidance periods, more than 50"),
        ({"push": Actuator(low=1.0, high=0.0)}, "low, 1, lies above high, 0; exchange the two"),
        ({"push": Actuator(high="thrust")}, "high 'thrust' is no number of the vehicle"),
        ({"push": Actuator(low=0.0, start=-1.0)}, "start is -1.0; it must lie between 0 and inf"),
        ({"pusch": Actuator(rate=1.0)}, "actuators 'pusch' is unknown; did you mean 'push'"),
        ({"push": 5.0}, r"actuators 'push' is 5.0; give Actuator\("),
        (5.0, "actuators are 5.0; give a mapping from commands"),
    ],
)
def test_actuators_are_looked_at_where_they_are_given(actuators, told):
    with pytest.raises(ValueError, match=told):
        fly(Model(MODEL.flight, actuators=actuators), {}, law=square, end_time=20.0, trials=1, compiled=False)


@pytest.mark.parametrize(
    ("vehicle", "start", "told"),
    [
        (Entry(115.0, bank_rate=0.1, bank_rate_deg=5.0), CAPSULE, "bank_rate and bank_rate_deg are the same number"),
        (Entry(115.0, bank_rate_deg="5"), CAPSULE, "bank_rate_deg is '5'; give a finite number"),
        (Entry(115.0, delay=0.1), CAPSULE, "actuator of 'bank': a delay of 0.1 s is no multiple"),
        (Lander(9e3, 220.0, throttle_rate=-5.0), LANDS, "actuator of 'thrust': rate is -5.0; give a positive number"),
        (Lander(9e3, 220.0, largest_tilt_deg=-5.0), LANDS, "largest_tilt is -0.087.* rad; give a positive number"),
    ],
)
def test_limits_of_vehicles_are_looked_at(vehicle, start, told):
    with pytest.raises(ValueError, match=told):
        fly(vehicle, start, end_time=20.0, trials=1, compiled=False)


def test_a_model_with_guidance_of_its_own_takes_no_actuators_and_what_a_law_returns_is_still_checked():
    def guide(sensed) -> tuple[Push, Memory]:
        return Push(0.0), Memory()

    with pytest.raises(ValueError, match="actuators: the model has guidance of its own"):
        fly(Model(Flight(rates, guide=guide), actuators={"push": HARD}), {}, end_time=9.0, trials=1, compiled=False)
    with pytest.raises(ValueError, match="bank is 70 rad, more than a turn"):
        fly(Entry(115.0, lag=1.0), CAPSULE, law=lambda time: 70.0, end_time=20.0, trials=1, compiled=False)
    for law, told in ((lambda time: None, "returned None; it must return push"), (lambda time: (1.0, 2.0), "push")):
        with pytest.raises(ValueError, match=told):
            cart(HARD, law=law)
