"""Can all headlines of a paper be true at once? History matching in waves.

A universe is implausible if some headline lies further from what is printed than three standard deviations of what our
sampling, the paper's own sampling and the emulator leave open, beyond half a printed digit. Every wave fits an emulator
of each headline to the universes computed so far, rules out what is implausible, and computes more universes in what is
left, until nothing more is ruled out.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from marsedl.replication.claims.claim import REFUTED_VERDICTS
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.inputs.choices import Choice, Choices
from marsedl.replication.universes import designs
from marsedl.replication.universes.designs import AGAIN, WAVE, Universe, combined_values, interval_of
from marsedl.replication.universes.table import VERDICTS, Universes, components_of, decoded, gathered, selected

CANDIDATES = 8192
MOST = 4  # waves
FEWEST = 4  # universes that an emulator rests on
FIRST_OF_WAVES = 100_000  # number of the first universe of a wave
RIDGES = 10.0 ** np.arange(-4, 5)  # of which the emulator takes the one with the smallest error of what is left out


@dataclass(frozen=True)
class Wave:
    """What one wave ruled out.

    `volume` is the share of the candidates that is left. `shares` are those of the values of each choice among what is
    left (a range in four equal parts); `contradicting` are the fewest headlines that no candidate fulfils together, if
    none is left.
    """

    volume: float
    shares: dict[str, list[float]]
    contradicting: tuple[str, ...]


class Matching:
    """History matching of a paper's headlines."""

    def __init__(self, choices: Choices, published: Iterable[PublishedClaim]):
        """Take the choices, of which misprints are not varied, and what the paper prints."""
        self.choices = choices
        self.varied = designs.varied(choices)
        self.headlines = sorted((one for one in published if one.headline), key=lambda one: one.headline)
        self._statements = [one.id for one in self.headlines if one.kind == "qualitative"]

    def measured(self, table: Universes) -> dict[str, np.ndarray]:
        """Return how far each headline is from being true in each universe, with its standard deviation.

        It is an array (2, universe) by component: what is missing, 0 if it is true, beyond half a printed digit; NaN
        without a result.
        """
        found, claims, components = {}, table.claim.tolist(), table.component.tolist()
        for claim in (one for one in self.headlines if one.id in claims):
            place = claims.index(claim.id)
            verdicts = np.array(VERDICTS)[table.verdict[:, place]]
            for label, _, half in components_of(claim):
                at = components.index(label)
                distance = table.value[:, at] - table.limit[:, at]
                deviation = np.nan_to_num(table.error[:, at])
                if claim.kind == "qualitative":  # positive where the statement fails
                    distance = np.where(np.isin(verdicts, REFUTED_VERDICTS), 1.0, -1.0) * np.abs(distance)
                    distance = np.where(verdicts == "none", np.nan, distance)
                elif claim.trials:  # the paper's own sampling error, at the spread of ours
                    deviation = deviation * np.sqrt(1.0 + table.trials[:, place] / claim.trials)
                found[label] = np.array([distance, np.hypot(deviation, half / SIGMAS)])
        return {label: one for label, one in found.items() if np.isfinite(one[0]).any()}

    def wave(self, table: Universes, number: int) -> tuple[Wave, np.ndarray]:
        """Return what the universes of a table rule out, and the candidates that are left, as points (count, varied).

        number: of the wave, which has candidates of its own.
        """
        candidates = designs.sobol(len(self.varied), CANDIDATES, designs.SEED + 1 + number)
        points = self._points(table)
        among = np.isfinite(points).all(axis=1)
        features = _features(self.varied, np.nan_to_num(points))
        wanted = _features(self.varied, candidates)
        distances = {}
        for label, (missing, deviation) in self.measured(table).items():
            use = among & np.isfinite(missing)
            if use.sum() < FEWEST:
                continue
            mean, error = emulated(features[use], missing[use], wanted)
            spread = np.hypot(error, np.median(deviation[use]))
            distances[label] = _standardized(mean, spread, one_sided=label in self._statements)
        worst = np.max([np.zeros(CANDIDATES), *distances.values()], axis=0)
        left = candidates[worst < SIGMAS]
        shares = {}
        for k, one in enumerate(self.varied):
            parts = 4 if one.range else len(combined_values(one))
            counts = np.bincount(interval_of(left[:, k], parts), minlength=parts)
            shares[one.name] = (counts / max(len(left), 1)).tolist()
        return Wave(len(left) / CANDIDATES, shares, () if len(left) else self._contradicting(distances)), left

    def waves(self, table: Universes) -> list[Wave]:
        """Return what each wave ruled out by which universes of a table were computed."""
        table = selected(table, table.seed == 0)
        return [self.wave(selected(table, table.wave <= k), k)[0] for k in range(1 + int(table.wave.max()))]

    def extended(self, table: Universes, compute: Callable[[list[Universe]], Universes], count: int) -> Universes:
        """Return a table with the universes of waves, and the best of all again with other random numbers.

        table: universes that fill the space. count: universes of a wave.
        """
        before = math.inf
        for number in range(1, MOST + 1):
            wave, left = self.wave(selected(table, table.seed == 0), number - 1)
            if not len(left) or wave.volume > 0.9 * before:
                break
            before, first = wave.volume, FIRST_OF_WAVES + count * (number - 1)
            assignments = [designs.assignment_at(self.choices, self.varied, point) for point in left[:count]]
            universes = [Universe(first + k, WAVE, one, wave=number) for k, one in enumerate(assignments)]
            table = gathered([table, compute(universes)])
        rows = [_standardized(*one, one_sided=name in self._statements) for name, one in self.measured(table).items()]
        if not rows:
            return table
        worst = np.where(table.seed == 0, np.max(rows, axis=0), np.nan)  # NaN without all results
        if not np.isfinite(worst).any():
            return table
        at = int(np.nanargmin(worst))
        assignment = decoded(self.choices, table.assignment[at])
        again = Universe(AGAIN + int(table.number[at]), WAVE, assignment, seed=1, wave=int(table.wave.max()))
        return table if again.number in table.number else gathered([table, compute([again])])

    def _points(self, table: Universes) -> np.ndarray:
        """Universes as points of the unit cube (universe, varied); NaN for a value that is not combined."""
        points = np.full((len(table.number), len(self.varied)), np.nan)
        for at, row in enumerate(table.assignment):
            values = decoded(self.choices, row)
            for k, one in enumerate(self.varied):
                value, names = values.get(one.name), combined_values(one)
                if one.range and value is not None:
                    points[at, k] = np.clip(one.range.share(value), 0.0, 1.0)
                elif value in names:
                    points[at, k] = (names.index(value) + 0.5) / len(names)
        return points

    def _contradicting(self, distances: dict[str, np.ndarray]) -> tuple[str, ...]:
        """The fewest headlines, one or two, that no candidate fulfils together; else all."""
        allowed = {label: distance < SIGMAS for label, distance in distances.items()}
        pairs = (pair for pair in itertools.product(allowed, repeat=2) if pair[0] < pair[1])
        for those in (*itertools.product(allowed), *pairs):
            if not np.all([allowed[label] for label in those], axis=0).any():
                return those
        return tuple(allowed)


