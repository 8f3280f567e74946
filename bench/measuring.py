"""What the benchmarks of all papers share: inputs, taking turns, rows with targets, the same flights in C."""

import ctypes
import os
import resource
import shlex
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

import numba
import numpy as np

from marsedl.papers import catalogue, input_model
from marsedl.replication.checks.twice import snakemake
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.pipeline.catalogue import FLIGHTS
from marsedl.replication.pipeline.runner import Memory, Run

ROOT = Path(__file__).resolve().parents[1]
CORES = len(os.sched_getaffinity(0))
REPETITIONS = 7
FLIGHT_REPETITIONS = 25  # a kernel and its twin in C differ by little
HEADER = ("paper", "quantity", "value", "unit", "target", "met", "note")


def add_row(rows, paper, quantity, value, unit, at_least=None, below=None, note=""):
    """Add a row with the columns of the header; target, whether it is met, and the note may be empty.

    The note says what is compared with the target; it stands where the target is not met.
    """
    target = f">= {at_least:g}" if at_least is not None else f"< {below:g}" if below is not None else ""
    met = value >= at_least if at_least is not None else value < below if below is not None else None
    answer, three_digits = {None: "", True: "yes", False: "no"}[met], f"{float(f'{value:.3g}'):.9g}"
    rows.append((paper, quantity, three_digits, unit, target, answer, "" if met is not False else note))


@cache
def inputs_of(slug):
    """Inputs of a paper's corrected reading."""
    return load_study(slug, input_model(slug), ROOT).readings["corrected"].inputs


def run(slug):
    """The paper in this process, with the inputs of the corrected reading; it remembers nothing of other runs."""
    return Run.of(catalogue(slug), inputs_of(slug), Memory())


def designed(slug):
    """A run that remembers all that the gains need, and the gains."""
    paper = run(slug)
    paper.record("gains")
    return paper


def seconds(function, clock=time.perf_counter):
    """Seconds that a function takes."""
    start = clock()
    function()
    return clock() - start


def ensembles_seconds(design, cases, trials):
    """CPU time (s) to fly and gather this number of trials of each case on what a run remembers of the design."""

    def fly():
        for case in cases:
            flown = Run(design.paper, design.values, design.memory, {case: trials}).record(f"{FLIGHTS}.{case}")
            assert np.all(flown.count + flown.excluded == trials)

    return seconds(fly, time.process_time)


def interleaved(functions, repetitions=REPETITIONS):
    """Median wall times (s) of functions that take turns; each runs once beforehand."""
    rounds = [[seconds(function) for function in functions] for _ in range(repetitions + 1)]
    return [statistics.median(taken) for taken in zip(*rounds[1:], strict=True)]


def cpu_seconds(function, repetitions=3):
    """Median CPU time (s) of a function."""
    return statistics.median(seconds(function, time.process_time) for _ in range(repetitions))


def compare_flights(row, label, trials, flights, at_least=None):
    """Rows for the same flights by several functions, by name, which take turns; returns their seconds by name.

    at_least: the target of the kernel's speed over that of "strict C", if these are among them.
    """
    taken = dict(zip(flights, interleaved(list(flights.values()), FLIGHT_REPETITIONS), strict=True))
    for name, each in taken.items():
        row(f"{name}, {label}", 1e6 * each / trials, "us per trial")
    if "strict C" in taken:
        ratio = taken["strict C"] / taken["kernel"]
        row(f"speed of the kernel over strict C, {label}", ratio, "ratio", at_least=at_least)
    return taken


def same_bits(mine, theirs):
    """Raise AssertionError unless `Trajectories` have the same bits in all outputs up to the ends of the trials."""
    np.testing.assert_array_equal(mine.length, theirs.length)
    flying = np.arange(len(theirs.history))[:, np.newaxis, np.newaxis] < theirs.length
    for name in ("history", "observed", "observed_maximum", "final_state"):
        pair = [getattr(flown, name) for flown in (mine, theirs)]
        pair = [np.where(flying, table, 0.0) if table.ndim == 3 else table for table in pair]
        np.testing.assert_array_equal(*pair, err_msg=name)


def scaling(row, fly):
    """Row for the speed of two threads over one; `fly` flies enough trials for both."""

    def with_threads(number):
        numba.set_num_threads(number)
        fly()

    one, two = interleaved([lambda: with_threads(1), lambda: with_threads(2)])
    numba.set_num_threads(1)
    row(f"speed of 2 threads over 1 ({CORES} cores)", one / two, "ratio", at_least=1.8)


def children_cpu(*targets):
    """CPU seconds, user and system, of a Snakemake run in this project and of all its jobs, one at a time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = snakemake(ROOT, *targets, "--cores", "1", NUMBA_NUM_THREADS="1")
    assert done.returncode == 0, done.stdout[-3000:]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


# --------------------------------------------------------------------------------------------------------- flights in C

# Strict IEEE arithmetic without contraction and reordering, in the processor's widest vectors: the kernels' bits.
FLAGS = "-std=c11 -O3 -march=native -ffp-contract=off -fno-math-errno -fno-trapping-math -shared -fPIC"
WIDE = "-mprefer-vector-width=512"  # on processors that have such vectors; without it compilers take 256 bits


@cache
def library(name):
    """The shared library of `name`.c in this folder; None, after a loud word, where no compiler is."""
    compiler = os.environ.get("CC") or next(filter(shutil.which, ("cc", "gcc", "clang")), None)
    if not compiler:
        print(f"NO C COMPILER: flights in C are SKIPPED ({name}.c); install one, or name it by CC", file=sys.stderr)
        return None
    source, target = Path(__file__).with_name(f"{name}.c"), f"{tempfile.mkdtemp()}/{name}.so"
    flags = [*FLAGS.split(), *[WIDE] * (os.uname().machine == "x86_64")]
    subprocess.run([*shlex.split(compiler), *flags, "-o", target, source, "-lm"], check=True)
    return ctypes.CDLL(target)


def call(function, values, arrays):
    """Call a C function with a structure of these values in their order, and with arrays; all are C-contiguous.

    All members of the structure have 64 bits: pointers to arrays, doubles for floats, and integers for all others.
    """
    assert all(array.flags.c_contiguous for array in (*values, *arrays) if getattr(array, "shape", ()))
    structure = np.array([_bits(value) for value in values], np.int64)
    function(*(array.ctypes.data_as(ctypes.c_void_p) for array in (structure, *arrays)))


def _bits(value):
    """The 64 bits of a member, as an integer."""
    if getattr(value, "shape", ()):
        return value.ctypes.data
    return np.float64(value).view(np.int64) if isinstance(value, float) else int(value)
