"""How the iteration ends, and what mends it: many iterations with one and with both branches of the clean-up burn."""

import numpy as np

from marsedl.papers.random_field.flight_statistics import lost
from marsedl.papers.random_field.records import VARIANTS, Convergence, Nominal
from marsedl.papers.random_field.variants import designed, flown, percentiles
from marsedl.replication.catalogue import stage


@stage(claimed_in=("corrected",))
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
                "lost": lost(ensemble),
                "control_change": np.append(0.0, change),
            }
        )
    return Convergence(**{name: np.array([row[name] for row in rows]) for name in rows[0]})
