"""Plot of a funnel that a reader of the report can look into."""

import math

import numpy as np

from marsedl.papers.funnels.records import CAR_STATE, Dubins, FlightEnsemble
from marsedl.replication.report.closeups import CloseUp, rounded
from marsedl.replication.units import DEGREE

MOST_FLIGHTS = 30  # each drawn at every so many of its steps:
FLIGHT_STEP = 4


def funnel(dubins: Dubins, dubins_calm: FlightEnsemble, dubins_wind: FlightEnsemble) -> CloseUp:
    """Slices of both funnels of the Dubins car, with flights inside."""
    scale = np.array([DEGREE if CAR_STATE.units[name] == "rad" else 1.0 for name in CAR_STATE.names])
    path, funnels = dubins.state[::2], list(dubins.funnel)
    cases = []
    for flights, base, title in ((dubins_calm, "flow", "without wind"), (dubins_wind, "wind", "in wind")):
        level = dubins.level[funnels.index(base)]
        # {1/2 x'P x <= level} is the image of the unit ball under this matrix
        half_axes = [
            math.sqrt(2.0 * rho) * np.linalg.inv(np.linalg.cholesky(dubins.shape[step])).T / scale[:, np.newaxis]
            for rho, step in zip(level, dubins.slice_step, strict=True)
        ]
        histories = (path + flights.kept_history[:MOST_FLIGHTS])[:, ::FLIGHT_STEP] / scale
        cases.append({"name": title, "half_axes": rounded(np.array(half_axes)), "flights": rounded(histories)})
    return CloseUp(
        "funnel",
        "Funnel of the Dubins car",
        "The funnel in x, y and heading, which a flat picture cannot show. Each outline is one of its slices, an"
        " ellipsoid around the nominal path, which is the thick line; thin lines are flights of the car under its"
        " feedback. The slice under the slider is drawn strong, with its largest deviations beside it.",
        "tube",
        {
            "axes": [
                {"name": CAR_STATE.label(name), "unit": "°" if unit == "rad" else unit}
                for name, unit in CAR_STATE.units.items()
            ],
            "time": rounded(dubins.slice_time),
            "centre": rounded(path[dubins.slice_step] / scale),
            "cases": cases,
        },
    )
