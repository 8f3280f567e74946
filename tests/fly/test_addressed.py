"""Laws that are compiled alone: they share the kernel of their vehicle, and fly as they do in Python."""

import enum
import math
import subprocess
import sys
import types
import warnings
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import njit
from numba.core import event

from marsedl.fly import Below, GainTable, Normal, fly
from marsedl.fly.campaign import Campaign, _told_of_compiling
from marsedl.montecarlo.flights import Flight, Nothing, model
from marsedl.montecarlo.flights.addressed import is_addressed

sys.path.insert(0, __file__.rpartition("/")[0])
from flown_models import PROBE, Push, guide, rates


class Inner(NamedTuple):
    table: np.ndarray
    scale: float = 2.0


class Parameters(NamedTuple):
    """Parameters of all types; the strided and the read-only array are copied."""

    nodes: np.ndarray = np.linspace(0.0, 30.0, 7)[::2]
    values: np.ndarray = np.broadcast_to(np.arange(3.0), (2, 3))
    counts: np.ndarray = np.arange(4)
    inner: Inner = Inner(np.linspace(0.5, 1.5, 5))
    whole: int = -3
    flag: bool = True
    single: Any = np.float32(0.25)
    short: Any = np.int32(-2)
    point: Any = np.array(0.125)


class Thrust(NamedTuple):
    up: float


class Five(NamedTuple):
    calls: float = 0.0
    fastest: float = -1.0
    first: float = 5.0
    time: float = 0.0
    product: float = 1.0


def reads(speed, time, law: Parameters = Parameters()) -> Thrust:  # noqa: B008
    row = law.values[1, 2] + law.inner.scale * law.inner.table[3] + law.nodes[2] * (1.0 if law.flag else 0.0)
    number = row + law.whole * law.counts[2] + np.float64(law.single) + law.short + law.point[()]
    return Thrust(1e-2 * number - 1e-3 * speed * time)


def remembers(half_index, cycle, state, sensed, vehicle, memory, p) -> tuple[Push, Five]:
    fastest = sensed.speed if sensed.speed < memory.fastest else memory.fastest
    first = state.altitude if cycle == 0 else memory.first
    product = memory.product * (1.0 + 1e-3 * vehicle.drag * p.gravity)
    return Push(1e-3 * fastest), Five(memory.calls + 1.0, fastest, first, 0.5 * half_index, product)


def remains(memory) -> tuple[Push, Five]:
    return Push(0.1 * memory.first), memory


def rising(time):
    return 1e-2 * time


TABLE = GainTable(
    {"speed": [-60.0, 0.0], "up": [1.0, 0.0], "altitude": [0.0, 500.0], "up_per_altitude": [1e-4, 2e-4]}, "speed"
)
LAWS = [guide, reads, partial(reads, law=Parameters(flag=False)), remembers, remains, rising, TABLE, 0.5]
DROP = {"start": {"altitude": Normal(500.0, 20.0)}, "trigger": Below("altitude", 0.0), "end_time": 100.0, "trials": 70}


def compiled(prefix):
    return {name for name in model._COMPILED if name.startswith(prefix)}


def test_laws_of_a_vehicle_compile_one_kernel_and_fly_as_in_python():
    flights = [fly(PROBE, law=LAWS[0], **DROP)]
    kernels, laws = compiled("fly_"), compiled("law_")
    flights += [fly(PROBE, law=law, truth=law is remembers, **DROP) for law in LAWS[1:]]
    assert compiled("fly_") == kernels
    assert len(compiled("law_") - laws) == 6  # that with other parameters is the same law
    for flown in flights:
        replayed = flown.replay(69, in_python=True)
        assert replayed.final == {name: values[69] for name, values in flown.final.items()}
        assert replayed.history.equals(flown.replay(69).history)


def refuses(time):
    if time > 5.0:
        raise ValueError("faster than its table")
    return 0.5


def chooses(law) -> tuple[Push, Nothing]:
    return Push(0.0), ()


def is_late(time, law) -> bool:
    return time > law.push


def is_over(time) -> bool:
    return time > 1.0


def bends(speed):
    return 0.5 if speed < 0.0 else np.fft.fftfreq(3, speed)[0]


@pytest.mark.filterwarnings("ignore:.*did not become vector code")
def test_what_a_law_raises_reaches_who_flies_it_also_from_the_cache():
    for _ in range(2):
        with pytest.raises(ValueError, match="faster than its table"):
            fly(PROBE, law=refuses, **DROP)
        model._COMPILED.clear()


