"""Sec. IV: the mass profile and its iteration."""

import numpy as np

from marsedl.montecarlo.statistics import covariance, variance
from marsedl.papers.powered_descent.claims.measures import MOTION_PART, FinalMisses, freedom
from marsedl.papers.powered_descent.inputs import Mission
from marsedl.papers.powered_descent.records import FlightEnsemble, Nominal
from marsedl.replication.claims.claim import Doubt
from marsedl.replication.claims.counterexamples import replaced, spread
from marsedl.replication.claims.thresholds import ABOUT
from marsedl.replication.claims.verdicts import Evaluation
from marsedl.replication.claims.writing import claim, holds, measure
from marsedl.replication.pipeline.injection import Largest


@claim(counterexample=replaced("nominal.integrated_change", 1.0))
def mass_iteration_converges(nominal: Nominal):
    change = nominal.integrated_change
    if len(change) < 2:
        return Evaluation(
            True, evidence="one pass is enough", doubts=[Doubt(why="there is no pass to compare it with")]
        )
    return holds(measure(f"factor from pass to pass, {len(change)} passes", change[1:] / change[:-1]) < 1)


@claim(counterexample=spread("closed_loop.final_state", component="altitude"))
def prior_mass_sufficient(
    mission: Mission,
    misses: FinalMisses,
    closed_loop: Largest[FlightEnsemble],
    prior_mass: Largest[FlightEnsemble],
):
    # The flights whose mass flows meet their targets, and do so by the design: the mass that it assumes beforehand is
    # near enough to theirs. Compared are the same trials with the same noise, with the mass as it flows and as assumed.
    true_mass, assumed_mass = closed_loop.final_state[:, MOTION_PART], prior_mass.final_state[:, MOTION_PART]
    scale = np.sqrt(np.diag(mission.final_covariance))
    product, trials = np.outer(scale, scale), min(len(true_mass), len(assumed_mass))
    assumed_covariance, assumed_variance = covariance(assumed_mass), variance(assumed_mass)
    variances = np.outer(assumed_variance, assumed_variance)
    # As if the two ensembles were independent: their common noise makes the errors smaller.
    mean_error = np.sqrt(2 * assumed_variance / trials) / scale
    error = np.sqrt(2 * (assumed_covariance**2 + variances) / freedom(trials)) / product
    shift, change = (
        np.abs(true_mass.mean(axis=0) - assumed_mass.mean(axis=0)) / scale,
        np.abs(covariance(true_mass) - assumed_covariance) / product,
    )
    unit = "target standard deviations"
    return holds(
        measure("error of the mean, with the mass that flows", misses.mean, unit, error=misses.mean_error) <= ABOUT,
        measure("relative error of the covariance, with it", misses.covariance, error=misses.covariance_error) <= ABOUT,
        measure("shift of the final mean by the mass that flows", shift, unit, error=mean_error) <= ABOUT,
        measure("relative change of the final covariance by it", change, error=error) <= ABOUT,
        trials=trials,
        miss=misses.covariance.max(),
        change=change.max(),
    )
