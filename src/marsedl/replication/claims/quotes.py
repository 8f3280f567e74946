"""Numbers that texts quote by the names of claims: `{prior_final_mass:.2f} kg`, `{euler.prior_final_mass:.2f} kg`.

A quote is a claim, with a reading before it unless it is that of the text. Entries of a vector count from 0:
`{mc_final_mean[1]:.1f}`. `{claim.printed}` is what the paper prints, `{claim.standard_error}` the standard error,
`{claim.margin}` the measure that decides a statement, and `{claim.name}` a number that the claim's reason may quote.
Numbers may be added, subtracted, multiplied and divided, and take a format. Literal braces are doubled.
"""

import ast
import json
import operator
import string
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.numbers import NOT_EVALUATED
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.files import write_text
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.pipeline.catalogue import Erratum, Paper

COMMITTED = Path("data/reference/quotes.json")  # what texts quote of the last accepted build, for the documentation

_OPERATORS = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
_BESIDE = ("value", "standard_error", "trials")  # what can be quoted of every result
_FORM = "write {claim:.2f}, {reading.claim:.2f} or {claim[0]:.2f}, and double literal braces"


class _AbsentError(Exception):
    """A number that this build does not have."""


class _Piece(NamedTuple):
    """Words of a text, and the number after them, if there is one."""

    words: str
    quote: str | None
    number: Callable[["Quotes"], Any] | None
    format: str

    @property
    def written(self) -> str:
        """The quote as it stands between its braces."""
        return f"{self.quote}:{self.format}" if self.format else self.quote or ""


@dataclass(frozen=True)
class Quotes:
    """What texts of a paper can quote.

    `claims` are its rows of verdicts by id, None if there are none yet; `readings` the names of all its readings,
    `reading` the one that the texts are about. A number that was not evaluated is a dash.
    """

    claims: Mapping[str, Claim] | None
    readings: Collection[str]
    reading: str = CORRECTED

    def fill(self, text: str, where: str) -> str:
        """Return a text with its numbers.

        Args:
            text: with quotes in braces.
            where: the place of the text, for messages.

        Raises:
            InputError: a quote is malformed, or names a claim, reading or entry that does not exist.

        """
        try:
            return "".join(piece.words + self._quoted(piece) for piece in pieces(text))
        except ValueError as error:
            raise InputError(f"{where}: {error}") from None

    def look_up(self, names: list[str]) -> Any:
        """Return the number or vector of "reading.claim.standard_error", of which only the claim must be there."""
        first, claims = names[0], names if self.claims is None else self.claims
        of_reading = len(names) > 1 and first in self.readings
        claim, *number_names = names[1:] if of_reading else names
        # Before anything is judged, "a.b" may as well be a number b of a claim a.
        if len(names) > 1 and not of_reading and (claim not in claims or len(number_names) > 1):
            raise ValueError(f"there is no reading '{first}'; {nearest(first, self.readings)}")
        if self.claims is None:
            raise _AbsentError
        if claim not in claims:
            raise ValueError(f"there is no claim '{claim}'; {nearest(claim, claims)}")
        if len(number_names) > 1:
            raise ValueError(f"'{'.'.join(names)}' names more than a claim and a number of it")
        reading = first if of_reading else self.reading
        number = _beside(self.claims[claim], reading, number_names[0] if number_names else "value")
        if number is None:
            raise _AbsentError
        return number

    def _quoted(self, piece: _Piece) -> str:
        if piece.number is None:
            return ""
        try:
            number = piece.number(self)
            if isinstance(number, bool | str | list):
                raise ValueError(f"{number!r} is not a number")
            return format(number, piece.format)
        except _AbsentError:
            return NOT_EVALUATED
        except (ValueError, TypeError, ArithmeticError) as error:
            raise ValueError(f"{{{piece.quote}}}: {error}") from None


def _beside(row: Claim, reading: str, name: str) -> Any:
    """What is quoted of a claim: `printed`, one of `_BESIDE`, `margin`, or a number that its reason may quote."""
    if name == "printed":
        return row.printed
    result = row.readings.get(reading)
    if result is None:
        return None
    if name in _BESIDE:
        return getattr(result, name)
    if name == "margin":
        return result.margin and result.margin.value
    if name not in result.numbers and result.verdict is not None:
        valid_names = ["printed", "margin", *_BESIDE, *result.numbers]
        raise ValueError(f"claim '{row.id}' has no number '{name}'; {nearest(name, valid_names)}")
    return result.numbers.get(name)


@dataclass(frozen=True)
class Committed:
    """Numbers that were accepted with the last full build, as text by the quote as it is written."""

    numbers: Mapping[str, str]

    def fill(self, text: str, where: str) -> str:
        """Return a text with its numbers; raises InputError naming `where` if one was not accepted yet."""
        return "".join(piece.words + self._text(piece, where) for piece in pieces(text))

    def _text(self, piece: _Piece, where: str) -> str:
        if piece.number is None:
            return ""
        if piece.written not in self.numbers:
            raise InputError(
                f"{where}: {COMMITTED} has no {{{piece.written}}}; run 'marsedl accept' after a full build"
            )
        return self.numbers[piece.written]


