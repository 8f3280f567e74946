"""Can all headlines of a paper be true at once, and do choices that fit some claims fit others?"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from marsedl.replication.claims.counts import capital, plural
from marsedl.replication.inputs.choices import in_words
from marsedl.replication.universes.designs import AGAIN, ONE_AT_A_TIME, SPACE_FILLING, WAVE
from marsedl.replication.universes.judging import Judge
from marsedl.replication.universes.table import decoded
from marsedl.replication.universes.waves import Matching, Wave


class Best(NamedTuple):
    """The universe in which most headlines stand: how many of them and of all claims, there and in `corrected`.

    What cannot fail counts in none; `corrected` is counted at the numbers of trials of universes.
    """

    universe: int
    changed: dict[str, object]  # its values of choices that are not those of corrected
    headlines: int
    in_corrected: int
    of: int  # headlines that universes compute
    claims: int
    claims_in_corrected: int
    of_claims: int
    again: bool | None  # whether as many headlines stand with other random numbers; None: not computed


class Predicted(NamedTuple):
    """How many claims of one half stand in the universe in which most of the other half stand, and in `corrected`."""

    universe: int
    agreeing: int
    in_corrected: int
    of: int


class Joint(NamedTuple):
    """What the universes say of all headlines together.

    `never` are the smallest sets that never stand together, `not_computed` the headlines that no universe computes.
    """

    waves: Sequence[Wave]
    best: Best | None
    never: Sequence[tuple[str, ...]]
    halves: Sequence[Predicted]
    not_computed: Sequence[str]


def joint(judge: Judge, matching: Matching) -> Joint:
    """Return what the universes of a table say of all headlines together, also by waves towards them."""
    computed = {name for name, one in judge.of.items() if one.has_result.any()}
    names = [one.id for one in matching.headlines if one.id in computed]
    absent = [one.id for one in matching.headlines if one.id not in computed]
    return Joint(
        matching.waves, _best(judge, names) if names else None, _never_together(judge, names), _halves(judge), absent
    )


def _best(judge: Judge, names: Sequence[str]) -> Best:
    """The universe in which most of some claims, and then most of all, stand."""
    table, headlines, claims = judge.table, judge.agrees(names).sum(axis=1), judge.agrees([*judge.of]).sum(axis=1)
    # Of equal ones the first that has its own random numbers from `corrected`.
    at = max(range(len(table.number)), key=lambda k: (headlines[k], table.seed[k] == 0, claims[k], -k))
    assignment, base = (decoded(judge.choices, table.assignment[k]) for k in (at, judge.base))
    again = np.flatnonzero(np.abs(table.number - table.number[at]) == AGAIN)
    return Best(
        universe=int(table.number[at]),
        changed={name: value for name, value in assignment.items() if value != base.get(name)},
        headlines=int(headlines[at]),
        in_corrected=int(headlines[judge.base]),
        of=len(names),
        claims=int(claims[at]),
        claims_in_corrected=int(claims[judge.base]),
        of_claims=sum(bool((one.agrees | one.refuted).any()) for one in judge.of.values()),
        again=bool(headlines[again[0]] >= headlines[at]) if len(again) else None,
    )


def _never_together(judge: Judge, names: Sequence[str]) -> list[tuple[str, ...]]:
    """The smallest sets of claims that stand together in no universe which decides all of them."""
    for size in range(1, len(names) + 1):
        found = []
        for those in itertools.combinations(names, size):
            claims = [judge.of[name] for name in those]
            decided = np.all([one.agrees | one.refuted for one in claims], axis=0)
            if decided.any() and not np.all([one.agrees for one in claims], axis=0).any():
                found.append(those)
        if found:
            return found
    return []


def _halves(judge: Judge) -> list[Predicted]:
    """How choices that fit one half of the claims, in turns, do on the other half."""
    same_streams, found = np.flatnonzero(judge.table.seed == 0), []
    halves = judge.agrees([*judge.of][::2]), judge.agrees([*judge.of][1::2])
    for fitted, others in (halves, halves[::-1]):
        at, agreeing = same_streams[np.argmax(fitted.sum(axis=1)[same_streams])], others.sum(axis=1)
        found.append(
            Predicted(int(judge.table.number[at]), int(agreeing[at]), int(agreeing[judge.base]), others.shape[1])
        )
    return found


def in_sentences(judge: Judge) -> str:
    """Return how many universes there are, and what they say of all headlines together, in Markdown."""
    found, table = joint(judge, Matching(judge)), judge.table
    designs = {
        "with one choice varied": int(judge.among(ONE_AT_A_TIME).sum()) - 1,
        "that fill the space": int(judge.among(SPACE_FILLING).sum()),
        "of waves": int(judge.among(WAVE).sum()),
        "with other random numbers": int((table.seed > 0).sum()),
    }
    parts = ", ".join(f"{count} {what}" for what, count in designs.items() if count)
    texts = [f"{len(table.number)} universes: `corrected`, {parts}"]
    if (best := found.best) is not None:
        share = f"at most {best.headlines}" if best.headlines else "none"
        most = f"all {best.of}" if best.headlines == best.of else f"{share} of {best.of}"
        where = f"universe {best.universe}" if best.changed else "`corrected`"
        changed = ", ".join(f"{in_words(name)} = {in_words(value)}" for name, value in best.changed.items())
        where += f" ({changed})" if changed else ""
        texts.append(f"{most} headlines stand in one universe, in {where}; {best.in_corrected} in `corrected`")
        if best.again is not None:
            texts[-1] += f"; with other random numbers {'as many' if best.again else 'fewer'}"
    for names in found.never:
        those = " and ".join(f"`{name}`" for name in names)
        texts.append(f"{those} {'stand together' if len(names) > 1 else 'stands'} in none")
    if found.not_computed:
        texts.append(f"not computed in universes: {', '.join(f'`{name}`' for name in found.not_computed)}")
    texts += _of_waves(found.waves)
    return " ".join(f"{capital(text)}." for text in texts)


def _of_waves(waves: Sequence[Wave]) -> list[str]:
    """What waves rule out, and whether their universes have more headlines than those before."""
    if len(waves) < 2:
        return []
    last, agreeing = waves[-1], [wave.agreeing for wave in waves]
    left = f"{100 * last.volume:.3g} % of the choices are not ruled out" if last.volume else "no choices are left"
    better = "more" if max(agreeing[1:]) > agreeing[0] else "no more"
    means = f"{agreeing[0]:.2g} headlines stand on average in the universes that fill the space"
    return [f"by the emulators {left} after {plural(len(waves) - 1, 'wave')}; {means}, {better} in those of the waves"]
