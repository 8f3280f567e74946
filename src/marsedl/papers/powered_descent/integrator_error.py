"""Error of the integrators against their step, on shared Brownian paths."""

from dataclasses import dataclass

import numpy as np

from marsedl.papers.powered_descent import flight, segments
from marsedl.papers.powered_descent.gains import Gains
from marsedl.replication.artifacts import quantity

REFINEMENT = (2, 5, 10, 20, 50)  # reference steps in one step of the tested runs
SCHEMES = ("rk4", "euler_maruyama")
STATE = "m, m, m/s, m/s, kg"


@dataclass(frozen=True)
class IntegratorError:
    """Differences of the final states from those of the finest Runge-Kutta run with the same noise."""

    scheme: np.ndarray = quantity("1", ("schemes",), "name of the scheme", "str")
    step: np.ndarray = quantity("s", ("steps",), "largest step of the run")
    reference_step: float = quantity("s", (), "largest step of the reference run")
    trials: int = quantity("1", (), "trials in each run")
    strong_error: np.ndarray = quantity(STATE, ("schemes", "steps", 5), "root mean square difference")
    bias: np.ndarray = quantity(STATE, ("schemes", "steps", 5), "mean difference")
    bias_standard_error: np.ndarray = quantity(STATE, ("schemes", "steps", 5), "standard error of the mean difference")
    variance_bias: np.ndarray = quantity("1", ("schemes", "steps", 5), "relative difference of the variances")


def compute(inputs, gains: Gains) -> IntegratorError:
    """Fly the same trials with both schemes and several steps."""
    coarsest = REFINEMENT[-1] * inputs.finest_time_step
    # Every tested step must divide the segments; the reference step is then a little below the one asked for.
    counts = [REFINEMENT[-1] * int(np.ceil(d / coarsest - 1e-9)) for d in inputs.segment_durations]
    reference = _final_states(inputs, gains, counts, "rk4", 1)
    differences = np.array(
        [[_final_states(inputs, gains, counts, scheme, q) - reference for q in REFINEMENT] for scheme in SCHEMES]
    )
    variance = reference.var(axis=0, ddof=1)
    step = max(d / n for d, n in zip(inputs.segment_durations, counts, strict=True))
    return IntegratorError(
        scheme=np.array(SCHEMES),
        step=step * np.array(REFINEMENT),
        reference_step=float(step),
        trials=len(reference),
        strong_error=np.sqrt((differences**2).mean(axis=2)),
        bias=differences.mean(axis=2),
        bias_standard_error=differences.std(axis=2, ddof=1) / np.sqrt(len(reference)),
        variance_bias=(reference + differences).var(axis=2, ddof=1) / variance - 1,
    )


def _final_states(inputs, gains, counts, scheme, refinement):
    """Final states (trials, 5) of a run whose steps hold `refinement` increments of the reference run."""
    schedules = flight.schedules_of(inputs, gains, [count // refinement for count in counts])
    states = flight.initial_states(
        segments.initial_mean(inputs),
        inputs.initial_covariance,
        inputs.wet_mass,
        inputs.seed,
        np.arange(inputs.convergence_trials),
    )
    flown = flight.fly(
        schedules,
        flight.plant_of(inputs),
        states,
        steps_per_output=[schedule.steps for schedule in schedules],
        seed=inputs.seed,
        integrator=scheme,
        increments=refinement,
    )
    return flown.final_state.T.copy()
