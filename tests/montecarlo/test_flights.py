"""The engine: compiled flights are those of the plain functions, converge, keep energy, and refuse bad models."""

import random
import sys
import time
from collections import namedtuple
from dataclasses import fields, replace
from enum import IntEnum
from types import ModuleType, SimpleNamespace
from typing import NamedTuple

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from marsedl.montecarlo.flights import Flight, Nothing, addressed, loop, periods
from marsedl.montecarlo.flights.addressed import words_of
from marsedl.montecarlo.flights.binding import digest
from marsedl.montecarlo.flights.columns import (
    borrowed,
    column,
    dresser,
    flat,
    getter,
    putter,
    reader,
    shape_of,
    types_of,
)
from marsedl.montecarlo.flights.diagnosis import scalar_loops
from marsedl.montecarlo.integrators import euler_maruyama, semi_implicit_euler
from marsedl.montecarlo.lanes import LANES, lane_array


class State(NamedTuple):
    h: float
    v: float


class White(NamedTuple):
    a: float


class Planet(NamedTuple):
    gravity: float
    table: np.ndarray


class Law(NamedTuple):
    gain: float
    limit: float


class Body(NamedTuple):
    drag: float


class Air(NamedTuple):
    density: float


class Felt(NamedTuple):
    speed: float
    drag: float


class Brake(NamedTuple):
    thrust: float


class Memory(NamedTuple):
    calls: float = 0.0
    largest: float = 1.0


class Walk(NamedTuple):
    value: float


class Advice(NamedTuple):
    floor: float


class Errors(NamedTuple):
    constant: float
    noise: float


class Known(NamedTuple):
    speed: float
    constant: float


class Fastest(NamedTuple):
    speed: float = -np.inf


class Row(NamedTuple):
    h: float
    v: float
    thrust: float


class Seen(NamedTuple):
    drag: float
    guided: float


class End(NamedTuple):
    time: float
    h: float
    v: float
    calls: float
    walked: float
    known: float


def rates(state, found, command, vehicle, noise, p) -> State:
    return State(
        state.v, command.thrust - p.gravity - vehicle.drag * found.density * state.v * abs(state.v) + 0.1 * noise.a
    )


def look_up(state, air, p) -> Air:
    node = min(max(int(state.h / 10.0), 0), len(air) - 1)
    return Air(p.table[node] * (1.0 + air[node]))


def vary(node, normal, drawn, p) -> tuple[float, Walk]:
    value = 0.8 * drawn.value + 0.1 * normal + 0.01 * node / p.gravity
    return value, Walk(value)


def sense(time, half_index, state, found, vehicle) -> Felt:
    return Felt(abs(state.v) + 1e-4 * half_index, vehicle.drag * found.density * state.v * state.v + 1e-3 * time)


def navigate(cycle, time, sensed, nav, draws, vehicle, p) -> Known:
    constant = draws.constant if cycle == 0 else nav.constant
    return Known(sensed.speed + vehicle.drag * constant + draws.noise / p.gravity + 1e-3 * time, constant)


def consult(sensed, law) -> Advice:
    floor = 0.0
    for number in range(3):
        if sensed.speed > number:
            floor += 0.1 * law.gain
    return Advice(floor)


def phase(sensed, nav, memory) -> int:
    return 1 if max(sensed.speed, nav.speed) > 4.0 * memory.largest else 0


def glide(sensed, advice, memory, past) -> tuple[Brake, Memory]:
    past[0] = sensed.speed
    return Brake(advice.floor), Memory(memory.calls + 1.0, max(memory.largest, 0.1 * sensed.speed))


def brake(share, sensed, nav, advice, memory, past, law) -> tuple[Brake, Memory]:
    past[1] = sensed.drag
    wanted = law.gain * nav.speed + advice.floor + share + 1e-3 * past[1]
    return Brake(wanted if wanted < law.limit else law.limit), Memory(memory.calls + 1.0, memory.largest)


def interrupts(state, memory) -> bool:
    return abs(state.v) > 5.0 * memory.largest


def ended(state) -> float:
    return state.h


def watch(watched, sensed) -> Fastest:
    return Fastest(max(watched.speed, sensed.speed))


