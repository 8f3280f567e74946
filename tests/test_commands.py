"""Every command that the pages and the program itself show can be given as it is shown.

They are collected from the pages (blocks of commands and inline code), from the texts in the source that are printed,
and from the templates of the report. Those of Snakemake are planned in a copy of the tree, beside the configuration
that the page shows; those of `marsedl` run there, or in a smoke build if they need one. What installs, deletes or takes
minutes is listed with the test, or the step of CI, that runs it.
"""

import argparse
import ast
import csv
import functools
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib import import_module
from pathlib import Path

import pytest

from marsedl import cli
from marsedl.replication.verification import copy_tree, snakemake

ROOT = Path(__file__).parents[1]
PAGES = [path for name in ("README.md", "CONTRIBUTING.md") if (path := ROOT / name).exists()]
PAGES += sorted(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts)
SOURCES = sorted(path for folder in ("src", "workflow") for path in (ROOT / folder).rglob("*.py"))
TEMPLATES = sorted((ROOT / "src" / "marsedl" / "replication" / "templates").glob("*.j2"))

# At least so many commands are found there; fewer mean that they are no longer recognised.
EXPECTED = {
    "README.md": 12,
    "CONTRIBUTING.md": 8,
    "docs/adding-a-paper.md": 10,
    "docs/design.md": 2,
    "docs/formats.md": 1,
    "docs/gate.md": 5,
    "docs/notebooks/an_ensemble.md": 2,
    "docs/notebooks/index.md": 1,
    "docs/notebooks/verdicts_as_data.md": 1,
    "docs/papers/powered_descent.md": 1,
    "docs/reproducibility.md": 18,
    "docs/results.md": 1,
    "docs/scaling.md": 16,
    "docs/tutorial.md": 10,
    "docs/using.md": 40,
    "docs/verdicts.md": 1,
    "src": 34,
    "templates": 2,
}

PROGRAMS = "snakemake|marsedl|make|pytest|python|pip|uv|git|podman|rocrate-validator|h5dump|scancel|scontrol"
COMMAND = re.compile(rf"(?:[A-Z_]+=\S+ )*(?:{PROGRAMS}) \S.*|\. \S+/activate|eval \"\$\(.*\)\"")
# In the source, where prose stands around them: at the start, in quotes or brackets, or after a colon.
IN_PROSE = re.compile(r"(?:^|['\"(`>]|: +)\s*((?:snakemake|marsedl|git|make|pytest) (?:\{[^}]*\}|[^'`<)\",;\n])+)")
PROSE = {"git cannot list the project", "make it a frozen dataclass of quantities", "marsedl {marsedl.__version__}"}

# What stands for something, and one thing that it may stand for.
STANDS_FOR = {
    "<slug>": "powered_descent",
    "{slug}": "hypersonic_glide",
    "{paper}": "powered_descent",
    "{paper.slug}": "powered_descent",
    "{project.options}": " --config size=smoke",
    "snakemake {target}{size}": "snakemake figures/powered_descent/fig07.png --config size=smoke",
    "snakemake {target}": "snakemake figures/powered_descent/fig07.png --config size=smoke",
    "snakemake {path}{options}": "snakemake data/cache/powered_descent/corrected/gains.h5 --config size=smoke",
    "{path.relative_to(root)}": "data/reference/powered_descent.json",
    "{COMMITTED_INPUTS}": "data/reference/inputs.json",
    "snakemake {path} --config size={parts[1]}": "snakemake figures/powered_descent/fig07.png --config size=smoke",
    "snakemake {setting} --config ...": "snakemake claims --config size=smoke",
    "{name}": "report/badge.json",
    "{shlex.quote(str(folder))}": "own/reference",
    "corrected {case}": "corrected closed_loop 7",  # the report's script adds the number
    "{{ paths[0] }}": "figures/powered_descent/fig07.png",
    "{{ slug }} {{ row.id }}": "powered_descent prior_final_mass",
    "montecarlo.NAME": "montecarlo.closed_loop",
    "NAME.png": "fig07.png",
    "NAME.csv": "eq54.csv",
    "NAME.h5": "gains.h5",
    "READING": "printed",
    "PAPER": "powered_descent",
    "COMMAND": "list",
    "diff A B": "diff configs configs",
    "trial random_field both_branches": "trial random_field metres",  # a reading that the smoke size builds
    # Shown for a Slurm, which is not everywhere; tests/slurm runs it. What stands in which order is the same.
    "--workflow-profile profiles/slurm": "--workflow-profile profiles/default",
}

