"""What flies: the two vehicles that come with the package, and a model of one's own."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from marsedl.fly import dynamics
from marsedl.fly.actuators import Actuator, Coordinates
from marsedl.fly.declared import (
    MARS,
    NOT_NEGATIVE,
    POSITIVE,
    QUARTER_TURN,
    Below,
    Declared,
    Exponential,
    Markov,
    Normal,
    Planet,
    Table,
    Uniform,
    declare,
    is_number,
    require_numbers,
)
from marsedl.fly.own_air import OwnAir, Profiles, Wind, beside, varied
from marsedl.models.atmosphere import uniform_cells, uniform_nodes
from marsedl.montecarlo.flights import Flight
from marsedl.words import require

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
    "energy": ("m^2/s^2", "specific mechanical energy V^2 / 2 - mu / r of the planet-relative velocity"),
    "bank": ("rad", "bank angle; positive turns the heading clockwise"),
    "max_load": ("m/s^2", "largest aerodynamic acceleration at the start of a step or the end"),
    "min_altitude": ("m", "lowest altitude at the start of a step or the end"),
    "max_altitude": ("m", "highest altitude at the start of a step or the end"),
    "ballistic_coefficient": ("kg/m^2", "ballistic coefficient m / (C_D A)"),
    "lift_to_drag": ("1", "lift-to-drag ratio"),
    **{f"{what}_factor": ("1", f"true over declared {what}") for what in ("drag", "lift", "density")},
    "gravitational_parameter": ("m^3/s^2", "gravitational parameter of the planet"),
    "radius": ("m", "radius of the planet"),
    "rotation_rate": ("rad/s", "rotation rate of the planet"),
    "zonal_wind": ("m/s", "wind to the east"),
    "meridional_wind": ("m/s", "wind to the north"),
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
ENGINE_QUANTITIES = {  # with actuators
    "thrust": ("N", "thrust"),
    "tilt": ("rad", "angle of the thrust from the vertical, positive downrange"),
    "thrust_downrange": ("N", "thrust, downrange"),
    "thrust_vertical": ("N", "thrust, upwards"),
}
ENTRY_BOUNDS = {
    **dict.fromkeys(("ballistic_coefficient", "velocity", "gravitational_parameter", "radius"), POSITIVE),
    **dict.fromkeys(("drag_factor", "density_factor"), NOT_NEGATIVE),
    **dict.fromkeys(("flight_path_angle", "latitude"), QUARTER_TURN),
}
LANDER_BOUNDS = {
    **dict.fromkeys(("mass", "specific_impulse", "largest_thrust"), POSITIVE),
    **dict.fromkeys(("smallest_thrust", "thrust_scale"), NOT_NEGATIVE),
}
ROUNDING = 1e-6  # m, by which a trigger may miss the ground
SPACING = 250.0  # of the nodes of the mean density, m, where no row of a table needs a smaller one
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
        bounds: lowest and highest value of numbers of the start and the vehicle; a flight that draws others is refused.
        failed: function (p, final values by name) -> mapping from outcomes to the flights that have them, (trials,);
            these do not count in statistics.
        ends: mapping from outcomes to triggers, which end flights beside the trigger of `fly`.
        actuators: mapping from what is commanded to `Actuator`, how it is followed. All functions are then told what is
            flown as `command`, but `watch` what is commanded, also where it arrives within a period. Histories hold
            both, the latter as `commanded_<name>`; final numbers hold what is flown, and as `saturated_<name>` in how
            many guidance periods its limits kept it from what is commanded: it was cut, or could not be reached within
            a period of its arrival.
        coordinates: `actuators.Coordinates` that actuators move in place of the numbers of the command.
        air: `own_air.OwnAir`, the trials' own air in place of `vary`.

    `final` and histories hold the state, which is the truth, under its names. What `navigate` returns, or without it
    `sense`, is what laws are told; results hold `nav_<name>`, and what is sensed under the name of a state as
    `sensed_<name>`.
    """

    flight: Any
    p: tuple = ()
    vehicle: tuple = ()
    quantities: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    nodes: int = 0
    complete: Callable = None
    warn: Callable = None
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    failed: Callable = None
    ends: Mapping[str, Any] = field(default_factory=dict)
    actuators: Mapping[str, Actuator] = field(default_factory=dict)
    coordinates: Coordinates | None = None
    air: OwnAir | None = None

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
        return declare(start, self.units(state._fields), state._field_defaults, "start", self.bounds)

    def declared_vehicle(self, given=None) -> Declared:
        """Vehicle, or what is given of it by name, checked."""
        names = getattr(self.vehicle, "_fields", ())
        given = dict(zip(names, self.vehicle, strict=True)) if given is None else given
        return declare(given, self.units(names), {}, "vehicle", self.bounds)


