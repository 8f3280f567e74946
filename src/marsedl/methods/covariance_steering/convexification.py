"""Successive convexification: solve, move the nominal to the solution, linearise again (random field, Algorithm 1)."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from marsedl.methods.checks import require_at_least
from marsedl.summaries import summary

__all__ = ["Run", "Step", "classify", "successive_convexification"]


class Step(NamedTuple):
    """What one iteration returns."""

    control: np.ndarray  # the next nominal control
    monitored: np.ndarray  # (q,), quantities on which termination is decided, of the nominal that this control gives
    result: Any  # whatever the caller keeps of the iteration

    __repr__ = summary


class Run(NamedTuple):
    """All iterations that were made."""

    results: list  # of the iterations, as `Step.result`
    control: np.ndarray  # (iterations + 1, ...), nominal controls from the guess on
    monitored: np.ndarray  # (iterations, q)
    outcome: str  # "converged", "cycling" or "stopped"
    period: int  # of the cycle; 1 if converged, 0 if stopped

    __repr__ = summary


def successive_convexification(step: Callable[[np.ndarray], Step], guess, *, iterations, tolerances, stop=True) -> Run:
    """Iterate until nothing changes, the iteration cycles, or its number is exhausted.

    Args:
        step: one iteration, from a nominal control to `Step`: propagate and linearise about it, solve the convex
            program, and monitor the nominal that its solution gives.
        guess: first nominal control.
        iterations: largest number of iterations.
        tolerances: changes of the monitored quantities that count as none, (q,).
        stop: whether to end as soon as the iteration has converged or cycles; otherwise all iterations are made.

    Returns:
        `Run`.

    Raises:
        ValueError: if iterations < 1, or the number of monitored quantities changes or is not that of the tolerances.
        Whatever `step` raises.
    """
    require_at_least("iterations", iterations, 1)
    tolerances = np.atleast_1d(np.asarray(tolerances, dtype=float))
    controls, monitored, results = [np.asarray(guess, dtype=float)], [], []
    for number in range(iterations):
        result = step(controls[-1])
        values = np.atleast_1d(np.asarray(result.monitored, dtype=float))
        if values.shape != tolerances.shape:
            raise ValueError(
                f"iteration {number + 1} monitors {values.size} quantities, tolerances has {tolerances.size}"
            )
        controls.append(np.asarray(result.control, dtype=float))
        monitored.append(values)
        results.append(result.result)
        if stop and classify(monitored, tolerances)[0] != "stopped":
            break
    outcome, period = classify(monitored, tolerances)
    return Run(results, np.array(controls), np.array(monitored), outcome, period)


def classify(monitored, tolerances):
    """What a sequence of monitored quantities does at its end.

    "converged": the last value is that of the iteration before. "cycling": the last two periods of some length p > 1
    are equal, value by value. "stopped": neither.

    Args:
        monitored: (iterations, q).
        tolerances: differences that count as none, (q,).

    Returns:
        Outcome and period: 1 if converged, p if cycling, 0 if stopped.
    """
    monitored = np.asarray(monitored, dtype=float)
    count = len(monitored)
    for period in range(1, count // 2 + 1):
        repeats = 1 if period == 1 else period
        recent = monitored[count - repeats :]
        earlier = monitored[count - repeats - period : count - period]
        if (np.abs(recent - earlier) <= tolerances).all():
            return ("converged", 1) if period == 1 else ("cycling", period)
    return "stopped", 0