def store(half_index, time, cycle, state, command) -> Row:
    return Row(state.h + 0.01 * half_index, state.v + 0.01 * time, command.thrust + 0.01 * cycle)


def observe(sensed, guided) -> Seen:
    return Seen(sensed.drag, guided)


def finish(time, state, nav, memory, drawn) -> End:
    return End(time, state.h, state.v, memory.calls, drawn.value, nav.speed)


def landed(state) -> bool:
    return state.h <= 0.0


def light(state, noise, p) -> State:
    return State(state.v, -p.gravity + 0.1 * noise.a - 0.01 * state.v)


def falls(state, p) -> State:
    return State(state.v, -p.gravity)


WHOLE = Flight(
    rates,
    look_up=look_up,
    vary=vary,
    sense=sense,
    navigate=navigate,
    draws=Errors,
    consult=consult,
    phase=phase,
    guide=(glide, brake),
    interrupts=interrupts,
    ended=ended,
    watch=watch,
    store=store,
    observe=observe,
    finish=finish,
    noise=White,
)
EULER = Flight(light, noise=White, integrator=euler_maruyama, ended=landed)
SEMI_IMPLICIT = Flight(light, noise=White, integrator=semi_implicit_euler(1), ended=landed)
FALL = Flight(falls, ended=ended)
PLANET = Planet(3.7, np.linspace(0.02, 0.01, 12))
SCHEDULE = periods(8.0, 1.0, 4, every=2)


def assert_same(a, b):
    """Equal bits up to each trial's end, and there."""
    a, b = (replace(x, history=x.history.copy(), observed=x.observed.copy()).with_ends() for x in (a, b))
    for field in fields(a):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name), err_msg=field.name)


def one(paths, trial):
    return type(paths)(*(getattr(paths, field.name)[..., trial : trial + 1] for field in fields(paths)))


CASES = st.tuples(
    st.lists(st.tuples(st.floats(0.5, 110.0), st.floats(-20.0, 5.0), st.floats(0.1, 2.0)), min_size=1, max_size=5),
    *(st.integers(0, 2**40), st.integers(0, 10_000), st.floats(0.0, 3.0), st.floats(0.5, 9.0), st.booleans()),
)


@settings(max_examples=12, deadline=None)
@given(CASES)
def test_compiled_flights_are_those_of_the_plain_functions(case):
    bodies, seed, first, gain, limit, own_air = case
    h, v, drag = np.array(bodies).T
    options = {"vehicle": Body(drag), "law": Law(gain, limit), "seed": seed, "first_trial": first, "past": 2}
    options |= {"stored": 2, **({"nodes": 12} if own_air else {"air": 0.01 * np.outer(np.arange(12.0), h / 100.0)})}
    flown = WHOLE.fly(PLANET, SCHEDULE, State(h, v), **options)
    assert flown.history.shape[1] == 2
    for trial in range(len(h)):
        alone = WHOLE.fly_in_python(PLANET, SCHEDULE, State(h, v), trial=first + trial, **options)
        assert_same(one(flown, trial), alone)


@pytest.mark.parametrize("flight", [EULER, SEMI_IMPLICIT])
@settings(max_examples=6, deadline=None)
@given(st.floats(0.5, 60.0), st.integers(0, 2**40), st.integers(0, 10_000), st.integers(1, 3))
def test_euler_flights_that_end_with_a_step_are_those_of_the_plain_functions(flight, h, seed, first, increments):
    options = {"seed": seed, "first_trial": first, "increments": increments, "trials": 3}
    flown = flight.fly(PLANET, SCHEDULE, State(h, 1.0), **options)
    for trial in range(3):
        alone = flight.fly_in_python(PLANET, SCHEDULE, State(h, 1.0), trial=first + trial, **options)
        assert_same(one(flown, trial), alone)


def test_a_trial_flies_alike_on_any_thread_in_any_chunk_and_alone():
    trials = 2 * LANES + 7
    h, v = np.linspace(5.0, 110.0, trials), np.linspace(-15.0, 3.0, trials)

    def fly(first, last):
        options = {"vehicle": Body(0.5), "law": Law(1.0, 6.0), "seed": 3, "nodes": 12, "past": 2}
        return WHOLE.fly(PLANET, SCHEDULE, State(h[first:last], v[first:last]), first_trial=first, **options)

    available = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        whole = fly(0, trials)
        numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))
        assert_same(whole, fly(0, trials))
    finally:
        numba.set_num_threads(available)
    assert len({*whole.length}) > 2  # trials end at their own times
    for first, last in ((0, 1), (LANES - 1, LANES + 2), (trials - 3, trials)):
        part = fly(first, last)
        for trial in range(first, last):
            assert_same(one(part, trial - first), one(whole, trial))


