"""A new paper from templates: small, complete, and built by the workflow as it stands."""

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
SUFFIX, SLUG = ".j2", "__slug__"
REGISTER = "src/marsedl/papers/__init__.py"
_SLUGS = re.compile(r"(?ms)^SLUGS = (\(.*?\))$")
_LINE = 120


def new_paper(root: Path, slug: str, title: str, authors: str, monte_carlo: bool = True) -> list[Path]:
    """Write a minimal complete paper and register it: its stages, a figure, a table, an erratum and a claim.

    Args:
        root: the project's folder.
        slug: name of the paper in files and targets: lower case letters, digits and underscores.
        title: of the paper.
        authors: of the paper, in one line.
        monte_carlo: whether it flies Monte Carlo trials; without them it has one stage.

    Returns:
        The files that were written, last the register of papers, which was changed.

    Raises:
        InputError: if the name is taken or cannot serve, title or authors are not one line of text, a file exists
            already, or the project does not register its papers where this is expected. Nothing is written then.
    """
    slugs = _registered(root)
    _check_slug(root, slug, slugs)
    for name, text in (("title", title), ("authors", authors)):
        if not text.strip() or not text.isprintable() or set(text) & set('"\\'):
            raise InputError(f"{name}: {text!r} is not one line of text without quotation marks and backslashes")
    values = {
        "monte_carlo": monte_carlo,
        "slug": slug,
        "title": title,
        "authors": authors,
        "model": "".join(word.capitalize() for word in slug.split("_")) + "Inputs",
    }
    files = {root / path: text for path, text in _rendered(values).items()}
    for path in files:
        if path.exists():
            raise InputError(f"{path} exists already; choose another name, or move the file away")
    files[root / REGISTER] = _with_slug(root, (*slugs, slug))
    for path, text in files.items():
        write_text(path, text)
    return list(files)


def next_steps(slug: str) -> str:
    """Return what is left to do for a new paper, one step a line."""
    return "\n".join(
        [
            f"build it:      snakemake {slug} --config size=smoke",
            f"test it:       pytest tests/papers/test_{slug}.py",
            "replace the lander by the paper, file by file: docs/adding-a-paper.md says what belongs where",
            f"tests/papers/conftest.py: a fixture Pipeline('{slug}'), and in REDUCED its sizes that only cost time",
            "when its inputs are as they should be: make schemas",
            "CITATION.cff: add a reference",
            "after a full build that you have looked at, with its line in README.md: marsedl accept",
        ]
    )


def _registered(root: Path) -> tuple[str, ...]:
    """The papers that the project knows."""
    match = _SLUGS.search(_read(root / REGISTER))
    if not match:
        raise InputError(f"{root / REGISTER}: no line 'SLUGS = (...)', in which papers are registered; restore it")
    return ast.literal_eval(match[1])


def _check_slug(root: Path, slug: str, slugs: tuple[str, ...]) -> None:
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", slug) or keyword.iskeyword(slug) or len(slug) > 40:
        raise InputError(
            f"'{slug}' cannot be the name of a paper: use at most 40 lower case letters, digits and single underscores"
        )
    if slug in READ_AS_MISSING:
        raise InputError(f"pandas reads the name '{slug}' in a table as no value; choose another name")
    if slug in slugs:
        raise InputError(f"there is a paper '{slug}' already; choose another name")
    for other_slug in slugs:
        if f"{other_slug}_".startswith(f"{slug}_") or f"{slug}_".startswith(f"{other_slug}_"):
            raise InputError(f"'{slug}' would be taken for '{other_slug}' in the names of rules; choose another name")
    rules = [root / "Snakefile", *sorted((root / "workflow" / "rules").glob("*.smk"))]
    # A rule in a loop has the name that its function yields first.
    names_in_use = {name for path in rules for name in re.findall(r'(?m)^(?:rule | +yield ")(\w+)', _read(path))}
    names_in_use |= {path.stem for path in (root / REGISTER).parent.iterdir()} | {path.stem for path in rules}
    if slug in names_in_use:
        raise InputError(f"'{slug}' is the name of a rule or module already; choose another name")


def _rendered(values: dict[str, str | bool]) -> dict[str, str]:
    """The text of every file by its path in the project; an empty text is no file."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES), undefined=StrictUndefined, keep_trailing_newline=True, trim_blocks=True
    )
    environment.filters["literal"] = _literal
    texts = {name: environment.get_template(name).render(values) for name in environment.list_templates(["j2"])}
    return {name.replace(SLUG, values["slug"]).removesuffix(SUFFIX): text for name, text in texts.items() if text}


def _literal(text: str) -> str:
    """A text as Python source, on several lines where it is long."""
    pieces = textwrap.wrap(text, _LINE - 20, drop_whitespace=False, break_long_words=False)
    return "\n    ".join(json.dumps(piece, ensure_ascii=False) for piece in pieces)


def _with_slug(root: Path, slugs: tuple[str, ...]) -> str:
    line = f"SLUGS = ({', '.join(map(json.dumps, slugs))})"
    if len(line) > _LINE:
        line = "SLUGS = (\n" + "".join(f"    {json.dumps(slug)},\n" for slug in slugs) + ")"
    return _SLUGS.sub(line, _read(root / REGISTER), count=1)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); restore it") from None
