"""Laws that are compiled alone: they share the kernel of their vehicle, and fly as they do in Python."""

import subprocess
import sys
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import njit
from numba.core import event

from marsedl.fly import Below, GainTable, Normal, fly
from marsedl.fly.campaign import _told_of_compiling
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


def is_late(time) -> bool:
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
    assert not is_addressed(Flight(rates), (), ())


def test_a_law_that_cannot_be_compiled_is_told_with_its_line():
    line = bends.__code__.co_firstlineno + 1
    with pytest.raises(TypeError, match=rf"numba cannot compile .*test_addressed.py, line {line}, in bends: "):
        fly(PROBE, law=bends, **DROP)


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