def test_a_drag_free_fall_ends_where_its_parabola_does():
    height = np.array([3.0, 20.0, 47.0])
    flown = FALL.fly(PLANET, SCHEDULE, State(height, 0.0))
    np.testing.assert_allclose(flown.final_state[1], -np.sqrt(2.0 * 3.7 * height), rtol=1e-11)
    np.testing.assert_allclose(flown.final_state[0], 0.0, atol=1e-10)


class Orbit(NamedTuple):
    x: float
    y: float
    u: float
    v: float


def attracted(state) -> Orbit:
    squared = state.x * state.x + state.y * state.y
    pull = 1.0 / (squared * np.sqrt(squared))
    return Orbit(state.u, state.v, -pull * state.x, -pull * state.y)


def crosses(state) -> float:
    return 0.8 - state.y


def test_a_circular_orbit_converges_to_order_four_with_and_without_a_root_and_keeps_its_energy():
    whole, cut = [], []
    flight = Flight(attracted, ended=crosses)
    for steps in (16, 32, 64, 128):
        start = Orbit(np.array([1.0, 0.0]), np.array([0.0, -1.0]), np.array([0.0, 1.0]), np.array([1.0, 0.0]))
        # trial 0 crosses y = 0.8 at x = 0.6; trial 1 does not within 2 s
        x, y, u, v = flight.fly((), periods(2.0, 2.0, steps), start).final_state
        cut.append(abs(x[0] - 0.6))
        whole.append(np.hypot(x[1] - np.sin(2.0), y[1] + np.cos(2.0)))
    for errors in (whole, cut):
        assert -np.polyfit(range(4), np.log2(errors), 1)[0] == pytest.approx(4.0, abs=0.4)
    np.testing.assert_allclose(0.5 * (u**2 + v**2) - 1.0 / np.hypot(x, y), -0.5, atol=1e-8)


# ---- refusals --------------------------------------------------------------------------------------------------------


def misspelt(stat) -> State:
    return State(stat, stat)


def unannotated(state):
    return state


def too_short(state) -> State:
    return (state.v,)


def uncompilable(state) -> State:
    return State(state.v, float(f"{state.h:.3f}"))


def longest(lengths):
    return np.linalg.norm(lengths["of"])


def helped(state) -> State:
    return State(state.v, longest({"of": state.h}))


def looping(sensed, memory) -> tuple[Brake, Memory]:
    thrust = sensed.speed
    while thrust > 1.0:
        thrust *= 0.5
    return Brake(thrust), memory


def steady(sensed, memory) -> tuple[Brake, Memory]:
    return Brake(0.5 * sensed.speed), Memory(memory.calls + 1.0, memory.largest)


class Cart(NamedTuple):
    x: float
    v: float


class Navigation(NamedTuple):
    initial: float
    walk: float
    noise: float
    end: float


class Measured(NamedTuple):
    x: float
    v: float
    offset: float


class Draws(NamedTuple):
    x: float
    v: float


class Both(NamedTuple):
    x: float
    known: float


def rolls(state, command) -> Cart:
    return Cart(state.v, command.thrust)


def measure(cycle, sensed, nav, draws, p) -> Measured:
    offset = p.initial * draws.x if cycle == 0 else nav.offset + p.walk * draws.x
    return Measured(sensed.x + offset, sensed.v + p.noise * draws.v, offset)


def truly(state) -> Cart:
    return state


def steer(nav, memory) -> tuple[Brake, Memory]:
    return Brake(-0.25 * nav.x - 0.9 * nav.v), Memory(memory.calls + 1.0, max(memory.largest, nav.x))


def store_both(state, nav) -> Both:
    return Both(state.x, nav.x)


def finish_both(state, nav) -> Both:
    return Both(state.x, nav.x)


