"""Every command that the pages show can be given as it is shown.

Those of Snakemake are planned in a copy of the tree, with the readings that the pages show. Those of `marsedl` run
here, or in a smoke build if they need one. What installs, deletes or takes minutes is tested elsewhere.
"""

import csv
import functools
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib import import_module
from pathlib import Path

import pytest
import yaml

from marsedl import cli
from marsedl.replication.checks.twice import copy_tree, snakemake

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
PAGES += sorted(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts)
PROGRAMS = "snakemake|marsedl|make|pytest|python|pip|uv|git|podman|h5dump|scancel|scontrol"
COMMAND = re.compile(rf"(?:[A-Z_]+=\S+ )*(?:{PROGRAMS}) \S.*|\. \S+/activate|eval \"\$\(.*\)\"")
STANDS_FOR = {  # what the pages write for anything, and one thing that it may stand for
    "<slug>": "powered_descent",
    "PAPER": "powered_descent",
    "READING": "printed",
    "COMMAND": "list",
    "diff A B": "diff configs configs",
    # Shown for a Slurm, which is not everywhere; tests/slurm runs it. What stands in which order is the same.
    "--workflow-profile profiles/slurm": "--workflow-profile profiles/default",
}
ELSEWHERE = [
    *("make *", ". .venv/bin/activate", "python bench/*", "python profiles/*", "pytest *", "uv *", "pip *", "git *"),
    *("podman *", "h5dump *", "scancel *", "scontrol *", "*tests/slurm/cluster.py *", "marsedl verify*"),
    *("marsedl accept*", "marsedl readme", "snakemake --report *", "snakemake --unlock*", "snakemake --profile *"),
    *("snakemake * --configfile own/mine.yaml *", "snakemake *--workflow-profile profiles/slurm*"),
    "*hypersonic_glide*",
]
# What needs a build, or a process of its own, is given in a smoke build.
OF_A_BUILD = ("marsedl trial *", "marsedl what-if *", "marsedl universe *", "python -c *", "marsedl diff build/*")
COMPARED = "marsedl compare *"


@dataclass(frozen=True)
class Command:
    """A command as it is shown, and where."""

    text: str
    where: str

    @functools.cached_property
    def line(self) -> str:
        """The command with something in the place of what stands for anything."""
        line = self.text
        for placeholder, sample in STANDS_FOR.items():
            line = line.replace(placeholder, sample)
        return line

    def matches(self, patterns) -> bool:
        return any(fnmatchcase(self.line, pattern) for pattern in patterns)


def of_page(path) -> tuple[list[Command], list[str]]:
    """The commands of a page, and the readings that it shows; a block's commands are its lines without comments."""
    commands, readings, where = [], [], str(path.relative_to(ROOT))
    text = path.read_text(encoding="utf-8")
    for prose, language, block in re.findall(r"(?ms)(.*?)(?:^```(\S*)\n(.*?)^```$|\Z)", text):
        inline = [" ".join(code.split()) for code in re.findall(r"(?<!`)`([^`]+)`(?!`)", prose)]
        commands += [Command(code, where) for code in inline if COMMAND.fullmatch(code)]
        if language == "yaml" and re.match(r"[a-z_]+:\n  readings:", block):
            readings.append(block)
        if language in ("", "sh", "bash", "console"):
            lines = [line for line in (re.sub(r"(?:^|\s+)# .*$", "", line) for line in block.splitlines()) if line]
            if lines and COMMAND.fullmatch(lines[0]):
                commands += [Command(line, where) for line in lines]
    return commands, readings


SHOWN = [command for path in PAGES for command in of_page(path)[0]]
READINGS = [readings for path in PAGES for readings in of_page(path)[1]]
RUN = list({command.line: command for command in SHOWN if not command.matches(ELSEWHERE)}.values())
ON_A_BUILD = [command for command in RUN if command.matches(OF_A_BUILD) and len(command.line.split()) > 2]
PLANNED = [c for c in RUN if re.match(r"(?:[A-Z_]+=\S+ )*snakemake ", c.line)]
ALIKE = [c.line for c in RUN if c.matches([COMPARED])]
GIVEN = [c.line for c in RUN if c.line.startswith("marsedl ") and c not in ON_A_BUILD and c.line not in ALIKE]


