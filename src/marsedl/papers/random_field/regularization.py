"""What the navigation errors of the design do: gains, predictions and flights against their size."""

from dataclasses import dataclass

import numpy as np

from marsedl.papers.random_field import montecarlo
from marsedl.papers.random_field.linearization import UNITS
from marsedl.papers.random_field.nominal import Nominal
from marsedl.papers.random_field.variants import designed, flown, percentiles
from marsedl.replication.artifacts import quantity


@dataclass(frozen=True)
class Regularization:
    """The last law of the reading's iterations for every size of the navigation errors."""

    factor: np.ndarray = quantity("1", ("sizes",), "factor of the reading's navigation errors")
    position_error: np.ndarray = quantity("m", ("sizes",), "standard deviation of the navigation error in radius")
    condition_number: np.ndarray = quantity("1", ("sizes",), "of the design's Cov(W) in the last iteration")
    largest_gain: np.ndarray = quantity("1", ("sizes",), "largest gain in units of 1 km, 100 m/s, 0.01 rad")
    predicted_deviation: np.ndarray = quantity("m/s", ("sizes",), "predicted standard deviation of delta-v")
    design_deviation: np.ndarray = quantity("m/s", ("sizes",), "the same with navigation errors")
    flown_deviation: np.ndarray = quantity("m/s", ("sizes",), "over the captured flights", allow_nan=True)
    percentile: np.ndarray = quantity("m/s", ("sizes",), "99th percentile over flights", allow_nan=True)
    percentile_error: np.ndarray = quantity("m/s", ("sizes",), "its standard error", allow_nan=True)
    saturated: np.ndarray = quantity("1", ("sizes",), "flights whose command leaves the limits at some step", "int64")
    worst_step: np.ndarray = quantity("1", ("sizes",), "flights beyond the limits at the worst step", "int64")
    lost: np.ndarray = quantity("1", ("sizes",), "lost trials", "int64")


def compute(inputs, nominal: Nominal) -> Regularization:
    """Design and fly every size; ill-conditioned designs are made here, to show what comes of them."""
    rows = []
    for factor in inputs.navigation_factors:
        deviations = factor * np.where(inputs.navigation_deviations > 0.0, inputs.navigation_deviations, 0.01 * UNITS)
        varied, made = designed(inputs, nominal, navigation_deviations=deviations, ill_conditioned="report")
        ensemble = flown(varied, nominal, made)
        percentile, error = (values[-1] for values in percentiles(ensemble))
        by_step, at_any = montecarlo.step_violations(ensemble, made.partition)
        captured = ensemble.delta_v[-1][np.isfinite(ensemble.delta_v[-1])]
        rows.append(
            {
                "factor": factor,
                "position_error": deviations[0],
                "condition_number": made.condition_number[-1],
                "largest_gain": made.largest_gain[-1],
                "predicted_deviation": made.delta_v_deviation[-1],
                "design_deviation": made.design_delta_v_deviation[-1],
                "flown_deviation": captured.std(ddof=1) if len(captured) > 1 else np.nan,
                "percentile": percentile,
                "percentile_error": error,
                "saturated": at_any[-1],
                "worst_step": by_step[-1].max(),
                "lost": montecarlo.lost(ensemble)[-1],
            }
        )
    return Regularization(**{name: np.array([row[name] for row in rows]) for name in rows[0]})
