"""Kernels of flights that other processes compiled and cached."""

import os
import subprocess
import sys

MODEL = """
import sys
from typing import NamedTuple

from marsedl.montecarlo.flights import Flight, periods
from marsedl.montecarlo.integrators import euler_maruyama, runge_kutta_4


class State(NamedTuple):
    x: float


def rates(state) -> State:
    return State(-state.x)


for name in sys.argv[1:]:
    flight = Flight(rates, integrator={"rk4": runge_kutta_4, "euler": euler_maruyama}[name])
    print(flight.fly((), periods(1.0, 1.0, 1), State(1.0)).final_state[0, 0])
"""


def test_kernels_that_two_processes_compiled_fly_each_its_own_model_in_a_third(tmp_path):
    script = tmp_path / "decay.py"
    script.write_text(MODEL, encoding="utf-8")

    def flown(*names):
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        done = subprocess.run([sys.executable, script, *names], env=environment, capture_output=True, check=True)
        return [float(line) for line in done.stdout.split()]

    runge_kutta, euler = 1.0 - 1.0 + 1.0 / 2.0 - 1.0 / 6.0 + 1.0 / 24.0, 0.0
    assert abs(flown("rk4")[0] - runge_kutta) < 1e-15
    assert flown("euler") == [euler]
    both = flown("rk4", "euler")
    assert abs(both[0] - runge_kutta) < 1e-15 and both[1] == euler


HELPER = """
from marsedl.compiling import jitable


@jitable
def slope(x):
    return -x
"""

CALLER = """
import multiprocessing
from typing import NamedTuple

from marsedl.montecarlo.flights import Flight, periods
from marsedl.montecarlo.flights.model import _COMPILED

from helper import slope


class State(NamedTuple):
    x: float


def rates(state) -> State:
    return State(slope(state.x))


FLIGHT = Flight(rates)


def fly(start):
    x = FLIGHT.fly((), periods(1.0, 1.0, 1), State(start)).final_state[0, 0]
    (kernel,) = _COMPILED.values()
    return x.hex(), sum(kernel.stats.cache_misses.values()), sum(kernel.stats.cache_hits.values())


if __name__ == "__main__":
    print(*fly(1.0))
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(*pool.apply(fly, (1.0,)))
"""


def test_only_an_edited_helper_compiles_again_and_a_spawned_process_flies_the_same(tmp_path):
    script, helper = tmp_path / "caller.py", tmp_path / "helper.py"
    script.write_text(CALLER, encoding="utf-8")

    def flown(text):
        helper.write_text(text, encoding="utf-8")
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run([sys.executable, script], env=environment, capture_output=True, check=True, text=True)
        here, spawned = (line.split() for line in done.stdout.splitlines())
        assert here[0] == spawned[0]
        return float.fromhex(here[0]), here[1:]

    first, again = flown(HELPER), flown(HELPER)
    commented, edited = flown(HELPER + "# a comment\n"), flown(HELPER.replace("-x", "-2.0 * x"))
    assert first[1] == edited[1] == ["1", "0"]
    assert again[1] == commented[1] == ["0", "1"]
    assert first[0] == again[0] == commented[0]
    assert abs(first[0] - 0.375) < 1e-15 and abs(edited[0] - (1.0 - 2.0 + 2.0 - 8.0 / 6.0 + 16.0 / 24.0)) < 1e-15


GAINS = """
SCALE = 1.0


def doubled(x):
    return 2.0 * SCALE * x


def gain(x):
    return doubled(x)
"""

READS = """
import sys
from typing import NamedTuple

import numba
import numpy as np

import numba_gains
from marsedl.montecarlo.flights import Flight, periods
from marsedl.montecarlo.flights.model import _COMPILED
from marsedl.montecarlo.integrators import euler_maruyama

FACTOR, TABLE, velocity = 1.0, np.array([1.0, 2.0]), np.arange(3.0)


class State(NamedTuple):
    x: float


class Gains(NamedTuple):
    slope: float = 1.0


GAINS = Gains()


@numba.njit
def recursive(n):  # which cannot be inlined
    if n <= 1:
        return FACTOR
    return recursive(n - 1) + recursive(n - 2)


def enclosing():
    inside = 1.0

    def offset(x):
        return inside * x

    def change(value):
        nonlocal inside
        inside = value

    return offset, change


offset, change = enclosing()


def rates(state, half_index) -> State:
    x = state.x
    return State(
        recursive(int(x) + 2) + 10.0 * TABLE[1] + 1e2 * numba_gains.gain(x) + 1e4 * numba_gains.SCALE + 1e6 * offset(x)
        + 1e8 * GAINS.slope
    )


FLIGHT = Flight(rates, integrator=euler_maruyama)


def show():
    flown = FLIGHT.fly((), periods(1.0, 1.0, 1), State(1.0)).final_state[0, 0]
    in_python = FLIGHT.fly_in_python((), periods(1.0, 1.0, 1), State(1.0)).final_state[0, 0]
    compiled = sum(sum(kernel.stats.cache_misses.values()) for kernel in _COMPILED.values())
    print(flown, in_python, compiled)


for number in map(float, sys.argv[1:]):
    FACTOR = TABLE[1] = numba_gains.SCALE = number
    GAINS = Gains(number)
    change(number)
    show()
"""


def test_a_model_flies_the_numbers_that_it_reads_now_in_this_process_and_in_later_ones(tmp_path):
    """Numbers, arrays, closures, NamedTuples, attributes of modules, helpers of helpers: changed between flights."""
    script, gains = tmp_path / "reads.py", tmp_path / "numba_gains.py"  # whose name begins as numba's
    script.write_text(READS, encoding="utf-8")
    gains.write_text(GAINS, encoding="utf-8")

    def flown(*numbers):
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, script, *map(str, numbers)], env=environment, capture_output=True, text=True, check=True
        )
        lines = [[float(number) for number in line.split()] for line in done.stdout.splitlines()]
        assert [line[0] for line in lines] == [line[1] for line in lines]
        return [line[0] for line in lines], int(lines[-1][2])

    def expected(number, doubles=2.0):
        return 1.0 + number * (3.0 + 10.0 + 1e2 * doubles + 1e4 + 1e6 + 1e8)

    assert flown(2.0, 3.0) == ([expected(2.0), expected(3.0)], 2)
    assert flown(3.0) == ([expected(3.0)], 0)  # a kernel of the first process
    assert flown(4.0) == ([expected(4.0)], 1)
    assert flown(2.0, 4.0) == ([expected(2.0), expected(4.0)], 0)  # helpers of both meet under names of their own
    gains.write_text(GAINS.replace("2.0 * SCALE", "5.0 * SCALE"), encoding="utf-8")
    assert flown(3.0) == ([expected(3.0, 5.0)], 1)