def targets(smoke: bool, own: bool) -> list[str]:
    """The targets of Snakemake that stand before options, of the smoke size or not, of readings of one's own or not."""
    found = []
    for command in PLANNED:
        words = shlex.split(command.line.partition("snakemake ")[2])
        before = next((place for place, word in enumerate(words) if word.startswith("-")), len(words))
        if ("size=smoke" in words, "--configfile" in words) == (smoke, own):
            found += words[:before]
    return list(dict.fromkeys(found))


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A copy of the tree with all readings of the pages in one file, and a density table that one of them names."""
    folder = copy_tree(ROOT, tmp_path_factory.mktemp("commands") / "project")
    (folder / "gram_run.csv").write_text("altitude_km,density_kg_m3\n0,0.02\n50,1e-4\n125,1e-9\n", encoding="utf-8")
    merged = {}
    for readings in READINGS:
        for slug, body in yaml.safe_load(readings).items():
            merged.setdefault(slug, {"readings": {}})["readings"] |= body["readings"]
    (folder / "mine.yaml").write_text(yaml.safe_dump(merged), encoding="utf-8")
    return folder


def test_pages_show_commands():
    assert len(SHOWN) > 100
    assert len(PLANNED) > 15


@pytest.mark.workflow
@pytest.mark.parametrize(
    ("smoke", "own", "options"),
    [
        (False, False, ()),
        (True, False, ("--config", "size=smoke")),
        (False, True, ("--configfile", "mine.yaml", "--config", "chunks=8")),
    ],
)
def test_snakemake_plans_what_is_shown(project, smoke, own, options):
    asked = targets(smoke, own)
    process = snakemake(project, *asked, *options, "--dry-run", "--quiet", "host", "--cores", "1")
    assert process.returncode == 0, process.stdout[-3000:]
    assert "Job stats:" in process.stdout
    for target in asked:
        assert "/" not in target or target in process.stdout, target
    if not options:
        page = (ROOT / "docs" / "using.md").read_text(encoding="utf-8")
        (block,) = re.findall(r"(?ms)^## What comes out\n\n```\n(.*?)^```$", page)
        for path in [path for line in block.splitlines() for path in re.findall(r"^\S+|(?<=\w  )\w+\.\w+", line)]:
            assert re.search(rf"\n    output: .*\b{re.escape(path)}", process.stdout), path


@pytest.mark.parametrize("line", GIVEN)
def test_other_commands_do_what_is_shown(monkeypatch, tmp_path, capsys, line):
    monkeypatch.chdir(ROOT)
    (tmp_path / "mine.yaml").write_text(READINGS[0], encoding="utf-8")
    words = shlex.split(line.replace("mine.yaml", str(tmp_path / "mine.yaml")))[1:]
    if words[0] in ("fly", "new-law"):  # the page on a law of one's own runs these, in tests/scenarios
        assert cli.command_line().parse_args(words).command == words[0]
        return
    if words in (["trial"], ["diff"], ["explain"], ["new-paper"], ["list"], ["compare"]):  # named, without arguments
        words.append("--help")
    try:
        assert cli.main(words) == 0
    except SystemExit as ended:
        assert not ended.code
    captured = capsys.readouterr()
    assert captured.out
    assert captured.err == ""


@pytest.mark.workflow
def test_commands_that_need_a_build_do_what_is_shown(tree):
    """The smoke build stands in for that of the full size, whose commands are shown; it has fewer trials."""
    for name in ("data/cache", "report"):
        shutil.copytree(tree.path(name), tree.folder / name)
    for number in range(2):  # of which one page compares a file
        shutil.copytree(tree.path("report"), tree.folder / f"build/verify/{number}/build/smoke/report")
    assert len(ON_A_BUILD) >= 4
    environment = {**os.environ, "PYTHONPATH": str(tree.folder / "src")}
    for command in ON_A_BUILD:
        words = shlex.split(command.line)
        words[:1] = [sys.executable] if words[0] == "python" else [sys.executable, "-m", "marsedl.cli"]
        process = subprocess.run(words, cwd=tree.folder, env=environment, capture_output=True, text=True, check=False)
        assert process.returncode == 0, (command, process.stderr)
        assert process.stdout, command


@pytest.mark.workflow
def test_what_is_compared_is_compared_as_it_is_shown(tree):
    """In the smoke size, after the claims of the page's own reading were judged; `../other` is a copy of the build."""
    (tree.folder / "mine.yaml").write_text(READINGS[0], encoding="utf-8")
    tree.works("report/claims/powered_descent.json", configfile="mine.yaml")
    shutil.copytree(tree.build, tree.folder.parent / "other", dirs_exist_ok=True)
    assert len(ALIKE) >= 4
    for line in ALIKE:
        own = () if "--configfile" in line else ("--configfile", "mine.yaml")  # with which the build is up to date
        process = tree.marsedl(*shlex.split(line)[1:], *own, "--size", "smoke")
        assert process.returncode == 0, (line, process.stderr)
        assert "verdicts that change: " in process.stdout, line


def test_commands_that_install_name_files_and_extras_that_exist():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = [command.line for command in SHOWN if command.matches(("uv *", "pip *"))]
    assert len(lines) >= 5
    for line in lines:
        assert all((ROOT / name).exists() for name in re.findall(r" -r (\S+)", line)), line
        extras = [name for names in re.findall(r"\.\[([\w,]+)\]|--extra (\w+)", line) for name in names if name]
        assert {part for name in extras for part in name.split(",")} <= project["optional-dependencies"].keys(), line


def test_benchmarks_of_an_unknown_paper_are_refused():
    command = [sys.executable, "bench/run.py", "random_feild"]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert process.returncode == 1
    assert process.stderr == "bench/run.py: there is no paper 'random_feild'; did you mean 'random_field'?\n"


def test_a_missed_target_of_the_benchmarks_has_its_note(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "bench")
    measuring, rows = import_module("measuring"), []
    row = functools.partial(measuring.add_row, rows, "funnels")
    row("a build", 4.0, "CPU s", below=3.0, note="Of a target.")
    row("a build", 2.0, "CPU s", below=3.0, note="Of a target.")
    row("a build", 2.0, "CPU s")
    assert [measured[4:] for measured in rows] == [("< 3", "no", "Of a target."), ("< 3", "yes", ""), ("", "", "")]
    header, *committed = csv.reader((ROOT / "data" / "reference" / "benchmarks.csv").read_text("utf-8").splitlines())
    assert tuple(header) == measuring.HEADER
    assert all((measured[5] == "no") == bool(measured[6]) for measured in committed)


def test_the_makefile_knows_what_is_shown():
    shown_targets = {command.line.split()[1] for command in SHOWN if command.line.startswith("make ")}
    assert shown_targets <= set(re.findall(r"(?m)^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8")))
