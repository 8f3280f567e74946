"""The entry as a controlled system: equations with their disturbances, sets and scales, and the closed loop."""

from typing import NamedTuple

import numpy as np

from marsedl.methods.funnels.closed_loop import ClosedLoop
from marsedl.models.atmosphere import named_profile
from marsedl.models.dynamics.vinh_entry import vinh_entry_rates
from marsedl.models.heating import sutton_graves_heat_rate
from marsedl.papers.funnels.inputs import Guidance, Inputs, Mission, Planet, Uncertainty, Vehicle

STATES = ("altitude", "longitude", "latitude", "velocity", "flight_path_angle", "heading")
DISTURBANCES = 2  # of the density at all altitudes, and of its slope
WINDOW_POINTS = 201  # altitudes at which a line is fitted to a profile


class Air(NamedTuple):
    """Line through ln rho over the altitude h, rho in kg/m^3, and how far the density may be off."""

    log_density_at_surface: float  # a in a + b h
    log_density_slope: float  # b, 1/m
    density_amplitude: float = 0.0  # a_1
    density_slope_amplitude: float = 0.0  # b_1, 1/m
    density_disturbance: str = "parametric"  # how w enters, see `density`


def undisturbed_air(planet: Planet) -> Air:
    """Return the air without disturbances: as it is given, or the least-squares line through ln rho of a profile."""
    if planet.density_profile == "exponential":
        return Air(planet.log_density_at_surface, planet.log_density_slope)
    profile = named_profile(
        planet.density_profile,
        coefficients=planet.density_coefficients,
        upper_altitude=planet.density_upper_altitude,
        table=planet.density_table,
    )
    altitude = np.linspace(*planet.density_window, WINDOW_POINTS)
    slope, level = np.polyfit(altitude, profile(altitude)[0], 1)
    return Air(float(level), float(slope))


def disturbed_air(planet: Planet, uncertainty: Uncertainty) -> Air:
    """Return the air with its disturbances."""
    return undisturbed_air(planet)._replace(
        density_amplitude=uncertainty.density_amplitude,
        density_slope_amplitude=uncertainty.density_slope_amplitude,
        density_disturbance=uncertainty.density_disturbance,
    )


def log_density(air: Air, altitude):
    """Logarithm of the mean density in kg/m^3 at an altitude in m."""
    return air.log_density_at_surface + air.log_density_slope * altitude


def density(air: Air, altitude, disturbance=(0.0, 0.0)):
    """Density in kg/m^3 (robust entry funnels, Sec. 4, "bilinear exponential").

        parametric:  rho = exp((a + a_1 w_1) + (b + b_1 w_2) h)
        additive:    rho = exp(a + b h) (1 + a_1 w_1 + b_1 w_2 h)

    Both grow with a_1 w_1 + b_1 w_2 h, and agree to first order in w.

    Args:
        air: mean density, and amplitudes a_1, b_1.
        altitude: h, m.
        disturbance: w, two components, in the unit disc.
    """
    if air.density_disturbance == "additive":
        share = air.density_amplitude * disturbance[0] + (air.density_slope_amplitude * disturbance[1]) * altitude
        return np.exp(log_density(air, altitude)) * (1.0 + share)
    level = air.log_density_at_surface + air.density_amplitude * disturbance[0]
    slope = air.log_density_slope + air.density_slope_amplitude * disturbance[1]
    return np.exp(level + slope * altitude)


def densest(air: Air, altitude):
    """Disturbances of the unit disc with the largest density at altitudes (m,), (2, m); negative: the least.

    The density grows with a_1 w_1 + b_1 w_2 h, which is largest at the end of the diameter along (a_1, b_1 h).
    """
    direction = np.stack([np.full_like(altitude, air.density_amplitude), air.density_slope_amplitude * altitude])
    length = np.linalg.norm(direction, axis=0)
    return direction / np.where(length > 0.0, length, 1.0)


def entry_rates(planet: Planet, vehicle: Vehicle, air: Air):
    """Equations of motion (robust entry funnels, Eq. 37) as a function of state, bank angle and disturbance.

    Returns:
        Function `rates(half_index, state, control, disturbance)` for `ClosedLoop`; they do not depend on the time.
    """
    drag_factor = 1.0 / (2.0 * vehicle.ballistic_coefficient)
    constants = (
        *(planet.planet_radius, drag_factor, vehicle.lift_to_drag * drag_factor),
        *(planet.gravitational_parameter, planet.rotation_rate),
    )

    def rates(_, state, control, disturbance):
        return vinh_entry_rates(state, control[0], density(air, state[0], disturbance), *constants)

    return rates


