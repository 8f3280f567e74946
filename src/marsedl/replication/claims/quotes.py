"""Numbers that texts quote by name: `{claim:.2f} kg`, `{reading.claim:.2f}`, `{claim.number:.1%}`, `{claim[0]:.1f}`.

A quote names a claim, after a reading unless it is that of the text. A name behind the claim is another number of it:
`printed`, `standard_error`, `trials`, `margin` (the measure that decides, with `margin.limit`, `margin.standard_error`)
or one that the claim's function names. In the reason of a claim the claim itself is left out: `{value:.2f}`,
`{number:.2f}`, `{reading.number:.2f}`. Entries of a vector count from 0. The format is Python's; `%` makes a share
98.2 %. A number that this build does not have is a dash. Literal braces are doubled. Nothing is calculated: what a text
needs is a number that the claim's function names.
"""

import json
import re
import string
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.numbers import NOT_EVALUATED
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.files import write_text
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.pipeline.catalogue import Erratum, Paper, Product

ACCEPTED = Path("data/reference/quotes.json")  # what texts quote of the last accepted build, for the documentation
_QUOTE = re.compile(r"[A-Za-z]\w*(\.\w+|\[\d+\])*")


def quotes_in(text: str) -> list[tuple[str, str]]:
    """Split a text into pairs of words and the quote behind them, "" behind the last; raises ValueError."""
    pairs = []
    for words, quote, form, conversion in string.Formatter().parse(text):
        if quote is not None and (conversion or not _QUOTE.fullmatch(quote)):
            raise ValueError(f"{{{quote}}} names no claim; write {{claim:.2f}}, and double literal braces")
        pairs.append((words, f"{quote}:{form}" if form else quote or ""))
    return pairs


def with_numbers_of_a_claim(reason: str, numbers: Mapping[str, Mapping[str, Any] | None], reading: str) -> str:
    """Return the reason of a claim with its numbers; raises ValueError if one does not exist.

    numbers: those of the claim by reading and name, None for a reading without any; reading: that which is not named.
    """
    readings = {name: _absent() if of_reading is None else of_reading for name, of_reading in numbers.items()}
    if both := readings.keys() & readings[reading].keys():
        raise ValueError(f"'{min(both)}' is the name of a reading and of a number")
    return _filled(reason, partial(_number, readings[reading] | readings))


@dataclass(frozen=True)
class Quotes:
    """What texts of a paper can quote: the number as text, by the quote as it is written.

    `claims` are its verdicts, None if there are none yet; `readings` the names of all its readings, `reading` the one
    that the texts are about.
    """

    claims: Iterable[Claim] | None
    readings: Collection[str]
    reading: str = CORRECTED

    def __getitem__(self, quote: str) -> str:
        """Return a number as text; raises ValueError if it does not exist."""
        return _number(self._names, quote)

    @cached_property
    def _names(self) -> Mapping[str, Any]:
        if self.claims is None:
            return defaultdict(_absent, {name: defaultdict(_absent) for name in self.readings})
        of = {name: {row.id: _numbers(row, name) for row in self.claims} for name in {*self.readings, self.reading}}
        return of | of[self.reading]


def _absent() -> defaultdict[str, Any]:
    """What can be quoted of a claim that has no numbers: whatever is named is None."""
    return defaultdict(lambda: None, margin=defaultdict(lambda: None))


def _numbers(row: Claim, reading: str) -> Mapping[str, Any]:
    """What can be quoted of a claim; a number that only another reading has is None."""
    result, printed = row.readings.get(reading), {"printed": row.printed}
    if result is None or result.verdict is None:
        return _absent() | printed
    numbers = {name: None for other in row.readings.values() for name in other.numbers}
    always = {name: getattr(result, name) for name in ("value", "standard_error", "trials")}
    margin = result.margin.model_dump() if result.margin else defaultdict(lambda: None)
    return numbers | result.numbers | always | printed | {"margin": margin}


def _number(names: Mapping[str, Any], quote: str) -> str:
    """Return the number that a quote leads to, as text; raises ValueError if it does not exist.

    names: by name a number, a vector, None for what this build does not have, or more names, with `value` if none
    follows.
    """
    path, _, form = quote.partition(":")
    path, *indices = re.findall(r"[\w.]+", path)
    found: Any = names
    for name in path.split("."):
        try:
            found = found[name]
        except (KeyError, TypeError):
            remedy = "quote {claim}, {reading.claim} or {reading.claim.number}"
            remedy = nearest(name, found) if isinstance(found, dict) else remedy
            raise ValueError(f"there is no '{name}' to quote; {remedy}") from None
    found = found.get("value") if isinstance(found, dict) else found
    for index in indices if found is not None else ():
        if not isinstance(found, list) or int(index) >= len(found):
            raise ValueError(f"there is no entry {index}; entries of a vector count from 0")
        found = found[int(index)]
    if isinstance(found, bool | list):
        raise ValueError(f"{found!r} is not a number")
    return NOT_EVALUATED if found is None else format(found, form).replace("%", " %")


def _filled(text: str, number: Callable[[str], str]) -> str:
    """A text with its numbers, by the quote as it is written."""
    return "".join(words + (quote and number(quote)) for words, quote in quotes_in(text))


class Accepted(dict):
    """Numbers that were accepted with the last full build, as text by the quote as it is written."""

    def __missing__(self, quote: str) -> None:
        """Reject a quote that was not accepted yet."""
        raise ValueError(f"{ACCEPTED} has no {{{quote}}}; run 'marsedl accept' after a full build")


def accepted(root: Path, slug: str) -> Accepted:
    """Return the accepted numbers of a paper."""
    return Accepted(json.loads((root / ACCEPTED).read_text(encoding="utf-8")).get(slug, {}))


def accept(root: Path, papers: Mapping[str, tuple[Paper, Quotes]]) -> Path:
    """Commit the numbers that the texts of all papers quote; returns the file."""
    numbers = {slug: numbers_of(*paper) for slug, paper in papers.items()}
    write_text(root / ACCEPTED, json.dumps(numbers, indent=1, ensure_ascii=False) + "\n")
    return root / ACCEPTED


def numbers_of(paper: Paper, quotes: Quotes) -> dict[str, str]:
    """Return what the texts of a paper quote, sorted by the quote as it is written."""

    class Gathered(dict):
        def __missing__(self, quote: str) -> str:
            return self.setdefault(quote, quotes[quote])

    numbers = Gathered()
    with_numbers(paper, numbers)
    return dict(sorted(numbers.items()))


def with_numbers(paper: Paper, quotes: Quotes | Mapping[str, str]) -> Paper:
    """Return a catalogue with the numbers of its texts; raises InputError, naming the text, if one does not exist."""

    def filled(of: Any, where: str) -> Any:
        match of:
            case str():
                try:
                    return _filled(of, quotes.__getitem__)
                except (ValueError, TypeError) as error:
                    raise InputError(f"{where}: {error}") from None
            case dict():
                return {name: filled(text, f"{where}.{name}") for name, text in of.items()}
            case tuple():
                return tuple(filled(text, where) for text in of)
            case Product():
                return replace(of, caption=filled(of.caption, f"{where}.caption"))
            case Erratum():
                texts = {key: getattr(of, key) for key in ("printed", "evidence", "used")}
                return replace(of, **filled(texts, f"{where}.{of.id}"))

    names = ("figures", "tables", "described", "errata", "in_short", "found")
    return replace(paper, **{name: filled(getattr(paper, name), f"{paper.slug}: {name}") for name in names})