def arrived(state, p) -> bool:
    return state.x <= p.end


CART = Flight(
    rolls,
    sense=truly,
    navigate=measure,
    draws=Draws,
    guide=steer,
    ended=arrived,
    store=store_both,
    finish=finish_both,
)
MINUTE = periods(60.0, 1.0, 2)


def test_errors_of_navigation_grow_as_their_theory_says():
    """An initial error of 5 and a random walk of 0.5 a period: at 0, 30, 59 s the deviation is that of their sum."""
    trials = 20_000
    flown = CART.fly(Navigation(5.0, 0.5, 0.1, -1e9), MINUTE, Cart(100.0, 0.0), trials=trials, seed=3)
    error, periods_passed = flown.history[:-1, 1] - flown.history[:-1, 0], np.arange(60)
    theory = np.sqrt(5.0**2 + 0.5**2 * periods_passed)
    np.testing.assert_allclose(error.std(axis=1), theory, rtol=4.0 / np.sqrt(2.0 * trials))
    np.testing.assert_array_less(np.abs(error.mean(axis=1)), 4.0 * theory / np.sqrt(trials))
    steps = np.diff(error, axis=0)  # those of a random walk are independent of each other
    assert abs(np.corrcoef(steps[10], steps[11])[0, 1]) < 4.0 / np.sqrt(trials)


def test_navigation_has_the_bits_of_python_alone_among_others_and_after_an_end():
    p, start, trials = Navigation(5.0, 0.5, 0.1, 20.0), Cart(100.0, 0.0), LANES + 5
    flown = CART.fly(p, MINUTE, start, trials=trials, seed=3)
    assert len({*flown.length}) > 2  # what is known at a trial's end stays as others fly on
    for trial in (0, LANES - 1, trials - 1):
        assert_same(one(flown, trial), CART.fly_in_python(p, MINUTE, start, trial=trial, seed=3))
        assert_same(one(flown, trial), CART.fly(p, MINUTE, start, trials=1, first_trial=trial, seed=3))
    other = CART.fly(p, MINUTE, start, trials=trials, seed=3, navigation_stream=9)
    assert (flown.history[0, 1] != other.history[0, 1]).all()


def onward(command) -> tuple[Brake, Nothing]:
    return Brake(0.5 * command.thrust + 1.0), ()


def test_guidance_is_told_what_it_commanded_at_last_and_zeros_before():
    """Thrusts of 1, 1.5 and 1.75 m/s^2, a second each."""
    flight, schedule = Flight(rolls, guide=onward), periods(3.0, 1.0, 2)
    flown = flight.fly((), schedule, Cart(0.0, 0.0), trials=LANES + 5)
    assert (flown.final_state[1] == 4.25).all()
    assert_same(one(flown, LANES), flight.fly_in_python((), schedule, Cart(0.0, 0.0), trial=LANES))


def test_a_flight_with_one_normal_has_the_bits_of_python():
    """The normal of each trial is of the noise, of the air or of navigation, or none is moved."""
    only = np.array([[1, 1, 2, 1, 4], [0, 5, 7, 3, 0], [0.0, 0.7, -1.3, 5.0, 2.0]])
    h, v = np.linspace(30.0, 110.0, 5), -5.0
    options = {"vehicle": Body(0.5), "law": Law(1.0, 6.0), "nodes": 12, "past": 2, "seed": 3, "first_trial": 8}
    flown = WHOLE.fly(PLANET, SCHEDULE, State(h, v), only=only, **options)
    for trial in range(5):
        alone = WHOLE.fly_in_python(PLANET, SCHEDULE, State(h, v), trial=8 + trial, only=only, **options)
        assert_same(one(flown, trial), alone)
    calm = WHOLE.fly(PLANET, SCHEDULE, State(h, v), only=np.zeros((3, 5)), **options)
    moved = (flown.final_state != calm.final_state).any(axis=0)
    assert moved.tolist() == [False, True, True, True, True]
    own = only[:, 1:2]
    assert_same(one(flown, 1), WHOLE.fly(PLANET, SCHEDULE, State(h[1], v), trials=1, only=own, **options))


