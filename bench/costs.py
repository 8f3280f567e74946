"""What a full build and CI cost: `python bench/costs.py [--ci FILE]`, into `data/reference/costs.csv`.

Reads the benchmarks that Snakemake wrote beside the jobs of `snakemake all` (`benchmarks/**/*.tsv`): CPU seconds, the
longest job and the largest memory of each kind of job. With `--ci`, also the lines `part,seconds` that `.ci/run` leaves
there. Rows that are not measured anew stay as they were. Start-up of Snakemake itself is in no row.
"""

import argparse
import csv
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUTPUT = ROOT / "data" / "reference" / "costs.csv"
COLUMNS = ("where", "what", "jobs", "cpu_s", "longest_s", "memory_mb")


def kind_of(path: Path) -> tuple[str, str]:
    """Return the paper and the kind of job of a benchmark, by its path below `benchmarks`."""
    *folders, name = path.with_suffix("").parts
    if not folders:
        return "all", name
    if len(folders) == 2:  # of a reading: a stage, or one of its Monte Carlo cases
        return folders[0], name.partition(".")[0]
    return folders[0], name if name in ("claims", "counterexamples") else "figures and tables"


def number(text: str) -> float:
    """Return a value of a benchmark; Snakemake has none of a job that ended before it looked."""
    return float(text) if text not in ("-", "NA") else 0.0


def measured(folder: Path) -> dict[tuple[str, str], dict]:
    """Return the costs of each kind of job of the build in a folder, and their sum."""
    costs: dict = defaultdict(lambda: {"jobs": 0, "cpu_s": 0.0, "longest_s": 0.0, "memory_mb": 0.0})
    for path in sorted((folder / "benchmarks").rglob("*.tsv")):
        with path.open(encoding="utf-8", newline="") as file:
            [row] = csv.DictReader(file, delimiter="\t")
        for kind in (kind_of(path.relative_to(folder / "benchmarks")), ("all", "sum")):
            cost = costs[kind]
            cost["jobs"] += 1
            cost["cpu_s"] += number(row["cpu_time"])
            cost["longest_s"] = max(cost["longest_s"], number(row["s"]))
            cost["memory_mb"] = max(cost["memory_mb"], number(row["max_rss"]))
    return dict(costs)


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--ci", type=Path, help="file of lines 'part,seconds'")
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT, help="of the build")
    arguments = parser.parse_args()
    rows = {kind: {**cost, "where": kind[0], "what": kind[1]} for kind, cost in measured(arguments.folder).items()}
    if OUTPUT.exists():
        with OUTPUT.open(encoding="utf-8", newline="") as file:
            kept = [row for row in csv.DictReader(file) if not rows or row["where"] == "ci"]
        rows = {(row["where"], row["what"]): row for row in kept} | rows
    if arguments.ci:
        for line in arguments.ci.read_text(encoding="utf-8").split():
            part, seconds = line.split(",")
            rows["ci", part] = {"where": "ci", "what": part, "longest_s": float(seconds)}
    with OUTPUT.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for _, row in sorted(rows.items()):
            writer.writerow({key: f"{value:.0f}" if isinstance(value, float) else value for key, value in row.items()})


if __name__ == "__main__":
    main()
