"""Plot of the iteration that a reader of the report can look into."""

from marsedl.papers.random_field.records import Convergence
from marsedl.plotting.fields import field
from marsedl.replication.report.closeups import CloseUp, rounded
from marsedl.replication.units import PURE


def iterations(convergence: Convergence) -> CloseUp:
    """Iteration histories of the successive convexification."""
    series = [
        f"{variant.replace('_', ' ')}: {outcome}" + (f" with period {period}" if period > 1 else "")
        for variant, outcome, period in zip(convergence.variant, convergence.outcome, convergence.period, strict=True)
    ]
    quantities = []
    for path, error, name, unit in (
        ("percentile", "percentile_error", "99th percentile of Δv, over flights", ""),
        ("predicted", "", "99th percentile of Δv, predicted", ""),
        ("apoapsis", "", "apoapsis of the nominal", "planet radii"),
        ("nominal_delta_v", "", "Δv of the nominal", ""),
        ("control_change", "", "largest change of the mean control", ""),
    ):
        history = field(convergence, path, unit=unit)
        quantity = {
            "name": name,
            "unit": "" if history.unit in PURE else history.unit,
            "values": rounded(history.values),
        }
        quantities.append(quantity | ({"errors": rounded(getattr(convergence, error), digits=3)} if error else {}))
    return CloseUp(
        "iterations",
        "Histories of the iteration",
        "What each pass of the successive convexification arrives at, over more passes than the paper has. Compare the"
        " percentile of the velocity change Δv that the flights need with the one that the program predicts. Bars are"
        " three standard errors; iteration 0 is the initial guess without feedback.",
        "histories",
        {"steps": "iteration", "series": series, "quantities": quantities},
    )
