"""Can all headlines of a paper be true at once? History matching in waves.

A headline is missed by some distance in a universe: that of its number from what is printed, beyond half a printed
digit, in standard deviations of what our sampling and the paper's own leave open. Every wave fits an emulator of each
headline to the universes computed so far. It is fitted to the inverse hyperbolic sine of that distance, which is
bounded, and its error is that of nineteen in twenty universes left out: one whose number diverges must not decide for
all. A wave rules out where even three errors of the emulator leave the distance above three deviations, and computes
more universes in what is left, until nothing more is ruled out.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from marsedl.replication.claims.names import REFUTED_VERDICTS
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.inputs.choices import Choice
from marsedl.replication.universes import designs
from marsedl.replication.universes.designs import AGAIN, FIRST_OF_WAVES, WAVE, Universe, combined_values, interval_of
from marsedl.replication.universes.judging import Judge
from marsedl.replication.universes.table import Universes, decoded, gathered, selected

CANDIDATES = 8192
MOST = 4  # waves
FEWEST = 4  # universes that an emulator rests on
NINETEEN_OF_TWENTY, TWO_SIDED = 0.95, 1.96  # share of universes, and its quantile of a normal distribution
FAR = 100.0  # deviations; further is as far
REFINEMENTS = 4  # of a range, each of which halves an interval
RIDGES = 10.0 ** np.arange(-4, 5)  # of which the emulator takes the one with the smallest error of what is left out


@dataclass(frozen=True)
class Wave:
    """What one wave ruled out.

    `volume` is the share of the candidates that is left. `shares` are those of the values of each choice among what is
    left (a range in four equal parts); `contradicting` are the fewest headlines that no candidate fulfils together, if
    none is left. `agreeing` is the mean number of headlines that stand in its own universes, NaN of none.
    """

    volume: float
    shares: dict[str, list[float]]
    contradicting: tuple[str, ...]
    agreeing: float


class Matching:
    """History matching of a paper's headlines, as they are judged."""

    def __init__(self, judge: Judge):
        """Take what judges the universes; misprints are not varied."""
        self.judge, self.choices = judge, judge.choices
        self.varied = designs.varied(judge.choices)
        headlines = (one for one in judge.published.values() if one.headline)
        self.headlines = sorted(headlines, key=lambda one: one.headline)

    def measured(self, judge: Judge) -> dict[str, np.ndarray]:
        """Return by how much each headline is missed in each universe, in deviations (universe,), by component.

        Positive where a number is too large or a statement fails; NaN without a result. A statement without sampling
        error is measured in the median of its distances, and fulfilled below 0; numbers are within three deviations.
        """
        found = {}
        for one in (judge.of[claim.id] for claim in self.headlines if claim.id in judge.of):
            claim, is_statement = one.claim, one.is_statement
            for place in [one.deciding] if is_statement else range(len(one.labels)):
                value, error, limit = one.numbers[:, :, place]
                distance, deviation = value - limit, np.nan_to_num(error)
                if is_statement:
                    side = np.where(one.refuted, 1.0, -1.0)
                    distance = np.where(one.has_result, side * np.abs(distance), np.nan)
                elif claim.trials:  # the paper's own sampling error, at the spread of ours
                    deviation = deviation * np.sqrt(1.0 + one.trials / claim.trials)
                if not np.isfinite(distance).any():
                    continue
                scale = np.median(np.hypot(deviation, one.halves[place] / SIGMAS)[np.isfinite(distance)])
                usual = np.nanmedian(np.abs(distance))
                label = claim.id if is_statement else claim.id + one.labels[place]
                found[label] = distance / (scale or usual or 1.0)
        return found

    def wave(self, judge: Judge, number: int) -> tuple[Wave, np.ndarray]:
        """Return what judged universes rule out, and the candidates that are left, as shares (count, varied).

        number: of the wave, which has candidates of its own.
        """
        candidates = designs.sobol(len(self.varied), CANDIDATES, designs.SEED + 1 + number)
        shares = self._shares(judge.table)
        among = np.isfinite(shares).all(axis=1)
        features = _features(self.varied, np.nan_to_num(shares))
        wanted = _features(self.varied, candidates)
        distances = {}
        for label, missed in self.measured(judge).items():
            use = among & np.isfinite(missed)
            if use.sum() < FEWEST:
                continue
            mean, error = emulated(features[use], np.arcsinh(np.clip(missed[use], -FAR, FAR)), wanted)
            distances[label] = self._excess(label, mean) / max(error, 1e-12)
        worst = np.max([np.zeros(CANDIDATES), *distances.values()], axis=0)
        left = candidates[worst < SIGMAS]
        left_of = {}
        for k, one in enumerate(self.varied):
            parts = 4 if one.range else len(combined_values(one))
            counts = np.bincount(interval_of(left[:, k], parts), minlength=parts)
            left_of[one.name] = (counts / max(len(left), 1)).tolist()
        of_wave = (judge.table.wave == number) & (judge.table.seed == 0) & (judge.table.design != 0)
        agrees = judge.agrees([one.id for one in self.headlines if one.id in judge.of])
        agreeing = float(agrees[of_wave].sum(axis=1).mean()) if of_wave.any() else math.nan
        contradicting = () if len(left) else self._contradicting(distances)
        return Wave(len(left) / CANDIDATES, left_of, contradicting, agreeing), left

    def _excess(self, label: str, mean: np.ndarray) -> np.ndarray:
        """By how much a headline is missed beyond what is allowed, both as inverse hyperbolic sines."""
        is_statement = self.judge.of[label.partition("[")[0]].is_statement
        return np.maximum(mean if is_statement else np.abs(mean) - math.asinh(SIGMAS), 0.0)

    @cached_property
    def waves(self) -> list[Wave]:
        """What each wave ruled out by which the judged universes were computed."""
        table = selected(self.judge.table, self.judge.table.seed == 0)
        numbers = range(1 + int(table.wave.max()))
        return [self.wave(self.judge.over(selected(table, table.wave <= k)), k)[0] for k in numbers]

    def extended(self, compute: Callable[[list[Universe]], Universes], count: int) -> Universes:
        """Return the judged table with the universes of waves, and the best of all again with other random numbers.

        count: universes of a wave.
        """
        table, before = self.judge.table, math.inf
        for number in range(1, MOST + 1):
            wave, left = self.wave(self.judge.over(selected(table, table.seed == 0)), number - 1)
            if not len(left) or wave.volume > 0.9 * before:
                break
            before, first = wave.volume, FIRST_OF_WAVES + count * (number - 1)
            assignments = [designs.assignment_at(self.choices, self.varied, shares) for shares in left[:count]]
            universes = [Universe(first + k, WAVE, one, wave=number) for k, one in enumerate(assignments)]
            table = gathered([table, compute(universes)])
        missed = self.measured(self.judge.over(table))
        if not missed:
            return table
        worst = np.max([self._excess(label, np.arcsinh(one)) for label, one in missed.items()], axis=0)
        worst = np.where(table.seed == 0, worst, np.nan)  # NaN without all results
        if not np.isfinite(worst).any():
            return table
        at = int(np.nanargmin(worst))
        assignment = decoded(self.choices, table.assignment[at])
        again = Universe(AGAIN + int(table.number[at]), WAVE, assignment, seed=1, wave=int(table.wave.max()))
        return table if again.number in table.number else gathered([table, compute([again])])

    def _shares(self, table: Universes) -> np.ndarray:
        """Values of choices as shares, from 0 to 1 (universe, varied); NaN for a value that is not combined."""
        shares = np.full((len(table.number), len(self.varied)), np.nan)
        for at, row in enumerate(table.assignment):
            values = decoded(self.choices, row)
            for k, one in enumerate(self.varied):
                value, names = values.get(one.name), combined_values(one)
                if one.range and value is not None:
                    shares[at, k] = np.clip(one.range.share(value), 0.0, 1.0)
                elif value in names:
                    shares[at, k] = (names.index(value) + 0.5) / len(names)
        return shares

    @staticmethod
    def _contradicting(distances: dict[str, np.ndarray]) -> tuple[str, ...]:
        """The fewest headlines, one or two, that no candidate fulfils together; else all."""
        allowed = {label: distance < SIGMAS for label, distance in distances.items()}
        pairs = (pair for pair in itertools.product(allowed, repeat=2) if pair[0] < pair[1])
        for those in (*itertools.product(allowed), *pairs):
            if not np.all([allowed[label] for label in those], axis=0).any():
                return those
        return tuple(allowed)


