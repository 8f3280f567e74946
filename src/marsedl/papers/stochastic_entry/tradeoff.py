"""Final range dispersion of the stochastic law against the partition of its design and against the altitude limit."""

import numpy as np

from marsedl.methods.covariance_steering.lqg_dual import InfeasibleProblem, noise_floor
from marsedl.papers.stochastic_entry.gains import problem, solved
from marsedl.papers.stochastic_entry.inputs import Design, Guidance, refuse_partial_periods
from marsedl.papers.stochastic_entry.objective import final_weights
from marsedl.papers.stochastic_entry.records import TRIGGERS, Linearization, Tradeoff
from marsedl.replication.catalogue import stage
from marsedl.replication.errors import MarsedlError


@stage(claimed_in=("corrected",))
def compute(guidance: Guidance, design: Design, linearization: Linearization) -> Tradeoff:
    """Solve Problem 1 on every partition and with every altitude limit.

    Raises MarsedlError if an interval is no multiple of the guidance period, or a partition has no feasible law.
    """
    try:
        refuse_partial_periods("design.partition_study", design.partition_study, guidance.guidance_period)
        refuse_partial_periods("design.coarse_interval", [design.coarse_interval], guidance.guidance_period)
    except ValueError as error:
        raise MarsedlError(str(error)) from None
    triggers = range(len(TRIGGERS))
    solutions = [
        [_solved(guidance, design, linearization, t, interval) for interval in design.partition_study] for t in triggers
    ]
    limited = (design.partition_interval, design.coarse_interval)
    return Tradeoff(
        interval=design.partition_study,
        range_deviation=np.sqrt(
            [[_range_variance(design, linearization, t, s) for s in solutions[t]] for t in triggers]
        ),
        early_control=np.array([[3.0 * np.sqrt(s.control_variance[0]) for s in solutions[t]] for t in triggers]),
        gap=np.array([[s.gap for s in solutions[t]] for t in triggers]),
        altitude_limit=design.altitude_limit_study,
        limited_interval=np.array(limited),
        limited_deviation=np.array(
            [
                [
                    [_limited(guidance, design, linearization, t, i, a) for a in design.altitude_limit_study]
                    for t in triggers
                ]
                for i in limited
            ]
        ),
        floor=np.sqrt(
            [
                noise_floor(p.system, p.objective)
                for p in (problem(guidance, design, linearization, t, guidance.guidance_period) for t in triggers)
            ]
        ),
    )


def _solved(guidance: Guidance, design: Design, linearization, trigger, interval):
    try:
        return solved(problem(guidance, design, linearization, trigger, interval=interval))
    except InfeasibleProblem as error:
        raise MarsedlError(
            f"partition_study: the {TRIGGERS[trigger]} trigger on intervals of {interval:g} s: {error}; leave it out, "
            "or raise altitude_limit, flight_path_angle_limit or control_limit"
        ) from None


def _range_variance(design: Design, linearization, trigger, solution):
    objective = final_weights(design, linearization)[trigger]
    return objective @ solution.covariance[-1] @ objective


def _limited(guidance: Guidance, design: Design, linearization, trigger, interval, altitude_limit):
    try:
        solution = solved(problem(guidance, design, linearization, trigger, interval, altitude_limit))
    except InfeasibleProblem:
        return np.nan
    return np.sqrt(_range_variance(design, linearization, trigger, solution))
