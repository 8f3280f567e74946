"""Write what the jobs of a build took, and from it what the Slurm profile asks for.

`python profiles/slurm/measure.py [folder]`, of the build in this or another folder: reads its `benchmarks/**/*.tsv`,
writes the largest of every rule into `measured.csv` beside this file, and the last sections of `config.yaml`: groups,
and what each rule asks for. A rule that was not built there keeps its row.
"""

import csv
import re
import sys
from pathlib import Path

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.command_line import tables_of_equal_needs

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
# Jobs of a second to half a minute, many in one job of Slurm: figures and tables of a paper, and the designs of its
# readings with flights of few trials. A failure in one paper leaves the others. Other Monte Carlo cases and long stages
# are jobs of their own.
SHORT = "flights"
DESIGNS = {
    **dict.fromkeys(("powered_descent", "stochastic_entry"), ("nominal", "linearization", "gains", SHORT)),
    "random_field": ("nominal", "linearization", "gains"),
    "funnels": ("linearization", "gains"),
}
IN_A_GROUP = {"products": 24, "tables": 12, "designs": 4}
# Rules without a benchmark, which are jobs all the same: the smoke size is built twice, by two jobs at a time.
STATED = {"verify": {"mem_mb": 4000, "runtime": 180}}


def rule_of(path: Path) -> str:
    """Return the rule that a file of `benchmarks` is of, by its path below that folder."""
    parts = path.with_suffix("").parts
    if len(parts) == 1:
        return {"claims": "all_claims", "report": "site"}.get(parts[0], parts[0])
    if parts[0] not in SLUGS:
        return f"{parts[0]}_product"
    paper, name = catalogue(parts[0]), parts[-1]
    if len(parts) == 2:
        if name in ("claims", "counterexamples"):
            return f"{parts[0]}_{name}"
        return "figure" if name in paper.figures else f"{parts[0]}_table_{name}"
    if name.startswith(SHORT):
        return f"{parts[0]}_{name}"
    stem, _, case = name.partition(".")
    if stem not in paper.stages:  # some tables have the name of a stage; a whole build draws none of other readings
        return "figure" if stem in paper.figures else f"{parts[0]}_table_{stem}"
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


def groups() -> dict[str, str]:
    """Return the group of each rule whose jobs are short."""
    tables = {
        f"{slug}_table_{next(iter(tables))}": f"{slug}_tables"
        for slug in SLUGS
        for tables in tables_of_equal_needs(catalogue(slug))
    }
    designs = {f"{slug}_{stage}": f"{slug}_designs" for slug, stages in DESIGNS.items() for stage in stages}
    return {"figure": "{paper}_products", **tables, **designs}


def sections(table: dict[str, dict[str, float]]) -> str:
    """Return the last sections of the profile."""
    grouped = groups()
    sizes = {group: IN_A_GROUP[group.rpartition("_")[2]] for group in grouped.values()}
    lines = ["groups:", *(f'  - "{rule}={group}"' for rule, group in grouped.items())]
    lines += ["group-components:", *(f'  - "{group}={size}"' for group, size in sizes.items())]
    lines += [
        "# Memory is 500 MB for Snakemake and 1.5 times the largest job of the rule, run time (minutes) 4 times the",
        "# longest one, at least 5.",
    ]
    return "\n".join(lines) + "\n" + _resources(table)


def _resources(table: dict[str, dict[str, float]]) -> str:
    asked = {**{rule: resources(row) for rule, row in table.items()}, **STATED}
    lines = [
        f"  {rule}: {{mem_mb: {asked[rule]['mem_mb']} * attempt, runtime: {asked[rule]['runtime']} * attempt}}"
        for rule in sorted(asked)
    ]
    return "set-resources:\n" + "\n".join(lines) + "\n"


def rules() -> set[str]:
    """Return the rules that have a benchmark."""
    stages = {f"{slug}_{stage}" for slug in SLUGS for stage in catalogue(slug).stages}
    stages |= {f"{slug}_{SHORT}" for slug in SLUGS if len(input_model(slug).CASES) > 1}
    claims = {f"{slug}_{name}" for slug in SLUGS for name in ("claims", "counterexamples")}
    return stages | claims | groups().keys() | {"all_claims", "comparison_product", "digests", "site"}


def main() -> None:
    """Write the table and the section."""
    table = {**read_table(), **measured(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())}
    table = {rule: row for rule, row in table.items() if rule in rules()}
    rows = [
        f"{rule},{row['jobs']:.0f},{row['seconds']:.1f},{row['memory_mb']:.0f}" for rule, row in sorted(table.items())
    ]
    TABLE.write_text("\n".join([",".join(COLUMNS), *rows]) + "\n", encoding="utf-8")
    text = PROFILE.read_text(encoding="utf-8")
    PROFILE.write_text(text.partition("groups:\n")[0] + sections(read_table()), encoding="utf-8")


if __name__ == "__main__":
    main()
