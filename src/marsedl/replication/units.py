"""Units in which records are shown: one table of conversions for the columns of tables and the axes of figures."""

import math
from typing import Any

import numpy as np

KM, DEGREE = 1e3, math.pi / 180.0  # in metres and radians
WATT_PER_CM2 = 1e4  # in W/m^2
PURE = ("", "1")  # units of pure numbers, which heads of columns and labels of axes do not show
CONVERSIONS = {  # from the unit of a record to that in which it is shown
    ("m", "km"): 1e-3,
    ("m/s", "km/s"): 1e-3,
    ("rad", "deg"): 180.0 / math.pi,
    ("rad", "mrad"): 1e3,
    ("rad/s", "deg/s"): 180.0 / math.pi,
    ("rad/s^2", "deg/s^2"): 180.0 / math.pi,
    ("1", "%"): 100.0,
    ("1", "planet radii"): 1.0,
    ("N", "kN"): 1e-3,
    ("Pa", "kPa"): 1e-3,
    ("W/m^2", "W/cm^2"): 1e-4,
}


def converted(values: Any, unit: str, target_unit: str, name: str = "a value") -> np.ndarray:
    """Return values in another unit; raises ValueError, which has the field's `name`, if there is no conversion."""
    if target_unit == unit:
        return np.asarray(values)
    if (unit, target_unit) not in CONVERSIONS:
        targets = ", ".join(other for source, other in CONVERSIONS if source == unit)
        raise ValueError(
            f"field '{name}' is in {unit}, which is not converted to {target_unit}"
            + (f"; it can be shown in {targets}" if targets else "")
        )
    return np.asarray(values) * CONVERSIONS[unit, target_unit]
