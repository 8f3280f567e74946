"""Other machines: the smoke size with other instruction sets and library versions, compared with the pinned ones.

`python bench/machines.py sse` builds the smoke size twice, once as it is pinned and once in a copy of the project that
pins the instruction sets of another machine. It compares verdicts and numbers as `marsedl verify` does, and stores the
worst margin of every artifact in data/reference/machines.csv. Rows of other machines and papers stay in the table.
"""

import argparse
import csv
import json
import subprocess
import sys
from itertools import groupby
from pathlib import Path

from marsedl.papers import SLUGS, rounding_noise
from marsedl.replication.checks.reference import compare, fingerprints, format_changes
from marsedl.replication.checks.twice import copy_tree, snakemake
from marsedl.replication.claims.committed import VERDICTS
from marsedl.replication.records.tables import read_table
from marsedl.replication.sizes import build_folder
from marsedl.replication.terminal import columns

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "data" / "reference" / "machines.csv"
HEADER = ("machine", "setting", "paper", "artifact", "numbers", "beyond", "margin", "worst")
LIBRARIES = ("numpy", "scipy", "numba", "casadi", "cvxpy", "clarabel", "h5py")
# OpenBLAS's oldest kernels for machines with AVX2, NumPy without what its build dispatches to, LLVM's plain x86-64, and
# a mathematical library without vector units and fused products; then the widest of the same.
INSTRUCTION_SETS = {
    "sse": {
        "OPENBLAS_CORETYPE": "Prescott",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F",
    },
    "avx512": {"OPENBLAS_CORETYPE": "SkylakeX", "NUMBA_CPU_NAME": "skylake-avx512", "NUMBA_CPU_FEATURES": ""},
}
# Appended to a copy of the project's pins.
PINNED_IN = "src/marsedl/replication/pipeline/numerics.py"
PINS = """
from marsedl.replication.pipeline import kernel_cache
NUMERIC_ENVIRONMENT.update({variables!r})
kernel_cache.vector_features = lambda: ""
"""
VERSIONS = f"""
import json, platform
from importlib.metadata import version
print(json.dumps({{"Python": platform.python_version(), **{{name: version(name) for name in {LIBRARIES!r}}}}}))
"""


def versions(python: str) -> str:
    """The versions of a Python and of its libraries, in words."""
    output = subprocess.run([python, "-c", VERSIONS], capture_output=True, text=True, check=True).stdout
    return ", ".join(f"{name} {version}" for name, version in json.loads(output).items())


def build(folder: Path, slugs: list[str], cores: int, variables: dict[str, str], python: str | None = None) -> None:
    """Build the claims of some papers at the smoke size in an empty folder, with other pins or another Python."""
    copy_tree(ROOT, folder)
    if variables:
        with (folder / PINNED_IN).open("a", encoding="utf-8") as file:
            file.write(PINS.format(variables=variables))
    print(f"smoke build in {folder}", flush=True)
    targets = [f"report/claims/{slug}.json" for slug in slugs]
    process = snakemake(folder, *targets, "--cores", str(cores), "--config", "size=smoke", nice=19, python=python)
    if process.returncode:
        sys.exit(f"the smoke build in {folder} failed:\n{process.stdout[-3000:]}")


def compared(pinned: Path, folder: Path, slug: str) -> list[tuple[str, ...]]:
    """Rows of the table for one paper, without the machine: verdicts, claims, and every artifact."""
    entries = []
    for made in (build_folder(root, "smoke") for root in (pinned, folder)):
        paths = sorted(made.glob(f"data/cache/{slug}/*/*.h5"))
        entries.append(fingerprints(made, slug, {f"{path.parent.name}/{path.stem}": path for path in paths}))
    comparison = compare(*entries, rounding_noise().get(slug, ()))
    if comparison.changes:
        print(format_changes(comparison), flush=True)
    changed = [change.name for change in comparison.of(VERDICTS)]
    verdicts = sum(len(entry) for name, entry in entries[0].items() if name.startswith(VERDICTS))
    rows = [(slug, "verdicts", str(verdicts), str(len(changed)), "", "; ".join(changed))]
    margins = {name: value for name, value in comparison.margins.items() if name not in comparison.by_shape}
    margins |= {change.name: change.margin for change in comparison.of("")}  # those that one build lacks, too
    for artifact, group in groupby(sorted(margins, key=artifact_of), key=artifact_of):
        names = sorted(group)
        worst, beyond = max(names, key=margins.get), sum(margins[name] > 1 for name in names)
        where = worst.replace(f"{artifact}/", "", 1) if margins[worst] > 0 else ""
        rows.append((slug, artifact, str(len(names)), str(beyond), f"{margins[worst]:.1e}", where))
    return rows


def artifact_of(name: str) -> str:
    """The artifact, without its reading, that a number of this name is of, or `claims`."""
    first, second, _ = name.split("/")
    return first if first == "claims" else second


def main() -> int:
    """Build and compare one machine after the other; returns 1 if a verdict or a number beyond tolerance changes."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", choices=[[], *INSTRUCTION_SETS], metavar="sse|avx512")
    parser.add_argument("--libraries", action="append", default=[], metavar="NAME=PYTHON", help="another environment")
    parser.add_argument("--paper", action="append", default=[], choices=SLUGS, help="only this paper")
    parser.add_argument("--cores", type=int, default=2, help="cores of each build (default: %(default)s)")
    options = parser.parse_args()
    slugs, folder, rows = options.paper or list(SLUGS), ROOT / "build" / "machines", []
    pythons = dict(text.split("=", 1) for text in options.libraries)
    names = [*(options.names or ([] if pythons else INSTRUCTION_SETS)), *pythons]
    build(folder / "pinned", slugs, options.cores, {})
    for name in names:
        variables = INSTRUCTION_SETS.get(name, {})
        setting = "; ".join(f"{key}={value}" for key, value in variables.items()) or versions(pythons[name])
        build(folder / name, slugs, options.cores, variables, pythons.get(name))
        for slug in slugs:
            of_paper = [(name, setting, *row) for row in compared(folder / "pinned", folder / name, slug)]
            print(f"{name}, {slug}\n{columns([row[3:] for row in (HEADER, *of_paper)], 2)}", flush=True)
            rows += of_paper
    replaced = {(row[0], row[2]) for row in rows}
    table = [*(row for row in read_table(TABLE)[1:] if (row[0], row[2]) not in replaced), *rows]
    order = list(dict.fromkeys(row[0] for row in table))
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([HEADER, *sorted(table, key=lambda row: order.index(row[0]))])
    return int(any(row[HEADER.index("beyond")] != "0" for row in rows))


if __name__ == "__main__":
    sys.exit(main())
