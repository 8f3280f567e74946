"""What flies: the two vehicles that come with the package, and a model of one's own."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from marsedl.fly.declared import MARS, Declared, Exponential, Markov, Normal, Planet, Table, Uniform, declare

__all__ = ["Entry", "Lander", "Model"]

_ANGLES = {
    "flight_path_angle": "flight path angle, positive while climbing",
    "azimuth": "heading, clockwise from north",
}
ENTRY_QUANTITIES = {
    "altitude": ("m", "altitude"),
    "velocity": ("m/s", "planet-relative velocity"),
    **{name: ("rad", meaning) for name, meaning in _ANGLES.items()},
    **{name: ("rad", name) for name in ("latitude", "longitude")},
    "range": ("m", "distance along the great circle of the nominal start"),
    "crossrange": ("m", "distance to the right of the great circle of the nominal start"),
    "density": ("kg/m^3", "density of the air"),
    "drag": ("m/s^2", "drag acceleration"),
    "lift": ("m/s^2", "lift acceleration"),
    "bank": ("rad", "bank angle; positive turns the heading clockwise"),
    "max_load": ("m/s^2", "largest aerodynamic acceleration at the start of a step"),
    "min_altitude": ("m", "lowest altitude at the start of a step"),
    "ballistic_coefficient": ("kg/m^2", "ballistic coefficient m / (C_D A)"),
    "lift_to_drag": ("1", "lift-to-drag ratio"),
}
LANDER_QUANTITIES = {
    "downrange": ("m", "downrange"),
    "altitude": ("m", "altitude"),
    "downrange_velocity": ("m/s", "downrange velocity"),
    "vertical_velocity": ("m/s", "vertical velocity, positive upwards"),
    "mass": ("kg", "mass"),
    "thrust_downrange": ("N", "commanded thrust, downrange"),
    "thrust_vertical": ("N", "commanded thrust, upwards"),
    "max_command": ("N", "largest thrust that was commanded"),
    "min_command": ("N", "smallest thrust that was commanded"),
    "specific_impulse": ("s", "specific impulse"),
    "smallest_thrust": ("N", "smallest thrust"),
    "largest_thrust": ("N", "largest thrust"),
    "thrust_scale": ("1", "true over commanded thrust"),
}
END_TIME = {"end_time": ("s", "time at which the flight ended")}
MARTIAN_AIR = Exponential()
Number = float | Normal | Uniform


@dataclass(frozen=True)
class Model:
    """A model of your own: a `montecarlo.flights.Flight` of plain functions, and what its numbers mean.

    Args:
        flight: `Flight`. It may leave `guide` and `ended` to the law and the trigger of `fly`; then `rates` annotates
            its argument `command` with the NamedTuple that the law returns.
        p: parameters, a NamedTuple.
        vehicle: a NamedTuple whose members may be dispersed, which functions ask for as `vehicle`.
        quantities: mapping from names to (unit, meaning).
        nodes: of the trials' own air, if the flight has `vary`.
        complete: function (p, nominal start by name) -> p, for parameters that depend on the start.
        warn: function (p, final values by name) -> sentences on flights that left what the model covers.
    """

    flight: Any
    p: tuple = ()
    vehicle: tuple = ()
    quantities: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    nodes: int = 0
    complete: Callable = None
    warn: Callable = None

    def model(self) -> "Model":
        """The model itself."""
        return self

    def __reduce__(self):
        """Pickle the functions of the flight, which a process of a pool binds again."""
        return _bound_again, (parts_of(self.flight), *(getattr(self, part.name) for part in fields(self)[1:]))

    def units(self, names) -> dict[str, str]:
        """Units of these quantities, "" where none is declared."""
        return {name: self.quantities.get(name, ("",))[0] for name in names}

    def declared_start(self, start) -> Declared:
        """Initial state, checked: see `declared.declare`."""
        state = self.flight.parts["state"]
        return declare(start, self.units(state._fields), state._field_defaults, "start")

    def declared_vehicle(self) -> Declared:
        """Vehicle, checked."""
        names = getattr(self.vehicle, "_fields", ())
        return declare(dict(zip(names, self.vehicle, strict=True)), self.units(names), {}, "vehicle")


def parts_of(flight) -> dict[str, Any]:
    """Arguments that bind a `Flight` again; what the engine stores by default, the state, is left to it."""
    functions = {role: flight.functions[role] for role in flight.classes}
    parts = {role: made for role, made in functions.items() if made.__name__ != "the_state"}
    return {**parts, "guide": flight.guides or None, **flight.options}


def _bound_again(parts, *others):
    from marsedl.montecarlo.flights import Flight

    return Model(Flight(**parts), *others)


@dataclass(frozen=True)
class Entry:
    """Entry of a gliding vehicle over a rotating planet; the law commands the bank angle.

    Start: altitude (m), velocity (m/s, planet-relative), flight_path_angle (rad), and azimuth, latitude, longitude
    (rad; by default eastwards along the equator). Laws are told these, and range, crossrange (m), density (kg/m^3),
    drag and lift (m/s^2).

    Args:
        ballistic_coefficient: m / (C_D A), kg/m^2. lift_to_drag: 1. Both may be dispersed.
        planet: `Planet`.
        air: mean density: `Exponential`, `Table`, or None for no air.
        variation: of the density, `Markov`, or None.
        nodes: altitudes (lowest, highest, spacing), m, at which the mean density is stored, log-linear between them.
    """

    ballistic_coefficient: Number
    lift_to_drag: Number = 0.0
    planet: Planet = MARS
    air: Exponential | Table | None = MARTIAN_AIR
    variation: Markov | None = None
    nodes: tuple[float, float, float] = (-5e3, 150e3, 250.0)

    def model(self) -> Model:
        """The model that flies."""
        from marsedl.fly import dynamics

        altitude = np.arange(self.nodes[0], self.nodes[1] + self.nodes[2], self.nodes[2])
        log_density = np.full(altitude.size, -700.0) if self.air is None else self.air.log_density(altitude)
        varied = (0.0, 1.0, 0.0, np.zeros(2))
        if self.variation is not None:
            retention = np.exp(-self.variation.spacing / self.variation.correlation_length)
            bottom, spacing = float(self.variation.bottom), float(self.variation.spacing)
            varied = (bottom, spacing, float(retention), self.variation.deviations())
        mean = (float(self.nodes[0]), float(self.nodes[2]), np.asarray(log_density, float))
        return Model(
            dynamics.ENTRY,
            p=dynamics.EntryParameters(*map(float, self.planet), *mean, *varied, frame=()),
            vehicle=dynamics.EntryVehicle(self.ballistic_coefficient, self.lift_to_drag),
            quantities=ENTRY_QUANTITIES,
            nodes=len(varied[3]),
            complete=lambda p, start: p._replace(frame=dynamics.frame_of(start)),
            warn=_below_the_air,
        )


def _below_the_air(p, final):
    if count := int((final["min_altitude"] < p.bottom).sum()):
        yield (
            f"{count:,} flights went below {p.bottom:g} m, the lowest node of the air: its density continues along its "
            f"last slope there; a trigger such as Below('altitude', 0.0) ends them before"
        )


@dataclass(frozen=True)
class Lander:
    """Powered descent in a plane over flat ground, with the mass of its propellant; the law commands the thrust.

    Start: downrange, altitude (m), downrange_velocity, vertical_velocity (m/s) and mass (kg), of which laws are told.
    The command, thrust_downrange and thrust_vertical (N), is scaled to the limits of its magnitude.

    Args:
        largest_thrust, smallest_thrust: N. specific_impulse: s. thrust_scale: true over commanded thrust, 1. All may be
            dispersed.
        thrust_noise: white noise of both components of the force, N s^(1/2).
        gravity: m/s^2.
    """

    largest_thrust: Number
    specific_impulse: Number
    smallest_thrust: Number = 0.0
    thrust_scale: Number = 1.0
    thrust_noise: float = 0.0
    gravity: float = 3.71

    def model(self) -> Model:
        """The model that flies."""
        from marsedl.fly import dynamics

        vehicle = (self.specific_impulse, self.smallest_thrust, self.largest_thrust, self.thrust_scale)
        return Model(
            dynamics.LANDER,
            p=dynamics.LanderParameters(float(self.gravity), float(self.thrust_noise)),
            vehicle=dynamics.LanderVehicle(*vehicle),
            quantities=LANDER_QUANTITIES,
        )