def refined(judge: Judge, compute: Callable[[list[Universe]], Universes]) -> Universes:
    """Return the judged table with more values of ranges: where a refuted headline passes what is printed.

    Between two neighbours on both sides of what is printed, neither of which makes the claim true, and between one that
    comes nearer and one without a result, the middle is computed, several times over.
    """
    table = judge.table
    for _ in range(REFINEMENTS):
        judge = judge.over(table)
        wanted = {
            (choice.name, choice.range.at(share)): choice
            for claim in judge.published.values()
            if claim.headline and claim.id in judge.of and judge.verdict(claim.id) in REFUTED_VERDICTS
            for choice in judge.choices
            if choice.range
            for share in _between(judge, claim.id, choice)
        }
        if not wanted:
            break
        used = table.number[(table.number >= designs.FIRST_REFINED) & (table.number < designs.FIRST)]
        first = int(used.max(initial=designs.FIRST_REFINED - 1)) + 1
        universes = [
            Universe(first + k, designs.ONE_AT_A_TIME, designs.by_itself(judge.choices, choice, value))
            for k, ((_, value), choice) in enumerate(wanted.items())
        ]
        table = gathered([table, compute(universes)])
    return table


def _between(judge: Judge, claim: str, choice: Choice) -> list[float]:
    """The shares of a choice's range at which a universe is wanted for a claim, see `refined`."""
    effects = [one for one in judge.effects(claim) if one.choice == choice.name]
    if not effects or any(one.is_true for one in effects):
        return []
    before, _, limit = judge.of[claim].number(judge.base)
    missed = {choice.range.share(float(one.value)): one.number - limit for one in effects}
    if choice.corrected is not None:
        missed[choice.range.share(float(choice.corrected))] = before - limit
    found, shares = [], sorted(missed)
    for low, high in itertools.pairwise(shares):
        sides = missed[low], missed[high]
        lost = [math.isnan(one) for one in sides]
        nearer = any(abs(one) < abs(before - limit) for one in sides)
        if sides[0] * sides[1] < 0.0 or (sum(lost) == 1 and nearer):
            found.append(0.5 * (low + high))
    return found