# What installs, deletes, takes minutes or needs other programs: the test that runs it, or the step of CI.
ELSEWHERE = {
    "make all": ".github/workflows/ci.yml",
    "make test": ".ci/run",
    "make lint": ".ci/run",
    "make quick": "tests/test_makefile.py::test_quick_selects_the_tests_that_compute_no_stage",
    "make slurm": ".ci/run",
    "make environment": "tests/test_makefile.py::test_every_step_of_the_installation_is_announced_and_shown",
    ". .venv/bin/activate": "tests/test_makefile.py::test_every_step_of_the_installation_is_announced_and_shown",
    "make lock": "tests/test_environment.py::test_the_locks_agree_in_their_versions",
    "make schemas": "tests/test_schemas.py::test_the_committed_schemas_are_what_is_made",
    "make docs": "tests/test_docs.py::test_the_pages_need_no_network_and_name_no_folder_of_this_machine",
    "make verify": "tests/workflow/test_reproducibility.py::test_two_builds_agree_in_every_product",
    "make bench": "tests/test_commands.py::test_benchmarks_of_an_unknown_paper_are_refused",
    "python bench/run.py *": "tests/test_commands.py::test_benchmarks_of_an_unknown_paper_are_refused",
    "marsedl verify": "tests/workflow/test_reproducibility.py::test_two_builds_agree_in_every_product",
    "marsedl verify --no-rebuild": ".github/workflows/ci.yml",
    "marsedl machines*": "tests/workflow/test_machines.py::test_numbers_stay_within_tolerance_without_vector_units",
    "marsedl accept": "tests/replication/test_verification.py::test_accept_shows_the_table_and_then_verify_agrees",
    "marsedl * --reference *": "tests/workflow/test_gate.py::test_the_gate_passes_until_a_number_moves",
    "snakemake * --configfile own/mine.yaml *": (
        "tests/workflow/test_gate.py::test_the_gate_passes_until_a_number_moves"
    ),
    "marsedl readme": "tests/test_docs.py::test_the_readme_says_what_the_committed_verdicts_are",
    "marsedl audit": ".ci/run",
    "marsedl crate*": "tests/replication/test_crate.py::test_the_smoke_build_is_a_valid_crate",
    "rocrate-validator *": "tests/replication/test_crate.py::test_a_valid_crate_of_the_profile",
    "git checkout *": "tests/replication/test_verification.py::test_damaged_references_are_refused_with_a_remedy",
    "podman *": "tests/test_container.py::test_what_is_copied_exists_and_is_not_generated",
    "pytest -m long": "tests/workflow/test_faults.py::test_a_kill_at_any_moment_loses_nothing",
    "pytest tests/papers/test_hypersonic_glide.py": (
        "tests/replication/test_scaffold.py::test_they_pass_their_own_tests_and_the_contract_of_all_papers"
    ),
    "pytest tests/slurm": "tests/slurm/test_slurm.py::test_products_through_slurm_are_the_same_as_without_it",
    "pytest -m long tests/slurm": (
        "tests/slurm/test_slurm.py::test_the_smoke_pipeline_through_slurm_is_the_same_as_without_it"
    ),
    "*tests/slurm/cluster.py *": "tests/slurm/test_slurm.py::test_products_through_slurm_are_the_same_as_without_it",
    "python profiles/slurm/measure.py": "tests/slurm/test_profile.py::test_a_build_is_measured_by_its_largest_jobs",
    "snakemake --profile mycluster *": "tests/slurm/test_profile.py::test_nothing_in_the_profile_is_of_one_cluster",
    "snakemake --report *": (
        "tests/comparison/test_comparison_workflow.py::test_the_report_of_snakemake_holds_captions_categories_and_labels"
    ),
    "snakemake --unlock*": "tests/workflow/test_faults.py::test_a_killed_snakemake_can_go_on",
    "uv *": "tests/test_commands.py::test_commands_that_install_name_files_and_extras_that_exist",
    "pip *": "tests/test_commands.py::test_commands_that_install_name_files_and_extras_that_exist",
    "h5dump *": "tests/test_commands.py::test_programs_of_the_system_are_named_with_their_package",
    "scancel *": "tests/test_commands.py::test_programs_of_the_system_are_named_with_their_package",
    "scontrol *": "tests/test_commands.py::test_programs_of_the_system_are_named_with_their_package",
}
OF_A_BUILD = ("marsedl trial *", "python -c *", "marsedl diff build/*")  # what needs one is given in a smoke build
INSTALLING = ("uv *", "pip *")
PACKAGES = {"h5dump": "hdf5-tools", "scancel": "slurm-wlm", "scontrol": "slurm-wlm"}  # of Debian


