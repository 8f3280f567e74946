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
