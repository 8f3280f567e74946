"""How the iteration ends, and what mends it: many iterations with one and with both branches of the clean-up burn."""

from dataclasses import dataclass

import numpy as np

from marsedl.papers.random_field import montecarlo
from marsedl.papers.random_field.nominal import Nominal
from marsedl.papers.random_field.variants import designed, flown, percentiles
from marsedl.replication.artifacts import quantity

# One linearised branch, as in the paper; both branches in the program; one branch and short end steps.
VARIANTS = ("one_branch", "both_branches", "short_end_steps")


@dataclass(frozen=True)
class Convergence:
    """Iteration histories of the variants, which the file names in its order; law 0 is the open loop."""

    variant: np.ndarray = quantity("1", ("variants",), "name of the variant", "str")
    outcome: np.ndarray = quantity("1", ("variants",), "converged, cycling or stopped", "str")
    period: np.ndarray = quantity("1", ("variants",), "of the cycle; 1 if converged, 0 if stopped", "int64")
    apoapsis: np.ndarray = quantity("1", ("variants", "laws"), "nominal exit apoapsis, planet radii", allow_nan=True)
    nominal_delta_v: np.ndarray = quantity("m/s", ("variants", "laws"), "nominal delta-v", allow_nan=True)
    predicted: np.ndarray = quantity(
        "m/s", ("variants", "laws"), "percentile that the program predicts", allow_nan=True
    )
    percentile: np.ndarray = quantity("m/s", ("variants", "laws"), "99th percentile over flights", allow_nan=True)
    percentile_error: np.ndarray = quantity("m/s", ("variants", "laws"), "its standard error", allow_nan=True)
    lost: np.ndarray = quantity("1", ("variants", "laws"), "lost trials", "int64")
    control_change: np.ndarray = quantity("1", ("variants", "laws"), "largest change of the mean control")


def compute(inputs, nominal: Nominal) -> Convergence:
    """Run every variant for the study's number of iterations, and fly all of its laws."""
    rows = []
    for variant in VARIANTS:
        changes = {"iterations": inputs.convergence_iterations, "clean_up_branch": "mean"}
        if variant == "both_branches":
            changes["clean_up_branch"] = "both"
        if variant == "short_end_steps":
            changes["partition"] = inputs.fine_partition
        varied, made = designed(inputs, nominal, **changes)
        ensemble = flown(varied, nominal, made)
        percentile, error = percentiles(ensemble)
        change = np.abs(np.diff(made.control, axis=0)).max(axis=1)
        rows.append(
            {
                "variant": variant,
                "outcome": made.outcome,
                "period": made.period,
                "apoapsis": made.apoapsis,
                "nominal_delta_v": made.nominal_delta_v,
                "predicted": made.percentile,
                "percentile": percentile,
                "percentile_error": error,
                "lost": montecarlo.lost(ensemble),
                "control_change": np.append(0.0, change),
            }
        )
    return Convergence(**{name: np.array([row[name] for row in rows]) for name in rows[0]})
