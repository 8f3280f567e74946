"""Other machines: the smoke size with other instruction sets and library versions, compared with the pinned ones.

A build is pinned to one instruction set, so that its numbers are the same wherever it runs. What they would be
elsewhere is found by removing the pins (see `replication/jobs.py`) and asking every library for the code that it
would run on another machine. Verdicts are compared, and the numbers of `replication/verification.py`, with its
tolerances.
"""

import csv
import io
import json
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

from marsedl.replication.claims import write_text
from marsedl.replication.errors import InputError, MarsedlError, nearest
from marsedl.replication.jobs import INSTRUCTION_SETS, UNPINNED
from marsedl.replication.sizes import build_folder
from marsedl.replication.tables import read_table
from marsedl.replication.terminal import columns
from marsedl.replication.verification import (
    Comparison,
    built_verdicts,
    compare,
    copy_tree,
    fingerprints,
    format_changes,
    snakemake,
)

TABLE = Path("data/reference/machines.csv")
HEADER = ("machine", "setting", "paper", "artifact", "numbers", "beyond", "margin", "worst")
LIBRARIES = ("numpy", "scipy", "numba", "casadi", "cvxpy", "clarabel", "h5py")
PINNED = "pinned"
_VERDICTS = "verdicts"
_VERSIONS = f"""
import json, platform
from importlib.metadata import version
print(json.dumps({{"Python": platform.python_version(), **{{name: version(name) for name in {LIBRARIES!r}}}}}))
"""


@dataclass(frozen=True)
class Machine:
    """A machine that this one pretends to be: instruction sets in place of the pinned ones, or another Python."""

    name: str
    instruction_sets: Mapping[str, str] = field(default_factory=dict)  # environment variables; none: the pinned ones
    needs: str = ""  # the feature of the processor without which it cannot be run, as LLVM calls it
    python: str | None = None  # whose environment holds the libraries, if it is not this one

    @property
    def environment(self) -> dict[str, str | None]:
        """The environment variables of a build; None stands for one that must not be set."""
        free = dict.fromkeys(INSTRUCTION_SETS) if self.instruction_sets else {}
        return {UNPINNED: "1" if self.instruction_sets else None, **free, **self.instruction_sets}

    def setting(self) -> str:
        """What is different, in words: instruction sets, or versions; raises MarsedlError if Python lacks a library."""
        if self.instruction_sets:
            return "; ".join(f"{name}={value}" for name, value in self.instruction_sets.items())
        python = self.python or sys.executable
        process = subprocess.run([python, "-c", _VERSIONS], capture_output=True, text=True, check=False)
        if process.returncode:
            raise MarsedlError(f"{python}: lacks some of the libraries; it says:\n{process.stderr[-1000:]}")
        return ", ".join(f"{name} {version}" for name, version in json.loads(process.stdout).items())


_PINNED = Machine(PINNED)

# OpenBLAS's oldest kernels, NumPy without what its build dispatches to, LLVM's plain x86-64, and a mathematical library
# that takes the paths without vector units and fused products; then the widest of the same.
MACHINES = {
    machine.name: machine
    for machine in (
        Machine(
            "sse",
            {
                "OPENBLAS_CORETYPE": "Prescott",
                "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
                "NUMBA_CPU_NAME": "generic",
                "NUMBA_CPU_FEATURES": "",
                "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F",
            },
        ),
        Machine(
            "avx512",
            {"OPENBLAS_CORETYPE": "SkylakeX", "NUMBA_CPU_NAME": "skylake-avx512", "NUMBA_CPU_FEATURES": ""},
            needs="avx512f",
        ),
    )
}


def select(names: Sequence[str], libraries: Iterable[str] = ()) -> list[Machine]:
    """Return the machines of these names, all if there are none, and one for every `NAME=PYTHON` of `libraries`.

    Raises InputError for an unknown name, or if this machine's processor cannot run one of them.
    """
    other_pythons = []
    for text in libraries:
        name, equals, python = text.partition("=")
        if not equals or not name.isidentifier() or name in (PINNED, *MACHINES) or not Path(python).is_file():
            raise InputError(f"--libraries {text}: give a new name and a Python, as in older=build/older/bin/python")
        other_pythons.append(Machine(name, python=str(Path(python).absolute())))
    if unknown := next((name for name in names if name not in MACHINES), None):
        raise InputError(f"there is no machine '{unknown}'; {nearest(unknown, MACHINES)}")
    machines = [MACHINES[name] for name in (names or ([] if other_pythons else MACHINES))]
    if lacking := next((machine for machine in machines if machine.needs and not _has(machine.needs)), None):
        raise InputError(f"machine '{lacking.name}' cannot be run on a processor without {lacking.needs}; name others")
    return [*machines, *other_pythons]


def _has(feature: str) -> bool:
    """Whether this machine's processor has a feature."""
    from llvmlite.binding import get_host_cpu_features

    return get_host_cpu_features().get(feature, False)


