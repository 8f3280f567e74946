"""Benchmarks of Monte Carlo, design and pipeline of every paper: `python bench/run.py [paper ...]`.

What is claimed are ratios, measured in one run by interleaved repetitions, with medians; one thread unless it says
otherwise. Prints a table; without arguments, measures the pipelines as well and writes the table to
`data/reference/benchmarks.csv`. Other load on the machine lowers the scaling with threads most.
"""

import csv
import os
import statistics
import sys
import tempfile
from importlib import import_module
from pathlib import Path

from marsedl.replication.jobs import pin_numerics

ROOT = Path(__file__).resolve().parents[1]
pin_numerics(ROOT)
os.environ["NUMBA_NUM_THREADS"] = str(max(2, os.cpu_count()))  # for the scaling; everything else asks for one thread
del os.environ["NPY_DISABLE_CPU_FEATURES"]  # array code may be as fast as it can

from measuring import Rows, children_cpu, say  # noqa: E402

from marsedl.papers import SLUGS  # noqa: E402
from marsedl.replication.verification import copy_tree  # noqa: E402

OUTPUT = ROOT / "data" / "reference" / "benchmarks.csv"


def measure_pipelines(rows):
    """CPU time of every paper from nothing, each in a tree of its own, then of runs with little or nothing to do."""
    with tempfile.TemporaryDirectory() as folder:
        for slug in SLUGS:
            say(f"{slug}: pipeline from nothing")
            tree = copy_tree(ROOT, Path(folder) / slug)
            limit = import_module(slug).PIPELINE_LIMIT
            rows.of(slug)(f"snakemake {slug}, full size, from nothing", children_cpu(tree, slug), "CPU s", below=limit)
        say("pipeline with nothing to do, and for one figure")
        children_cpu(tree, "all")
        nothing = statistics.median(children_cpu(tree, "all") for _ in range(3))
        rows.of("all")("snakemake all, nothing to do", nothing, "CPU s", below=4.0)
        for slug in SLUGS:
            figure = tree / "figures" / slug / f"{import_module(slug).FIGURE}.png"
            figure.unlink()
            drawn = children_cpu(tree, str(figure.relative_to(tree)))
            rows.of(slug)("one figure drawn again, beyond that", drawn - nothing, "CPU s", below=3.0)


def main(slugs):
    """Measure, print, and store if all is measured."""
    rows = Rows()
    for slug in slugs or SLUGS:
        import_module(slug).measure(rows.of(slug))
    if not slugs:
        measure_pipelines(rows)
        with OUTPUT.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([Rows.HEADER, *rows.rows])
    widths = [max(map(len, column)) for column in zip(Rows.HEADER, *rows.rows, strict=True)]
    for row in [Rows.HEADER, *rows.rows]:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


if __name__ == "__main__":
    if sys.argv[1:2] == ["--ensemble"]:
        import_module(sys.argv[2]).ensemble_in_this_process(int(sys.argv[3]))
    else:
        main(sys.argv[1:])
