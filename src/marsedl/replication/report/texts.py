"""The words of a paper that are not computed, from its `texts.yaml`: captions, what its figures show, errata."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, StringConstraints, field_validator

from marsedl.replication.claims.quotes import quotes_in
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.inputs.messages import Keys, Place, checked
from marsedl.replication.inputs.yaml_file import read_yaml
from marsedl.replication.pipeline.catalogue import TEXTS, Erratum, Paper, Product


def _with_quotes(text: str) -> str:
    quotes_in(text)  # well-formed; what they name is looked up when they are filled
    return text


def _without_quotes(text: str) -> str:
    if "{" in text:
        raise ValueError("no numbers are quoted here; write it without braces")
    return text


Words = Annotated[str, StringConstraints(strict=True, strip_whitespace=True, min_length=1)]
Text = Annotated[Words, AfterValidator(_with_quotes)]
Plain = Annotated[Words, AfterValidator(_without_quotes)]


class _Table(Keys):
    caption: Text
    beyond: bool = False


class _Figure(_Table):
    shows: Annotated[str, AfterValidator(_with_quotes)] = ""
    claims: tuple[Words, ...] = ()
    shape: tuple[Words, ...] = ()
    not_comparable: Plain | Literal[""] = ""


class _Erratum(Keys):
    printed: Text
    evidence: Text
    used: Text
    title: Plain = ""


class _Texts(Keys):
    figures: dict[str, _Figure]
    tables: dict[str, _Table] = Field({})
    errata: dict[str, _Erratum] = Field({})

    @field_validator("figures", "tables", "errata", mode="before")
    @classmethod
    def _none_of_them(cls, value):
        return {} if value is None else value

    question: Plain = ""
    in_short: tuple[Text, ...] = ()
    found: dict[str, Text] = Field({})
    beside: dict[Plain, dict[Plain, Plain]] = Field({})
    unmarked: dict[Words, Plain] = Field({})


class _Compared(Keys):
    figure: Plain
    table: Plain


def with_texts(paper: Paper, path: Path) -> Paper:
    """Return a catalogue with its words from `texts.yaml`; its figures and tables are those that have any.

    Raises InputError, which names file, line and key, if the file is missing or malformed.
    """
    document = read_yaml(path)
    texts = checked(_Texts, document, Place(str(path), document))
    for stem, figure in texts.figures.items():
        about = (*figure.shape, *figure.claims)
        if bool(about) == bool(figure.not_comparable) and not figure.beyond and figure.shows:
            remedy = "name the claims about it, or say under not_comparable why there are none"
            raise InputError(f"{path}: figures.{stem}: {'has both' if about else 'no likeness'}; {remedy}")
    declared = {
        "figures": {
            stem: Product(**one.model_dump(exclude={"shows"}) | {"claims": (*one.shape, *one.claims)})
            for stem, one in texts.figures.items()
        },
        "described": {stem: figure.shows for stem, figure in texts.figures.items() if figure.shows},
        "tables": {stem: Product(**dict(table)) for stem, table in texts.tables.items()},
        "errata": tuple(Erratum(name, **dict(erratum)) for name, erratum in texts.errata.items()),
    }
    return replace(paper, **dict(texts) | declared)


def check_found(paper: Paper, headline: Collection[str]) -> None:
    """Raise InputError unless the texts of a paper say of each headline claim, and of no other one, what came out."""
    where = f"src/marsedl/papers/{paper.slug}/{TEXTS}: found"
    if other := sorted(paper.found.keys() - set(headline)):
        raise InputError(f"{where}: '{other[0]}' is no headline claim; {nearest(other[0], headline)}")
    if missing := [name for name in headline if name not in paper.found]:
        raise InputError(f"{where}: nothing on the headline claim '{missing[0]}'; write a clause with its numbers")


def comparison_texts(path: Path) -> dict[str, tuple[str, str]]:
    """Return the captions of the figure and the table of each comparison; raises InputError as `with_texts`."""
    document = read_yaml(path)
    place = Place(str(path), document)
    texts = {name: checked(_Compared, entry, place / name) for name, entry in document.items()}
    return {name: (entry.figure, entry.table) for name, entry in texts.items()}
