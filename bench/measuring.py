"""What the benchmarks of all papers share: inputs, taking turns, rows with targets."""

import json
import os
import re
import resource
import statistics
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

import numpy as np

from marsedl.papers import catalogue, input_model
from marsedl.replication.catalogue import FLIGHTS
from marsedl.replication.graph import Memory, Run
from marsedl.replication.inputs import load_study
from marsedl.replication.jobs import arguments_of
from marsedl.replication.verification import snakemake

ROOT = Path(__file__).resolve().parents[1]
RUN = Path(__file__).with_name("run.py")
CORES = len(os.sched_getaffinity(0))
REPETITIONS = 7
C_REPETITIONS = 25  # they differ by little


class Rows:
    """The table of results: paper, quantity, value, unit, target, whether it is met, note; the last three may be empty.

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
            answer = {None: "", True: "yes", False: "no"}[met]
            self.rows.append((paper, quantity, rounded(value), unit, target, answer, "" if met is not False else note))

        return row


def rounded(value):
    """Three digits."""
    return f"{float(f'{value:.3g}'):.9g}"


def say(text):
    """Tell what is measured now."""
    print(f"{text} ...", file=sys.stderr, flush=True)


@cache
def inputs_of(slug):
    """Inputs of a paper's corrected reading."""
    return load_study(slug, input_model(slug), ROOT / "configs" / f"{slug}.yaml").readings["corrected"].inputs


def run(slug):
    """The paper in this process, with the inputs of the corrected reading; it remembers nothing of other runs."""
    return Run.of(catalogue(slug), inputs_of(slug), Memory())


def designed(slug):
    """A run that remembers all that the gains need, and the gains."""
    paper = run(slug)
    paper.record("gains")
    return paper


def ensemble(design, case, trials):
    """A Monte Carlo case with this number of trials, flown and gathered on what a run remembers of the design."""
    return Run(design.paper, design.values, design.memory, {case: trials}).record(f"{FLIGHTS}.{case}")


def sections(slug, function):
    """The sections of the corrected reading that a function takes, by their names."""
    return arguments_of(function, inputs_of(slug).plain(), lambda name, kind: None)


def interleaved(functions, repetitions=REPETITIONS):
    """Median wall times (s) of functions that take turns; each runs once beforehand."""
    for function in functions:
        function()
    times = [[] for _ in functions]
    for _ in range(repetitions):
        for function, taken in zip(functions, times, strict=True):
            start = time.perf_counter()
            function()
            taken.append(time.perf_counter() - start)
    return [statistics.median(taken) for taken in times]


def same_bits(mine, theirs):
    """Raise AssertionError unless `Trajectories` have the same bits in all outputs up to the ends of the trials."""
    np.testing.assert_array_equal(mine.length, theirs.length)
    flying = np.arange(len(theirs.history))[:, np.newaxis, np.newaxis] < theirs.length
    for name in ("history", "observed", "observed_maximum", "final_state"):
        of_both = [getattr(flown, name) for flown in (mine, theirs)]
        if of_both[0].ndim == 3:
            of_both = [np.where(flying, table, 0.0) for table in of_both]
        np.testing.assert_array_equal(*of_both, err_msg=name)


def against_c(row, kernel, in_c, label, trials, at_least):
    """Rows for the same flights in strict C: its time, and the speed of the kernel over it."""
    taken, theirs = interleaved((kernel, in_c), C_REPETITIONS)
    row(f"strict C, {label}", 1e6 * theirs / trials, "us per trial")
    row(f"speed of the kernel over strict C, {label}", theirs / taken, "ratio", at_least=at_least)


def children_cpu(tree, target):
    """CPU seconds, user and system, of a Snakemake run in a copy of the tree and of all its jobs.

    One job at a time: those that share a core slow each other, and their CPU times grow.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = snakemake(tree, target, "--cores", "1", NUMBA_NUM_THREADS="1")
    assert done.returncode == 0, done.stdout[-3000:]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure_ensembles(row, paper, sizes, largest_memory):
    """Rows for ensembles of these sizes, each flown and gathered by a process of its own, which runs one thread.

    The paper's benchmark has `ensemble_in_this_process(trials)`, which calls `tell_ensemble`. largest_memory: limit of
    the peak memory, MB, whatever the size. Returns the seconds of the last one.
    """
    for trials in sizes:
        say(f"{paper.slug}: ensemble of {trials:,} trials")
        command = [sys.executable, str(RUN), "--ensemble", paper.slug, str(trials)]
        done = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        row(f"ensemble of {trials:,} trials, speed", done["trials"] / done["seconds"], "trials per s and core")
        row(f"ensemble of {trials:,} trials, peak memory of the process", done["memory"], "MB", below=largest_memory)
    return done["seconds"]


def tell_ensemble(fly, trials):
    """Call `fly()`, which flies this number of trials, and print its seconds and the peak memory (MB) as JSON."""
    start = time.perf_counter()
    fly()
    print(json.dumps({"seconds": time.perf_counter() - start, "trials": trials, "memory": peak_memory()}))


def peak_memory(process="self"):
    """Peak resident memory of this or another process, MB; `ru_maxrss` would count that of who started it too."""
    status = Path(f"/proc/{process}/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return int(re.search(r"VmHWM:\s+(\d+) kB", status.read_text()).group(1)) / 1024
