"""Write what the jobs of a build took, and from it what the Slurm profile asks for.

`python profiles/slurm/measure.py [folder]`, of the build in this or another folder: reads its `benchmarks/**/*.tsv`,
writes the largest of every rule into `measured.csv` beside this file, and the section `set-resources` of `config.yaml`,
which is its last. A rule that was not built there keeps its row.
"""

import csv
import re
import sys
from pathlib import Path

from marsedl.papers import SLUGS, catalogue

HERE = Path(__file__).parent
TABLE = HERE / "measured.csv"
PROFILE = HERE / "config.yaml"
COLUMNS = ("rule", "jobs", "seconds", "memory_mb")
# A job of Slurm holds two processes of Snakemake beside its own: the one that Slurm starts and the one that runs the
# job. Resident memory of both after the DAG of the largest job is built, rounded up.
SNAKEMAKE_MB = 500
MEMORY_FACTOR = 1.5  # for what the samples of a benchmark miss, and other libraries
TIME_FACTOR = 4  # for slower nodes and busy file systems
TIME_MINUTES = 5  # at least: Snakemake's own start, compiling kernels anew, waiting for another that compiles
SMALLEST_MB = 200  # of a job's own process: what a job of less than a second takes is not seen by the samples
# Rules without a benchmark, which are jobs all the same: the smoke size is built twice, by two jobs at a time.
STATED = {"verify": {"mem_mb": 4000, "runtime": 180}}


def rule_of(path: Path) -> str:
    """Return the rule that a file of `benchmarks` is of, by its path below that folder."""
    parts = path.with_suffix("").parts
    if len(parts) == 1:
        return {"claims": "all_claims", "report": "index"}.get(parts[0], parts[0])
    if parts[0] not in SLUGS:
        return f"{parts[0]}_product"
    paper, name = catalogue(parts[0]), parts[-1]
    if len(parts) == 2:
        if name == "claims":
            return f"{parts[0]}_claims"
        return "default_figure" if name in paper.figures else "default_table"
    stem, _, case = name.partition(".")
    if stem not in paper.stages:  # some tables have the name of a stage; a whole build draws none of other readings
        return "figure" if stem in paper.figures else "table"
    return f"{parts[0]}_{stem}_chunk" if re.search(r"\.\d+of\d+$", case) else f"{parts[0]}_{stem}"


def measured(folder: Path) -> dict[str, dict[str, float]]:
    """Return the number of jobs of every rule of a build, and the longest time (s) and largest memory (MB) of them."""
    found = {}
    for path in sorted((folder / "benchmarks").rglob("*.tsv")):
        name = path.relative_to(folder / "benchmarks")
        rule = rule_of(name)
        if rule.endswith("_montecarlo") and any(path.parent.glob(f"{path.stem}.*of*.tsv")):
            rule += "_gather"
        with path.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file, delimiter="\t"):
                largest = found.setdefault(rule, {"jobs": 0, "seconds": 0.0, "memory_mb": 0.0})
                largest["jobs"] += 1
                largest["seconds"] = max(largest["seconds"], float(row["s"]))
                memory = row["max_rss"]
                largest["memory_mb"] = max(largest["memory_mb"], 0.0 if memory in ("-", "NA") else float(memory))
    return found


def read_table(path: Path = TABLE) -> dict[str, dict[str, float]]:
    """Return the committed table: the number of jobs, the longest time and the largest memory of every rule."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        rows = {row.pop("rule"): row for row in csv.DictReader(file)}
    return {rule: {name: float(value) for name, value in row.items()} for rule, row in rows.items()}


def resources(row: dict[str, float]) -> dict[str, int]:
    """Return what a first attempt asks for: memory (MB, whole hundreds) and run time (minutes)."""
    memory = SNAKEMAKE_MB + MEMORY_FACTOR * max(row["memory_mb"], SMALLEST_MB)
    minutes = TIME_FACTOR * row["seconds"] / 60
    return {"mem_mb": -int(-memory // 100) * 100, "runtime": max(TIME_MINUTES, -int(-minutes // 1))}


def section(table: dict[str, dict[str, float]]) -> str:
    """Return the section `set-resources` of the profile."""
    asked = {**{rule: resources(row) for rule, row in table.items()}, **STATED}
    lines = [
        f"  {rule}: {{mem_mb: {asked[rule]['mem_mb']} * attempt, runtime: {asked[rule]['runtime']} * attempt}}"
        for rule in sorted(asked)
    ]
    return "set-resources:\n" + "\n".join(lines) + "\n"


def main() -> None:
    """Write the table and the section."""
    table = {**read_table(), **measured(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())}
    for kind in ("figure", "table"):  # of any reading: no whole build has them, and they are as large as the default's
        table[kind] = {**table[f"default_{kind}"], "jobs": 0}
    rows = [
        f"{rule},{row['jobs']:.0f},{row['seconds']:.1f},{row['memory_mb']:.0f}" for rule, row in sorted(table.items())
    ]
    TABLE.write_text("\n".join([",".join(COLUMNS), *rows]) + "\n", encoding="utf-8")
    text = PROFILE.read_text(encoding="utf-8")
    PROFILE.write_text(text.partition("set-resources:\n")[0] + section(read_table()), encoding="utf-8")


if __name__ == "__main__":
    main()
