"""The project's shape: catalogues that fit their modules, and a workflow that keeps its own rules."""

import ast
import inspect
import re
import shutil
import subprocess
from importlib import import_module
from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue, input_model

ROOT = Path(__file__).parents[2]
RULES = sorted((ROOT / "workflow" / "rules").glob("*.smk"))
SCRIPTS = sorted((ROOT / "workflow" / "scripts").glob("*.py"))
FILES_OF_EVERY_PAPER = {"__init__.py", "inputs.py", "claims.py"}
STAGES_OF_CASES = {"montecarlo", "montecarlo_chunk", "montecarlo_gather"}
SCIENCE = ("numpy", "scipy", "numba", "casadi", "cvxpy", "matplotlib", "h5py")


def parameters(function) -> set[str]:
    return set(inspect.signature(function).parameters)


@pytest.mark.parametrize("slug", SLUGS)
def test_every_paper_has_the_files_that_its_catalogue_asks_for(slug):
    paper, folder = catalogue(slug), ROOT / "src" / "marsedl" / "papers" / slug
    products = {"figures.py": paper.figures, "tables.py": {**paper.tables, **paper.summaries}}
    products["closeups.py"] = paper.closeups
    asked = FILES_OF_EVERY_PAPER | {name for name, stems in products.items() if stems}
    asked |= {f"{paper.entry(stage).split(':')[0].rpartition('.')[2]}.py" for stage in paper.stages}
    present = {path.name for path in folder.glob("*.py")}
    assert present >= asked
    assert not present & (products.keys() - asked), "the catalogue names nothing of this file"
    for name in ("configs", "data/published"):
        assert (ROOT / name / f"{slug}.yaml").exists()
    assert STAGES_OF_CASES & set(paper.stages) == (STAGES_OF_CASES if input_model(slug).CASES else set())


@pytest.mark.parametrize("slug", SLUGS)
def test_stages_products_and_functions_belong_together(slug):
    paper, fields = catalogue(slug), set(input_model(slug).model_fields)
    for name, stage in paper.stages.items():
        module, function = paper.entry(name).split(":")
        assert {need.split(".")[-1] for need in stage.needs} <= parameters(getattr(import_module(module), function))
        assert set(stage.inputs) <= fields
        assert {need.split(".")[0] for need in stage.needs} <= set(paper.stages)
        assert stage.meaning
    for kind, products in (("figures", paper.figures), ("tables", paper.tables)):
        for stem, product in products.items():
            function = getattr(import_module(f"marsedl.papers.{slug}.{kind}"), stem)
            assert {need.split(".")[-1] for need in product.needs} <= parameters(function)
            assert set(product.inputs) <= fields
            assert product.caption
    for stem, needs in paper.closeups.items():
        function = getattr(import_module(f"marsedl.papers.{slug}.closeups"), stem)
        assert {need.split(".")[-1] for need in needs} == parameters(function)
        assert {need.split(".")[0] for need in needs} <= set(paper.stages)
    assert set(paper.described) == {stem for stem, figure in paper.figures.items() if not figure.beyond}
    assert all(text.endswith(".") for text in paper.described.values())
    assert not set(paper.figures) & {*paper.tables, *paper.summaries, "claims"}, "a name in the report stands once"
    assert set(input_model(slug).CASES.values()) <= fields
    assert len({erratum.id for erratum in paper.errata}) == len(paper.errata)


@pytest.mark.parametrize("slug", SLUGS)
def test_no_two_products_have_one_name(slug):
    """The catalogue, the logs and the report know figures and tables by their names alone."""
    paper = catalogue(slug)
    names = [*paper.figures, *paper.tables, *paper.summaries, "claims"]
    assert not {name for name in names if names.count(name) > 1}


@pytest.mark.parametrize("slug", SLUGS)
def test_every_figure_function_is_in_the_catalogue(slug):
    paper = catalogue(slug)
    for kind, known in (("figures", paper.figures), ("tables", {**paper.tables, **paper.summaries})):
        if not known:
            continue
        module = import_module(f"marsedl.papers.{slug}.{kind}")
        drawn = {
            name
            for name, function in inspect.getmembers(module, inspect.isfunction)
            if function.__module__ == module.__name__ and re.match(r"fig\d|tab\d|eq\d", name)
        }
        assert drawn <= set(known)


@pytest.mark.parametrize("slug", SLUGS)
def test_the_default_reading_and_the_printed_one_exist(slug):
    text = (ROOT / "configs" / f"{slug}.yaml").read_text(encoding="utf-8")
    assert re.search(r"(?m)^  printed:\n    frozen: ", text)
    assert re.search(r"(?m)^  corrected:\n", text)


def rules_of(path) -> dict[str, str]:
    """Bodies of the rules of a file, by name or position."""
    parts = re.split(r"(?m)^ *(?:rule\s*(\w*)\s*:|use rule \w+ as (\w+) with:)\n", path.read_text(encoding="utf-8"))
    return {
        a or b or f"{path.stem} {k}": body for k, (a, b, body) in enumerate(zip(*[iter(parts[1:])] * 3, strict=True))
    }


@pytest.mark.parametrize("path", [*RULES, ROOT / "Snakefile"], ids=lambda path: path.name)
def test_every_rule_has_a_log_and_none_runs_python_itself(path):
    text = path.read_text(encoding="utf-8")
    assert not re.search(r"(?m)^\s*(run:|checkpoint\b)", text)
    assert "directory(" not in text
    for name, body in rules_of(path).items():
        if re.search(r"(?m)^ +(script|shell|output):", body):
            assert re.search(r"(?m)^ +log:", body), f"rule {name} of {path.name} has no log"


def test_rules_are_found():
    stages = {"stages 0", "stages 1"}  # of a paper, and of each of its stages; the audit asks for them by name
    assert {"figure", "default_figure", "verify", *stages} <= {name for path in RULES for name in rules_of(path)}


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_scripts_are_short_and_hold_no_science(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 25
    tree = ast.parse(text)
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    for name in imported:
        assert name.split(".")[0] not in SCIENCE
        assert not name.startswith(("marsedl.models", "marsedl.methods", "marsedl.montecarlo"))
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.Lambda | ast.While)]
    assert "guarded(snakemake)" in text


def test_imports_keep_to_the_layers():
    command = shutil.which("lint-imports")
    assert command, "import-linter is part of the development environment"
    done = subprocess.run([command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "0 broken" in done.stdout