def test_what_does_not_fit_into_words_stays_within_the_kernel():
    flight = Flight(rates, guide=chooses)
    for law in ((), (1, 2.0, np.arange(3), (True,))):
        assert is_addressed(flight, (None, "asks not for it"), law)
    for law in ((None,), ("steep",), (1j,), (np.zeros(2, complex),)):
        assert not is_addressed(flight, (), law)
    assert not is_addressed(Flight(rates, guide=chooses, interrupts=is_late), (), ())
    assert is_addressed(Flight(rates, guide=chooses, interrupts=is_over), (), ())
    assert not is_addressed(Flight(rates), (), ())


def test_a_law_that_cannot_be_compiled_is_told_with_its_line():
    line = bends.__code__.co_firstlineno + 1
    with pytest.raises(TypeError, match=rf"numba cannot compile .*test_addressed.py, line {line}, in bends: "):
        fly(PROBE, law=bends, **DROP)


# ---- the compiled law is the Python law ------------------------------------------------------------------------------


class Divisor(NamedTuple):
    zero: float = 0  # an integer that is meant as a float
    whole: int = 2


class Count(NamedTuple):
    number: int = 1


def divides_by_parameters(altitude, time, law: Divisor = Divisor()):  # noqa: B008
    share = 1.0 / law.zero if altitude > 250.0 else 0.0
    return min(share, 0.1) + min(1e-3 / abs(law.whole - int(time)), 0.1)


def divides_by_its_own_number(altitude):
    return min(1e-3 / max(altitude - 250.0, 0.0), 0.4)


def guards_a_root(altitude):
    root = scaled(math.sqrt(altitude - 250.0) + math.log(altitude - 250.0))
    return root if altitude > 250.0 else 0.0


def scaled(number):
    return 1e-3 * number


def overflows(speed):
    return 0.3 * (1.0 / math.exp(-40.0 * speed)) + min(math.exp(1000.0) ** 2, 0.1)


def takes_the_root(altitude):
    return 1e-3 * math.sqrt(altitude - 250.0)


def remembers_integers(memory) -> tuple[Push, Count]:
    return Push(0.3 * memory.number**-1), Count(memory.number + 1)


ARITHMETIC = [divides_by_parameters, divides_by_its_own_number, guards_a_root, overflows, remembers_integers]


@pytest.mark.filterwarnings("ignore:.*did not become vector code")
@pytest.mark.parametrize("law", ARITHMETIC)
def test_arithmetic_that_python_refuses_is_the_same_in_python_as_compiled(law):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "(divide by zero|overflow|invalid value) encountered", RuntimeWarning)
        warnings.filterwarnings("ignore", ".* as compiled, it goes on with nan or inf", UserWarning)
        flown, python = (fly(PROBE, law=law, **DROP | {"trials": 2}, compiled=how) for how in (True, False))
    np.testing.assert_array_equal(flown.numbers, python.numbers)
    assert flown.outcomes() == {"ended: altitude below 0": 2}


def test_flights_that_become_not_finite_are_counted_in_python_as_compiled_and_python_says_where():
    told = r"2 of 2 flights: not finite; replay\(0\) shows one and replay\(0, in_python=True\) warns at the line"
    with pytest.warns(UserWarning, match=told):
        flown = fly(PROBE, law=takes_the_root, **DROP | {"trials": 2})
    with pytest.warns(UserWarning, match=told):
        assert fly(PROBE, law=takes_the_root, **DROP | {"trials": 2}, compiled=False).outcomes() == flown.outcomes()
    line = takes_the_root.__code__.co_firstlineno + 1
    with pytest.warns(
        UserWarning, match=rf"takes_the_root \(.*, line {line}\): math domain error, at \d+ s of trial 1; as compiled"
    ):
        flown.replay(1, in_python=True)
    assert flown.outcomes() == {"not finite": 2}


def starts_at_zero(time):
    return 0.0 if time < 5.0 else 70.0


def rolls(time):
    return 1.5 * time


def test_degrees_are_refused_when_the_law_first_commands_them_and_a_rolling_vehicle_is_not():
    units = {"quantities": PROBE.quantities | {"up": ("rad", "angle")}}
    told = r"the law commands 70 after 5 s of trial 0: up is 70 rad, more than a turn; give it in radians"
    with pytest.raises(ValueError, match=told):
        fly(replace(PROBE, **units), law=starts_at_zero, **DROP)
    assert fly(replace(PROBE, **units), law=rolls, **DROP | {"trigger": None, "end_time": 9.0}).trials == 70


