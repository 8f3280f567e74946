"""Other machines: the smoke size with other instruction sets and library versions, compared with the pinned ones.

`python bench/machines.py sse` builds the smoke size twice, once as it is pinned and once in a copy of the project that
pins the instruction sets of another machine. It compares verdicts and numbers as `marsedl verify` does, and stores the
worst margin of every artifact in data/reference/machines.csv. Rows of other machines and papers stay in the table.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import pandas as pd

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.checks.reference import compare, fingerprints, format_changes
from marsedl.replication.checks.twice import copy_tree, snakemake
from marsedl.replication.claims.committed import VERDICTS
from marsedl.replication.claims.rows import read_claims

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "data" / "reference" / "machines.csv"
COLUMNS = ["artifact", "numbers", "beyond", "margin", "worst"]
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
VERSIONS = """
import platform
from importlib.metadata import version
names = "numpy", "scipy", "numba", "casadi", "cvxpy", "clarabel", "h5py"
print("Python", platform.python_version() + "".join(f", {name} {version(name)}" for name in names))
"""


def build(folder, slugs, cores, variables, python=sys.executable):
    """Build the claims of some papers at the smoke size in an empty folder, with other pins or another Python."""
    copy_tree(ROOT, folder)
    if variables:
        with (folder / PINNED_IN).open("a", encoding="utf-8") as file:
            file.write(PINS.format(variables=variables))
    print(f"smoke build in {folder}", flush=True)
    arguments = *(f"report/claims/{slug}.json" for slug in slugs), "--cores", str(cores), "--config", "size=smoke"
    process = snakemake(folder, *arguments, python=("nice", "-n", "19", python))
    if process.returncode:
        sys.exit(f"the smoke build in {folder} failed:\n{process.stdout[-3000:]}")


def compared(pinned, other, slug):
    """A row for the verdicts of a paper and one for each artifact: how many numbers, how far they move."""
    entries = []
    for made in (folder / "build" / "smoke" for folder in (pinned, other)):
        paths = sorted(made.glob(f"data/cache/{slug}/*/*.h5"))
        rows = read_claims(made / f"report/claims/{slug}.json")
        entries.append(fingerprints(rows, {f"{path.parent.name}/{path.stem}": path for path in paths}))
    comparison = compare(*entries, catalogue(slug).noise)
    if comparison.changes:
        print(format_changes(comparison), flush=True)
    changed = [change.name for change in comparison.of(VERDICTS)]
    verdicts = sum(len(entry) for name, entry in entries[0].items() if name.startswith(VERDICTS))
    rows = [("verdicts", verdicts, len(changed), "", "; ".join(changed))]
    margins = {name: value for name, value in comparison.margins.items() if name not in comparison.by_shape}
    margins |= {change.name: change.margin for change in comparison.of("")}  # those that one build lacks, too
    artifact_of = {name: name.split("/")[0 if name.startswith("claims/") else 1] for name in margins}
    for artifact, of_artifact in pd.Series(margins, dtype=float).sort_index().groupby(artifact_of):
        margin, beyond = of_artifact.max(), int((of_artifact > 1).sum())
        worst = of_artifact.idxmax().replace(f"{artifact}/", "", 1) if margin > 0 else ""
        rows.append((artifact, len(of_artifact), beyond, f"{margin:.1e}", worst))
    return pd.DataFrame(rows, columns=COLUMNS).astype(str)


def main():
    """Build and compare one machine after the other; returns 1 if a verdict or a number beyond tolerance changes."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", choices=[[], *INSTRUCTION_SETS], metavar="sse|avx512")
    parser.add_argument("--libraries", action="append", default=[], metavar="NAME=PYTHON", help="another environment")
    parser.add_argument("--paper", action="append", default=[], choices=SLUGS, help="only this paper")
    parser.add_argument("--cores", type=int, default=2, help="cores of each build (default: %(default)s)")
    options = parser.parse_args()
    slugs, folder = options.paper or list(SLUGS), ROOT / "build" / "machines"
    pythons = dict(text.split("=", 1) for text in options.libraries)
    table = pd.read_csv(TABLE, dtype=str, keep_default_na=False)
    order, new = list(table["machine"].unique()), []
    build(folder / "pinned", slugs, options.cores, {})
    for name in [*(options.names or ([] if pythons else INSTRUCTION_SETS)), *pythons]:
        variables, python = INSTRUCTION_SETS.get(name, {}), pythons.get(name, sys.executable)
        versions = subprocess.run([python, "-c", VERSIONS], capture_output=True, text=True, check=True).stdout.strip()
        setting = "; ".join(f"{key}={value}" for key, value in variables.items()) or versions
        build(folder / name, slugs, options.cores, variables, python)
        for slug in slugs:
            rows = compared(folder / "pinned", folder / name, slug)
            print(f"{name}, {slug}\n{rows.to_string(index=False)}", flush=True)
            table = table[(table["machine"] != name) | (table["paper"] != slug)]
            new.append(rows.assign(machine=name, setting=setting, paper=slug))
    new = pd.concat(new)
    order = dict.fromkeys([*order, *new["machine"]])
    table = pd.concat([table, new]).sort_values("machine", key=lambda of: of.map(list(order).index), kind="stable")
    table.to_csv(TABLE, columns=["machine", "setting", "paper", *COLUMNS], index=False, lineterminator="\n")
    return int((new["beyond"] != "0").any())


if __name__ == "__main__":
    sys.exit(main())
