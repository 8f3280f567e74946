"""Designs: which universes are computed, numbered and the same on every machine.

A universe assigns a value to some choices; those that it leaves out are as in `corrected`. Universe 0 is `corrected`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from marsedl.replication.errors import InputError
from marsedl.replication.inputs.choices import MISPRINT, Assignment, Choice, Choices, Value

ONE_AT_A_TIME, SPACE_FILLING, WAVE = "one_at_a_time", "space_filling", "wave"
DESIGNS = (ONE_AT_A_TIME, SPACE_FILLING, WAVE)
SEED = 20261127  # of the scrambling; any number serves
RANGE_SHARES = (0.0, 0.5, 1.0)  # of a range, in a design of one at a time
FIRST_REFINED = 500  # number of the first universe between two others of a range
FIRST = 1000  # number of the first universe of the space-filling design
FIRST_OF_WAVES = 100_000  # number of the first universe of a wave
AGAIN = 1_000_000  # added to the number of one that is computed again with other random numbers


@dataclass(frozen=True)
class Universe:
    """A numbered assignment of choices.

    `seed` numbers the random streams, 0 those of the reading `corrected`. `inputs` are further ones by "section.key",
    as they are written in a configuration. `wave` is that in which it was computed, 0 before the first.
    """

    number: int
    design: str
    assignment: Assignment
    seed: int = 0
    inputs: Mapping[str, object] = field(default_factory=dict)
    wave: int = 0


def one_at_a_time(choices: Choices, names: Sequence[str] | None = None) -> list[Universe]:
    """Return `corrected`, and every value of every choice beside it, by itself.

    names: the choices that are varied; all unless given. A choice that needs others (`only_if`) is varied with these.
    """
    assignments: list[dict] = [{}]
    for choice in choices:
        if names is not None and choice.name not in names:
            continue
        values = [choice.range.at(share) for share in RANGE_SHARES] if choice.range else choice.alternatives
        assignments += [by_itself(choices, choice, value) for value in values if value != choices.default(choice)]
    return [Universe(number, ONE_AT_A_TIME, one) for number, one in enumerate(assignments)]


def by_itself(choices: Choices, choice: Choice, value: Value) -> dict[str, Value]:
    """Return the assignment that varies one choice, with the values of others without which it changes nothing."""
    only_if = choice.only_if.items()
    needed = {name: those[0] for name, those in only_if if choices.default(choices.by_name[name]) not in those}
    return {**needed, choice.name: value}


def numbered(choices: Choices, number: int, names: Sequence[str] | None = None, alone: int | None = None) -> Universe:
    """Return a universe by its number alone: below 1000 one at a time, from there on space filling.

    names, alone: as of `design`. Raises InputError for a number that no design has, as those of waves, which depend on
    the universes before them.
    """
    by_themselves, again = one_at_a_time(choices, names)[:alone], number >= AGAIN
    if 0 <= number < len(by_themselves):
        return by_themselves[number]
    if not FIRST <= (base := number - AGAIN * again) < FIRST_OF_WAVES:
        raise InputError(
            f"no table holds universe {number}, and no design has it: one at a time are 0 to {len(by_themselves) - 1}, "
            f"space filling {FIRST} to {FIRST_OF_WAVES - 1}, and these plus {AGAIN} with other random numbers"
        )
    combined = varied(choices)
    last = assignment_at(choices, combined, sobol(len(combined), base - FIRST + 1)[-1])
    return Universe(number, SPACE_FILLING, last, seed=int(again))


def varied(choices: Choices) -> list[Choice]:
    """Return the choices that are combined: those with several values, but no misprints."""
    return [one for one in choices if one.kind != MISPRINT and (one.range or len(combined_values(one)) > 1)]


def combined_values(choice: Choice) -> list[str]:
    """Return the alternatives of a choice that are combined with others."""
    return [name for name in choice.alternatives if name not in choice.apart]


def space_filling(choices: Choices, count: int) -> list[Universe]:
    """Return universes along a scrambled Sobol sequence over all choices that are combined; powers of two fill space.

    A longer design begins with the shorter one.
    """
    combined = varied(choices)
    assignments = [assignment_at(choices, combined, shares) for shares in sobol(len(combined), count)]
    return [Universe(FIRST + number, SPACE_FILLING, one) for number, one in enumerate(assignments)]


def sobol(dimensions: int, count: int, seed: int = SEED) -> np.ndarray:
    """Return the first rows of a scrambled Sobol sequence (count, dimensions), each number from 0 to 1."""
    from scipy.stats import qmc

    if not dimensions:
        return np.zeros((count, 0))
    sequence = qmc.Sobol(dimensions, scramble=True, seed=seed)
    return sequence.random_base2(math.ceil(math.log2(max(count, 1))))[:count]


def assignment_at(choices: Choices, combined: Sequence[Choice], shares: Sequence[float]) -> dict:
    """Return the assignment at shares of choices, from 0 to 1; values that do not apply are left out."""
    drawn = {}
    for one, share in zip(combined, map(float, shares), strict=True):
        names = combined_values(one)  # in equal parts of the unit interval
        drawn[one.name] = one.range.at(share) if one.range else names[interval_of(share, len(names))]
    complete = choices.complete(drawn)
    return {one.name: complete[one.name] for one in choices if complete[one.name] != choices.default(one)}


def interval_of(shares, count: int):
    """Return in which of `count` equal parts of the unit interval shares lie, counted from 0."""
    return np.minimum(np.asarray(shares) * count, count - 1).astype(int)


def redrawn(choices: Choices, universe: Universe, names: Sequence[str], attempt: int) -> Universe:
    """Return a universe with some of its choices drawn again; the draws depend on its number and the attempt alone.

    With other random numbers it keeps its choices.
    """
    key = np.array([universe.number % AGAIN, attempt], dtype=np.uint64)
    shares = np.random.Generator(np.random.Philox(key=key)).random(len(names))
    drawn = assignment_at(choices, [choices.by_name[name] for name in names], shares)
    kept = {name: value for name, value in universe.assignment.items() if name not in names}
    return replace(universe, assignment={**kept, **drawn})


def design(
    choices: Choices, count: int, names: Sequence[str] | None = None, alone: int | None = None
) -> list[Universe]:
    """Return the universes of a table: one at a time (of some choices, at most so many), then those that fill space.

    One of sixteen of these comes again with other random numbers.
    """
    filling = space_filling(choices, count)
    again = [replace(one, number=AGAIN + one.number, seed=1) for one in filling[: count // 16]]
    return [*one_at_a_time(choices, names)[:alone], *filling, *again]