def heat_rate(vehicle: Vehicle, air: Air, altitude, velocity, disturbance=(0.0, 0.0)):
    """Heat rate at the stagnation point, W/m^2; see `density` for altitude and disturbance."""
    rho = density(air, altitude, disturbance)
    return sutton_graves_heat_rate(rho, velocity, vehicle.nose_radius, vehicle.heat_rate_constant)


def entry_state(mission: Mission):
    """State at entry, (6,)."""
    return np.array(
        [
            mission.entry_altitude,
            mission.entry_longitude,
            mission.entry_latitude,
            mission.entry_velocity,
            mission.entry_flight_path_angle,
            mission.entry_heading,
        ]
    )


def _state(radius, lengths, velocity, angles):
    """A vector of states from lengths, of which downrange and crossrange are turned into angles."""
    altitude, downrange, crossrange = lengths
    return np.array([altitude, downrange / radius, crossrange / radius, velocity, *angles])


def state_scale(planet: Planet, guidance: Guidance):
    """Deviations of the states that cost as much as one another in the regulator, (6,)."""
    return _state(planet.planet_radius, guidance.scale_lengths, guidance.scale_velocity, guidance.scale_angles)


def initial_semi_axes(planet: Planet, uncertainty: Uncertainty):
    """Semi-axes of the initial set S_1, (6,)."""
    lengths, velocity, angles = uncertainty.initial_lengths, uncertainty.initial_velocity, uncertainty.initial_angles
    return uncertainty.initial_scale * _state(planet.planet_radius, lengths, velocity, angles)


def initial_set(semi_axes):
    """Matrix M_1 of the initial set S_1 = {1/2 xb'M_1 xb <= 1} (robust entry funnels, Eq. 20), (6, 6)."""
    return np.diag(2.0 / semi_axes**2)


def additive_amplitudes(planet: Planet, uncertainty: Uncertainty):
    """Semi-axes of the disturbances that are added to the rates, (6,), their units; None where there are none."""
    if not uncertainty.additive:
        return None
    velocities, turn_rates = uncertainty.additive_velocities, uncertainty.additive_turn_rates
    return _state(planet.planet_radius, velocities, uncertainty.additive_acceleration, turn_rates)


def slices(loop: ClosedLoop, steps_per_slice):
    """Fine steps at which the slices of the funnel are, (N,)."""
    return np.arange(0, loop.steps + 1, int(steps_per_slice))


def slice_at(loop: ClosedLoop, steps_per_slice, share):
    """Number, from 1, of the slice nearest to a share of the flight, of those from which a stage begins."""
    stages = len(slices(loop, steps_per_slice)) - 1
    return min(round(share * stages), stages - 1) + 1


def spacing_of(loop: ClosedLoop, stages):
    """Fine steps between slices that divide the flight into about so many equal parts."""
    divisors = [number for number in range(1, loop.steps + 1) if loop.steps % number == 0]
    return min(divisors, key=lambda number: abs(np.log(loop.steps / number / stages)))


def disturbed_loop(given: Inputs, linearization, gain):
    """The closed loop in the disturbed air, see `closed_loop`."""
    return closed_loop(given.planet, given.vehicle, disturbed_air(given.planet, given.uncertainty), linearization, gain)


def closed_loop(planet: Planet, vehicle: Vehicle, air: Air, linearization, gain):
    """The closed loop around the reference.

    Args:
        planet, vehicle, air: see `entry_rates`.
        linearization: artifact, for the reference on the half-step grid.
        gain: K on the half-step grid, (2 n + 1, 6).

    Returns:
        `ClosedLoop` of six states, the bank angle, and two disturbances of the density.
    """
    return ClosedLoop(
        rates=entry_rates(planet, vehicle, air),
        time=linearization.time,
        states=linearization.state,
        controls=linearization.bank[:, np.newaxis],
        gains=np.asarray(gain)[:, np.newaxis],
        disturbances=DISTURBANCES,
    )
