"""Plot of the final states that a reader of the report can look into."""

import numpy as np

from marsedl.papers.powered_descent.records import MOTION, FlightEnsemble, Gains
from marsedl.replication.report.closeups import CloseUp, rounded

MOST_POINTS = 2000


def final_states(gains: Gains, closed_loop: FlightEnsemble, open_loop: FlightEnsemble) -> CloseUp:
    """Final states against the covariance of the design."""
    predicted = _ellipse("predicted by the design", gains.mean[-1], gains.covariance[-1])
    cases = [
        {
            "name": name,
            "points": rounded(flights.final_state[:MOST_POINTS, :MOTION], axis=0),
            "ellipses": [
                *ellipses,
                _ellipse("of the trials", flights.mean[-1, :MOTION], flights.covariance[-1, :MOTION, :MOTION]),
            ],
            "replay": f"marsedl trial powered_descent corrected {case}",
        }
        for case, name, flights, ellipses in (
            ("closed_loop", "with feedback", closed_loop, [predicted]),
            ("open_loop", "without feedback", open_loop, []),
        )
    ]
    return CloseUp(
        "final_states",
        "Final states of the trials",
        "Each point is the state in which one Monte Carlo flight of the nonlinear plant ends. The dashed ellipse is the"
        " covariance that the linear design predicts, the solid one that of the trials: where they coincide, the design"
        " keeps its promise. It promises nothing for flights without feedback.",
        "scatter",
        {
            "axes": [{"name": MOTION.label(component), "unit": unit} for component, unit in MOTION.units.items()],
            "cases": cases,
        },
    )


def _ellipse(name: str, mean: np.ndarray, covariance: np.ndarray) -> dict:
    return {"name": name, "mean": rounded(mean), "covariance": rounded(covariance, digits=6)}
