"""A new paper from the templates: it is built as the others are, and nothing is written where it cannot be."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from marsedl.replication.checks.scaffold import new_paper, next_steps
from marsedl.replication.checks.twice import copy_tree
from marsedl.replication.errors import InputError

ROOT = Path(__file__).parents[3]
SLUG, SMALL = "hypersonic_glide", "short_hop"  # with Monte Carlo and without, as the small project has them
TITLE, AUTHORS = "A Title", "A. O'Author and B. Müller"


@pytest.fixture
def tree(tmp_path):
    return copy_tree(ROOT, tmp_path / "project")


def run(tree, *command):
    """Run a command in the tree, with its package."""
    environment = {**os.environ, "PYTHONPATH": str(tree / "src")}
    return subprocess.run(
        [sys.executable, "-m", *command], cwd=tree, env=environment, capture_output=True, text=True, check=False
    )


def content(tree):
    return {path: path.read_bytes() for path in tree.rglob("*") if path.is_file()}


@pytest.mark.workflow
def test_the_workflow_builds_them_and_their_claims_have_verdicts(small):
    for slug, table in ((SLUG, "touchdown"), (SMALL, "descent")):
        assert f"build it:      snakemake {slug} --config size=smoke" in next_steps(slug)
        (row,) = json.loads(small.path(f"report/claims/{slug}.json").read_text("utf-8"))
        assert row["verdict"] == "reproduced"
        assert set(row["readings"]) == {"corrected", "printed"}
        names = {path.name for path in small.path(f"figures/{slug}").iterdir()}
        tables = {f"{stem}.{suffix}" for stem in (table, "claims") for suffix in ("csv", "md")}
        assert names == {"fig01.png", "fig01.pdf", "headline.png", *tables}


@pytest.mark.workflow
def test_their_own_tests_and_the_contract_of_all_papers_pass_also_without_figures(small):
    def edit(name, old, new):
        text, edits = re.subn(old, new, small.path(name).read_text("utf-8"))
        assert edits == 1
        small.path(name).write_text(text, "utf-8")

    contract = Path("tests/replication/pipeline/test_catalogue.py")
    for path in (Path("pyproject.toml"), contract):
        small.path(str(path)).parent.mkdir(parents=True, exist_ok=True)
        small.path(str(path)).write_bytes((ROOT / path).read_bytes())
    edit(f"src/marsedl/papers/{SMALL}/texts.yaml", r"(?s)figures:\n.*?\n\n", "figures:\n\n")
    edit(f"tests/papers/test_{SMALL}.py", r".* import figures\n", "")
    edit(f"tests/papers/test_{SMALL}.py", r" +assert figures\..*\n", "")
    small.path(f"src/marsedl/papers/{SMALL}/figures.py").unlink()
    assert small.plan(SMALL).files.isdisjoint({f"figures/{SMALL}/fig01.png"})
    selected = ["-k", f"{SLUG} or {SMALL}", "-vv", "-p", "no:cacheprovider", "-o", "addopts=--import-mode=importlib"]
    process = run(small.folder, "pytest", "tests", *selected)
    assert process.returncode == 0, process.stdout[-3000:]
    for slug in (SLUG, SMALL):
        own = f"tests/papers/test_{slug}.py::test_every_claim_has_the_verdict_that_is_expected"
        assert f"{own} PASSED" in process.stdout
        assert f"::test_every_paper_has_the_files_that_its_catalogue_asks_for[{slug}] PASSED" in process.stdout


@pytest.mark.workflow
def test_its_trial_is_flown_again_to_the_last_bit(small):
    process = small.marsedl("trial", SLUG, "corrected", "7", "--size", "smoke")
    assert process.returncode == 0, process.stderr
    assert "the same to the last bit" in process.stdout


@pytest.mark.workflow
def test_an_edit_of_its_equations_reruns_what_its_facts_say(small):
    targets = []
    for slug in (SLUG, SMALL):
        facts = yaml.safe_load(small.path(f"tests/workflow/facts/{slug}.yaml").read_text("utf-8"))["physics"]
        small.edit(f"src/marsedl/{facts['file']}", facts["old"], facts["new"])
        targets += [(slug, stage) for stage in facts["rerun"]]
    plan = small.plan(*(f"report/claims/{slug}.json" for slug in (SLUG, SMALL)))
    artifacts = [Path(path) for path in plan.files if path.startswith("data/cache/")]
    assert {(path.parts[2], path.stem.partition(".")[0]) for path in artifacts} == set(targets)


def test_it_keeps_to_the_style_and_is_written_where_papers_are(tree):
    files = [*new_paper(tree, SMALL, TITLE, AUTHORS, monte_carlo=False), *new_paper(tree, SLUG, TITLE, AUTHORS)]
    assert all(path.is_file() for path in files)
    python = [str(path) for path in files if path.suffix == ".py"]
    assert len(python) > 20
    (tree / "pyproject.toml").write_bytes((ROOT / "pyproject.toml").read_bytes())
    for command in (["check", "--no-cache"], ["format", "--check", "--no-cache"]):
        process = run(tree, "ruff", *command, *python)
        assert process.returncode == 0, process.stdout
    assert not [path for path in files if path.suffix == ".smk"], "a new paper adds no rule"
    for path in files:
        text = path.read_text("utf-8")
        assert "{{" not in text
        assert "__slug__" not in text
        assert text.endswith("\n") and not text.endswith("\n\n")
    for name in re.findall(r"(?<= )[\w/]+\.(?:py|md)", next_steps(SLUG)):
        assert (tree / name).exists() or (ROOT / name).exists(), name


def test_it_is_registered_behind_the_other_papers_and_explained_before_anything_is_built(tree):
    for slug in ("first_of_the_further_papers", SLUG):
        new_paper(tree, slug, TITLE, AUTHORS)
    register = (tree / "src" / "marsedl" / "papers" / "__init__.py").read_text("utf-8")
    assert max(map(len, register.splitlines())) <= 120
    process = run(tree, "marsedl.cli", "list")
    assert re.findall(r"(?m)^[a-z_]+$", process.stdout)[-2:] == ["first_of_the_further_papers", SLUG]
    (claim,) = yaml.safe_load((tree / "data" / "published" / f"{SLUG}.yaml").read_text("utf-8"))["claims"]
    process = run(tree, "marsedl.cli", "explain", SLUG, claim["id"])
    assert process.stdout.endswith(f"\n  no verdict yet: run 'snakemake report/claims/{SLUG}.json'\n"), process.stderr


REFUSED = {
    "at most 40 lower case letters": ("Glide", "glide-2", "glide__path", "../glide", "class", "g" * 41, ""),
    "is the name of a paper, rule or module": ("funnels", "claims", "figure", "density", "common"),
}
TEXTS = [("", AUTHORS, "title: ''"), ("One\nTwo", AUTHORS, "title"), (TITLE, 'A "B"', "authors")]


def test_what_cannot_serve_is_refused_and_nothing_is_written_or_overwritten(tree):
    (tree / "configs" / f"{SLUG}.yaml").write_text("mine")
    before = content(tree)
    cases = [(slug, TITLE, AUTHORS, message) for message, slugs in REFUSED.items() for slug in slugs]
    cases += [(SMALL, *texts) for texts in TEXTS]
    cases += [(SLUG, TITLE, AUTHORS, f"configs/{SLUG}.yaml exists already")]
    for slug, title, authors, message in cases:
        with pytest.raises(InputError, match=re.escape(message)):
            new_paper(tree, slug, title, authors)
    assert content(tree) == before


def test_a_project_without_its_register_is_refused_by_name(tree):
    name = "src/marsedl/papers/__init__.py"
    (tree / name).write_text("")
    with pytest.raises(InputError, match=re.escape(name)):
        new_paper(tree, SLUG, TITLE, AUTHORS)