def committed(root: Path, slug: str) -> Committed:
    """Return the accepted numbers of a paper; raises InputError if the file cannot be read."""
    try:
        return Committed(json.loads((root / COMMITTED).read_text(encoding="utf-8")).get(slug, {}))
    except (OSError, ValueError, AttributeError) as error:
        raise InputError(f"{COMMITTED}: cannot be read ({error!r}); restore it, or run 'marsedl accept'") from None


def accept(root: Path, papers: Mapping[str, tuple[Paper, Quotes]]) -> Path:
    """Commit the numbers that the texts of all papers quote; returns the file."""
    numbers = {slug: numbers_of(*paper) for slug, paper in papers.items()}
    write_text(root / COMMITTED, json.dumps(numbers, indent=1, ensure_ascii=False) + "\n")
    return root / COMMITTED


def numbers_of(paper: Paper, quotes: Quotes) -> dict[str, str]:
    """Return what the texts of a paper quote: the number as text, by the quote as it is written, sorted by it."""
    numbers = {}

    class Gather:
        def fill(self, text: str, where: str) -> str:
            number_quotes = [piece.written for piece in pieces(text) if piece.number]
            numbers.update((quote, quotes.fill(f"{{{quote}}}", where)) for quote in number_quotes)
            return text

    with_numbers(paper, Gather())
    return dict(sorted(numbers.items()))


def with_numbers(paper: Paper, quotes: "Quotes | Committed") -> Paper:
    """Return a catalogue with the numbers of its texts; raises InputError as `Quotes.fill`, naming the text."""

    def fill(text: str, *place: str) -> str:
        return quotes.fill(text, f"{paper.slug}: {' of '.join(place)}")

    def captions(products: Mapping[str, Any]) -> dict[str, Any]:
        return {stem: replace(item, caption=fill(item.caption, "caption", stem)) for stem, item in products.items()}

    def erratum(entry: Erratum) -> Erratum:
        texts = {key: fill(getattr(entry, key), key, entry.id) for key in ("printed", "evidence", "used")}
        return replace(entry, **texts)

    return replace(
        paper,
        figures=captions(paper.figures),
        tables=captions(paper.tables),
        summaries={stem: fill(text, "caption", stem) for stem, text in paper.summaries.items()},
        described={stem: fill(text, "what the paper shows", stem) for stem, text in paper.described.items()},
        errata=tuple(map(erratum, paper.errata)),
        in_short=tuple(fill(text, "sentence", "in_short") for text in paper.in_short),
    )


def by_id(rows: Iterable[Claim] | None) -> dict[str, Claim] | None:
    """Return the rows of a paper's claims by their ids; None if there are none."""
    return None if rows is None else {row.id: row for row in rows}


def pieces(text: str) -> list[_Piece]:
    """Split a text at its quotes; raises ValueError if one is malformed."""
    try:
        return [_Piece(words, quote, quote and _compiled(quote), spec or "") for words, quote, spec in _fields(text)]
    except SyntaxError as error:
        raise ValueError(f"{error.msg}; {_FORM}") from None


def _fields(text: str) -> Iterable[tuple[str, str | None, str | None]]:
    try:
        for words, quote, spec, conversion in string.Formatter().parse(text):
            if quote == "" or conversion:
                raise SyntaxError("a quote names no claim")
            yield words, quote, spec
    except ValueError as error:  # a brace without its partner
        raise SyntaxError(str(error)) from None


def _compiled(quote: str) -> Callable[[Quotes], Any]:
    try:
        return _number(ast.parse(quote.strip(), mode="eval").body)
    except (SyntaxError, RecursionError):
        raise SyntaxError(f"{{{quote}}} is not a number of a claim") from None


def _number(node: ast.expr) -> Callable[[Quotes], Any]:
    match node:
        case ast.Constant(value=int() | float() as number):
            return lambda quotes: number
        case ast.UnaryOp(op=ast.USub(), operand=of):
            inner = _number(of)
            return lambda quotes: -inner(quotes)
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _OPERATORS:
            apply, first, second = _OPERATORS[type(sign)], _number(left), _number(right)
            return lambda quotes: apply(first(quotes), second(quotes))
        case ast.Subscript(value=of, slice=ast.Constant(value=int() as index)):
            vector = _number(of)
            return lambda quotes: _entry(vector(quotes), index)
        case ast.Name() | ast.Attribute() if all(map(str.isidentifier, names := ast.unparse(node).split("."))):
            return lambda quotes: quotes.look_up(names)
    raise SyntaxError


def _entry(vector: Any, index: int) -> Any:
    if not isinstance(vector, list) or index >= len(vector):
        raise ValueError(f"there is no entry {index}; entries of a vector count from 0")
    return vector[index]
