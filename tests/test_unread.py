"""Nothing is written that nothing reads: fields of records, inputs, and functions of the source.

A name counts as read if any module of `src`, a bench or a script of the workflow uses it as a name, an attribute or a
part of a text ("nominal.mass" names a field for a figure), apart from where it is declared. Public functions of the
library also count if the documentation shows them.
"""

import ast
import re
from collections import Counter
from pathlib import Path

from marsedl.papers import SLUGS, input_model

ROOT = Path(__file__).parents[1]
SOURCES = [path for folder in ("src", "bench", "workflow") for path in sorted((ROOT / folder).rglob("*.py"))]
TEXTS = [
    *ROOT.glob("src/**/*.yaml"),
    *ROOT.glob("data/published/*.yaml"),
    *ROOT.glob("src/**/*.j2"),
    *ROOT.glob("workflow/**/*.smk"),
    ROOT / "Snakefile",
]
DOCS = [*ROOT.glob("docs/**/*.md"), *ROOT.glob("docs/**/*.ipynb"), ROOT / "README.md", ROOT / "pyproject.toml"]
# Tests alone read them: the minimum principle, the envelope theorem, what the printed boundary condition designs for.
# Who opens the artifact reads how a path went beyond a fold.
EVIDENCE = {"costate", "path_weight", "noise_density_design", "fold_barrier"}
# Called by name: by the workflow (what a paper draws, tabulates and claims), and by libraries.
CALLED = re.compile(r"src/marsedl/papers/\w+/(figures|tables|claims/.*)\.py|src/marsedl/cli\.py")


def words(text):
    return re.findall(r"[A-Za-z_]\w*", text)


def trees():
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES}


def uses(modules):
    """How often each name is used: as a name, an attribute, an imported name, or a word of a text but a docstring."""
    count = Counter()
    for tree in modules.values():
        docstrings = {
            id(node.body[0].value)
            for node in ast.walk(tree)
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
            and node.body and isinstance(node.body[0], ast.Expr)
        }  # fmt: skip
        for node in ast.walk(tree):
            if isinstance(node, ast.Name | ast.Attribute):
                count[node.id if isinstance(node, ast.Name) else node.attr] += not isinstance(node.ctx, ast.Store)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
                count.update(words(node.value))
            elif isinstance(node, ast.keyword) and getattr(getattr(node.value, "func", None), "id", "") == "Column":
                count[node.arg] += 1  # a column of a table is named like the field
    count.update(word for path in TEXTS for word in words(path.read_text(encoding="utf-8")))
    return count


def declared_fields(modules):
    """Fields of records, whose value is `quantity(...)`: where they are, and their name."""
    for path, tree in modules.items():
        for node in ast.walk(tree):
            call = node.value if isinstance(node, ast.AnnAssign) else None
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "quantity":
                yield f"{path.relative_to(ROOT)}:{node.lineno} {node.target.id}", node.target.id


def test_every_field_of_a_record_is_read():
    """A paper's by the paper or the comparison; statuses of solvers by the report, which knows them by their ending."""
    modules, unread = trees(), []
    for slug in SLUGS:
        own = {path: tree for path, tree in modules.items() if slug in str(path) or "comparison" in str(path)}
        count = uses(own)
        unread += [
            place
            for place, name in declared_fields({path: tree for path, tree in own.items() if slug in path.parts})
            if not count[name] and name not in EVIDENCE and not name.endswith(("_status", "_converged"))
        ]
    assert unread == []


def test_every_input_is_read():
    count = uses(trees())
    names = [(slug, name) for slug in SLUGS for name in input_model(slug).names()]
    assert [f"{slug} {name}" for slug, name in names if not count[name.split(".")[1]]] == []


def test_every_function_is_called():
    modules = trees()
    count = uses(modules)
    count.update(word for path in DOCS for word in words(path.read_text(encoding="utf-8")))
    places = [
        f"{path.relative_to(ROOT)}:{node.lineno} {node.name}"
        for path, tree in modules.items()
        if path.is_relative_to(ROOT / "src") and not CALLED.match(str(path.relative_to(ROOT)))
        for node in tree.body
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not count[node.name]
    ]
    assert places == []
