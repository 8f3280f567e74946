"""What laws know of a flight: the truth with declared errors, under names of its own, and the truth itself by leave."""

import inspect
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

from marsedl.fly import Below, Entry, Error, Exponential, Model, Normal, Senses, ThroughDrag, Uniform, fly
from marsedl.montecarlo.flights import Flight


class State(NamedTuple):
    altitude: float
    speed: float = -20.0


class Push(NamedTuple):
    up: float


class Body(NamedTuple):
    factor: float


class Gain(NamedTuple):
    gain: float = 0.0


class Memory(NamedTuple):
    calls: float = 0.0


def rates(state, command: Push, vehicle) -> State:
    return State(state.speed, -0.5 * state.speed - 10.0 + vehicle.factor * command.up)


def push(speed, altitude, law: Gain = Gain()):  # noqa: B008
    return law.gain * (speed + 0.01 * altitude)


UNITS = {"altitude": ("m", "altitude"), "speed": ("m/s", "climb rate")}
PROBE = Model(Flight(rates), vehicle=Body(Normal(1.0, 0.01)), quantities=UNITS)
ALTITUDE = Error(bias=Normal(3.0, 5.0), walk=0.5, noise=0.2)
SENSES = Senses(altitude=ALTITUDE, speed=Error(scale=Normal(1.0, 0.02), drift=Uniform(-0.1, 0.1)))
DROP = {"end_time": 60.0, "trigger": Below("altitude", 0.0), "substeps": 2, "law": push}
HIGH = {"altitude": Normal(500.0, 20.0)}
CAPSULE = {"altitude_km": 60.0, "velocity": 5500.0, "flight_path_angle_deg": -14.0}


def dropped(senses=SENSES, start=HIGH, model=PROBE, **options):
    return fly(model, start, senses=senses, **DROP | options)


@pytest.fixture(scope="module")
def flown():
    return dropped(trials=4000, history=1.0, seed=5)


def test_errors_of_what_is_known_have_their_distributions(flown):
    data, trials = flown.to_xarray(), 4000
    times = np.arange(15)  # none ends before
    error = (data["nav_altitude_history"] - data["altitude_history"]).values[times]
    theory = np.sqrt(5.0**2 + 0.5**2 * times + 0.2**2)
    np.testing.assert_allclose(error.std(axis=1), theory, rtol=4.0 / np.sqrt(2.0 * trials))
    np.testing.assert_array_less(np.abs(error.mean(axis=1) - 3.0), 4.0 * theory / np.sqrt(trials))
    speed, known = data["speed_history"].values[times], data["nav_speed_history"].values[times]
    first_scale = known[0] / speed[0]
    np.testing.assert_allclose(first_scale.std(), 0.02, rtol=4.0 / np.sqrt(2.0 * trials))
    drift = (known[1:] - first_scale * speed[1:]) / times[1:, np.newaxis]
    np.testing.assert_allclose(drift, np.broadcast_to(drift[0], drift.shape), atol=1e-9)  # constant in a trial
    assert -0.1 <= drift.min() < -0.099 and 0.099 < drift.max() <= 0.1
    assert data["nav_altitude"].attrs == {"units": "m", "long_name": "altitude, as laws know it"}


def test_results_and_triggers_hold_the_truth(flown):
    assert flown.outcomes() == {"ended: altitude below 0": 4000}
    np.testing.assert_allclose(flown.final["altitude"], 0.0, atol=1e-9)
    assert flown.final["nav_altitude"].std() > 4.0
    assert flown.percentiles("altitude_km")["value"].abs().max() < 1e-9
    assert flown.truth == () and "truth" not in repr(flown)


