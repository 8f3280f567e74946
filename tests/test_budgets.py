"""The size of the project, which shrinks: whoever needs more says why where they raise a number here."""

import ast
import re
from pathlib import Path
from statistics import mean

import pytest

from marsedl.papers import SLUGS
from marsedl.replication.checks.twice import copy_tree, snakemake

ROOT = Path(__file__).parents[1]
# Statements of code: docstrings, blank lines and layout are free.
STATEMENTS = {
    "src/marsedl": 30_849,
    "src/marsedl/papers": 10_364,
    "src/marsedl/methods": 4_144,
    "src/marsedl/models": 652,
    "src/marsedl/design": 916,
    "src/marsedl/montecarlo": 1_918,  # a law is compiled alone, so that a new one takes a second
    "src/marsedl/fly": 2_436,
    # The explorer of universes took the place of 45 statements of papers; what is read of all inputs is followed; all
    # claims are judged again from artifacts, and ensembles compared state by state.
    "src/marsedl/replication": 6_395,
}
LINES = 42_862  # of tests
MEAN_LINES = {
    "claims/*.py": 11.5,
    "tables.py": 26.5,
    "figures.py": 21.6,
}  # of a claim (errors of the value), a table, a figure
JOBS = 196  # of `snakemake all` at smoke size


def statements(path):
    """The statements of a file but for its docstrings."""
    nodes = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.stmt)]
    texts = [node for node in nodes if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)]
    return len(nodes) - len(texts)


@pytest.mark.parametrize("folder", STATEMENTS)
def test_statements(folder):
    assert sum(map(statements, (ROOT / folder).rglob("*.py"))) <= STATEMENTS[folder]


def test_lines_of_tests():
    assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in (ROOT / "tests").rglob("*.py")) <= LINES


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
