"""Can all headlines of a paper be true at once, and do choices that fit some claims fit others?"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from marsedl.replication.claims.claim import REFUTED_VERDICTS
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.universes.judging import TRUE, Judge
from marsedl.replication.universes.table import VERDICTS, decoded
from marsedl.replication.universes.waves import Matching, Wave


class Best(NamedTuple):
    """The universe in which most headlines stand: how many of them, and of all claims, there and in `corrected`."""

    universe: int
    changed: dict[str, object]  # its values of choices that are not those of corrected
    headlines: int
    of: int
    claims: int
    claims_in_corrected: int
    again: bool | None  # whether as many headlines stand with other random numbers; None: not computed


class Predicted(NamedTuple):
    """How many claims of one half stand in the universe in which most of the other half stand, and in `corrected`."""

    universe: int
    standing: int
    in_corrected: int
    of: int


class Joint(NamedTuple):
    """What the universes say of all headlines together; `never` are the smallest sets that never stand together."""

    waves: Sequence[Wave]
    best: Best | None
    never: Sequence[tuple[str, ...]]
    halves: Sequence[Predicted]


def joint(judge: Judge) -> Joint:
    """Return what the universes of a table say of all headlines together."""
    matching = Matching(judge.choices, list(judge.published.values()))
    verdicts = zip(judge.table.claim, judge.table.verdict.T, strict=True)
    decided = [str(name) for name, codes in verdicts if codes.any()]  # code 0 is "none"
    names = [one.id for one in matching.headlines if one.id in decided]
    waves = matching.waves(judge.table)
    return Joint(waves, _best(judge, names), never_together(judge, names), halves(judge))


def _verdicts(judge: Judge, names: Sequence[str]) -> np.ndarray:
    """Verdicts of some claims (universe, claim)."""
    return np.array(VERDICTS)[judge.table.verdict[:, [judge.claim_place(name) for name in names]]]


def _counts(judge: Judge, names: Sequence[str]) -> np.ndarray:
    """How many of some claims stand in each universe."""
    return np.isin(_verdicts(judge, names), TRUE).sum(axis=1)


def _best(judge: Judge, names: Sequence[str]) -> Best | None:
    if not names:
        return None
    table, everything = judge.table, list(map(str, judge.table.claim))
    headlines, claims = _counts(judge, names), _counts(judge, everything)
    own = np.flatnonzero(table.seed == 0)
    at = max(own, key=lambda k: (headlines[k], claims[k], -k))
    assignment, base = (decoded(judge.choices, table.assignment[k]) for k in (at, judge.base))
    same = [k for k in np.flatnonzero(table.seed != 0) if np.array_equal(*table.assignment[[k, at]], equal_nan=True)]
    return Best(
        int(table.number[at]),
        {name: value for name, value in assignment.items() if value != base.get(name)},
        int(headlines[at]),
        len(names),
        int(claims[at]),
        int(claims[judge.base]),
        bool(headlines[same[0]] >= headlines[at]) if same else None,
    )


def never_together(judge: Judge, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the smallest sets of claims that stand together in no universe which decides all of them."""
    verdicts = _verdicts(judge, names)
    decided = np.isin(verdicts, TRUE + REFUTED_VERDICTS)
    stands = np.isin(verdicts, TRUE)
    for size in range(1, len(names) + 1):
        found = []
        for those in itertools.combinations(range(len(names)), size):
            use = decided[:, those].all(axis=1)
            if use.any() and not stands[use][:, those].all(axis=1).any():
                found.append(tuple(names[k] for k in those))
        if found:
            return found
    return []


def halves(judge: Judge) -> list[Predicted]:
    """Return how choices that fit one half of the claims, in turns, do on the other half; see `Predicted`."""
    names = list(map(str, judge.table.claim))
    own, found = np.flatnonzero(judge.table.seed == 0), []
    for fitted, others in ((names[::2], names[1::2]), (names[1::2], names[::2])):
        fit, rest = _counts(judge, fitted), _counts(judge, others)
        at = max(own, key=lambda k: (fit[k], -k))
        number = int(judge.table.number[at])
        found.append(Predicted(number, int(rest[at]), int(rest[judge.base]), len(others)))
    return found


def answer(found: Joint) -> str:
    """Return in a few words whether all headlines are true at once somewhere."""
    if found.best is None:
        return "no universe evaluates a headline"
    if found.best.headlines == found.best.of:
        where = CORRECTED if not found.best.changed else f"universe {found.best.universe}"
        return f"all {found.best.of} headlines stand in {where}"
    return f"at most {found.best.headlines} of {found.best.of} headlines stand in one universe"
