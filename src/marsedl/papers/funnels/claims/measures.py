"""What several claims share: limits of statements, levels of the flights, and what is left out of a stage."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import COMPLETE, LEVEL, SPHERES
from marsedl.papers.funnels.inputs import Guidance, Planet, Recursion
from marsedl.papers.funnels.records import CoarseFunnels, FlightEnsemble, Funnel, StageStudy
from marsedl.replication.claims.thresholds import ROUNDING
from marsedl.replication.claims.writing import Test, check, provided


def complete(funnel: Funnel) -> Test:
    """Test that a funnel exists to the end."""
    if funnel.outcome == COMPLETE:
        return check("the funnel is complete", True)
    return check(f"the funnel is complete (its outcome is: {funnel.outcome})", False)


def by_our_limit(test: Test, why: str) -> Test:
    """Test of what the paper does not print and we chose, as `Limit(ours)`: in doubt if half or twice ours turns it."""
    doubt = test.doubt and test.doubt.model_copy(update={"why": f"{why}; half or twice ours would turn the verdict"})
    return replace(test, doubt=doubt)


def on_slices(recursion: Recursion, funnel: Funnel) -> Test:
    """Test that the samples from which the levels follow lie on the slices: others say nothing of the funnel."""
    departure = np.abs(sampled_levels(recursion, funnel) - 1.0).max()
    on_them = bool(departure < ROUNDING)
    return provided("the samples from which the levels follow lie on the slices", on_them)


def sampled_levels(recursion: Recursion, funnel: Funnel) -> np.ndarray:
    """V/rho of the points at which the programs of a reading are matched, (slices, samples)."""
    points = funnel.samples[:, : funnel.shape.shape[1]]
    if recursion.sampling == "raw":
        deviations = np.sqrt(2.0) * np.broadcast_to(points * recursion.raw_units, (len(funnel.level), *points.shape))
    else:
        factor = np.linalg.cholesky(funnel.shape)
        radius = np.sqrt(2.0 * funnel.level)[:, np.newaxis, np.newaxis]
        deviations = radius * (points @ np.linalg.inv(factor))
    values = np.einsum("kmi,kij,kmj->km", deviations, funnel.shape, deviations)
    return values / (2.0 * funnel.level[:, np.newaxis])


def flown_levels(funnel: Funnel, ensemble: FlightEnsemble) -> np.ndarray:
    """Largest V of the flights of an ensemble at the slices, (slices,)."""
    return ensemble.maximum_over_trials[funnel.step, LEVEL]


def over_flown(funnel: Funnel, ensemble: FlightEnsemble) -> np.ndarray:
    """Level of the funnel over the largest V of the flights at the slices after the first, (slices - 1,)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return funnel.level[1:] / flown_levels(funnel, ensemble)[1:]


def largest_error(funnel: Funnel, ensemble: FlightEnsemble) -> np.ndarray:
    """Standard deviation of the largest V of a tenth of the flights at the slices, (slices,); NaN of fewer than two."""
    repeats = ensemble.repeat_maximum[:, funnel.step, LEVEL]
    repeats = repeats[np.isfinite(repeats).any(axis=1)]
    return np.std(repeats, axis=0, ddof=1) if len(repeats) > 1 else np.full(len(funnel.step), np.nan)


def largest(values: np.ndarray, default: float = np.nan) -> float:
    """Largest of the numbers among some values."""
    values = np.asarray(values)
    return float(np.max(values, initial=-np.inf, where=np.isfinite(values))) if np.isfinite(values).any() else default


def peaks(values: np.ndarray) -> np.ndarray:
    """Numbers of the slices at which a sequence has an inner local maximum."""
    inner = values[1:-1]
    return np.flatnonzero((inner > values[:-2]) & (inner > values[2:])) + 1


def of_variant(coarse_funnels: CoarseFunnels, name: str) -> np.ndarray:
    """Levels of one of the funnels with coarse slices."""
    return coarse_funnels.variant_level[list(coarse_funnels.variant).index(name)]


class TooFewSamples(NamedTuple):
    """The bound of the benchmark stage from the most of the samples that are too few."""

    few: int
    few_bound: float
    enough_bound: float


def too_few_samples(stage_study: StageStudy) -> TooFewSamples:
    """Compare the bound from too few samples with that from enough."""
    enough = stage_study.samples[list(stage_study.variables).index(SPHERES.variables)]
    short = stage_study.few_rank < enough
    few = int(stage_study.few_samples[short].max(initial=0))
    return TooFewSamples(few, largest(stage_study.few_bound[short]), float(stage_study.form_bound[0]))


class Definiteness(NamedTuple):
    """Least eigenvalue of the matrices of all slices, in the scales of the regulator."""

    least: float


def definiteness(planet: Planet, guidance: Guidance, funnel: Funnel) -> Definiteness:
    """Least eigenvalue over the slices."""
    scale = environment.state_scale(planet, guidance)
    return Definiteness(np.linalg.eigvalsh(funnel.shape * np.outer(scale, scale))[:, 0].min())