@dataclass(frozen=True)
class Command:
    """A command as it is shown, where, and the configuration that the page shows before it."""

    text: str
    where: str
    readings: str = ""

    @functools.cached_property
    def line(self) -> str:
        """The command as it can be given, with something in the place of what stands for anything."""
        line = self.text
        for placeholder, sample in STANDS_FOR.items():
            line = line.replace(placeholder, sample)
        assert not re.search(r"[{}]|<\w", line) or line.startswith(("scancel", "python -c")), f"{self.where}: {line}"
        words = line.split()
        parsers = subcommands()
        if words[0] == "marsedl" and len(words) == 2 and words[1] in parsers and required(parsers[words[1]]):
            return f"{line} --help"  # named, without its arguments
        return line

    def matches(self, patterns) -> bool:
        return any(fnmatchcase(self.line, pattern) for pattern in patterns)


@functools.cache
def subcommands() -> dict[str, argparse.ArgumentParser]:
    (action,) = (a for a in cli.command_line()._actions if isinstance(a, argparse._SubParsersAction))
    return action.choices


def required(parser) -> list[str]:
    """The arguments without which a command is refused."""
    return [a.dest for a in parser._actions if a.required and a.nargs != "*"]


def of_page(path) -> list[Command]:
    """The commands of a page; those of a block are its lines without their comments."""
    commands, readings, where = [], "", str(path.relative_to(ROOT))
    for prose, language, block in re.findall(
        r"(?ms)(.*?)(?:^```(\S*)\n(.*?)^```$|\Z)", path.read_text(encoding="utf-8")
    ):
        inline = [" ".join(code.split()) for code in re.findall(r"(?<!`)`([^`]+)`(?!`)", prose)]
        commands += [Command(code, where, readings) for code in inline if COMMAND.fullmatch(code)]
        if language == "yaml" and re.match(r"[a-z_]+:\n  readings:", block):
            readings = block
        if language in ("", "sh", "bash", "console"):
            lines = [re.sub(r"(?:^|\s+)# .*$", "", line) for line in block.splitlines()]
            lines = [line for line in lines if line]
            if lines and COMMAND.fullmatch(lines[0]):
                unknown = [line for line in lines if not COMMAND.fullmatch(line)]
                assert not unknown, f"{where}: among commands stands what is not known as one: {unknown}"
                commands += [Command(line, where, readings) for line in lines]
    return commands


@functools.cache
def printed_texts(path) -> list[str]:
    """The texts in a module that are not docstrings; the fields of an f-string stay as they are written."""
    source = path.read_text(encoding="utf-8")
    if not re.search(r"(?:snakemake|marsedl|git|make|pytest) ", source):
        return []
    tree = ast.parse(source)
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    bodies = [node.body for node in ast.walk(tree) if isinstance(node, documented) and node.body]
    docstrings = {id(body[0].value) for body in bodies if isinstance(body[0], ast.Expr)}
    texts = []

    def visit(node):
        if isinstance(node, ast.JoinedStr):
            parts = [p.value if isinstance(p, ast.Constant) else f"{{{ast.unparse(p.value)}}}" for p in node.values]
            texts.append("".join(parts))
        elif isinstance(node, ast.Constant):
            if isinstance(node.value, str) and id(node) not in docstrings:
                texts.append(node.value)
        else:
            for child in ast.iter_child_nodes(node):
                visit(child)

    visit(tree)
    return texts


def of_program() -> list[Command]:
    """The commands in the texts that the program prints, the help of its own commands among them."""
    commands = []
    for path in SOURCES:
        where = str(path.relative_to(ROOT))
        texts = printed_texts(path)
        commands += [Command(text.strip(), where) for line in texts for text in IN_PROSE.findall(line)]
    return [command for command in commands if command.text not in PROSE]


def of_templates() -> list[Command]:
    """The commands beside what stands in the report."""
    return [
        Command(text.strip(), f"templates: {path.name}")
        for path in TEMPLATES
        for text in re.findall(rf"<code[^>]*>((?:{PROGRAMS}) [^<]+)</code>", path.read_text(encoding="utf-8"))
    ]


