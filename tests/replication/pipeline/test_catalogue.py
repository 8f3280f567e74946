"""The project's shape: catalogues that fit their modules, and a workflow that keeps its own rules."""

import ast
import re
from importlib import import_module
from pathlib import Path
from typing import get_type_hints

import pytest

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.inputs.sections import Section

ROOT = Path(__file__).parents[3]
SCRIPTS = sorted((ROOT / "workflow" / "scripts").glob("*.py"))
FILES_OF_EVERY_PAPER = {"__init__.py", "inputs.py"}
SCIENCE = r"(numpy|scipy|numba|casadi|cvxpy|matplotlib|h5py|marsedl\.(models|methods|montecarlo))\b"


@pytest.mark.parametrize("slug", SLUGS)
def test_every_paper_has_the_files_that_its_catalogue_asks_for(slug):
    paper, folder = catalogue(slug), ROOT / "src" / "marsedl" / "papers" / slug
    products = {"figures.py": paper.figures, "tables.py": paper.tables}
    needed = FILES_OF_EVERY_PAPER | {name for name, stems in products.items() if stems}
    entries = [entry for stage in paper.stages.values() for entry in stage.entries]
    modules = [entry.partition(":")[0].removeprefix(f"marsedl.papers.{slug}.") for entry in entries]
    needed |= {f"{module.replace('.', '/')}.py" for module in modules}
    present = {path.relative_to(folder).as_posix() for path in folder.rglob("*.py")}
    assert present >= needed
    assert (folder / "claims" / "__init__.py").exists()
    assert not present & (products.keys() - needed), "the catalogue names nothing of this file"
    for name in ("configs", "data/published"):
        assert (ROOT / name / f"{slug}.yaml").exists()
    assert ("montecarlo" in paper.stages) == bool(input_model(slug).CASES)


@pytest.mark.parametrize("slug", SLUGS)
def test_stages_products_and_functions_belong_together(slug):
    paper, model = catalogue(slug), input_model(slug)
    for stage in paper.stages.values():
        *_, last = (getattr(import_module(m), f) for m, f in (entry.split(":") for entry in stage.entries))
        assert get_type_hints(last)["return"].__name__ in vars(import_module(last.__module__))
        assert set(stage.inputs) <= set(model.names())
        assert stage.meaning
        assert set(stage.claimed_in) <= set(load_study(slug, model, ROOT).readings)
    for stem in (*paper.figures, *paper.tables):
        assert paper.product(stem).caption
        assert set(paper.product(stem).inputs) <= set(model.names())
    assert set(paper.described) == {stem for stem, figure in paper.figures.items() if not figure.beyond}
    assert not set(paper.figures) & {*paper.tables, "claims"}, "a name in the report stands once"
    assert set(model.CASES.values()) <= set(model.names())


@pytest.mark.parametrize("slug", SLUGS)
def test_the_first_table_of_a_job_takes_all_artifacts_and_none_waits_for_flights_of_another(slug):
    """A reading may lack a case, and has the other tables nevertheless."""
    paper = catalogue(slug)
    jobs = paper.tables_by_job()
    assert sorted(stem for stems in jobs for stem in stems) == sorted(paper.tables)
    for first, *others in ([paper.tables[stem] for stem in stems] for stems in jobs):
        for one in others:
            assert {*one.needs} <= {*first.needs} and bool(one.needs) == bool(first.needs)
            flights = {need for need in (*first.needs, *first.optional) if need.startswith("montecarlo.")}
            assert flights <= {*one.needs, *one.optional} and one.optional == first.optional


def test_scripts_are_short_and_hold_no_science():
    for path in SCRIPTS:
        text = path.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= 26
        nodes = list(ast.walk(ast.parse(text)))
        imported = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        imported |= {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
        assert not [name for name in imported if re.match(SCIENCE, name)]
        assert not [node for node in nodes if isinstance(node, ast.FunctionDef | ast.Lambda | ast.While)]
        assert "guarded(snakemake)" in text


# ------------------------------------------------------------------------------------- what functions read of sections

READERS = sorted(path for part in ("papers", "comparison") for path in (ROOT / "src" / "marsedl" / part).rglob("*.py"))
SECTIONS = {
    of.__name__: name for slug in SLUGS for name, of in input_model(slug).sections().items() if name != "inputs"
} | {"Inputs": "given"}  # which holds all of them


def functions_of(path) -> list[ast.FunctionDef]:
    return [node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.FunctionDef)]


def sections_taken(function) -> dict[str, str]:
    """The parameters of a function that are annotated as sections, with the names of these."""
    sections = {}
    for argument in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs):
        annotated = ast.unparse(argument.annotation).rpartition(".")[2] if argument.annotation else ""
        if annotated in SECTIONS:
            sections[argument.arg] = SECTIONS[annotated]
    return sections


def test_what_is_read_of_a_section_can_be_followed():
    """A parameter that is a section has its name, and is used as `name.field` or as an argument alone."""
    for function in (function for path in READERS for function in functions_of(path)):
        sections = sections_taken(function)
        assert sections == {name: name for name in sections}, f"{function.name}: a section under another name"
        followed = set()
        for node in ast.walk(function):
            if isinstance(node, ast.Attribute):
                followed.add(id(node.value))
            if isinstance(node, ast.Call) and ast.unparse(node.func) not in ("getattr", "vars", "hasattr"):
                followed |= {id(a) for a in (*node.args, *(keyword.value for keyword in node.keywords))}
        names = [n for n in ast.walk(function) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)]
        lost = [n for n in names if n.id in sections and id(n) not in followed]
        assert not lost, f"{function.name}, line {lost[0].lineno}: {lost[0].id} is passed on where nothing follows it"


def test_sections_hold_inputs_alone():
    """A property would hide what is read of a section; no two sections have an input of one name."""
    for slug in SLUGS:
        names = [name.partition(".")[2] for name in input_model(slug).names()]
        assert len(names) == len({*names}), slug
        for of in input_model(slug).sections().values():
            members = {name for kind in of.__mro__ if kind not in Section.__mro__ for name in vars(kind)}
            members = {name for name in members if not name.startswith("_") and name not in of.model_fields}
            assert not members - {"model_config", "model_fields", "model_computed_fields", "CASES"}, (
                f"{slug}: {of.__name__}"
            )


@pytest.mark.parametrize("slug", SLUGS)
def test_no_class_but_the_section_has_its_name(slug):
    """What is read of a parameter is found by the name of its annotation."""
    names = {of.__name__ for name, of in input_model(slug).sections().items() if name != "inputs"}
    for path in (ROOT / "src" / "marsedl" / "papers" / slug).glob("*.py"):
        defined = {n.name for n in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(n, ast.ClassDef)}
        assert path.name == "inputs.py" or not defined & names, path.name
