"""A new paper from the templates: it is built as the others are, and nothing is written where it cannot be."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from marsedl.replication.errors import InputError
from marsedl.replication.scaffold import new_paper, next_steps
from marsedl.replication.sizes import build_folder
from marsedl.replication.verification import copy_tree, snakemake

ROOT = Path(__file__).parents[2]
SLUG, SMALL = "hypersonic_glide", "short_hop"  # with Monte Carlo and without
TITLE = (
    "A Study of Gliding & Steering, Which Has {Braces}, a Title That is Far Too Long for One Line, and What Not: Part 2"
)
AUTHORS = "A. O'Author and B. Müller"


@pytest.fixture
def tree(tmp_path):
    return copy_tree(ROOT, tmp_path / "project")


@pytest.fixture(scope="module")
def scaffolded(tmp_path_factory):
    """A copy of the tree with two new papers, and the files that were written."""
    tree = copy_tree(ROOT, tmp_path_factory.mktemp("scaffold") / "project")
    contract = Path("tests") / "replication" / "test_catalogue.py"
    (tree / contract).parent.mkdir(parents=True)
    for path in (Path("pyproject.toml"), contract):
        (tree / path).write_bytes((ROOT / path).read_bytes())
    return tree, write_papers(tree)


def write_papers(tree):
    """Both papers, and the files that they are."""
    return [*new_paper(tree, SMALL, TITLE, AUTHORS, monte_carlo=False), *new_paper(tree, SLUG, TITLE, AUTHORS)]


@pytest.fixture(scope="module")
def sapling(scaffolded):
    """Built as the command says."""
    tree, _ = scaffolded
    for slug in (SLUG, SMALL):
        (command,) = re.findall(r"(?m)^build it: +snakemake (.*)$", next_steps(slug))
        process = snakemake(tree, *command.split(), "--cores", "2")
        assert process.returncode == 0, process.stdout[-3000:]
    return tree


def run(tree, *command):
    """Run a command in the tree, with its package."""
    environment = {**os.environ, "PYTHONPATH": str(tree / "src")}
    return subprocess.run(
        [sys.executable, "-m", *command], cwd=tree, env=environment, capture_output=True, text=True, check=False
    )


def content(tree):
    return {path: path.read_bytes() for path in tree.rglob("*") if path.is_file()}


def products_of(tree, slug):
    """The one claim of a new paper, and the names of its figures and tables."""
    build = build_folder(tree, "smoke")
    (row,) = json.loads((build / "report" / "claims" / f"{slug}.json").read_text("utf-8"))
    return row, {path.name for path in (build / "figures" / slug).iterdir()}


def passes_its_tests_and_the_contract(tree, *slugs):
    process = run(tree, "pytest", "tests", "-k", " or ".join((*slugs, "rules")), "-vv", "-p", "no:cacheprovider")
    assert process.returncode == 0, process.stdout[-3000:]
    for slug in slugs:
        tests_of_paper, contract = f"tests/papers/test_{slug}.py", "tests/replication/test_catalogue.py"
        assert f"{tests_of_paper}::test_every_claim_has_the_verdict_that_is_expected PASSED" in process.stdout
        assert (
            f"{contract}::test_every_paper_has_the_files_that_its_catalogue_asks_for[{slug}] PASSED" in process.stdout
        )
    assert "::test_rules_are_found PASSED" in process.stdout


@pytest.mark.workflow
@pytest.mark.parametrize(("slug", "table"), [(SLUG, "touchdown"), (SMALL, "descent")])
def test_the_workflow_builds_it_and_its_claim_has_a_verdict(sapling, slug, table):
    row, names = products_of(sapling, slug)
    assert row["verdict"] == "reproduced"
    assert set(row["readings"]) == {"corrected", "printed"}
    assert names == {"fig01.png", "fig01.pdf", f"{table}.csv", f"{table}.md", "claims.csv", "claims.md"}


@pytest.mark.workflow
def test_the_command_that_builds_it_touches_no_other_paper(sapling):
    for folder in ("data/cache", "figures", "report/claims", "logs"):
        assert {path.stem for path in (build_folder(sapling, "smoke") / folder).iterdir()} == {SLUG, SMALL}


@pytest.mark.workflow
def test_they_pass_their_own_tests_and_the_contract_of_all_papers(sapling):
    passes_its_tests_and_the_contract(sapling, SLUG, SMALL)


@pytest.mark.workflow
def test_a_paper_needs_no_figures(scaffolded, tmp_path):
    def edit(name, old, new):
        text, edits = re.subn(old, new, (tree / name).read_text("utf-8"))
        assert edits == 1
        (tree / name).write_text(text, "utf-8")

    tree = shutil.copytree(scaffolded[0], tmp_path / "project", ignore=shutil.ignore_patterns("build", ".cache"))
    edit(f"src/marsedl/papers/{SMALL}/texts.yaml", r"(?s)figures:\n.*?\n\n", "figures:\n\n")
    edit(f"tests/papers/test_{SMALL}.py", r".* import figures\n", "")
    edit(f"tests/papers/test_{SMALL}.py", r" +assert figures\..*\n", "")
    (tree / f"src/marsedl/papers/{SMALL}/figures.py").unlink()
    process = snakemake(tree, SMALL, "--cores", "1", "--config", "size=smoke")
    assert process.returncode == 0, process.stdout[-3000:]
    assert products_of(tree, SMALL)[1] == {"descent.csv", "descent.md", "claims.csv", "claims.md"}
    passes_its_tests_and_the_contract(tree, SMALL)


@pytest.mark.workflow
def test_its_trial_is_flown_again_to_the_last_bit(sapling):
    process = run(sapling, "marsedl.cli", "trial", SLUG, "corrected", "7", "--size", "smoke")
    assert process.returncode == 0, process.stderr
    assert "the same to the last bit" in process.stdout


@pytest.mark.workflow
@pytest.mark.parametrize("slug", [SLUG, SMALL])
def test_an_edit_of_its_equations_reruns_what_its_facts_say(sapling, slug):
    facts = yaml.safe_load((sapling / "tests" / "workflow" / "facts" / f"{slug}.yaml").read_text("utf-8"))["physics"]
    path = sapling / "src" / "marsedl" / facts["file"]
    text = path.read_text("utf-8")
    assert text.count(facts["old"]) == 1
    path.write_text(text.replace(facts["old"], facts["new"]), "utf-8")
    try:
        target = f"report/claims/{slug}.json"
        process = snakemake(sapling, target, "--dry-run", "--quiet", "host", "--cores", "1", "--config", "size=smoke")
    finally:
        path.write_text(text, "utf-8")
    stages = set(re.findall(rf"(?m)^rule {slug}_(\w+):", process.stdout)) - {"claims"}
    assert stages == set(facts["rerun"])


def test_it_keeps_to_the_style_and_is_written_where_papers_are(scaffolded):
    tree, files = scaffolded
    assert all(path.is_file() for path in files)
    python = [str(path) for path in files if path.suffix == ".py"]
    assert len(python) > 20
    for command in (["check", "--no-cache"], ["format", "--check", "--no-cache"]):
        process = run(tree, "ruff", *command, *python)
        assert process.returncode == 0, process.stdout
    assert not [path for path in files if path.suffix == ".smk"], "a new paper adds no rule"
    for path in files:
        text = path.read_text("utf-8")
        assert "{{" not in text
        assert "__slug__" not in text
        assert text.endswith("\n") and not text.endswith("\n\n")


def test_it_and_its_claim_are_explained_before_anything_is_built(tree):
    new_paper(tree, SLUG, TITLE, AUTHORS)
    process = run(tree, "marsedl.cli", "explain", SLUG)
    assert process.stdout.startswith(f"{SLUG}: {TITLE}\n"), process.stderr
    (claim,) = yaml.safe_load((tree / "data" / "published" / f"{SLUG}.yaml").read_text("utf-8"))["claims"]
    process = run(tree, "marsedl.cli", "explain", SLUG, claim["id"])
    assert process.stdout.endswith("\n  no verdict yet: run 'snakemake claims'\n"), process.stderr


def test_it_is_registered_behind_the_other_papers(scaffolded):
    tree, _ = scaffolded
    process = run(tree, "marsedl.cli", "list")
    assert process.returncode == 0, process.stderr
    assert re.findall(r"(?m)^[a-z_]+$", process.stdout)[-1] == SLUG
    assert f"  {TITLE}\n  {AUTHORS}\n" in process.stdout
    for name in re.findall(r"(?<= )[\w/]+\.(?:py|md)", next_steps(SLUG)):
        assert (tree / name).exists() or (ROOT / name).exists(), name


def test_the_same_request_writes_the_same_bytes(tree, scaffolded):
    other, files = scaffolded
    for mine, theirs in zip(write_papers(tree), files, strict=True):
        assert mine.relative_to(tree) == theirs.relative_to(other)
        assert mine.read_bytes() == theirs.read_bytes()


def test_many_papers_fit_into_the_register(tree):
    for slug in ("first_of_the_further_papers", "second_of_the_further_papers"):
        new_paper(tree, slug, TITLE, AUTHORS)
    register = (tree / "src" / "marsedl" / "papers" / "__init__.py").read_text("utf-8")
    assert max(map(len, register.splitlines())) <= 120
    process = run(tree, "marsedl.cli", "list")
    assert re.findall(r"(?m)^[a-z_]+$", process.stdout)[-2:] == [
        "first_of_the_further_papers",
        "second_of_the_further_papers",
    ]


@pytest.mark.parametrize(
    ("slug", "message"),
    [
        ("funnels", "there is a paper 'funnels' already"),
        ("Glide", "at most 40 lower case letters"),
        ("glide-2", "at most 40 lower case letters"),
        ("glide__path", "at most 40 lower case letters"),
        ("../glide", "at most 40 lower case letters"),
        ("class", "at most 40 lower case letters"),
        ("g" * 41, "at most 40 lower case letters"),
        ("", "at most 40 lower case letters"),
        ("powered", "would be taken for 'powered_descent'"),
        ("funnels_again", "would be taken for 'funnels'"),
        ("claims", "is the name of a rule or module"),
        ("figure", "is the name of a rule or module"),
        ("density", "is the name of a rule or module"),
        ("common", "is the name of a rule or module"),
    ],
)
def test_a_name_that_cannot_serve_is_refused_and_nothing_is_written(tree, slug, message):
    before = content(tree)
    with pytest.raises(InputError, match=re.escape(message)):
        new_paper(tree, slug, TITLE, AUTHORS)
    assert content(tree) == before


@pytest.mark.parametrize(
    ("title", "authors", "message"),
    [("", AUTHORS, "title: ''"), ("One\nTwo", AUTHORS, "title"), (TITLE, 'A "B"', "authors")],
)
def test_a_text_that_cannot_serve_is_refused_and_nothing_is_written(tree, title, authors, message):
    before = content(tree)
    with pytest.raises(InputError, match=message):
        new_paper(tree, SLUG, title, authors)
    assert content(tree) == before


def test_no_file_is_overwritten(tree):
    (tree / "configs" / f"{SLUG}.yaml").write_text("mine")
    before = content(tree)
    with pytest.raises(InputError, match=rf"configs/{SLUG}\.yaml exists already"):
        new_paper(tree, SLUG, TITLE, AUTHORS)
    assert content(tree) == before


def test_a_project_without_its_register_is_refused_by_name(tree):
    name = "src/marsedl/papers/__init__.py"
    (tree / name).write_text("")
    with pytest.raises(InputError, match=re.escape(name)):
        new_paper(tree, SLUG, TITLE, AUTHORS)
    (tree / name).unlink()
    with pytest.raises(InputError, match=rf"{re.escape(name)}: cannot be read"):
        new_paper(tree, SLUG, TITLE, AUTHORS)
