"""Sec. IV: the mass profile and its iteration."""

import numpy as np

from marsedl.montecarlo.streaming import FinalMoments
from marsedl.papers.powered_descent.claims.measures import MOTION_PART, freedom
from marsedl.papers.powered_descent.inputs import Mission
from marsedl.papers.powered_descent.records import FlightEnsemble, Nominal
from marsedl.replication.claims.counterexamples import spread
from marsedl.replication.claims.thresholds import ABOUT
from marsedl.replication.claims.writing import claim, holds, measure
from marsedl.replication.pipeline.injection import Largest


@claim(by_construction="a mass iteration that does not converge is an error of its stage")
def mass_iteration_converges(nominal: Nominal):
    contraction = nominal.integrated_change[1:] / nominal.integrated_change[:-1]
    return holds(measure(f"factor from pass to pass, {len(contraction) + 1} passes", contraction) < 1)


@claim(counterexample=spread("closed_loop.final_state", component="altitude"))
def prior_mass_sufficient(mission: Mission, closed_loop: Largest[FlightEnsemble], prior_mass: Largest[FlightEnsemble]):
    # What the fixed profile costs: the same trials with the same noise, with the mass as it flows and as it is assumed.
    true_mass, assumed_mass = FinalMoments(closed_loop, MOTION_PART), FinalMoments(prior_mass, MOTION_PART)
    scale = np.sqrt(np.diag(mission.final_covariance))
    product, trials = np.outer(scale, scale), min(true_mass.count, assumed_mass.count)
    variances = np.outer(assumed_mass.variance, assumed_mass.variance)
    # As if the two ensembles were independent: their common noise makes the errors smaller.
    mean_error = np.sqrt(2 * assumed_mass.variance / trials) / scale
    error = np.sqrt(2 * (assumed_mass.covariance**2 + variances) / freedom(trials)) / product
    shift, change = (
        np.abs(true_mass.mean - assumed_mass.mean) / scale,
        np.abs(true_mass.covariance - assumed_mass.covariance) / product,
    )
    subject = "shift of the final mean by the mass that flows"
    return holds(
        measure(subject, shift, "target standard deviations", error=mean_error) <= ABOUT,
        measure("relative change of the final covariance by the mass that flows", change, error=error) <= ABOUT,
        trials=trials,
    )
