"""Plot of a funnel that a reader of the report can look into."""

import math

import numpy as np

from marsedl.papers.funnels.records import Dubins, FlightEnsemble
from marsedl.replication.closeups import CloseUp, rounded

MOST_FLIGHTS = 30  # each drawn at every so many of its steps:
FLIGHT_STEP = 4


def funnel(dubins: Dubins, dubins_calm: FlightEnsemble, dubins_wind: FlightEnsemble) -> CloseUp:
    """Slices of both funnels of the Dubins car, with flights inside."""
    unit = np.array([1.0, 1.0, math.pi / 180.0])
    path, known = dubins.state[::2], list(dubins.funnel)
    cases = []
    for flights, which, name in ((dubins_calm, "flow", "without wind"), (dubins_wind, "wind", "in wind")):
        level = dubins.level[known.index(which)]
        # {1/2 x'P x <= level} is the image of the unit ball under this matrix
        half_axes = [
            math.sqrt(2.0 * rho) * np.linalg.inv(np.linalg.cholesky(dubins.shape[step])).T / unit[:, np.newaxis]
            for rho, step in zip(level, dubins.slice_step, strict=True)
        ]
        flown = (path + flights.kept_history[:MOST_FLIGHTS])[:, ::FLIGHT_STEP] / unit
        cases.append({"name": name, "half_axes": rounded(np.array(half_axes)), "flights": rounded(flown)})
    return CloseUp(
        "funnel",
        "Funnel of the Dubins car",
        "The funnel in x, y and heading, which a flat picture cannot show. Each outline is one of its slices, an"
        " ellipsoid around the nominal path, which is the thick line; thin lines are flights of the car under its"
        " feedback. The slice under the slider is drawn strong, with its largest deviations beside it.",
        "tube",
        {
            "axes": [{"name": "x", "unit": "m"}, {"name": "y", "unit": "m"}, {"name": "heading", "unit": "°"}],
            "time": rounded(dubins.slice_time),
            "centre": rounded(path[dubins.slice_step] / unit),
            "cases": cases,
        },
    )
