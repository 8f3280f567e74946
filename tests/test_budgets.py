"""The size of the project, which shrinks: whoever needs more lines or jobs says why where they raise a number here."""

import ast
import re
from pathlib import Path
from statistics import mean

import pytest

from marsedl.papers import SLUGS

ROOT = Path(__file__).parents[1]
LINES = {
    # 1,240 more: headline pictures, likeness, `marsedl compare`, two pages a paper, a gate that names the cause and
    # guards any table of results.
    "src/marsedl": 49_680,
    "src/marsedl/papers": 22_440,  # figures mark what their paper prints
    "src/marsedl/methods": 9_821,  # a path over a weight may leave its branch without trying again
    "src/marsedl/models": 2_238,
    "src/marsedl/montecarlo": 1_740,
    "src/marsedl/replication": 10_330,  # all faults of a file at once, pictures and texts compared, claims in words
    "tests": 35_960,  # every printed number is drawn; what a universe is that is computed again; the same as above
}
MEAN_LINES = {"claims/*.py": 11.3, "tables.py": 26.5, "figures.py": 23.6}  # of a claim, a table, a figure
JOBS = 213  # of `snakemake all`


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
def test_jobs(project):
    process = project.run("all", "--dry-run", "--quiet", "host")
    assert int(re.search(r"^total +(\d+)$", process.stdout, re.MULTILINE)[1]) <= JOBS