def emulated(features: np.ndarray, values: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, float]:
    """Return what a ridge regression predicts, and the standard deviation of its misses when a universe is left out.

    That deviation is of the normal distribution whose misses are as large in nineteen of twenty universes.

    features: of the universes with values (count, n); values: in these (count,); wanted: features of those to predict
    (m, n).
    """
    mean, scale = values.mean(), values.std() or 1.0
    u, s, vt = np.linalg.svd(features, full_matrices=False)
    scaled = (values - mean) / scale
    best = (math.inf, np.zeros(features.shape[1]))
    for ridge in RIDGES:
        shrunk = s * s / (s * s + ridge)
        fitted = u @ (shrunk * (u.T @ scaled))
        leverage = np.einsum("ij,j,ij->i", u, shrunk, u)
        missed = np.abs(scaled - fitted) / np.maximum(1.0 - leverage, 1e-6)  # of each universe, when it is left out
        left_out = float(np.quantile(missed, NINETEEN_OF_TWENTY)) / TWO_SIDED
        if left_out < best[0]:
            best = left_out, vt.T @ ((s / (s * s + ridge)) * (u.T @ scaled))
    return mean + scale * (wanted @ best[1]), scale * best[0]


def _features(combined: Sequence[Choice], shares: np.ndarray) -> np.ndarray:
    """A constant, the values of each choice (of a range, its share and its square), and products of two choices."""
    blocks = []
    for k, one in enumerate(combined):
        if one.range:
            centred = 2.0 * shares[:, k] - 1.0
            blocks.append([centred, centred**2])
        else:
            count = len(combined_values(one))
            blocks.append([(interval_of(shares[:, k], count) == value) - 1.0 / count for value in range(count)])
    products = [a * b for first, second in itertools.combinations(blocks, 2) for a in first for b in second]
    return np.array([np.ones(len(shares)), *itertools.chain(*blocks), *products]).T
