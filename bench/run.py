"""Benchmarks of Monte Carlo, design and pipeline of every paper: `python bench/run.py [paper ...]`.

What is claimed are ratios, measured in one run by interleaved repetitions, with medians; one thread unless it says
otherwise. Prints a table and writes it to `data/reference/benchmarks.csv`, where the rows of papers that were not asked
for stay. Other load on the machine lowers the scaling with threads most.
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
from marsedl.replication.errors import nearest  # noqa: E402
from marsedl.replication.verification import copy_tree  # noqa: E402

OUTPUT = ROOT / "data" / "reference" / "benchmarks.csv"
# What is compared with a target; the benchmarks do not measure why it is missed.
FROM_NOTHING = "CPU time, user and system, of all jobs of a full build, one at a time; our own target."
ONE_FIGURE = "Median CPU time of three runs that draw one figure, less that of one with nothing to do; our own target."


def measure_pipelines(rows, slugs):
    """CPU time of every paper from nothing, each in a tree of its own, then of runs with little or nothing to do."""
    with tempfile.TemporaryDirectory() as folder:
        for slug in slugs:
            say(f"{slug}: pipeline from nothing")
            tree = copy_tree(ROOT, Path(folder) / slug)
            limit = import_module(slug).PIPELINE_LIMIT
            row, spent = rows.of(slug), children_cpu(tree, slug)
            row(f"snakemake {slug}, full size, from nothing", spent, "CPU s", below=limit, note=FROM_NOTHING)
        say("pipeline with nothing to do, and for one figure")
        everything = set(slugs) == set(SLUGS)
        if everything:
            children_cpu(tree, "all")
            nothing = statistics.median(children_cpu(tree, "all") for _ in range(3))
            rows.of("all")("snakemake all, nothing to do", nothing, "CPU s", below=4.0)
        for slug in slugs:
            if not everything:
                tree = Path(folder) / slug
                nothing = statistics.median(children_cpu(tree, slug) for _ in range(3))
            figure = tree / "figures" / slug / f"{import_module(slug).FIGURE}.png"

            def draw(tree=tree, figure=figure):
                figure.unlink()
                return children_cpu(tree, str(figure.relative_to(tree)))

            drawn = statistics.median(draw() for _ in range(3))
            row = rows.of(slug)
            row("one figure drawn again, beyond that", drawn - nothing, "CPU s", below=3.0, note=ONE_FIGURE)


def stored(measured):
    """The rows to store: those measured now, and the old ones of other papers, paper by paper."""
    now = {paper for paper, *_ in measured}
    with OUTPUT.open(encoding="utf-8", newline="") as file:
        kept = [tuple(row) for row in list(csv.reader(file))[1:] if row[0] not in now]
    order = {paper: place for place, paper in enumerate((*SLUGS, "all"))}
    return sorted([*kept, *measured], key=lambda row: order.get(row[0], len(order)))


def main(slugs):
    """Measure, store and print."""
    rows = Rows()
    for slug in slugs:
        import_module(slug).measure(rows.of(slug))
    measure_pipelines(rows, slugs)
    table = [Rows.HEADER, *stored(rows.rows)]
    with OUTPUT.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(table)
    widths = [max(map(len, column)) for column in zip(Rows.HEADER, *rows.rows, strict=True)]
    for row in [Rows.HEADER, *rows.rows]:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


if __name__ == "__main__":
    if sys.argv[1:2] == ["--ensemble"]:
        import_module(sys.argv[2]).ensemble_in_this_process(int(sys.argv[3]))
    elif sys.argv[1:2] == ["--program"]:
        import_module(sys.argv[2]).program_in_this_process(sys.argv[3], int(sys.argv[4]))
    elif unknown := next((slug for slug in sys.argv[1:] if slug not in SLUGS), None):
        sys.exit(f"bench/run.py: there is no paper '{unknown}'; {nearest(unknown, SLUGS)}")
    else:
        main(sys.argv[1:] or SLUGS)
