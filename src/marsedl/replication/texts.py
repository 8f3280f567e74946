"""The words of a paper that are not computed, from its `texts.yaml`: captions, what its figures show, errata."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, StringConstraints, ValidationError

from marsedl.replication.catalogue import Erratum, Paper, Product
from marsedl.replication.errors import InputError, nearest, shown
from marsedl.replication.quotes import pieces
from marsedl.replication.strict_yaml import Lined, read_yaml

FILE = "texts.yaml"  # in the folder of a paper, and in that of the comparisons


def _mapping(value: Any) -> Any:
    """Read a key without entries as an empty mapping."""
    return {} if value is None else value


def _with_quotes(text: str) -> str:
    """A text whose quotes of numbers are well-formed; what they name is looked up when they are filled."""
    pieces(text)
    return text


def _without_quotes(text: str) -> str:
    if "{" in text:
        raise ValueError("no numbers are quoted here; write it without braces")
    return text


Words = Annotated[str, StringConstraints(strict=True, strip_whitespace=True, min_length=1)]
Text = Annotated[Words, AfterValidator(_with_quotes)]
Plain = Annotated[Words, AfterValidator(_without_quotes)]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", defer_build=True)


class _Table(_Entry):
    caption: Text
    beyond: bool = False


class _Figure(_Table):
    shows: Annotated[str, AfterValidator(_with_quotes)] = ""


class _Erratum(_Entry):
    printed: Text
    evidence: Text
    used: Text
    title: Plain = ""
    kept_by: tuple[Words, ...] = ()


class _Texts(_Entry):
    figures: Annotated[dict[str, _Figure], BeforeValidator(_mapping)]
    tables: Annotated[dict[str, _Table], BeforeValidator(_mapping)] = {}
    over_readings: Annotated[dict[str, Text], BeforeValidator(_mapping)] = {}
    errata: Annotated[dict[str, _Erratum], BeforeValidator(_mapping)] = {}
    question: Plain = ""
    in_short: tuple[Text, ...] = ()
    picture: str = ""


class _Compared(_Entry):
    figure: Plain
    table: Plain


def with_texts(paper: Paper, path: Path) -> Paper:
    """Return a catalogue with its words; its figures and tables are those that have any.

    Args:
        paper: the catalogue as its package writes it.
        path: its `texts.yaml`.

    Raises:
        InputError: the file is missing or malformed; the message names file, line and key.

    """
    texts = _read(path, _Texts)
    return replace(
        paper,
        figures={stem: Product(figure.caption, figure.beyond) for stem, figure in texts.figures.items()},
        described={stem: figure.shows for stem, figure in texts.figures.items() if figure.shows},
        tables={stem: Product(table.caption, table.beyond) for stem, table in texts.tables.items()},
        summaries=dict(texts.over_readings),
        errata=tuple(Erratum(name, **dict(erratum)) for name, erratum in texts.errata.items()),
        question=texts.question,
        in_short=texts.in_short,
        picture=texts.picture,
    )


def comparison_texts(path: Path) -> dict[str, tuple[str, str]]:
    """Return the captions of the figure and the table of each comparison; raises InputError as `with_texts`."""
    document = read_yaml(path)
    if not isinstance(document, dict) or not document:
        raise InputError(f"{path}: expected comparisons with the captions of a figure and a table")
    return {name: tuple(dict(_checked(path, entry, _Compared, [name])).values()) for name, entry in document.items()}


def _read(path: Path, model: type[BaseModel]) -> Any:
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise InputError(f"{path}: expected the keys {', '.join(model.model_fields)}")
    return _checked(path, document, model, [])


def _checked(path: Path, document: Any, model: type[BaseModel], place: list[str]) -> Any:
    try:
        return model.model_validate(document)
    except ValidationError as error:
        # First an unknown key: it may be the missing one, misspelt.
        first = min(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
        keys = list(first["loc"])
        line_number, fields = _line_and_fields(document, keys, model)
        problem = {
            "extra_forbidden": f"unknown key; {nearest(keys[-1], fields)}",
            "missing": "is missing; write it",
        }.get(first["type"], first["msg"].removeprefix("Value error, "))
        line = f":{line_number}" if line_number else ""
        raise InputError(f"{path}{line}: key {shown('.'.join([*place, *map(str, keys)]))}: {problem}") from None


def _line_and_fields(document: Any, keys: list[str], model: type[BaseModel]) -> tuple[int | None, list[str]]:
    """The line of the innermost key that is there, and the fields that its place may have."""
    line, fields = None, list(model.model_fields)
    for number, key in enumerate(keys):
        if not isinstance(document, Lined) or key not in document:
            break
        line, document = document.lines[key], document[key]
        if number == 0 and key in _Texts.model_fields and len(keys) > 2:
            entry = {"figures": _Figure, "tables": _Table, "errata": _Erratum}.get(key)
            fields = list(entry.model_fields) if entry else fields
    return line, fields