def test_squares_of_what_single_normals_of_navigation_move_sum_up_to_the_variance():
    draws = 2 * 60
    only = np.array([np.full(draws, 4.0), np.arange(draws), np.full(draws, 0.5)])
    flown = CART.fly(Navigation(5.0, 0.5, 0.1, -1e9), MINUTE, Cart(100.0, 0.0), only=only)
    slopes = (flown.history[:-1, 1] - flown.history[:-1, 0]) / 0.5
    np.testing.assert_allclose(np.sum(slopes**2, axis=1), 5.0**2 + 0.5**2 * np.arange(60), rtol=1e-9)


def speed(state) -> Felt:
    return Felt(state.v, 0.0)


def steered(state, command) -> State:
    return State(state.v, -command.thrust)


def test_bad_models_are_refused_by_name():
    with pytest.raises(ValueError, match=r"misspelt .*asks for 'stat'.*did you mean 'state'"):
        Flight(misspelt)
    with pytest.raises(ValueError, match="annotate what unannotated"):
        Flight(unannotated)
    with pytest.raises(ValueError, match=r"returns a float.*return a bool"):
        Flight(falls, ended=ended, integrator=euler_maruyama)
    with pytest.raises(ValueError, match="noise is 1; give a NamedTuple class"):
        Flight(falls, noise=1)
    with pytest.raises(ValueError, match="draws is 2; give a NamedTuple class"):
        Flight(falls, draws=2)
    with pytest.raises(ValueError, match="navigate tells guidance what it knows; this flight has no guide"):
        Flight(falls, navigate=measure)


@pytest.mark.parametrize(
    ("function", "error"),
    [(too_short, r"too_short .* returned \(.*\); it must return h, v"), (uncompilable, "numba cannot")],
)
def test_what_cannot_be_compiled_is_told_with_its_reason(function, error):
    with pytest.raises((TypeError, ValueError), match=error) as refusal:
        Flight(function).fly((), SCHEDULE, State(1.0, 1.0))
    line = uncompilable.__code__.co_firstlineno + 1
    if function is uncompilable:
        assert f"{__file__}, line {line}" in str(refusal.value)


def test_what_cannot_be_compiled_in_a_helper_is_told_with_its_line_and_no_line_of_the_engine():
    with pytest.raises(TypeError) as refusal:
        Flight(helped).fly((), SCHEDULE, State(1.0, 1.0))
    line = longest.__code__.co_firstlineno + 1
    assert f"{__file__}, line {line}, in longest: np.linalg.norm() only supported for array" in str(refusal.value)


def test_bad_starts_are_refused_with_field_and_trial():
    with pytest.raises(ValueError, match=r"start\.v of trial 12 is nan"):
        FALL.fly(PLANET, SCHEDULE, State(np.ones(3), np.array([0.0, 0.0, np.nan])), first_trial=10)
    with pytest.raises(ValueError, match=r"start\.h: 3, start\.v: 2"):
        FALL.fly(PLANET, SCHEDULE, State(np.ones(3), np.ones(2)))


@pytest.mark.parametrize(("guide", "slow"), [(looping, [looping]), (steady, [])])
def test_a_guide_with_a_loop_is_told_to_be_slow(guide, slow):
    assert scalar_loops(Flight(steered, sense=speed, guide=guide), ["rates", "sense", "guide"], (), (), State) == slow


# ---- what rests on the inside of numba -------------------------------------------------------------------------------


def test_each_intrinsic_moves_the_numbers_that_it_should():
    get, put, dress = getter(State), putter(State, falls), dresser(shape_of(PLANET))

    @njit
    def move(table, chosen):
        own = lane_array(2)
        for row in range(2):
            for lane in range(LANES):
                own[row, lane] = -1.0
        put(get(table, 5), own, 6, chosen)
        return own.copy()

    table = np.arange(2.0 * LANES).reshape(2, LANES)
    for chosen in (None, True, False):
        expected = np.full((2, LANES), -1.0)
        expected[:, 6] = -1.0 if chosen is False else [5.0, LANES + 5.0]
        np.testing.assert_array_equal(move(table, chosen), expected)

    @njit
    def sums(table, values):
        p, part = dress(values), column(borrowed(table), 3)
        return part.sum(), len(part), p.gravity, p.table.sum()

    assert sums(table, flat(PLANET)) == (LANES + 6.0, 2, 3.7, PLANET.table.sum())
    values = (
        2.5,
        -3,
        True,
        np.float32(0.1),
        np.uint64(2**63),
        np.arange(6.0).reshape(2, 3),
        np.array(7),
        np.arange(2, dtype=np.int8),
    )
    read = reader(types_of(values))

    @njit
    def read_all(words):
        return read(words)

    for found, value in zip(read_all(words_of(flat(values))), values, strict=True):
        np.testing.assert_array_equal(found, value)


