"""What several claims and tables share: what "met" means, and moments of the trials."""

from typing import NamedTuple

import numpy as np

from marsedl.montecarlo.statistics import covariance as covariance_of
from marsedl.montecarlo.statistics import variance
from marsedl.papers.powered_descent.inputs import Mission
from marsedl.papers.powered_descent.records import FlightEnsemble
from marsedl.replication.pipeline.injection import Largest

MOTION_PART, MASS = slice(4), 4  # components of the final state
UPPER = ((0, 0, 0, 1, 1, 2), (1, 2, 3, 2, 3, 3))


def freedom(trials: int) -> float:
    """Degrees of freedom of a sample variance; NaN of one trial, which has none."""
    return trials - 1 if trials > 1 else np.nan


class FinalMass(NamedTuple):
    """Final mass over the closed-loop trials: its mean, its variance and their number."""

    mean: float
    variance: float
    trials: int


def final_mass(closed_loop: Largest[FlightEnsemble]) -> FinalMass:
    """Moments of the final mass."""
    mass = closed_loop.final_state[:, MASS]
    return FinalMass(mass.mean(), variance(mass), len(mass))


class Misses(NamedTuple):
    """By how much trials miss a target, in its standard deviations and their products, with standard errors."""

    mean: np.ndarray  # (4,)
    mean_error: np.ndarray
    covariance: np.ndarray  # (4, 4)
    covariance_error: np.ndarray
    trials: int


class FinalMisses(Misses):
    """Those of the final target."""


def final_misses(mission: Mission, closed_loop: Largest[FlightEnsemble]) -> FinalMisses:
    """By how much the trials miss the final target."""
    return FinalMisses(*misses_at_the_end(closed_loop, mission))


def misses_at_the_end(ensemble: FlightEnsemble, mission: Mission):
    """By how much the final states of an ensemble miss the final target, `Misses`."""
    state = ensemble.final_state[:, MOTION_PART]
    return misses((state.mean(axis=0), covariance_of(state), len(state)), mission.final_mean, mission.final_covariance)


def misses(moments: tuple, mean: np.ndarray, covariance: np.ndarray) -> Misses:
    """By how much moments, as mean (4,), covariance (4, 4) and trials, miss a mean and a covariance."""
    sample_mean, sample_covariance, trials = moments
    scale = np.sqrt(np.diag(covariance))
    product = np.outer(scale, scale)
    sampling = np.sqrt(
        (sample_covariance**2 + np.outer(np.diag(sample_covariance), np.diag(sample_covariance))) / freedom(trials)
    )
    return Misses(
        np.abs(sample_mean - mean) / scale,
        np.sqrt(np.diag(sample_covariance) / trials) / scale,
        np.abs(sample_covariance - covariance) / product,
        sampling / product,
        trials,
    )


def printed_covariance(published) -> np.ndarray:
    """Covariance of Eq. 54 (4, 4), made symmetric: entry (1,2) as above the diagonal (E8), others the mean (E9)."""
    upper = np.array(published["mc_final_cov_upper"].printed)
    lower = np.array(published["mc_final_cov_lower"].printed)
    both = (upper + lower) / 2
    both[0] = upper[0]
    covariance = np.diag(np.array(published["mc_final_cov_diag"].printed, dtype=float))
    covariance[UPPER] = both
    covariance[UPPER[::-1]] = both
    return covariance
