"""Sec. V.A: the double integrator."""

import numpy as np

from marsedl.methods.covariance_steering.steering_program import upper_quantile
from marsedl.montecarlo.statistics import binomial_interval
from marsedl.papers.random_field.claims.measures import OPEN, chance_of_more
from marsedl.papers.random_field.double_integrator import ellipse_radius, normals_and_bounds, tail
from marsedl.papers.random_field.inputs import PointMass
from marsedl.papers.random_field.records import CLOSED, DoubleIntegrator, DoubleIntegratorFlights
from marsedl.replication.claiming import claim, holds, measure, measured
from marsedl.replication.counterexamples import replaced, scaled, shifted
from marsedl.replication.thresholds import CONFIDENCE

FREE = -1  # the law without constraints, behind those that fly

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
    """The normal vectors of Eq. 61 do pass through the apex, with slopes {flatter:.0f} times less steep. Between lines
    of the printed slopes nothing would constrain the law. At all nodes they lie at least {free_distance:.2f} deviations
    from the mean of the law without constraints. Without feedback the nearest lies {open_distance:.2f} deviations away.
    Its ellipse would reach {open_reach:+.4f} beyond it.""",
    errata="E10",
    counterexample=replaced("point_mass.double_integrator_first_normal", (4.255319, 8.51064)),
)
def dint_constraint_slopes(point_mass: PointMass, published, double_integrator: DoubleIntegrator | None = None):
    normals, _ = normals_and_bounds(point_mass)
    slopes = -normals[:, 0] / normals[:, 1]
    lines = f"the lines of the two normal vectors have slopes {slopes[0]:.5f} and {slopes[1]:.5f}"
    printed = np.array(published["dint_constraint_slopes"].printed)
    numbers = dict.fromkeys(("open_distance", "closed_distance", "free_distance", "open_reach"), np.nan)
    if double_integrator is not None:
        distance, reach = _between_printed_slopes(point_mass, double_integrator, printed)
        numbers = {
            "open_distance": distance[OPEN],
            "closed_distance": distance[CLOSED],
            "free_distance": distance[FREE],
            "open_reach": reach[OPEN],
        }
        lines += (
            f"; of lines with the printed slopes the nearest is {distance[FREE]:.2f} deviations from the mean of the "
            f"law without constraints, {distance[CLOSED]:.2f} from that of the constrained law, without feedback "
            f"{distance[OPEN]:.2f} (the ellipses reach {ellipse_radius(point_mass):.2f})"
        )
    return measured(slopes, evidence=lines, flatter=np.abs(printed / slopes).mean(), **numbers)


def _between_printed_slopes(point_mass, double_integrator, slopes):
    """Least distance of the mean from lines of other slopes through the apex, in deviations, and the ellipses' reach.

    Returns two arrays by law, the last one (FREE) without constraints, as it is this law that tells whether lines would
    constrain anything; the reach is the ellipses' largest excess of velocity over a line.
    """
    normals, bounds = normals_and_bounds(point_mass)
    apex = np.linalg.solve(normals, bounds)
    upward = np.sign(normals[:, 1])
    printed_normals = np.column_stack([-upward * slopes, upward])
    mean = np.array([*double_integrator.mean, double_integrator.free_mean])
    covariance = np.array([*double_integrator.covariance, double_integrator.free_covariance])
    spread = np.sqrt(np.einsum("ci,lkij,cj->lkc", printed_normals, covariance, printed_normals))
    room = printed_normals @ apex - mean @ printed_normals.T
    reach = ellipse_radius(point_mass) * spread - room
    return (room / spread).min(axis=(1, 2)), reach.max(axis=(1, 2))


# ---- chance constraints ----------------------------------------------------------------------------------------------


@claim(
    """Of {all_trials:,} flights {share:.3f} % lie outside, where {allotted:.2f} % are allotted. If the law kept what is
    allotted, as many or more would lie outside with a probability of {chance:.1g}. The paper judges by {first:,}
    flights. Of as many {first_share:.2f} % lie outside here ({first_low:.2f} to {first_high:.2f} %). This is with the
    constraint at the last node too. Without it {cc_to_4[share]:.0f} % lie outside there.""",
    errata="E11",
    withheld="the steps at which the lines constrain (`point_mass.double_integrator_constrained`)",
    counterexample=scaled("double_integrator_flights.any_violations", at=(CLOSED, -1)),
)
def dint_chance_constraints_satisfied(
    point_mass: PointMass, double_integrator: DoubleIntegrator, double_integrator_flights: DoubleIntegratorFlights
):
    flights = double_integrator_flights
    first, trials = flights.paper_trials, int(flights.count[CLOSED] + flights.excluded[CLOSED])
    allotted = 1.0 - point_mass.double_integrator_probability
    paper, whole = flights.paper_any_violations[CLOSED], flights.any_violations[CLOSED]
    worst = int(np.argmax(whole))
    low, high = (100 * bound for bound in binomial_interval(paper[worst], first, CONFIDENCE))
    all_low, all_high = (100 * bound for bound in binomial_interval(whole[worst], trials, CONFIDENCE))
    chance = float(chance_of_more(whole[worst], trials, allotted))

    def test(subject, count, limit):
        # The sampling error of a share that is as allotted.
        error = 100 * np.sqrt(limit * (1.0 - limit) / trials)
        return (
            measure(f"share of the trials outside of {subject}", 100 * count / trials, "%", error=error) <= 100 * limit
        )

    return holds(
        test("both constraints", whole, allotted),
        test("either one", flights.violations[CLOSED], tail(point_mass)),
        f"at the worst node, t = {double_integrator.partition[worst]:g}, {whole[worst]:,} of {trials:,} lie outside "
        f"({all_low:.3f} to {all_high:.3f} % with {100 * CONFIDENCE:g} % confidence), of the first {first:,} "
        f"{paper[worst]:,}; without feedback {100 * flights.any_violations[OPEN].max() / trials:.0f} %",
        trials=trials,
        share=100 * whole[worst] / trials,
        first=first,
        first_share=100 * paper[worst] / first,
        first_low=low,
        first_high=high,
        all_trials=trials,
        allotted=100 * allotted,
        chance=chance,
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