def build(root: Path, folder: Path, slugs: Iterable[str], machine: Machine = _PINNED, cores: int = 2) -> None:
    """Build the claims of some papers at the smoke size in an empty folder, as on another machine or as it is pinned.

    Raises MarsedlError with the end of Snakemake's output if that fails.
    """
    copy_tree(root, folder)
    arguments = (*(f"report/claims/{slug}.json" for slug in slugs), "--cores", str(cores), "--config", "size=smoke")
    process = snakemake(folder, *arguments, nice=19, python=machine.python, **machine.environment)
    if process.returncode:
        raise MarsedlError(f"the smoke build in {folder} failed:\n{process.stdout[-3000:]}")


def compare_builds(pinned: Path, folder: Path, slug: str, noise: Sequence[str] = ()) -> Comparison:
    """Compare the verdicts and numbers of one paper in two builds; noise as for `verification.compare`."""
    builds = [build_folder(root, "smoke") for root in (pinned, folder)]
    return compare(*(fingerprints(build, slug, _artifacts(build, slug)) for build in builds), noise)


def _artifacts(build: Path, slug: str) -> dict[str, Path]:
    """The files of a build's artifacts by "reading/artifact", of the readings that own them."""
    return {f"{path.parent.name}/{path.stem}": path for path in sorted(build.glob(f"data/cache/{slug}/*/*.h5"))}


def rows(machine: str, setting: str, slug: str, comparison: Comparison, verdicts: int) -> list[tuple[str, ...]]:
    """Reduce a comparison to rows of the table: one for all verdicts, one for all claims, one for every artifact.

    Args:
        machine: its name.
        setting: what is different there, in words.
        slug: the paper.
        comparison: of the two builds.
        verdicts: how many there are.

    Returns:
        Texts under `HEADER`: how many numbers or verdicts were compared, how many are beyond tolerance or changed, the
        worst margin in tolerances, and where that is. Numbers that rounding decides are not among them.

    """
    changed_verdicts = [change.name for change in comparison.changes if change.verdict]
    start = (machine, setting, slug)
    table = [(*start, _VERDICTS, str(verdicts), str(len(changed_verdicts)), "", "; ".join(changed_verdicts))]
    margins = {name: value for name, value in comparison.margins.items() if name not in comparison.by_shape}
    margins |= {c.name: c.margin for c in comparison.changes if not c.verdict}  # those that one build lacks, too
    for stage, names in groupby(sorted(margins, key=_artifact), key=_artifact):
        names = sorted(names)
        worst = max(names, key=margins.get)
        beyond = sum(margins[name] > 1 for name in names)
        where = worst.replace(f"{stage}/", "", 1) if margins[worst] > 0 else ""
        table.append((*start, stage, str(len(names)), str(beyond), f"{margins[worst]:.1e}", where))
    return table


def _artifact(name: str) -> str:
    """The artifact, without its reading, that a number of this name is of, or `claims`."""
    first, second, _ = name.split("/")
    return first if first == "claims" else second


def measure(
    root: Path, machines: Sequence[Machine], slugs: Sequence[str], noise: Mapping[str, Sequence[str]], cores: int = 2
) -> bool:
    """Build and compare one machine after the other; prints what differs and stores the table.

    The builds are made in `build/machines`. Rows of machines and papers that were not asked for stay in the table.

    Returns whether every verdict is the same and every number within its tolerance. Raises MarsedlError if a build
    fails.
    """
    settings = {machine.name: machine.setting() for machine in machines}
    folder = root / "build" / "machines"
    print(f"smoke build in {folder / PINNED}", flush=True)
    build(root, folder / PINNED, slugs, cores=cores)
    all_rows = []
    for machine in machines:
        setting = settings[machine.name]
        print(f"smoke build in {folder / machine.name} ({setting})", flush=True)
        build(root, folder / machine.name, slugs, machine, cores)
        for slug in slugs:
            comparison = compare_builds(folder / PINNED, folder / machine.name, slug, noise.get(slug, ()))
            verdicts = sum(map(len, built_verdicts(build_folder(folder / PINNED, "smoke"), slug).values()))
            paper_rows = rows(machine.name, setting, slug, comparison, verdicts)
            _print_rows(paper_rows)
            if comparison.changes:
                print(format_changes(comparison.changes), flush=True)
            all_rows += paper_rows
    store(root, all_rows)
    return all(row[HEADER.index("beyond")] == "0" for row in all_rows)


def store(root: Path, new_rows: Sequence[Sequence[str]]) -> None:
    """Write rows into the table, in place of those of the same machines and papers."""
    old_rows = read_table(root / TABLE)[1:] if (root / TABLE).exists() else []
    names = list(dict.fromkeys(row[0] for row in [*old_rows, *new_rows]))
    replaced = {(row[0], row[2]) for row in new_rows}
    all_rows = [*(row for row in old_rows if (row[0], row[2]) not in replaced), *new_rows]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([HEADER, *sorted(all_rows, key=lambda row: names.index(row[0]))])
    write_text(root / TABLE, text.getvalue())


def _print_rows(table: Sequence[Sequence[str]]) -> None:
    """Print rows of one machine and paper as a table."""
    print(f"{table[0][0]}, {table[0][2]}\n{columns([row[3:] for row in (HEADER, *table)], 2)}", flush=True)