def parts_of(flight) -> dict[str, Any]:
    """Arguments that bind a `Flight` again; what the engine stores by default, the state, is left to it."""
    functions = ((role, flight.functions[role]) for role in flight.classes)
    parts = {role: function for role, function in functions if function.__name__ != "the_state"}
    return {**parts, "guide": flight.guides or None, **flight.options}


def _bound_again(parts, *others):
    return Model(Flight(**parts), *others)


@dataclass(frozen=True)
class Entry:
    """Entry of a gliding vehicle over a rotating planet; the law commands the bank angle.

    Start: altitude (m), velocity (m/s, planet-relative), flight_path_angle (rad), and azimuth, latitude, longitude
    (rad; by default eastwards along the equator). Laws are told these, and range, crossrange (m), density (kg/m^3),
    drag and lift (m/s^2), and the specific mechanical energy V^2 / 2 - mu / r (m^2/s^2) of the planet-relative
    velocity, as `energy`.

    Args:
        ballistic_coefficient: m / (C_D A), kg/m^2. lift_to_drag: 1. Both may be dispersed.
        planet: `Planet`, whose numbers may be dispersed.
        air: mean density: `Exponential`, `Table`, or None for no air. Or `Profiles`, one for each trial.
        variation: of the density, `Markov`, or None.
        nodes: altitudes (lowest, highest, spacing), m, at which the mean density is stored, cubics of its logarithm
            between them; by default they hold all rows of a table and the start. Flights beyond them are told.
        ground: altitude, m, at which flights end that reach it. None: there is no ground.
        bank_rate, bank_acceleration: with which the bank angle goes at most to what is commanded, rad/s and rad/s^2;
            with `_deg` in degrees. Going there it passes zero, not half a turn.
        initial_bank: rad, or with `_deg`; by default the first command.
        lag: time constant of the bank behind these limits, s. delay: of commands, s, a whole number of integration
            steps. See `Actuator`; with any of these, results hold the bank angle that is flown, `commanded_bank`, and
            as `saturated_bank` the guidance periods in which the limits kept it from what was commanded.
        wind: `Wind`, through which drag, lift and what is sensed of them come; or None.
        drag_factor, lift_factor, density_factor: true over declared drag, lift and density, so that all three may be
            dispersed apart. None: 1, and no quantity of the vehicle.
    """

    ballistic_coefficient: Number
    lift_to_drag: Number = 0.0
    planet: Planet = MARS
    air: Exponential | Table | Profiles | None = MARTIAN_AIR
    variation: Markov | None = None
    nodes: tuple[float, float, float] | None = None
    ground: float | None = 0.0
    bank_rate: float | None = None
    bank_acceleration: float | None = None
    initial_bank: float | None = None
    lag: float = 0.0
    delay: float = 0.0
    bank_rate_deg: float | None = None
    bank_acceleration_deg: float | None = None
    initial_bank_deg: float | None = None
    wind: Wind | None = None
    drag_factor: Number | None = None
    lift_factor: Number | None = None
    density_factor: Number | None = None

    def model(self) -> Model:
        """The model that flies."""
        self._require_kinds()
        planet = Planet(*(one.mean if isinstance(one, Normal | Uniform) else one for one in self.planet))
        _require_planet(planet)
        density = self._density()
        deviation = np.zeros(density.nodes) if self.variation is None else self.variation.deviations()
        retention = 0.0 if self.variation is None else self.variation.retention
        varied = (density.bottom, density.spacing, retention, deviation)
        factors = (self.drag_factor, self.lift_factor, self.density_factor)
        plain = Model(
            dynamics.ENTRY,
            p=dynamics.EntryParameters(*map(float, planet), *self._mean_air(), *varied, frame=()),
            vehicle=dynamics.EntryVehicle(self.ballistic_coefficient, self.lift_to_drag),
            quantities=ENTRY_QUANTITIES,
            nodes=density.nodes,
            complete=self._completed,
            warn=self._told,
            bounds=ENTRY_BOUNDS,
            ends=_on_the_ground(self.ground),
            actuators=_acting(bank=self._bank()),
            air=density if isinstance(self.air, Profiles) else None,
        )
        if self.wind is None and factors == (None, None, None) and planet == self.planet:
            return plain
        from marsedl.fly import windy_entry

        wind = (self.wind or Wind()).own()
        factors = (1.0 if factor is None else factor for factor in factors)
        return replace(
            plain,
            flight=windy_entry.WINDY_ENTRY,
            p=windy_entry.WindyParameters(*plain.p, wind.bottom, wind.spacing),
            vehicle=windy_entry.WindyVehicle(*plain.vehicle, *factors, *self.planet),
            nodes=density.nodes + wind.nodes,
            air=beside(density, wind),
        )

    def _require_kinds(self):
        """Refuse what is of another kind, such as a dispersion."""
        kinds = {
            "planet": (getattr(self.planet, "_fields", None) == Planet._fields, "Planet(...)"),
            "air": (self.air is None or hasattr(self.air, "profile"), "Exponential, Table, Profiles, or None"),
            "variation": (isinstance(self.variation, Markov | None), "Markov(...), or None"),
            "wind": (isinstance(self.wind, Wind | None), "Wind(zonal=..., meridional=...), or None"),
            "nodes": (isinstance(self.nodes, tuple | list | None), "(lowest, highest, spacing) in m, or leave it out"),
        }
        for name, (good, wanted) in kinds.items():
            require(good, f"Entry: {name} is {getattr(self, name)!r}; give {wanted}")

    def _density(self) -> OwnAir:
        """Variations of the density, trial by trial."""
        if not isinstance(self.air, Profiles):
            return varied(self.variation)
        require(self.variation is None, "the profiles of air are those of the trials: leave variation out")
        return self.air.own()

    def _mean_density(self):
        """Mean density."""
        return self.air.mean() if isinstance(self.air, Profiles) else self.air

    def _bank(self):
        """Actuator of the bank angle."""
        rate, acceleration, start = (_angle(self, name) for name in ("bank_rate", "bank_acceleration", "initial_bank"))
        return Actuator(rate=rate, acceleration=acceleration, start=start, lag=self.lag, delay=self.delay)

    def with_equations(self, rates, **functions) -> Model:
        """A model with equations of motion of your own for the planet, the air and the vehicle of this entry.

        Their state has an `altitude` (m), and flights end on the ground. Flights beyond the nodes of the air are not
        told.

        Args:
            rates: function as in `montecarlo.flights`, such as `rates(state, found, command: Command, vehicle, p) ->
                State`. The density (kg/m^3) is `exponential(found.log_density) * found.factor`. `vehicle` has
                ballistic_coefficient and lift_to_drag, `p` has gravitational_parameter, radius and rotation_rate.
            functions: further arguments of a `montecarlo.flights.Flight`, such as `sense` and `noise`.
        """
        flight = Flight(rates, look_up=dynamics.look_up, vary=dynamics.vary, **functions)
        return replace(self.model(), flight=flight, warn=None)

    def _mean_air(self, start=0.0):
        """Lowest node, spacing and cells of the mean density; start: altitude, m."""
        mean = self._mean_density()
        rows = mean.rows()[:, 0] if isinstance(mean, Table) else np.array([-5e3, 150e3])
        spacing = min(SPACING, np.diff(rows).min())
        bottom = -5e3 - spacing * np.ceil(max(-5e3 - rows[0], 0.0) / spacing)
        nodes = self.nodes or (bottom, max(150e3, rows[-1], start + 25e3), spacing)
        require(
            len(nodes) == 3 and all(map(is_number, nodes)) and 0.0 < nodes[1] - nodes[0] <= 1e6 * nodes[2],
            f"nodes {nodes}: give altitudes (lowest, highest, spacing) in m, at most a million, or leave them out",
        )
        lowest, highest, spacing = map(float, nodes)
        whole = lowest + spacing * np.ceil((highest - lowest) / spacing)
        profile = _vacuum if mean is None else mean.profile()
        air = uniform_nodes(profile, lowest, whole, spacing)
        return lowest, spacing, uniform_cells(air.log_density, air.slope, spacing)

    def _completed(self, p, start):
        """Parameters that depend on the start. Warns of a start beyond the table of air, or in other units."""
        bottom, spacing, cells = self._mean_air(start["altitude"])
        altitude, velocity = start["altitude"], start.get("velocity", np.inf)
        mean = self._mean_density()
        lowest, *_, highest = mean.rows()[:, 0] if isinstance(mean, Table) else (-np.inf, np.inf)
        doubts = {
            f"an altitude of {altitude:g} m, beyond the rows of the table of air, {lowest:g} to {highest:g} m: its "
            f"last slope goes on there": not lowest <= altitude <= highest,
            f"a velocity of {velocity:g} m/s: is it in km/s?": velocity < 20.0,
        }
        for doubt in (words for words, is_so in doubts.items() if is_so):
            warnings.warn(f"flights start at {doubt}", stacklevel=5)
        frame = dynamics.frame_of(start) if {"latitude", "longitude", "azimuth"} <= {*start} else ()
        return p._replace(frame=frame, bottom=bottom, spacing=spacing, cells=cells)

    def _told(self, p, final):
        """Sentences on flights beyond the nodes of the air, and under the ground."""
        top = p.bottom + p.spacing * (len(p.cells) - 2)
        low = final["min_altitude"] < p.bottom
        ends = {"lowest": (low, p.bottom), "highest": (final["max_altitude"] > top, top)}
        for word, (beyond, node) in ends.items() if self.air is not None else ():
            if count := int(beyond.sum()):
                yield (
                    f"{count:,} flights went {'below' if word == 'lowest' else 'above'} {node:g} m, the {word} node of "
                    f"the air: its density continues along its last slope there; a trigger ends them before, such as "
                    f"Below('altitude', 0.0), or Entry(nodes=...) reaches farther"
                )
        if not low.any():
            yield from _under_the_ground(final["min_altitude"], self.ground)


