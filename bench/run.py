"""Benchmarks of every paper, of the front door of flights, of the doors of design, and of builds with little to do.

`python bench/run.py [paper, front_door or doors ...]`.

What is claimed are ratios, measured in one run by interleaved repetitions, with medians; one thread unless it says
otherwise. Prints a table and writes it to `data/reference/benchmarks.csv`, where the rows of papers that were not asked
for stay. Other load on the machine lowers the scaling with threads most.
"""

import os
import statistics
import sys
from functools import partial
from importlib import import_module
from pathlib import Path

from marsedl.replication.pipeline.numerics import pin_numerics

ROOT = Path(__file__).resolve().parents[1]
pin_numerics(ROOT)
os.environ["NUMBA_NUM_THREADS"] = str(max(2, os.cpu_count()))  # for the scaling; all else has one thread
del os.environ["NPY_DISABLE_CPU_FEATURES"]  # array code may be as fast as it can

import numba  # noqa: E402
import pandas as pd  # noqa: E402
from measuring import HEADER, add_row, children_cpu  # noqa: E402

from marsedl.papers import SLUGS  # noqa: E402
from marsedl.replication.errors import nearest  # noqa: E402
from marsedl.replication.terminal import columns  # noqa: E402

OWN = ("front_door", "doors")  # of one's own vehicle
ALL = (*SLUGS, *OWN)
OUTPUT = ROOT / "data" / "reference" / "benchmarks.csv"
ONE_FIGURE = "Median CPU time of three runs that draw one figure, less that of one with nothing to do; our own target."


def measure_builds(rows, slugs):
    """CPU time of builds of this project that have nothing or one figure to do; first brings its papers up to date."""
    if not slugs:
        return
    targets = ["all"] if set(slugs) == set(SLUGS) else slugs
    print(f"build of {', '.join(targets)}, with nothing to do, and for one figure ...", file=sys.stderr, flush=True)
    children_cpu(*targets)
    nothing = statistics.median(children_cpu(*targets) for _ in range(3))
    if targets == ["all"]:
        add_row(rows, "all", "snakemake all, nothing to do", nothing, "CPU s", below=4.0)
    for slug in slugs:
        figure, drawn = f"figures/{slug}/{import_module(slug).FIGURE}.png", []
        for _ in range(3):
            (ROOT / figure).unlink()
            drawn.append(children_cpu(figure) - nothing)
        title = "one figure drawn again, beyond that"
        add_row(rows, slug, title, statistics.median(drawn), "CPU s", below=3.0, note=ONE_FIGURE)


def main(slugs):
    """Measure, store and print."""
    rows = []
    numba.set_num_threads(1)
    for slug in slugs:
        print(f"{slug}: design and flights ...", file=sys.stderr, flush=True)
        import_module(slug).measure(partial(add_row, rows, slug))
    measure_builds(rows, [slug for slug in slugs if slug not in OWN])
    old, new = pd.read_csv(OUTPUT, dtype=str, keep_default_na=False), pd.DataFrame(rows, columns=HEADER)
    table = pd.concat([old[~old["paper"].isin(new["paper"])], new])
    table = table.sort_values("paper", key=lambda of: of.map((*ALL, "all").index), kind="stable")
    table.to_csv(OUTPUT, index=False, lineterminator="\n")
    print(columns([HEADER, *rows]))


if __name__ == "__main__":
    if unknown := next((slug for slug in sys.argv[1:] if slug not in ALL), None):
        sys.exit(f"bench/run.py: there is no paper '{unknown}'; {nearest(unknown, ALL)}")
    main(sys.argv[1:] or ALL)
