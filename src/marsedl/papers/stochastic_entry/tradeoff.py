"""Final range dispersion of the stochastic law against the partition of its design and against the altitude limit."""

from dataclasses import dataclass

import numpy as np

from marsedl.methods.covariance_steering.lqg_dual import InfeasibleProblem, noise_floor
from marsedl.papers.stochastic_entry.gains import TRIGGERS, final_weights, problem, solved
from marsedl.papers.stochastic_entry.linearization import Linearization
from marsedl.replication.artifacts import quantity
from marsedl.replication.errors import MarsedlError

COARSE = 10.0  # s, a second partition for the altitude limits: on the reading's own the floor may hide the trade-off


@dataclass(frozen=True)
class Tradeoff:
    """Standard deviation of the range error that each trigger's objective holds, predicted by the linear model."""

    interval: np.ndarray = quantity("s", ("partitions",), "interval over which the control is held")
    range_deviation: np.ndarray = quantity("m", (2, "partitions"), "optimum by trigger (time, velocity)")
    early_control: np.ndarray = quantity("1", (2, "partitions"), "three sigma of the control in the first interval")
    gap: np.ndarray = quantity("1", (2, "partitions"), "duality gap")
    altitude_limit: np.ndarray = quantity("m", ("limits",), "limit of the final altitude error")
    limited_interval: np.ndarray = quantity("s", (2,), "partitions of the study of limits")
    limited_deviation: np.ndarray = quantity(
        "m", (2, 2, "limits"), "optimum by partition, trigger and limit; NaN: infeasible", allow_nan=True
    )
    floor: np.ndarray = quantity("m", (2,), "deviation from noise after the last control")


def compute(inputs, linearization: Linearization) -> Tradeoff:
    """Solve Problem 1 on every partition and with every altitude limit."""
    triggers = range(len(TRIGGERS))
    found = [[_solved(inputs, linearization, t, interval) for interval in inputs.partition_study] for t in triggers]
    limited = (inputs.partition_interval, COARSE)
    return Tradeoff(
        interval=inputs.partition_study,
        range_deviation=np.sqrt([[_range_variance(inputs, linearization, t, s) for s in found[t]] for t in triggers]),
        early_control=np.array([[3.0 * np.sqrt(s.control_variance[0]) for s in found[t]] for t in triggers]),
        gap=np.array([[s.gap for s in found[t]] for t in triggers]),
        altitude_limit=inputs.altitude_limit_study,
        limited_interval=np.array(limited),
        limited_deviation=np.array(
            [
                [[_limited(inputs, linearization, t, i, a) for a in inputs.altitude_limit_study] for t in triggers]
                for i in limited
            ]
        ),
        floor=np.sqrt(
            [
                noise_floor(p.system, p.objective)
                for p in (problem(inputs, linearization, t, inputs.guidance_period) for t in triggers)
            ]
        ),
    )


def _solved(inputs, linearization, trigger, interval):
    try:
        return solved(problem(inputs, linearization, trigger, interval=interval))
    except InfeasibleProblem as error:
        raise MarsedlError(
            f"partition_study: the {TRIGGERS[trigger]} trigger on intervals of {interval:g} s: {error}; leave it out, "
            "or raise altitude_limit, flight_path_angle_limit or control_limit"
        ) from None


def _range_variance(inputs, linearization, trigger, solution):
    objective = final_weights(inputs, linearization)[trigger]
    return objective @ solution.covariance[-1] @ objective


def _limited(inputs, linearization, trigger, interval, altitude_limit):
    try:
        solution = solved(problem(inputs, linearization, trigger, interval, altitude_limit))
    except InfeasibleProblem:
        return np.nan
    return np.sqrt(_range_variance(inputs, linearization, trigger, solution))
