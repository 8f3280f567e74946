"""The equations of motion (robust entry funnels, Eq. 37) against motion in an inertial frame."""

import numpy as np

from marsedl.papers.funnels import environment
from marsedl.papers.funnels.records import EquationsOfMotion
from marsedl.replication.catalogue import stage

RANDOM_STATES = 1000
STATES = 22  # stream of random numbers, keyed by that of the design
COMPLEX_STEP = 1e-30


@stage(claimed_in=("corrected",))
def compute(inputs) -> EquationsOfMotion:
    """Eq. 37 at random states against gravity, lift and drag on inertial position and velocity, by the complex step."""
    generator = np.random.Generator(np.random.Philox((inputs.design_seed, STATES)))
    low = np.array([0.0, -3.0, -1.2, 400.0, -1.2, -3.0, -3.0])
    high = np.array([inputs.entry_altitude, 3.0, 1.2, inputs.entry_velocity, 1.2, 3.0, 3.0])
    *state, bank = generator.uniform(low, high, (RANDOM_STATES, len(low))).T
    rates = np.array(environment.entry_rates(inputs)(None, state, (bank,), (0.0,) * environment.DISTURBANCES))
    moved = np.array(state) + 1j * COMPLEX_STEP * rates
    position, velocity = inertial(inputs, 1j * COMPLEX_STEP, moved)
    expected = acceleration(inputs, position.real, velocity.real, state[0], bank)

    def deviation(found, truth):
        return float((np.linalg.norm(found - truth, axis=0) / np.linalg.norm(truth, axis=0)).max())

    return EquationsOfMotion(
        position_rate_deviation=deviation(position.imag / COMPLEX_STEP, velocity.real),
        velocity_rate_deviation=deviation(velocity.imag / COMPLEX_STEP, expected),
    )


def inertial(inputs, time, state):
    """Inertial position and velocity, (3, m) each; planet-fixed and inertial axes agree at time 0."""
    altitude, longitude, latitude, speed, path, heading = state
    radius, angle = inputs.planet_radius + altitude, longitude + inputs.rotation_rate * time
    sin_a, cos_a, sin_l, cos_l = np.sin(angle), np.cos(angle), np.sin(latitude), np.cos(latitude)
    east = np.array([-sin_a, cos_a, 0.0 * sin_a])
    north = np.array([-sin_l * cos_a, -sin_l * sin_a, cos_l])
    up = np.array([cos_l * cos_a, cos_l * sin_a, sin_l])
    relative = speed * (np.cos(path) * (np.cos(heading) * east + np.sin(heading) * north) + np.sin(path) * up)
    return radius * up, relative + inputs.rotation_rate * radius * cos_l * east


def acceleration(inputs, position, velocity, altitude, bank):
    """Inertial acceleration by gravity, drag, and lift turned to the right by the bank angle, (3, m)."""
    spin = np.array([[0.0], [0.0], [inputs.rotation_rate]])
    relative = velocity - np.cross(spin, position, axis=0)
    speed = np.linalg.norm(relative, axis=0)
    forward_axis = relative / speed
    right = np.cross(forward_axis, position, axis=0)
    right /= np.linalg.norm(right, axis=0)
    above = np.cross(right, forward_axis, axis=0)
    drag = np.exp(environment.log_density(inputs, altitude)) * speed**2 / (2.0 * inputs.ballistic_coefficient)
    lift = inputs.lift_to_drag * drag * (np.cos(bank) * above + np.sin(bank) * right)
    gravity = inputs.gravitational_parameter * position / np.linalg.norm(position, axis=0) ** 3
    return lift - drag * forward_axis - gravity
