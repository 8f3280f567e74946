"""Can all headlines of a paper be true at once, and do choices that fit some claims fit others?"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from marsedl.replication.inputs import CORRECTED
from marsedl.replication.universes.designs import AGAIN
from marsedl.replication.universes.judging import Judge
from marsedl.replication.universes.table import decoded
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
    matching = Matching(judge.choices, judge.published.values())
    decided = judge.table.claim[judge.table.verdict.any(axis=0)]  # code 0 is "none"
    names = [one.id for one in matching.headlines if one.id in decided]
    places = [judge.column[name] for name in names]
    never = [tuple(names[k] for k in those) for those in _never_together(judge, places)]
    return Joint(matching.waves(judge.table), _best(judge, places) if names else None, never, _halves(judge))


def _best(judge: Judge, places: Sequence[int]) -> Best:
    """The universe in which most of some claims, and then most of all, stand."""
    table, headlines, claims = judge.table, judge.stands[:, places].sum(axis=1), judge.stands.sum(axis=1)
    at = max(np.flatnonzero(table.seed == 0), key=lambda k: (headlines[k], claims[k], -k))
    assignment, base = (decoded(judge.choices, table.assignment[k]) for k in (at, judge.base))
    again = np.flatnonzero(table.number == AGAIN + table.number[at])
    return Best(
        int(table.number[at]),
        {name: value for name, value in assignment.items() if value != base.get(name)},
        int(headlines[at]),
        len(places),
        int(claims[at]),
        int(claims[judge.base]),
        bool(headlines[again[0]] >= headlines[at]) if len(again) else None,
    )


def _never_together(judge: Judge, places: Sequence[int]) -> list[tuple[int, ...]]:
    """The smallest sets of claims that stand together in no universe which decides all of them."""
    decided, stands = judge.decided[:, places], judge.stands[:, places]
    for size in range(1, len(places) + 1):
        found = []
        for those in itertools.combinations(range(len(places)), size):
            use = decided[:, those].all(axis=1)
            if use.any() and not stands[use][:, those].all(axis=1).any():
                found.append(those)
        if found:
            return found
    return []


def _halves(judge: Judge) -> list[Predicted]:
    """How choices that fit one half of the claims, in turns, do on the other half."""
    own, found, halves = np.flatnonzero(judge.table.seed == 0), [], (judge.stands[:, ::2], judge.stands[:, 1::2])
    for fitted, others in (halves, halves[::-1]):
        at, standing = own[np.argmax(fitted.sum(axis=1)[own])], others.sum(axis=1)
        number = int(judge.table.number[at])
        found.append(Predicted(number, int(standing[at]), int(standing[judge.base]), others.shape[1]))
    return found


def answer(found: Joint) -> str:
    """Return in a few words whether all headlines are true at once somewhere."""
    if found.best is None:
        return "no universe evaluates a headline"
    if found.best.headlines == found.best.of:
        where = CORRECTED if not found.best.changed else f"universe {found.best.universe}"
        return f"all {found.best.of} headlines stand in {where}"
    return f"at most {found.best.headlines} of {found.best.of} headlines stand in one universe"
