"""How claims are counted, in the words of every place that counts them: pages, README, badge and terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

# As in claim.py, which is slow to import.
_NO_CLAIMS = ("as_stated", "not_as_stated", "quoted"), ("input", "context")  # verdicts and kinds
_STANDING = ("reproduced", "close", "holds")


class Counts(NamedTuple):
    """Of some claims: printed numbers, statements, what cannot fail, and how they come out."""

    numbers: int
    statements: int
    bound: int
    reproduced: int
    close: int
    hold: int
    headline: int
    standing: int  # of the headline claims

    @property
    def in_words(self) -> str:
        """How many there are: "67 claims: 19 printed numbers, 40 statements; 8 cannot fail and are not counted"."""
        kinds = f"{plural(self.numbers, 'printed number')}, {plural(self.statements, 'statement')}"
        bound = f"; {self.bound} cannot fail and {'is' if self.bound == 1 else 'are'} not counted" if self.bound else ""
        return f"{plural(self.numbers + self.statements + self.bound, 'claim')}: {kinds}{bound}"

    @property
    def of_numbers(self) -> str:
        """How the printed numbers come out: "3 of 15 printed numbers reproduce, 3 are close"."""
        close = f", {self.close} {'is' if self.close == 1 else 'are'} close" if self.close else ""
        return f"{self.reproduced} of {plural(self.numbers, 'printed number')} reproduce{close}"

    @property
    def of_statements(self) -> str:
        """How the statements come out: "20 of 31 statements hold"."""
        return f"{self.hold} of {plural(self.statements, 'statement')} hold"

    @property
    def of_headline(self) -> str:
        """How the headline claims come out: "4 of 5 headline claims stand"."""
        return f"{self.standing} of {plural(self.headline, 'headline claim')} stand"


def counted(rows: Iterable[Any]) -> Counts:
    """Count claims, or of what has their `kind`, `verdict` (None: not built) and `headline`."""
    claims = [row for row in rows if row.verdict not in _NO_CLAIMS[0] and row.kind not in _NO_CLAIMS[1]]
    verdicts, headline = [row.verdict for row in claims], [row.verdict for row in claims if row.headline]
    bound = verdicts.count("by_construction")
    statements = sum(row.kind == "qualitative" and row.verdict != "by_construction" for row in claims)
    return Counts(
        numbers=len(claims) - bound - statements,
        statements=statements,
        bound=bound,
        reproduced=verdicts.count("reproduced"),
        close=verdicts.count("close"),
        hold=verdicts.count("holds"),
        headline=len(headline),
        standing=sum(verdict in _STANDING for verdict in headline),
    )


def capital(text: str) -> str:
    """Return a text with its first letter as a capital, and all others as they are."""
    return text[:1].upper() + text[1:]


def plural(number: int, word: str) -> str:
    """Return a number of things, such as "1 claim" or "2 claims"."""
    return f"{number} {word}{'' if number == 1 else 's'}"