def test_what_is_known_reaches_the_law_and_is_the_same_alone_in_python_and_for_all_gains(flown):
    low = dropped(law=partial(push, law=Gain(0.05)), trials=40, seed=5, history=1.0)
    assert (low.histories[:10, :, :] != flown.histories[:10, :, :40]).any(axis=(0, 1)).all()
    command = low.to_xarray()
    known = command["nav_speed_history"] + 0.01 * command["nav_altitude_history"]
    np.testing.assert_allclose(command["up_history"][:10], 0.05 * known[:10], rtol=1e-12)
    for trial in (0, 39):
        alone = low.replay(trial)
        assert alone.final == low.replay(trial, in_python=True).final
        assert all(alone.final[name] == low.final[name][trial] for name in low.final)
    assert (dropped(trials=13, seed=5, history=1.0).extended(300).numbers == flown.numbers[:, :300]).all()
    error = [f.histories[0] for f in (low, flown)]  # pairs meet the same errors
    np.testing.assert_array_equal(error[0][[0, 1, 3, 4]], error[1][[0, 1, 3, 4]][:, :40])


def test_senses_without_errors_change_no_bit_of_the_truth_and_added_errors_no_constant_one(flown):
    perfect, without = (
        dropped(senses, trials=30, seed=5, law=partial(push, law=Gain(0.05)), compiled=False)
        for senses in (Senses(speed=Error()), None)
    )
    for name in without.final:
        np.testing.assert_array_equal(perfect.final[name], without.final[name])
    alone = dropped(Senses(altitude=Error(bias=Normal(3.0, 5.0))), trials=5, seed=5, history=1.0, compiled=False)
    both = dropped(Senses(altitude=Error(bias=Normal(3.0, 5.0)), speed=Error(noise=1.0)), trials=5, seed=5, history=1.0,
                   compiled=False)  # fmt: skip
    bias = [(f.to_xarray()["nav_altitude_history"] - f.to_xarray()["altitude_history"])[0] for f in (alone, both)]
    np.testing.assert_array_equal(*bias)


def test_a_suffix_is_the_unit_of_the_error():
    metres = dropped(Senses(altitude=Error(bias=Normal(2e3, 5e3), walk=50.0)), trials=3, compiled=False)
    kilometres = dropped(Senses(altitude_km=Error(bias=Normal(2.0, 5.0), walk=0.05)), trials=3, compiled=False)
    np.testing.assert_allclose(metres.final["nav_altitude"], kilometres.final["nav_altitude"], rtol=1e-12)


def test_density_and_altitude_are_known_through_drag():
    air = Exponential(0.02, 9e3)
    senses = Senses(density=ThroughDrag(115.0), altitude=ThroughDrag(115.0, air, least_drag=5.0), drag=Error())
    options = {"end_time": 50.0, "law": 1.0, "substeps": 2, "history": 1.0, "compiled": False, "trials": 1}
    data = fly(Entry(115.0, 0.24, air=air), CAPSULE, senses=senses, **options).to_xarray()
    known = {name: data[f"{name}_history"].values[:-1, 0] for name in ("nav_density", "nav_altitude")}
    drag, density, altitude = (data[f"{name}_history"].values[:-1, 0] for name in ("drag", "density", "altitude"))
    np.testing.assert_allclose(known["nav_density"], density, rtol=1e-9)
    felt = drag > 5.0
    assert 5 < felt.sum() < len(felt)
    np.testing.assert_allclose(known["nav_altitude"][felt], altitude[felt], atol=1e-3)
    assert (known["nav_altitude"][~felt] < altitude[~felt]).all()  # as if the drag were 5 m/s^2
    lighter = senses.errors | {"density": ThroughDrag(100.0)}
    other = fly(Entry(115.0, 0.24, air=air), CAPSULE, senses=Senses(**lighter), **options).to_xarray()
    np.testing.assert_allclose(other["nav_density_history"], data["nav_density_history"] * 100.0 / 115.0, rtol=1e-12)


def test_an_entry_flies_with_errors_as_in_python():
    senses = Senses(altitude=Error(bias=Normal(0.0, 200.0), noise=20.0), velocity=Error(scale=Normal(1.0, 1e-3)))
    flights = fly(Entry(115.0, 0.24), CAPSULE, law=lambda velocity: 1.0 + 1e-5 * velocity, senses=senses,
                  trigger=Below("velocity", 4000.0), end_time=100.0, trials=20, seed=2)  # fmt: skip
    assert flights.outcomes() == {"ended: velocity below 4000": 20}
    assert {"nav_altitude", "nav_velocity"} < {*flights.final} and "nav_range" not in flights.final
    assert flights.replay(3).final == flights.replay(3, in_python=True).final