@dataclass(frozen=True)
class Lander:
    """Powered descent in a plane over flat ground, with the mass of its propellant; the law commands the thrust.

    Start: downrange, altitude (m), downrange_velocity, vertical_velocity (m/s) and mass (kg), of which laws are told.
    The command, thrust_downrange and thrust_vertical (N), is scaled to the limits of its magnitude. One of zero
    gives no thrust, whatever the smallest thrust is, as it has no direction. Flights that burn all of their propellant
    go on without thrust, are called "out of propellant" and count in no statistics. In the integration step in which it
    runs out, the thrust is the mean one that burns what is left, below the smallest thrust, too: the mass does not fall
    below the dry one, but for rounding, and the speed is that of the rocket equation.

    Args:
        largest_thrust, smallest_thrust: N. specific_impulse: s. thrust_scale: true over commanded thrust, 1. All may be
            dispersed.
        thrust_noise: white noise of both components of the force, N s^(1/2).
        gravity: m/s^2. dry_mass: that of the vehicle without propellant, kg.
        ground: altitude, m, at which flights end that reach it. None: there is no ground.
        throttle_rate: with which the thrust goes at most to what is commanded, N/s.
        largest_tilt: of the thrust from the vertical, to both sides. tilt_rate: with which it turns at most. Both rad
            and rad/s, or with `_deg` in degrees.
        lag: time constant of thrust and tilt behind these limits, s. delay: of commands, s, a whole number of
            integration steps. See `Actuator`; with any of these, results hold the thrust that is flown within its
            limits, `commanded_thrust_downrange`, `commanded_thrust_vertical`, and as `saturated_thrust` and
            `saturated_tilt` the guidance periods in which the limits kept them from what was commanded. A command of
            zero aims upwards; until the thrust has come down to zero, it is at least the smallest one.
    """

    largest_thrust: Number
    specific_impulse: Number
    smallest_thrust: Number = 0.0
    thrust_scale: Number = 1.0
    thrust_noise: float = 0.0
    gravity: float = 3.71
    dry_mass: float = 0.0
    ground: float | None = 0.0
    throttle_rate: float | None = None
    largest_tilt: float | None = None
    tilt_rate: float | None = None
    lag: float = 0.0
    delay: float = 0.0
    largest_tilt_deg: float | None = None
    tilt_rate_deg: float | None = None

    def model(self) -> Model:
        """The model that flies."""
        vehicle = (self.specific_impulse, self.smallest_thrust, self.largest_thrust, self.thrust_scale)
        p = dynamics.LanderParameters(self.gravity, self.thrust_noise, self.dry_mass)
        require_numbers(p, "Lander")
        gravity, noise, dry_mass = map(float, p)
        return Model(
            dynamics.LANDER,
            p=dynamics.LanderParameters(gravity, noise, max(dry_mass, dynamics.SPENT)),  # something has to be left
            vehicle=dynamics.LanderVehicle(*vehicle),
            warn=lambda p, final: _under_the_ground(final["altitude"], self.ground),
            bounds=LANDER_BOUNDS | {"mass": (max(self.dry_mass, POSITIVE[0]), np.inf)},
            ends=_on_the_ground(self.ground),
            failed=lambda p, final: {"out of propellant": final["mass"] <= p.dry_mass + dynamics.SPENT},
            **{"quantities": LANDER_QUANTITIES, **self._engine()},
        )

    def _engine(self):
        """Actuators of thrust and tilt, and what else a model with them has."""
        tilt, rate = _angle(self, "largest_tilt"), _angle(self, "tilt_rate")
        require(
            tilt is None or (is_number(tilt) and tilt > 0.0), f"largest_tilt is {tilt!r} rad; give a positive number"
        )
        both = {"lag": self.lag, "delay": self.delay}
        tilting = Actuator(rate, low=None if tilt is None else -tilt, high=tilt, **both)
        if not _acting(thrust=Actuator(self.throttle_rate, **both), tilt=tilting):
            return {}
        limits = {"low": "smallest_thrust", "high": "largest_thrust", "off": True}
        return {
            "actuators": {"thrust": Actuator(self.throttle_rate, **both, **limits), "tilt": tilting},
            "coordinates": Coordinates(dynamics.Engine, dynamics.engine_of, dynamics.thrust_of),
            "quantities": LANDER_QUANTITIES | ENGINE_QUANTITIES,
        }


