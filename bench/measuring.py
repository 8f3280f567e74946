"""What the benchmarks of all papers share: inputs, taking turns, rows with targets."""

import os
import resource
import statistics
import time
from functools import cache
from pathlib import Path

import numba
import numpy as np

from marsedl.montecarlo.ensembles import reduce_blocks
from marsedl.montecarlo.outcomes import NON_FINITE
from marsedl.montecarlo.statistics import central_moments, merge_moments
from marsedl.papers import catalogue, input_model
from marsedl.replication.checks.twice import snakemake
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.pipeline.catalogue import FLIGHTS
from marsedl.replication.pipeline.runner import Memory, Run

ROOT = Path(__file__).resolve().parents[1]
CORES = len(os.sched_getaffinity(0))
REPETITIONS = 7
FLIGHT_REPETITIONS = 25  # a kernel and its twin in C differ by little


class Rows:
    """The table of results; target, whether it is met, and the note may be empty.

    The note says what is compared with the target; it stands where the target is not met.
    """

    HEADER = ("paper", "quantity", "value", "unit", "target", "met", "note")

    def __init__(self):
        """Begin an empty table."""
        self.rows = []

    def of(self, paper):
        """The function `row(quantity, value, unit, at_least=None, below=None, note="")` of a paper."""

        def row(quantity, value, unit, at_least=None, below=None, note=""):
            target = f">= {at_least:g}" if at_least is not None else f"< {below:g}" if below is not None else ""
            met = value >= at_least if at_least is not None else value < below if below is not None else None
            answer, three_digits = {None: "", True: "yes", False: "no"}[met], f"{float(f'{value:.3g}'):.9g}"
            self.rows.append((paper, quantity, three_digits, unit, target, answer, "" if met is not False else note))

        return row


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


def above_memory(row, simulate_block, trials):
    """Rows for the moments of the final state, reduced block by block: the speed, and the memory that they add.

    Memory counts from the hundredth block on: the first ones load code and fill the allocator.
    """
    resident = []

    def moments(block):
        resident.append(Path("/proc/self/statm").read_text().split()[1])
        return central_moments(block.final_state[:, block.outcome != NON_FINITE].T)

    taken = seconds(lambda: reduce_blocks(simulate_block, 0, trials, moments, merge_moments), time.process_time)
    pages = np.array(resident, int)
    added = (pages[100:].max() - pages[:100].max()) * os.sysconf("SC_PAGE_SIZE") / 1e6
    row(f"{trials:,} trials of which moments are kept, speed", trials / taken, "trials per s and core")
    row(f"memory that {trials:,} trials add", max(added, 0.0), "MB", below=20.0)


def interleaved(functions, repetitions=REPETITIONS):
    """Median wall times (s) of functions that take turns; each runs once beforehand."""
    rounds = [[seconds(function) for function in functions] for _ in range(repetitions + 1)]
    return [statistics.median(taken) for taken in zip(*rounds[1:], strict=True)]


def cpu_seconds(function, repetitions=3):
    """Median CPU time (s) of a function."""
    return statistics.median(seconds(function, time.process_time) for _ in range(repetitions))


def compare_flights(row, label, trials, flights):
    """Rows for the same flights by several functions, by name, which take turns; returns their seconds by name."""
    taken = dict(zip(flights, interleaved(list(flights.values()), FLIGHT_REPETITIONS), strict=True))
    for name, each in taken.items():
        row(f"{name}, {label}", 1e6 * each / trials, "us per trial")
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


def children_cpu(tree, target):
    """CPU seconds, user and system, of a Snakemake run in a copy of the tree and of all its jobs.

    One job at a time: those that share a core slow each other, and their CPU times grow.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = snakemake(tree, target, "--cores", "1", NUMBA_NUM_THREADS="1")
    assert done.returncode == 0, done.stdout[-3000:]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