def test_a_kernel_is_named_by_where_each_constant_and_function_stands():
    def before(a):
        return a[1] + a[2]

    def one(a, b):
        return a[1] - b[2]

    def other(a, b):
        return a[2] - b[1]

    assert digest(before, one) != digest(before, other)
    assert digest(before, one, None) != digest(before, None, one)
    assert digest(before, one, before) != digest(before, one, one)


def digest_of(expression, **space):
    exec(f"def read(sensed):\n    return {expression}", space)
    return digest(space["read"])


@pytest.mark.parametrize("beside", [np.arange(3.0), ModuleType("velocity"), {"velocity": 1.0}])
def test_a_name_of_an_attribute_is_no_global(beside):
    assert digest_of("sensed.velocity") == digest_of("sensed.velocity", velocity=beside)


def test_a_digest_follows_all_that_is_read():
    def plain(x, *, factor=1.0):
        return factor * x

    def edited(x, *, factor=2.0):
        return factor * x

    modules = [ModuleType("beside") for _ in range(2)]
    for module, number in zip(modules, (1.0, 2.0), strict=True):
        module.n, module.inner, module.__name__ = number, SimpleNamespace(n=number), "numbalike"
    kinds = [IntEnum("Mode", {"on": number}) for number in (1, 2)]
    for expression, one, other in (
        ("n", 1.0, 2.0),
        ("n[0]", np.array([1.0]), np.array([2.0])),
        ("n.slope", namedtuple("Gains", ["slope"])(1.0), namedtuple("Gains", ["slopes"])(1.0)),
        ("n.n", *modules),
        ("f(n)", *modules),
        ("n.on", *kinds),
        ("n(1.0)", plain, edited),
        ("n(1.0)", njit(fastmath=True)(plain), njit(plain)),
    ):
        assert digest_of(expression, n=one, f=plain) == digest_of(expression, n=one, f=plain)
        assert digest_of(expression, n=one) != digest_of(expression, n=other), expression


def test_the_key_of_a_kernel_is_of_the_flight_alone_whatever_else_a_program_has_imported(monkeypatch):
    def engine():
        return digest(loop.group_flight, loop.fly_groups, addressed.law_of_lanes, addressed.guide_group)

    before = engine()
    monkeypatch.setitem(sys.modules, "imported_besides", ModuleType("imported_besides"))
    monkeypatch.syspath_prepend("elsewhere")
    assert engine() == before


class Reads:
    """An object, of which a compiled flight would keep the first numbers."""


def helper_with(state):
    return LOG[0]


LOG, CLOCK, OBJECT, LARGE = [1.0], time.time, Reads(), np.zeros(200_000)


@pytest.mark.parametrize(
    ("expression", "told"),
    [
        ("np.random.normal()", r"rates .* reads np\.random, whose answers belong to no trial"),
        ("normal()", r"reads normal, whose answers belong to no trial"),
        ("random.random()", r"reads random, whose answers"),
        ("CLOCK()", r"reads CLOCK, whose answers"),
        ("LOG[0]", r"reads LOG, a list whose changes a compiled flight does not see: .* law=parameters"),
        ("helper_with(state)", r"helper_with .* reads LOG, a list"),
        ("OBJECT.number", r"reads OBJECT, a Reads"),
        ("LARGE[0]", r"reads LARGE, a ndarray"),
    ],
)
def test_what_belongs_to_no_trial_or_is_not_followed_is_refused_before_anything_is_compiled(expression, told):
    space = {**globals(), "normal": np.random.normal, "random": random}
    exec(f"def rates(state):\n    return State(state.v, {expression})", space)
    space["rates"].__annotations__["return"] = State
    with pytest.raises(ValueError, match=told):
        Flight(space["rates"]).fly((), SCHEDULE, State(1.0, 1.0))