def _angle(vehicle, name):
    """An angle of a vehicle, or its rate, in radians; it may be given in degrees."""
    radians, degrees = getattr(vehicle, name), getattr(vehicle, f"{name}_deg")
    require(radians is None or degrees is None, f"{name} and {name}_deg are the same number: give one of them")
    require(degrees is None or is_number(degrees), f"{name}_deg is {degrees!r}; give a finite number, or None")
    return radians if degrees is None else float(np.deg2rad(degrees))


def _acting(**actuators):
    """Actuators of a vehicle: none if all follow at once."""
    return actuators if any(actuator != Actuator() for actuator in actuators.values()) else {}


def _vacuum(altitude):
    """The profile of no air."""
    return np.full(np.shape(altitude), -2000.0), 0.0, 0.0


def _on_the_ground(ground):
    """The end of a vehicle's flights at an altitude, if there is ground."""
    require(ground is None or is_number(ground), f"ground is {ground!r}; give an altitude in m, or None")
    return {} if ground is None else {"on the ground": Below("altitude", float(ground))}


def _under_the_ground(altitude, ground):
    """A sentence on flights below the ground."""
    if ground is not None and (count := int((altitude < ground - ROUNDING).sum())):
        yield (
            f"{count:,} flights went below the ground at {ground:g} m, down to {np.nanmin(altitude):g} m: a trigger "
            f"such as Below('altitude', {ground:g}) ends them there; ground={ground - 4e3:g} says where else it is, "
            f"ground=None that there is none"
        )


def _require_planet(planet):
    """Refuse a planet whose numbers are dispersed, or in other units than SI."""
    require_numbers(planet, "planet")
    gravity = planet.gravitational_parameter / planet.radius**2
    require(
        planet.radius >= 1e5
        and 1e-3 < gravity < 1e3
        and (planet.rotation_rate * planet.radius) ** 2 < 2 * gravity * planet.radius,
        f"{planet}: its radius, its gravity of {gravity:.3g} m/s^2 or its rotation are no planet's; give m^3/s^2, "
        f"m and rad/s",
    )
