"""Final range dispersion of the stochastic law against the altitude limit, on two partitions of the control."""

import numpy as np

from marsedl.methods.covariance_steering.lqg_dual import InfeasibleProblem, noise_floor
from marsedl.papers.stochastic_entry.gains import problem, solved
from marsedl.papers.stochastic_entry.inputs import Design, Guidance, refuse_partial_periods
from marsedl.papers.stochastic_entry.records import TRIGGERS, Linearization, Tradeoff
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import stage

TIME = TRIGGERS.index("time")


@stage(claimed_in=("corrected",))
def compute(guidance: Guidance, design: Design, linearization: Linearization) -> Tradeoff:
    """Solve Problem 1 for the fixed time with every altitude limit, on the reading's partition and on a coarse one.

    Raises MarsedlError if the coarse interval is no multiple of the guidance period.
    """
    try:
        refuse_partial_periods("design.coarse_interval", [design.coarse_interval], guidance.guidance_period)
    except ValueError as error:
        raise MarsedlError(str(error)) from None
    intervals, limits = (design.partition_interval, design.coarse_interval), design.altitude_limit_study
    fine = problem(guidance, design, linearization, TIME, guidance.guidance_period)
    return Tradeoff(
        altitude_limit=limits,
        control_interval=np.array(intervals),
        deviation=np.array(
            [[_deviation(guidance, design, linearization, i, limit) for limit in limits] for i in intervals]
        ),
        noise_deviation=float(np.sqrt(noise_floor(fine.system, fine.objective))),
    )


def _deviation(guidance: Guidance, design: Design, linearization, interval, altitude_limit):
    posed = problem(guidance, design, linearization, TIME, interval, altitude_limit)
    try:
        covariance = solved(posed).covariance[-1]
    except InfeasibleProblem:
        return np.nan
    return np.sqrt(posed.objective @ covariance @ posed.objective)