SHOWN = [command for path in PAGES for command in of_page(path)] + of_program() + of_templates()
DISTINCT = list({(command.line, command.readings): command for command in reversed(SHOWN)}.values())[::-1]
RUN = [command for command in DISTINCT if not command.matches(ELSEWHERE)]
ON_A_BUILD = [command for command in RUN if command.matches(OF_A_BUILD) and not command.line.endswith(" --help")]
PLANNED = [c for c in RUN if re.match(r"(?:[A-Z_]+=\S+ )*snakemake ", c.line)]
GIVEN = list({c.line: c for c in RUN if c not in ON_A_BUILD and c not in PLANNED}.values())


def batches() -> list[tuple[str, ...]]:
    """What is planned at once: targets that stand before the same options, with the same readings; all else alone."""
    together = {}
    for command in PLANNED:
        prefix, _, arguments = command.line.partition("snakemake ")
        words = shlex.split(arguments)
        number = next((place for place, word in enumerate(words) if word.startswith("-")), len(words))
        targets, options = words[:number], tuple(words[number:])
        key = (prefix, command.readings if "--configfile" in options else "", options if targets else (arguments,))
        together.setdefault(key, []).extend(targets)
    return [(*key, tuple(dict.fromkeys(targets))) for key, targets in together.items()]


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A fresh copy of the tree with the new paper that a page writes, and a density table of the user's own."""
    folder = copy_tree(ROOT, tmp_path_factory.mktemp("commands") / "project")
    shutil.copy(ROOT / "Makefile", folder)
    (folder / "gram_run.csv").write_text("altitude_km,density_kg_m3\n0,0.02\n50,1e-4\n125,1e-9\n", encoding="utf-8")
    (new,) = (command for command in RUN if command.line.startswith("marsedl new-paper hypersonic_glide "))
    process = run_line(folder, new.line)
    assert process.returncode == 0, process.stderr
    return folder