def emulated(features: np.ndarray, values: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, float]:
    """Return what a ridge regression predicts, and the standard deviation of what it misses when a point is left out.

    features: of the points with values (count, n); values: at these points (count,); wanted: features of the points to
    predict (m, n).
    """
    unit = 2.0 ** (math.frexp(np.abs(values).max())[1] - 1)  # squares of a number that diverges would be infinite
    values = values / unit
    mean, scale = values.mean(), values.std() or 1.0
    u, s, vt = np.linalg.svd(features, full_matrices=False)
    scaled = (values - mean) / scale
    best = (math.inf, np.zeros(features.shape[1]))
    for ridge in RIDGES:
        shrunk = s * s / (s * s + ridge)
        fitted = u @ (shrunk * (u.T @ scaled))
        leverage = np.einsum("ij,j,ij->i", u, shrunk, u)
        left_out = float(np.sqrt(np.mean(((scaled - fitted) / np.maximum(1.0 - leverage, 1e-6)) ** 2)))
        if left_out < best[0]:
            best = left_out, vt.T @ ((s / (s * s + ridge)) * (u.T @ scaled))
    return unit * (mean + scale * (wanted @ best[1])), unit * scale * best[0]


def _features(combined: Sequence[Choice], points: np.ndarray) -> np.ndarray:
    """A constant, the values of each choice (of a range, its share and its square), and products of two choices."""
    blocks = []
    for k, one in enumerate(combined):
        if one.range:
            centred = 2.0 * points[:, k] - 1.0
            blocks.append([centred, centred**2])
        else:
            count = len(combined_values(one))
            blocks.append([(interval_of(points[:, k], count) == value) - 1.0 / count for value in range(count)])
    products = [a * b for first, second in itertools.combinations(blocks, 2) for a in first for b in second]
    return np.array([np.ones(len(points)), *itertools.chain(*blocks), *products]).T


def _standardized(distance, deviation, *, one_sided: bool) -> np.ndarray:
    """Distances in standard deviations; a statement that holds has none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.where(distance == 0.0, 0.0, np.abs(distance) / deviation)
    return np.where(distance <= 0.0, 0.0, size) if one_sided else size
