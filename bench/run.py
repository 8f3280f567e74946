"""Benchmarks of Monte Carlo, design and pipeline of every paper: `python bench/run.py [paper ...]`.

What is claimed are ratios, measured in one run by interleaved repetitions, with medians; one thread unless it says
otherwise. Prints a table and writes it to `data/reference/benchmarks.csv`, where the rows of papers that were not asked
for stay. Other load on the machine lowers the scaling with threads most.
"""

import os
import statistics
import sys
import tempfile
from importlib import import_module
from pathlib import Path

from marsedl.replication.pipeline.numerics import pin_numerics

ROOT = Path(__file__).resolve().parents[1]
pin_numerics(ROOT)
os.environ["NUMBA_NUM_THREADS"] = str(max(2, os.cpu_count()))  # for the scaling; everything else asks for one thread
del os.environ["NPY_DISABLE_CPU_FEATURES"]  # array code may be as fast as it can

import pandas as pd  # noqa: E402
from measuring import Rows, children_cpu  # noqa: E402

from marsedl.papers import SLUGS  # noqa: E402
from marsedl.replication.checks.twice import copy_tree  # noqa: E402
from marsedl.replication.errors import nearest  # noqa: E402
from marsedl.replication.terminal import columns  # noqa: E402

OUTPUT = ROOT / "data" / "reference" / "benchmarks.csv"
# What is compared with a target; the benchmarks do not measure why it is missed.
FROM_NOTHING = "CPU time, user and system, of all jobs of a full build, one at a time; our own target."
ONE_FIGURE = "Median CPU time of three runs that draw one figure, less that of one with nothing to do; our own target."


def say(text):
    """Tell what is measured now."""
    print(f"{text} ...", file=sys.stderr, flush=True)


def measure_pipelines(rows, slugs, folder):
    """CPU time of every paper from nothing, each in a tree of its own, then of runs with little or nothing to do."""
    trees = {slug: copy_tree(ROOT, Path(folder) / slug) for slug in slugs}
    for slug, tree in trees.items():
        say(f"{slug}: pipeline from nothing")
        spent, limit = children_cpu(tree, slug), import_module(slug).PIPELINE_LIMIT
        rows.of(slug)(f"snakemake {slug}, full size, from nothing", spent, "CPU s", below=limit, note=FROM_NOTHING)
    say("pipeline with nothing to do, and for one figure")
    if everything := set(slugs) == set(SLUGS):
        trees = dict.fromkeys(slugs, tree)
        children_cpu(tree, "all")
        nothing = statistics.median(children_cpu(tree, "all") for _ in range(3))
        rows.of("all")("snakemake all, nothing to do", nothing, "CPU s", below=4.0)
    for slug, tree in trees.items():
        if not everything:
            nothing = statistics.median(children_cpu(tree, slug) for _ in range(3))
        figure, drawn = f"figures/{slug}/{import_module(slug).FIGURE}.png", []
        for _ in range(3):
            (tree / figure).unlink()
            drawn.append(children_cpu(tree, figure) - nothing)
        title = "one figure drawn again, beyond that"
        rows.of(slug)(title, statistics.median(drawn), "CPU s", below=3.0, note=ONE_FIGURE)


def main(slugs):
    """Measure, store and print."""
    rows = Rows()
    for slug in slugs:
        say(f"{slug}: design and flights")
        import_module(slug).measure(rows.of(slug))
    with tempfile.TemporaryDirectory() as folder:
        measure_pipelines(rows, slugs, folder)
    old, new = pd.read_csv(OUTPUT, dtype=str, keep_default_na=False), pd.DataFrame(rows.rows, columns=Rows.HEADER)
    table = pd.concat([old[~old["paper"].isin(new["paper"])], new])
    table = table.sort_values("paper", key=lambda of: of.map((*SLUGS, "all").index), kind="stable")
    table.to_csv(OUTPUT, index=False, lineterminator="\n")
    print(columns([Rows.HEADER, *rows.rows]))


if __name__ == "__main__":
    if unknown := next((slug for slug in sys.argv[1:] if slug not in SLUGS), None):
        sys.exit(f"bench/run.py: there is no paper '{unknown}'; {nearest(unknown, SLUGS)}")
    main(sys.argv[1:] or SLUGS)
