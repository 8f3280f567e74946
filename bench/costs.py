"""What a full build and CI cost: `python bench/costs.py [--ci FILE]`, into `data/reference/costs.csv`.

Reads the benchmarks that Snakemake wrote beside the jobs of `snakemake all` (`benchmarks/**/*.tsv`): CPU seconds, the
longest job and the largest memory of each kind of job. With `--ci`, also the lines `part,seconds` that `.ci/run` leaves
there. Rows that are not measured anew stay as they were. Start-up of Snakemake itself is in no row.
"""

import argparse
from pathlib import Path

import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
OUTPUT = ROOT / "data" / "reference" / "costs.csv"
KEY = ["where", "what"]
JUDGED = ("claims", "counterexamples", "points", "universes", "waves", "what_decides")
MEASURED = {
    "jobs": ("s", "size"),
    "cpu_s": ("cpu_time", "sum"),
    "longest_s": ("s", "max"),
    "memory_mb": ("max_rss", "max"),
}


def kind_of(path: Path) -> tuple[str, str]:
    """Return the paper and the kind of job of a benchmark, by its path below `benchmarks`."""
    *folders, name = path.parts
    kind = name.partition(".")[0]  # without the chunks of Monte Carlo cases and universes
    if len(folders) == 1 and kind not in JUDGED:  # two folders: a stage of a reading
        kind = "figures and tables"
    return folders[0] if folders else "all", kind


def measured(folder: Path) -> pd.DataFrame:
    """Return the costs of each kind of job of the build in a folder, and their sum; empty if there is none."""
    parts = []
    for path in sorted(folder.rglob("*.tsv")):
        row = pd.read_csv(path, sep="\t", na_values=["-", "NA"]).fillna({"cpu_time": 0.0, "max_rss": 0.0})
        parts += [
            row.assign(where=where, what=kind) for where, kind in (kind_of(path.relative_to(folder)), ("all", "sum"))
        ]
    return pd.concat(parts).groupby(KEY).agg(**MEASURED).round().astype("int64") if parts else pd.DataFrame()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--ci", type=Path, help="file of lines 'part,seconds'")
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT, help="of the build")
    arguments = parser.parse_args()
    old = pd.read_csv(OUTPUT, dtype=dict.fromkeys(MEASURED, "Int64"), index_col=KEY)
    new = [measured(arguments.folder / "benchmarks")]
    if arguments.ci:
        seconds = pd.read_csv(arguments.ci, names=["what", "longest_s"]).assign(where="ci")
        new.append(seconds.astype({"longest_s": "int64"}).set_index(KEY))
    rows = pd.concat([old.query("where == 'ci'") if len(new[0]) else old, *new])
    rows = rows[~rows.index.duplicated(keep="last")].sort_index()
    rows.astype("Int64").to_csv(OUTPUT, columns=list(MEASURED), lineterminator="\n")
