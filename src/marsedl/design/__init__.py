"""Doors from a vehicle's own equations to a law with a proof: the same `rates` that fly are designed with.

The budget of a dispersion is a question to flights, `Flights.budget` of `marsedl.fly`.
"""

from marsedl.design.desensitize import Gain, Robust, Sensitivity, desensitize
from marsedl.design.reference import Reference, optimal

__all__ = ["Gain", "Reference", "Robust", "Sensitivity", "desensitize", "optimal"]