def uses_vehicle(speed, vehicle):
    return vehicle.factor * speed


def uses_state(nav, state, memory: Memory) -> tuple[Push, Memory]:
    return Push(0.01 * state.speed + 0.0 * nav.altitude), Memory(memory.calls + 1.0)


def uses_air(found, sensed, memory) -> tuple[Push, Memory]:
    return Push(sensed.speed), memory


@pytest.mark.parametrize(("law", "name"), [(uses_vehicle, "vehicle"), (uses_state, "state"), (uses_air, "found")])
@pytest.mark.parametrize("senses", [None, SENSES])
def test_a_law_that_asks_for_the_truth_without_leave_is_refused_with_its_line(law, name, senses):
    line = inspect.getsourcelines(law)[1]
    with pytest.raises(
        ValueError, match=rf"{law.__name__} .*test_senses\.py.*line {line}\).* asks for '{name}', the truth"
    ):
        dropped(senses, law=law, trials=2, compiled=False)


def test_names_of_what_is_told_are_those_of_arguments_alone():
    def has_its_own(speed):
        sensed = Push(0.3 * speed)
        nav = Push(sensed.up)
        return Push(nav.up)

    assert dropped(law=has_its_own, trials=2, compiled=False).trials == 2


def test_by_leave_a_law_is_told_the_truth_and_the_result_says_so():
    for law, name in ((uses_vehicle, "vehicle"), (uses_state, "state")):
        flights = dropped(law=law, truth=True, trials=2, compiled=False)
        assert flights.truth == (name,) and f"the law is told the truth: {name}" in repr(flights)
        assert flights.to_xarray().attrs["truth_told_to_the_law"] == name


class Known(NamedTuple):
    height: float


class Draw(NamedTuple):
    height: float


def truly(state) -> State:
    return state


def altimeter(sensed, draws) -> Known:
    return Known(sensed.altitude + 2.0 * draws.height)


def test_a_model_may_have_navigation_of_its_own():
    own = Model(Flight(rates, sense=truly, navigate=altimeter, draws=Draw), vehicle=Body(1.0), quantities=UNITS)
    flights = dropped(None, model=own, law=lambda height: 0.01 * height, trials=3, history=1.0, compiled=False)
    data = flights.to_xarray()
    np.testing.assert_allclose(data["up_history"][:5], 0.01 * data["nav_height_history"][:5], rtol=1e-12)
    assert (np.abs(data["nav_height_history"] - data["altitude_history"])[:5] > 0.0).all()
    with pytest.raises(ValueError, match="senses: the model has guidance or navigation of its own"):
        dropped(SENSES, model=own, law=lambda height: 0.01 * height, trials=3)


@pytest.mark.parametrize(
    ("senses", "told"),
    [
        (Senses(altitud=Error()), "senses 'altitud' is unknown; did you mean 'altitude'"),
        (Senses(altitude=5.0), r"senses 'altitude' is 5.0; give Error\(bias=..., noise=...\)"),
        (Senses(altitude=Error(noise=-1.0)), "senses 'altitude': noise is -1.0; give the deviation"),
        (Senses(altitude=Error(walk=Normal(0.0, 1.0))), "walk is Normal.* give the deviation, a number"),
        (Senses(altitude=Error(bias="5")), "senses 'altitude_bias' is '5'; give a finite number"),
        (Senses(altitude=Error(), altitude_km=Error()), "senses 'altitude' is given twice"),
        (Senses(altitude=ThroughDrag(115.0)), "only density and altitude of an Entry are known through drag"),
        ({"altitude": Error()}, r"senses is \{.*\}; give Senses\("),
    ],
)
def test_senses_are_looked_at_where_they_are_given(senses, told):
    with pytest.raises(ValueError, match=told):
        dropped(senses, trials=2)
