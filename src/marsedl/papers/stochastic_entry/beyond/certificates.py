"""The stochastic law against independent formulations: a cone program, the search over LQG weights, Theorem III.1."""

import numpy as np

from marsedl.methods.covariance_steering.lqg_dual import InfeasibleProblem, lqg_gains, variances
from marsedl.papers.stochastic_entry.beyond.cone_program import solve_cone_program
from marsedl.papers.stochastic_entry.beyond.weight_search import bryson_weights, solve_over_weights
from marsedl.papers.stochastic_entry.gains import problem, solved
from marsedl.papers.stochastic_entry.inputs import Design, Guidance, refuse_partial_periods
from marsedl.papers.stochastic_entry.records import (
    START_SCALES,
    TRIGGERS,
    Certificates,
    Gains,
    Linearization,
)
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import stage

PERTURBATION = 0.05  # relative, of the gains


@stage(claimed_in=("corrected",))
def compute(guidance: Guidance, design: Design, linearization: Linearization, gains: Gains) -> Certificates:
    """Solve the design on a coarse partition by three ways, and test Theorem III.1 on the reading's own partition.

    Raises MarsedlError if the coarse interval is no multiple of the guidance period, or has no feasible law.
    """
    try:
        refuse_partial_periods("design.coarse_interval", [design.coarse_interval], guidance.guidance_period)
    except ValueError as error:
        raise MarsedlError(str(error)) from None
    rows = [_trigger(guidance, design, linearization, gains, trigger) for trigger in range(len(TRIGGERS))]
    return Certificates(**{name: np.array([row[name] for row in rows]) for name in rows[0]})


def _trigger(guidance: Guidance, design: Design, linearization, gains, trigger):
    coarse = problem(guidance, design, linearization, trigger, interval=design.coarse_interval)
    where = f"the {TRIGGERS[trigger]} trigger on intervals of {design.coarse_interval:g} s"
    try:
        reference = solved(coarse)
        cone = solve_cone_program(coarse, reference)
    except (InfeasibleProblem, RuntimeError) as error:
        raise MarsedlError(
            f"{where}: {error}; raise altitude_limit, flight_path_angle_limit or control_limit"
        ) from None
    # The search is not convex: which starts go astray differs in the last bits, hence between machines.
    usual, control_weight = bryson_weights(coarse)
    searches = [solve_over_weights(coarse, (usual, scale * control_weight)) for scale in START_SCALES]

    nominal_problem = problem(guidance, design, linearization, trigger)
    weight = np.outer(nominal_problem.objective, nominal_problem.objective)
    for direction, multiplier in zip(nominal_problem.final_directions, gains.final_multiplier[trigger], strict=True):
        weight += multiplier * np.outer(direction, direction)
    control_weight = nominal_problem.control_weight + gains.control_multiplier[trigger]
    again, _ = lqg_gains(nominal_problem.system, weight, control_weight)
    own_gain = gains.stochastic_gain[trigger][gains.partition_start]
    size = np.abs(own_gain).max(axis=0)

    def lagrangian(gain):
        covariance, variance = variances(nominal_problem, gain)
        return np.sum(weight * covariance[-1]) + control_weight @ variance

    best, rises = lagrangian(again), []
    for states in (slice(None), *range(again.shape[1])):
        for sign in (-1.0, 1.0):
            other = again.copy()
            other[:, states] *= 1.0 + sign * PERTURBATION
            rises.append(lagrangian(other) - best)
    above_floor = best - gains.noise_floor[trigger]
    return {
        "coarse_gap": reference.gap,
        "cone_ratio": cone.cost / reference.cost,
        "cone_status": cone.status,
        "cone_iterations": cone.iterations,
        "search_ratio": [search.cost / reference.cost for search in searches],
        "search_worst": [search.worst_ratio for search in searches],
        "weights_gain_error": np.abs(
            (_textbook_gains(nominal_problem.system, weight, control_weight) - own_gain) / size
        ).max(),
        "perturbed_cost": min(rises) / above_floor,
    }


def _textbook_gains(system, final_weight, control_weight):
    """Eq. 55 as printed but for its missing inverse, without the Joseph form of the design."""
    value, gains = final_weight, []
    for transition, control, weight in zip(
        system.transition[::-1], system.control[::-1, :, 0], control_weight[::-1], strict=True
    ):
        bracket = control @ value @ control + weight
        gain = -(control @ value @ transition) / bracket
        value = transition.T @ value @ transition - bracket * np.outer(gain, gain)
        gains.append(gain)
    return np.array(gains[::-1])
