"""The size of the project, which shrinks: whoever needs more lines or jobs says why where they raise a number here."""

import ast
import re
from pathlib import Path
from statistics import mean

import pytest

from marsedl.papers import SLUGS
from marsedl.replication.checks.twice import copy_tree, snakemake

ROOT = Path(__file__).parents[1]
LINES = {
    "src/marsedl": 50_302,
    "src/marsedl/papers": 21_766,  # the refusal of an unknown paper stands here, once
    "src/marsedl/methods": 9_821,  # a path over a weight may leave its branch without trying again
    "src/marsedl/models": 2_275,  # look-ups of flights in tables, which two papers had each
    "src/marsedl/montecarlo": 2_446,  # the engine that four papers and users fly by
    "src/marsedl/fly": 1_444,  # laws that return their command whole, and four more mistakes that are told
    "src/marsedl/replication": 9_523,  # of it universes, choices and what decides 1,781
    "tests": 36_148,  # bits of 213 flights, the engine and its front door
}
MEAN_LINES = {"claims/*.py": 11.3, "tables.py": 26.5, "figures.py": 23.6}  # of a claim, a table, a figure
JOBS = 206  # of `snakemake all`


def lines(path):
    return len(path.read_text(encoding="utf-8").splitlines())


@pytest.mark.parametrize("folder", LINES)
def test_lines(folder):
    assert sum(map(lines, (ROOT / folder).rglob("*.py"))) <= LINES[folder]


@pytest.mark.parametrize("pattern", MEAN_LINES)
def test_lines_of_a_function(pattern):
    """Of public functions, decorators included; what they share counts for the wings alone."""
    sizes = []
    for path in (path for slug in SLUGS for path in (ROOT / "src/marsedl/papers" / slug).glob(pattern)):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and path.stem != "measures":
                sizes.append(node.end_lineno - min([node.lineno, *(d.lineno for d in node.decorator_list)]) + 1)
    assert mean(sizes) <= MEAN_LINES[pattern]


@pytest.mark.workflow
def test_jobs(tmp_path):
    words = ["all", "--dry-run", "--quiet", "host", "--cores", "2", "--config", "size=smoke"]
    process = snakemake(copy_tree(ROOT, tmp_path / "project"), *words)
    assert int(re.search(r"^total +(\d+)$", process.stdout, re.MULTILINE)[1]) <= JOBS
