"""The entry as a controlled system: equations with their disturbances, sets and scales, and the closed loop."""

import numpy as np

from marsedl.methods.funnels.closed_loop import ClosedLoop
from marsedl.models.dynamics.vinh_entry import vinh_entry_rates
from marsedl.models.heating import sutton_graves_heat_rate

STATES = ("altitude", "longitude", "latitude", "velocity", "flight_path_angle", "heading")
STATE_UNIT = "m, rad, rad, m/s, rad, rad"
DISTURBANCES = 2  # of the density at all altitudes, and of its slope


def log_density(inputs, altitude, disturbance=(0.0, 0.0)):
    """Logarithm of the density in kg/m^3 (robust entry funnels, Sec. 4, "bilinear exponential").

        ln rho = (a + a_1 w_1) + (b + b_1 w_2) h

    Args:
        inputs: densities and amplitudes a_1, b_1.
        altitude: h, m.
        disturbance: w, two components, in the unit disc.
    """
    level = inputs.log_density_at_surface + inputs.density_amplitude * disturbance[0]
    slope = inputs.log_density_slope + inputs.density_slope_amplitude * disturbance[1]
    return level + slope * altitude


def entry_rates(inputs):
    """Equations of motion (robust entry funnels, Eq. 37) as a function of state, bank angle and disturbance.

    Returns:
        Function `rates(half_index, state, control, disturbance)` for `ClosedLoop`; they do not depend on the time.
    """
    drag_factor = 1.0 / (2.0 * inputs.ballistic_coefficient)
    constants = (
        *(inputs.planet_radius, drag_factor, inputs.lift_to_drag * drag_factor),
        *(inputs.gravitational_parameter, inputs.rotation_rate),
    )

    def rates(_, state, control, disturbance):
        density = np.exp(log_density(inputs, state[0], disturbance))
        return vinh_entry_rates(state, control[0], density, *constants)

    return rates


def heat_rate(inputs, altitude, velocity, disturbance=(0.0, 0.0)):
    """Heat rate at the stagnation point, W/m^2; see `log_density` for the arguments."""
    density = np.exp(log_density(inputs, altitude, disturbance))
    return sutton_graves_heat_rate(density, velocity, inputs.nose_radius, inputs.heat_rate_constant)


def entry_state(inputs):
    """State at entry, (6,)."""
    place = (inputs.entry_altitude, inputs.entry_longitude, inputs.entry_latitude)
    return np.array([*place, inputs.entry_velocity, inputs.entry_flight_path_angle, inputs.entry_heading])


def _state(inputs, lengths, velocity, angles):
    """A vector of states from lengths, of which downrange and crossrange are turned into angles."""
    altitude, downrange, crossrange = lengths
    radius = inputs.planet_radius
    return np.array([altitude, downrange / radius, crossrange / radius, velocity, *angles])


def state_scale(inputs):
    """Deviations of the states that cost as much as one another in the regulator, (6,)."""
    return _state(inputs, inputs.scale_lengths, inputs.scale_velocity, inputs.scale_angles)


def initial_semi_axes(inputs):
    """Semi-axes of the initial set S_1, (6,)."""
    return _state(inputs, inputs.initial_lengths, inputs.initial_velocity, inputs.initial_angles)


def initial_set(inputs):
    """Matrix M_1 of the initial set S_1 = {1/2 xb'M_1 xb <= 1} (robust entry funnels, Eq. 20), (6, 6)."""
    return np.diag(2.0 / initial_semi_axes(inputs) ** 2)


def additive_amplitudes(inputs):
    """Semi-axes of the disturbances that are added to the rates, (6,), in the units of the rates."""
    return _state(inputs, inputs.additive_velocities, inputs.additive_acceleration, inputs.additive_turn_rates)


def slices(inputs, steps_per_slice=None):
    """Fine steps at which the slices of the funnel are, (N,)."""
    return np.arange(0, inputs.fine_steps + 1, steps_per_slice or inputs.steps_per_slice)


def closed_loop(inputs, linearization, gain):
    """The closed loop around the reference.

    Args:
        inputs: see `entry_rates`.
        linearization: artifact, for the reference on the half-step grid.
        gain: K on the half-step grid, (2 n + 1, 6).

    Returns:
        `ClosedLoop` of six states, the bank angle, and two disturbances of the density.
    """
    return ClosedLoop(
        rates=entry_rates(inputs),
        time=linearization.time,
        states=linearization.state,
        controls=linearization.bank[:, np.newaxis],
        gains=np.asarray(gain)[:, np.newaxis],
        disturbances=DISTURBANCES,
    )