def run_line(folder, line) -> subprocess.CompletedProcess:
    """Give a line to a shell in a folder, whose package `marsedl` and `python` then use."""
    programs = folder.parent / "programs"
    programs.mkdir(exist_ok=True)
    for name, arguments in (("marsedl", "-m marsedl.cli"), ("python", "")):
        (programs / name).write_text(
            f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {arguments} "$@"\n', encoding="utf-8"
        )
        (programs / name).chmod(0o755)
    environment = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": str(folder / "src")}
    return subprocess.run(
        ["bash", "-c", line], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def test_commands_are_found_in_every_place_that_shows_some():
    counts = Counter(
        command.where.split("/")[0].split(":")[0] if command.where.startswith(("src", "templates")) else command.where
        for command in SHOWN
    )
    assert {where: number for where, number in EXPECTED.items() if counts[where] < number} == {}
    assert {where for where in counts if where not in EXPECTED} <= {f"docs/papers/{p.name}" for p in PAGES} | {
        "docs/reference/index.md",
        "workflow",
    }


def test_prose_that_looks_like_a_command_is_still_there():
    texts = [text for path in SOURCES for text in printed_texts(path)]
    assert {text for text in PROSE if not any(text in line for line in texts)} == set()


@pytest.mark.parametrize("pattern", ELSEWHERE)
def test_what_is_run_elsewhere_is_shown_and_run_there(pattern):
    assert any(command.matches([pattern]) for command in SHOWN), "nothing shows it any more"
    file, _, name = ELSEWHERE[pattern].partition("::")
    text = (ROOT / file).read_text(encoding="utf-8")
    if name:
        assert f"\ndef {name}(" in text
    else:  # a step of CI
        assert re.search(rf"(?m)^(?: *- run: )?(?:\.venv/bin/)?{re.escape(pattern)}$", text)


@pytest.mark.workflow
@pytest.mark.parametrize("batch", batches(), ids=lambda b: f"{b[0]}snakemake {' '.join([*b[3], *b[2]])}"[:80])
def test_snakemake_plans_what_is_shown(project, batch):
    prefix, readings, options, targets = batch
    (project / "mine.yaml").write_text(readings, encoding="utf-8")
    environment = dict(assignment.split("=", 1) for assignment in prefix.split())
    words = shlex.split(options[0]) if not targets and len(options) == 1 else options
    process = snakemake(project, *targets, *words, "--dry-run", "--quiet", "host", "--cores", "1", **environment)
    assert process.returncode == 0, process.stdout[-3000:]
    assert "Traceback" not in process.stdout
    assert "Job stats:" in process.stdout
    for target in targets:
        assert "/" not in target or target in process.stdout, target


@pytest.mark.workflow
def test_all_makes_what_the_page_lists(project):
    page = (ROOT / "docs" / "using.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"(?ms)^## What comes out\n\n```\n(.*?)^```$", page)
    paths = [path for line in block.splitlines() for path in re.findall(r"^\S+|(?<=\w  )\w+\.\w+", line)]
    assert len(paths) >= 7
    process = snakemake(project, "all", "--dry-run", "--quiet", "host", "--cores", "1")
    for path in paths:
        assert re.search(rf"\n    output: .*\b{re.escape(path)}", process.stdout), path


@pytest.mark.parametrize(
    "line", [command.line for command in GIVEN if not command.line.startswith("marsedl new-paper h")]
)
def test_other_commands_do_what_is_shown(project, line):
    mine = next(command.readings for command in SHOWN if command.readings)
    (project / "mine.yaml").write_text(mine, encoding="utf-8")
    process = run_line(project, line)
    assert process.returncode == 0, process.stderr
    assert process.stderr == ""
    assert process.stdout or line.startswith("eval ")


@pytest.mark.workflow
def test_commands_that_need_a_build_do_what_is_shown(tree):
    """The smoke build stands in for that of the full size, whose commands are shown; it has fewer trials."""
    for name in ("data/cache", "report"):
        shutil.copytree(tree.path(name), tree.folder / name)
    for number in range(2):  # of which one page compares a file
        shutil.copytree(tree.path("report"), tree.folder / f"build/verify/{number}/build/smoke/report")
    assert len(ON_A_BUILD) >= 6
    for command in ON_A_BUILD:
        process = run_line(tree.folder, command.line)
        assert process.returncode == 0, (command, process.stderr)
        assert process.stdout, command


def test_commands_that_install_name_files_and_extras_that_exist():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = [command.line for command in SHOWN if command.matches(INSTALLING)]
    assert len(lines) >= 5
    for line in lines:
        assert all((ROOT / name).exists() for name in re.findall(r" -r (\S+)", line)), line
        extras = [
            name for names in re.findall(r"\.\[([\w,]+)\]|--extra (\w+)", line) for name in ",".join(names).split(",")
        ]
        assert {*filter(None, extras)} <= project["optional-dependencies"].keys(), line
        for minor in re.findall(r"--python 3\.(\d+)", line):
            assert int(minor) >= int(project["requires-python"].removeprefix(">=3.")), line


def test_programs_of_the_system_are_named_with_their_package():
    texts = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in PAGES}
    programs = {(command.where, command.line.split()[0]) for command in SHOWN}
    for where, program in programs:
        assert program not in PACKAGES or PACKAGES[program] in texts[where], f"{where} shows {program}"
    assert {program for _, program in programs} >= PACKAGES.keys()


def test_benchmarks_of_an_unknown_paper_are_refused():
    process = subprocess.run(
        [sys.executable, "bench/run.py", "random_feild"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert process.returncode == 1
    assert process.stderr == "bench/run.py: there is no paper 'random_feild'; did you mean 'random_field'?\n"


def test_a_missed_target_of_the_benchmarks_has_its_note(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "bench")
    rows = import_module("measuring").Rows()
    row = rows.of("funnels")
    row("a build", 4.0, "CPU s", below=3.0, note="Of a target.")
    row("a build", 2.0, "CPU s", below=3.0, note="Of a target.")
    row("a build", 2.0, "CPU s")
    assert [measured[4:] for measured in rows.rows] == [("< 3", "no", "Of a target."), ("< 3", "yes", ""), ("", "", "")]
    header, *committed = csv.reader((ROOT / "data" / "reference" / "benchmarks.csv").read_text("utf-8").splitlines())
    assert tuple(header) == rows.HEADER
    assert all((measured[5] == "no") == bool(measured[6]) for measured in committed)


def test_the_makefile_knows_what_is_shown():
    shown_targets = {command.line.split()[1] for command in SHOWN if command.line.startswith("make ")}
    targets = set(re.findall(r"(?m)^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8")))
    assert shown_targets <= targets
