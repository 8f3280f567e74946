"""How claims are counted, in the words of every place that counts them: pages, README, badge and terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from marsedl.replication.claims.names import (
    AGREEING_VERDICTS,
    BY_CONSTRUCTION,
    COUNTED_VERDICTS,
    LISTED_VERDICTS,
    NUMBERS,
    STATED,
    STATEMENTS,
    VERDICTS_OF,
)


class Counts(NamedTuple):
    """Of some claims: printed numbers, statements, how they come out, and how many headline claims there are.

    `verdicts` are counted in all (`counted`), of printed numbers and statements apart, and of what is listed and never
    counted (`listed`).
    """

    numbers: int
    statements: int
    verdicts: Mapping[str, Mapping[str, int]]
    headline: int
    standing: int  # of the headline claims

    @property
    def bound(self) -> int:
        """How many cannot fail."""
        return self.verdicts["listed"][BY_CONSTRUCTION]

    @property
    def in_words(self) -> str:
        """How many there are: "67 claims: 19 printed numbers, 40 statements; 8 cannot fail and are not counted"."""
        kinds = f"{plural(self.numbers, 'printed number')}, {plural(self.statements, 'statement')}"
        bound = f"; {self.bound} cannot fail and {'is' if self.bound == 1 else 'are'} not counted" if self.bound else ""
        return f"{plural(self.numbers + self.statements + self.bound, 'claim')}: {kinds}{bound}"

    @property
    def of_numbers(self) -> str:
        """How the printed numbers come out: "3 of 15 printed numbers reproduce, 3 are close"."""
        close = self.verdicts[NUMBERS]["close"]
        also = f", {close} {'is' if close == 1 else 'are'} close" if close else ""
        return f"{self.verdicts[NUMBERS]['reproduced']} of {plural(self.numbers, 'printed number')} reproduce{also}"

    @property
    def of_statements(self) -> str:
        """How the statements come out: "20 of 31 statements hold"."""
        return f"{self.verdicts[STATEMENTS]['holds']} of {plural(self.statements, 'statement')} hold"

    @property
    def of_headline(self) -> str:
        """How the headline claims come out: "4 of 5 headline claims stand"."""
        return f"{self.standing} of {plural(self.headline, 'headline claim')} stand"


def counted(rows: Iterable[Any]) -> Counts:
    """Count claims, or of what has their `kind`, `verdict` (None: not built) and `headline`."""
    rows = list(rows)
    found = Counter((STATEMENTS if row.kind == "qualitative" else NUMBERS, row.verdict) for row in rows)
    verdicts = {kind: {verdict: found[kind, verdict] for verdict in of} for kind, of in VERDICTS_OF.items()}
    for name, of in (("counted", COUNTED_VERDICTS), ("listed", LISTED_VERDICTS)):
        verdicts[name] = {verdict: found[NUMBERS, verdict] + found[STATEMENTS, verdict] for verdict in of}
    unbuilt = [row.kind == "qualitative" for row in rows if row.verdict is None and row.kind not in STATED]
    headline = [row.verdict for row in rows if row.headline]
    return Counts(
        numbers=sum(verdicts[NUMBERS].values()) + unbuilt.count(False),
        statements=sum(verdicts[STATEMENTS].values()) + unbuilt.count(True),
        verdicts=verdicts,
        headline=len(headline),
        standing=sum(verdict in AGREEING_VERDICTS for verdict in headline),
    )


def capital(text: str) -> str:
    """Return a text with its first letter as a capital, and all others as they are."""
    return text[:1].upper() + text[1:]


def plural(number: int, word: str) -> str:
    """Return a number of things, such as "1 claim" or "2 claims"."""
    return f"{number} {word}{'' if number == 1 else 's'}"
