"""A new paper from templates: small, complete, and built by the workflow as it is."""

import ast
import json
import keyword
import re
import textwrap
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from marsedl.replication.errors import InputError
from marsedl.replication.files import write_text
from marsedl.replication.inputs.written import READ_AS_MISSING

TEMPLATES = Path(__file__).with_name("templates_paper")  # laid out as the project is
REGISTER = "src/marsedl/papers/__init__.py"
_SLUGS = re.compile(r"(?ms)^SLUGS = (\(.*?\))$")


def new_paper(root: Path, slug: str, title: str, authors: str, monte_carlo: bool = True) -> list[Path]:
    """Write a minimal complete paper and register it: its stages, a figure, a table, an erratum and a claim.

    Returns the files that were written, last the register of papers, which was changed. Raises InputError, and writes
    nothing, if the name is taken or cannot serve, if title or authors are not one line of text, or if a file exists.
    """
    register = root / REGISTER
    text = register.read_text(encoding="utf-8")
    if not (match := _SLUGS.search(text)):
        raise InputError(f"{register}: no line 'SLUGS = (...)', in which papers are registered; restore it")
    slugs = ast.literal_eval(match[1])
    _check_slug(root, slug)
    for name, line in (("title", title), ("authors", authors)):
        if not line.strip() or not line.isprintable() or set(line) & set('"\\'):
            raise InputError(f"{name}: {line!r} is not one line of text without quotation marks and backslashes")

    templates = Environment(
        loader=FileSystemLoader(TEMPLATES), undefined=StrictUndefined, keep_trailing_newline=True, trim_blocks=True
    )
    templates.filters["literal"] = _literal
    values = {"monte_carlo": monte_carlo, "slug": slug, "title": title, "authors": authors}
    files = {}
    for name in templates.list_templates(["j2"]):
        if content := templates.get_template(name).render(values):  # an empty text is no file
            path = root / name.replace("__slug__", slug).removesuffix(".j2")
            files[path] = content
            if path.exists():
                raise InputError(f"{path} exists already; choose another name, or move the file away")
    lines = "".join(f"    {json.dumps(name)},\n" for name in (*slugs, slug))
    files[register] = _SLUGS.sub(f"SLUGS = (\n{lines})", text, count=1)
    for path, content in files.items():
        write_text(path, content)
    return list(files)


def next_steps(slug: str) -> str:
    """Return what is left to do for a new paper, one step a line."""
    return f"""\
build it:      snakemake {slug} --config size=smoke
read verdicts: marsedl explain {slug} --size smoke
test it:       pytest tests/papers/test_{slug}.py
replace the lander by the paper, file by file: docs/adding-a-paper.md says what belongs where
tests/papers/conftest.py: a fixture Pipeline('{slug}'), and in REDUCED its sizes that only cost time
CITATION.cff: add a reference
after a full build that you have looked at, with its line in README.md: marsedl accept"""


def _check_slug(root: Path, slug: str) -> None:
    rules = [root / "Snakefile", *(root / "workflow" / "rules").glob("*.smk")]
    # Some rules of a loop have the name that a function yields first.
    taken = {name for path in rules for name in re.findall(r'(?m)^(?:rule | +yield ")(\w+)', path.read_text("utf-8"))}
    taken |= {path.stem for path in [*rules, *(root / REGISTER).parent.iterdir()]}
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", slug) or keyword.iskeyword(slug) or len(slug) > 40:
        problem = "cannot be the name of a paper: use at most 40 lower case letters, digits and single underscores"
    elif slug in READ_AS_MISSING:
        problem = "is read by pandas in a table as no value; choose another name"
    elif slug in taken:
        problem = "is the name of a paper, rule or module already; choose another name"
    else:
        return
    raise InputError(f"'{slug}' {problem}")


def _literal(text: str) -> str:
    """A text as Python source, on several lines where it is long."""
    pieces = textwrap.wrap(text, 100, drop_whitespace=False, break_long_words=False)
    return "\n    ".join(json.dumps(piece, ensure_ascii=False) for piece in pieces)
