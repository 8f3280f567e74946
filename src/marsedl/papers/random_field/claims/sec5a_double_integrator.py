"""Sec. V.A: the double integrator."""

import numpy as np

from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.montecarlo.statistics import binomial_interval
from marsedl.papers.random_field.claims.measures import share_error
from marsedl.papers.random_field.double_integrator import ellipse_radius, normals_and_bounds, tail
from marsedl.papers.random_field.inputs import PointMass
from marsedl.papers.random_field.records import CLOSED, DoubleIntegrator, DoubleIntegratorFlights
from marsedl.replication.claims.counterexamples import replaced, scaled, shifted
from marsedl.replication.claims.thresholds import CONFIDENCE
from marsedl.replication.claims.writing import claim, holds, measure, measured

# ---- inputs ----------------------------------------------------------------------------------------------------------


@claim()
def dint_n(point_mass: PointMass):
    return measured(len(point_mass.double_integrator_partition) - 1)


@claim()
def dint_pf_equals_p0(point_mass: PointMass):
    same_deviations = np.array_equal(
        point_mass.double_integrator_final_three_sigma, point_mass.double_integrator_initial_three_sigma
    )
    same_correlation = (
        point_mass.double_integrator_final_correlation == point_mass.double_integrator_initial_correlation
    )
    return measured(same_deviations and same_correlation)


@claim()
def dint_p_x(point_mass: PointMass):
    return measured(tail(point_mass))


@claim()
def dint_weights(point_mass: PointMass):
    largest_state_weight = float(np.max(point_mass.double_integrator_state_weights))
    return measured(
        [
            *map(float, point_mass.double_integrator_weights),
            largest_state_weight,
            point_mass.double_integrator_percentile_weight,
        ]
    )


@claim(errata="E10")
def dint_constraint_apex(point_mass: PointMass):
    apex = np.linalg.solve(*normals_and_bounds(point_mass))
    meets = f"the lines of the two normal vectors meet at ({apex[0]:.6f}, {apex[1]:.6f}), rounded here"
    return measured(np.round(apex, 4), evidence=meets)


@claim(
    "The vectors of Eq. 61 have slopes {flatter:.0f} times less steep.",
    errata="E10",
    counterexample=replaced("point_mass.double_integrator_first_normal", (4.255319, 8.51064)),
)
def dint_constraint_slopes(point_mass: PointMass, published):
    normals, _ = normals_and_bounds(point_mass)
    slopes = -normals[:, 0] / normals[:, 1]
    printed = np.array(published["dint_constraint_slopes"].printed)
    return measured(slopes, flatter=np.abs(printed / slopes).mean())


# ---- chance constraints ----------------------------------------------------------------------------------------------


@claim(
    "Of {trials:,} flights {share:.3f} % lie outside, where {allotted:.2f} % are allotted.",
    errata="E11",
    choices="constrained_steps",
    counterexample=scaled("double_integrator_flights.any_violations", at=(CLOSED, -1)),
)
def dint_chance_constraints_satisfied(
    point_mass: PointMass, double_integrator: DoubleIntegrator, double_integrator_flights: DoubleIntegratorFlights
):
    flights = double_integrator_flights
    trials = int(flights.count[CLOSED] + flights.excluded[CLOSED])
    allotted = 1.0 - point_mass.double_integrator_probability
    whole = flights.any_violations[CLOSED]
    worst = int(np.argmax(whole))
    low, high = (100 * bound for bound in binomial_interval(whole[worst], trials, CONFIDENCE))

    def test(subject, count, limit):
        share, error = 100 * count / trials, 100 * share_error(count, trials)
        return measure(f"share of the trials outside of {subject}", share, "%", error=error) <= 100 * limit

    return holds(
        test("both constraints", whole, allotted),
        test("either one", flights.violations[CLOSED], tail(point_mass)),
        f"at t = {double_integrator.partition[worst]:g} {whole[worst]:,} of {trials:,} lie outside ({low:.3f} to "
        f"{high:.3f} % with {100 * CONFIDENCE:g} % confidence), of the first {flights.paper_trials:,} "
        f"{flights.paper_any_violations[CLOSED, worst]:,}",
        trials=trials,
        share=100 * whole[worst] / trials,
        allotted=100 * allotted,
    )


@claim(errata="E10", counterexample=shifted("double_integrator.support", at=(CLOSED,)))
def dint_ellipses_protrude(
    point_mass: PointMass, double_integrator: DoubleIntegrator, double_integrator_flights: DoubleIntegratorFlights
):
    flights = double_integrator_flights
    support, error = _sampled_support(point_mass, flights)
    return holds(
        measure(
            "largest excess of a'x over its bound on the ellipses, by linear covariance",
            double_integrator.support[CLOSED].max(),
        )
        > 0.0,
        measure("the same by the flights", support, error=error) > 0.0,
        f"an ellipse that holds {100 * point_mass.ellipse_probability:g} % of the plane reaches "
        f"{ellipse_radius(point_mass):.2f} deviations far, the constraint {upper_quantile(tail(point_mass)):.2f}",
        trials=int(flights.count[CLOSED] + flights.excluded[CLOSED]),
    )


def _sampled_support(point_mass, flights):
    """Largest value of a'x over the ellipses of the trials under feedback, less the bound, and its standard error."""
    normals, bounds = normals_and_bounds(point_mass)
    mean = flights.mean[CLOSED, flights.node, :2]
    covariance = flights.covariance[CLOSED, flights.node, :2, :2]
    spread = np.sqrt(np.einsum("ci,kij,cj->kc", normals, covariance, normals))
    radius = ellipse_radius(point_mass)
    support = mean @ normals.T + radius * spread - bounds
    furthest = np.unravel_index(np.argmax(support), support.shape)
    error = spread[furthest] * np.sqrt((1.0 + 0.5 * radius**2) / flights.count[CLOSED])
    return float(support[furthest]), float(error)