FACTOR, TABLE_OF_NUMBERS, NESTED = 1.0, np.array([1.0, 2.0]), ((1.0, 2.0), 3.0)
MODULE = types.ModuleType("numpyish")
MODULE.inner = types.ModuleType("numpyish.inner")
MODULE.inner.number = 1.0


class Mode(enum.IntEnum):
    LOW = 1


@njit
def doubled(x):
    return 2.0 * x


def tripled(x, by=3.0):
    return by * x


CALLED = (doubled,)


def holder():
    inside = 1.0

    def enclosed():
        return inside

    def change(value):
        nonlocal inside
        inside = value

    return enclosed, change


enclosed, change = holder()


def reads_all(speed):
    module = MODULE
    held = FACTOR + TABLE_OF_NUMBERS[1] + NESTED[0][1] + module.inner.number + Mode.LOW.value + enclosed()
    return 1e-3 * (held + CALLED[0](1.0) + tripled(1.0))


@pytest.mark.filterwarnings("ignore:First-class function type")
def test_a_law_flies_what_its_holders_hold_now(monkeypatch):
    """Globals, arrays, tuples, attributes of modules, enumerations, closures, functions in tuples, and defaults."""
    here = sys.modules[__name__]

    def flown():
        flights = fly(PROBE, law=reads_all, **DROP | {"trials": 1})
        assert flights.replay(0, in_python=True).final == {name: values[0] for name, values in flights.final.items()}
        return flights.final["end_time"][0]

    def key():
        return Campaign(PROBE, DROP["start"], reads_all, None, 9.0, 1.0, 4, None, 0).reached

    @njit
    def halved(x):
        return 0.5 * x

    changes = [
        lambda: monkeypatch.setattr(here, "FACTOR", 40.0),
        lambda: TABLE_OF_NUMBERS.__setitem__(1, 40.0),
        lambda: monkeypatch.setattr(here, "NESTED", ((1.0, 40.0), 3.0)),
        lambda: monkeypatch.setattr(MODULE.inner, "number", 40.0),
        lambda: monkeypatch.setattr(here, "Mode", enum.IntEnum("Mode", {"LOW": 40})),
        lambda: change(40.0),
        lambda: monkeypatch.setattr(here, "CALLED", (halved,)),
        lambda: monkeypatch.setattr(tripled, "__defaults__", (40.0,)),
    ]
    ends, keys = [flown()], [key()]
    for one in changes:
        one()
        keys.append(key())
    ends.append(flown())
    assert len({*keys}) == len(changes) + 1
    assert ends[1] > ends[0]


def test_flights_in_python_are_the_compiled_ones_and_compile_nothing():
    def flown(trials, **how):
        return fly(PROBE, law=remembers, truth=True, history=5.0, seed=3, **DROP | {"trials": trials}, **how)

    compiled_flights = flown(5)
    model._COMPILED.clear()
    flights = flown(2, compiled=False).extended(5)
    assert flights.replay(1).final == compiled_flights.replay(1, in_python=True).final
    assert not model._COMPILED
    for name in ("numbers", "outcome", "histories"):
        np.testing.assert_array_equal(getattr(flights, name), getattr(compiled_flights, name))
    with pytest.raises(ValueError, match=r"flights in Python \(compiled=False\) take no processes"):
        flown(2, compiled=False, processes=2)


def test_flights_in_python_need_no_numba():
    program = """
import sys
from marsedl.fly import Lander, Normal, fly
start = {"downrange": Normal(-400.0, 30.0), "altitude": 1000.0, "downrange_velocity": 20.0, "vertical_velocity": -50.0}
options = {"law": (-1e3, 6e3), "end_time": 2.0, "trials": 2, "compiled": False}
def flown():
    return fly(Lander(1e4, 220.0, thrust_noise=50.0), start | {"mass": 900.0}, **options).numbers.tolist()
print("numba" in sys.modules, flown())
print("numba" in sys.modules, flown())
import numba
print("numba" in sys.modules, flown())
"""
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    _, without, afterwards = shown.splitlines()
    assert without == afterwards.replace("True", "False")


def test_who_waits_for_the_flight_of_a_vehicle_is_told(capsys):
    def fly_0123():
        pass

    for name, said in (("fly_0123", 1), ("law_0123", 0)):
        fly_0123.__name__ = name
        with _told_of_compiling(True), event.trigger_event("numba:compile", {"dispatcher": njit(fly_0123)}):
            pass
        assert capsys.readouterr().err.count("compiling the flight of this vehicle") == said
