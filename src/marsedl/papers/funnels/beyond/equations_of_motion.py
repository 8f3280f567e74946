"""The equations of motion (robust entry funnels, Eq. 37) against motion in an inertial frame."""

import numpy as np

from marsedl.montecarlo.streams import uniforms
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.inputs import Inputs, Planet, Vehicle
from marsedl.papers.funnels.records import EquationsOfMotion
from marsedl.replication.pipeline.catalogue import stage

RANDOM_STATES = 1000
STATES = 22  # stream of random numbers, keyed by that of the design
COMPLEX_STEP = 1e-30


@stage()
def compute(given: Inputs) -> EquationsOfMotion:
    """Eq. 37 at random states against gravity, lift and drag on inertial position and velocity, by the complex step."""
    low = np.array([0.0, -3.0, -1.2, 400.0, -1.2, -3.0, -3.0])
    high = np.array([given.mission.entry_altitude, 3.0, 1.2, given.mission.entry_velocity, 1.2, 3.0, 3.0])
    shares = uniforms(given.recursion.design_seed, STATES, range(RANDOM_STATES), len(low))
    *state, bank = (low + (high - low) * shares).T
    air = environment.undisturbed_air(given.planet)
    still = (0.0,) * environment.DISTURBANCES
    rates = np.array(environment.entry_rates(given.planet, given.vehicle, air)(None, state, (bank,), still))
    displaced = np.array(state) + 1j * COMPLEX_STEP * rates
    position, velocity = inertial(given.planet, 1j * COMPLEX_STEP, displaced)
    expected = acceleration(given.planet, given.vehicle, position.real, velocity.real, state[0], bank)

    def deviation(rate, truth):
        return float((np.linalg.norm(rate - truth, axis=0) / np.linalg.norm(truth, axis=0)).max())

    return EquationsOfMotion(
        position_rate_deviation=deviation(position.imag / COMPLEX_STEP, velocity.real),
        velocity_rate_deviation=deviation(velocity.imag / COMPLEX_STEP, expected),
    )


def inertial(planet: Planet, time, state):
    """Inertial position and velocity, (3, m) each; planet-fixed and inertial axes agree at time 0."""
    altitude, longitude, latitude, speed, path, heading = state
    radius, angle = planet.planet_radius + altitude, longitude + planet.rotation_rate * time
    sin_a, cos_a, sin_l, cos_l = np.sin(angle), np.cos(angle), np.sin(latitude), np.cos(latitude)
    east = np.array([-sin_a, cos_a, 0.0 * sin_a])
    north = np.array([-sin_l * cos_a, -sin_l * sin_a, cos_l])
    up = np.array([cos_l * cos_a, cos_l * sin_a, sin_l])
    relative = speed * (np.cos(path) * (np.cos(heading) * east + np.sin(heading) * north) + np.sin(path) * up)
    return radius * up, relative + planet.rotation_rate * radius * cos_l * east


def acceleration(planet: Planet, vehicle: Vehicle, position, velocity, altitude, bank):
    """Inertial acceleration by gravity, drag, and lift turned to the right by the bank angle, (3, m)."""
    spin = np.array([[0.0], [0.0], [planet.rotation_rate]])
    relative = velocity - np.cross(spin, position, axis=0)
    speed = np.linalg.norm(relative, axis=0)
    forward_axis = relative / speed
    right = np.cross(forward_axis, position, axis=0)
    right /= np.linalg.norm(right, axis=0)
    above = np.cross(right, forward_axis, axis=0)
    density = environment.density(environment.undisturbed_air(planet), altitude)
    drag = density * speed**2 / (2.0 * vehicle.ballistic_coefficient)
    lift = vehicle.lift_to_drag * drag * (np.cos(bank) * above + np.sin(bank) * right)
    gravity = planet.gravitational_parameter * position / np.linalg.norm(position, axis=0) ** 3
    return lift - drag * forward_axis - gravity
