"""Linear model, disturbance statistics and delta-v gradients along a nominal trajectory (Eqs. 19-26 and 75-78)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from marsedl.methods import field_disturbance
from marsedl.methods.linearization import linearize
from marsedl.models import orbits
from marsedl.models.dynamics.planar_entry import planar_entry_rates
from marsedl.papers.random_field import environment
from marsedl.papers.random_field.environment import targets
from marsedl.papers.random_field.inputs import Guidance, Inputs, Mission
from marsedl.papers.random_field.nominal import finite_or_nan, partition_used, states_of
from marsedl.papers.random_field.records import BRANCHES, Linearization, Nominal
from marsedl.replication.errors import InfeasibleError
from marsedl.replication.pipeline.catalogue import stage

UNITS = np.array([1e3, 100.0, 0.01])  # m, m/s, rad: every program is posed in these


class Model(NamedTuple):
    """The linear model along any trajectory, in SI units; fields as of `Linearization`."""

    state: np.ndarray
    transition: np.ndarray
    control: np.ndarray
    disturbance_covariance: np.ndarray  # (3 N, 3 N)
    pressure_gradient: np.ndarray
    apoapsis: float  # m
    apoapsis_gradient: np.ndarray
    delta_v: float
    field_map: (
        np.ndarray
    )  # (3 N, J), the disturbances from the field at the nodes of all intervals, quadrature included
    field_altitude: np.ndarray  # (J,), m, of these nodes; the ends of neighbouring intervals stand twice


class Motion(NamedTuple):
    """What a trajectory is linearised with."""

    log_density: Callable  # of altitude, m: ln of the mean density, its first and second derivative
    covariance: Callable  # of the density variation at two altitudes, m
    variation_mean: float
    planet_radius: float  # m
    gravity: float  # gravitational parameter, m^3/s^2
    targets: tuple  # as `environment.targets`
    drag_factor: float  # m^2/kg
    lift_factor: float  # m^2/kg
    time_step: float  # s


def motion_of(given: Inputs) -> Motion:
    """Return the motion, the air and the targets of the reading."""
    drag_factor = 0.5 / given.vehicle.ballistic_coefficient
    return Motion(
        log_density=environment.profile(given.air),
        covariance=environment.kernel(given.air),
        variation_mean=given.air.variation_mean,
        planet_radius=given.planet.planet_radius,
        gravity=given.planet.gravitational_parameter,
        targets=targets(given.planet, given.mission),
        drag_factor=drag_factor,
        lift_factor=given.vehicle.lift_to_drag * drag_factor,
        time_step=given.simulation.time_step,
    )


@stage()
def compute(given: Inputs, nominal: Nominal) -> Linearization:
    """Linearise about the guess."""
    return of_guess(given.mission, given.guidance, motion_of(given), nominal)


def of_guess(mission: Mission, guidance: Guidance, motion: Motion, nominal: Nominal) -> Linearization:
    """Linearise a motion, which may be another than the reading's, about the guess."""
    partition, refused = partition_used(mission)
    intervals = len(partition) - 1
    guess = np.full(intervals, guidance.initial_control)
    model = along(motion, partition, guess, states_of(motion.planet_radius, nominal))
    gradients = [delta_v_gradient(motion.targets, model.state[-1], sign) for sign in BRANCHES.values()]
    return Linearization(
        refused=refused,
        partition=partition,
        condition_number=finite_or_nan(field_disturbance.condition_number(model.disturbance_covariance, UNITS)),
        disturbance_covariance=model.disturbance_covariance.reshape(intervals, 3, intervals, 3),
        delta_v_gradient=np.array(gradients),
        **{name: getattr(model, name) for name in ("state", "transition", "control", "pressure_gradient")},
        apoapsis_gradient=model.apoapsis_gradient,
        delta_v=model.delta_v,
    )


def along(motion: Motion, partition, control, states) -> Model:
    """The model along a trajectory whose control is held over the intervals of a partition.

    partition: (N + 1,), s. control: (N,). states: radius, velocity, flight path angle at every half integration step,
    (2 steps + 1, 3).
    """
    half = motion.time_step / 2
    nodes = np.rint(partition / half).astype(int)
    altitude = states[:, 0] - motion.planet_radius
    log_density, slope, _ = motion.log_density(altitude)
    slope = np.broadcast_to(slope, altitude.shape)
    effects, weights, places, transitions, controls = [], [], [], [], []
    for first, last, interval_control in zip(nodes[:-1], nodes[1:], control, strict=True):
        part = slice(first, last + 1)
        state_matrix, control_matrix, field_matrix = _matrices(
            motion, states[part], interval_control, log_density[part], slope[part]
        )
        interval = field_disturbance.discretize_interval(state_matrix, control_matrix, field_matrix, motion.time_step)
        transitions.append(interval.transition)
        controls.append(interval.control[:, 0])
        effects.append(interval.field_effect)
        weights.append(field_disturbance.trapezoid_weights((last - first) // 2, motion.time_step))
        places.append(altitude[first : last + 1 : 2])
    places = np.concatenate(places)
    covariance = motion.covariance(places[:, np.newaxis], places[np.newaxis, :])
    end = states[-1]
    apoapsis = float(orbits.apoapsis_radius(*end, motion.gravity))
    if not np.isfinite(apoapsis):
        raise InfeasibleError(
            f"the nominal flight leaves at {end[1]:.0f} m/s and is not captured, so that there is no apoapsis to "
            "linearise: give a steeper entry_flight_path_angle, or let entry_angle be solved",
            dict(zip(("radius", "velocity", "flight_path_angle"), states.T, strict=True)),
        )
    return Model(
        state=states[nodes],
        transition=np.array(transitions),
        control=np.array(controls),
        disturbance_covariance=field_disturbance.disturbance_covariance(effects, weights, covariance),
        pressure_gradient=np.column_stack([slope[nodes[:-1]], 2.0 / states[nodes[:-1], 1], np.zeros(len(nodes) - 1)]),
        apoapsis=apoapsis,
        apoapsis_gradient=orbits.gradient(lambda *state: orbits.apoapsis_radius(*state, motion.gravity), end),
        delta_v=float(orbits.total_delta_v(*end, *motion.targets)),
        field_map=block_diag(*((w[:, np.newaxis] * f).T for w, f in zip(weights, effects, strict=True))),
        field_altitude=places,
    )


def delta_v_gradient(aim, state, sign):
    """Derivative of delta-v at an exit state, with the sign of the clean-up burn given (Eq. 76).

    aim: what `environment.targets` returns. state: radius (m), velocity, flight path angle. sign: of the second burn.
    """
    return orbits.gradient(lambda *at: orbits.total_delta_v(*at, *aim, branch=sign), state)


def _matrices(motion: Motion, states, control, log_density, slope):
    """State, control and field matrix along one interval."""

    def rates(radius, velocity, flight_path_angle, bank_cosine, variation, log_at, slope_at, radius_at):
        # The density's derivative at the node is the profile's own.
        density = np.exp(log_at + slope_at * (radius - radius_at)) * (1.0 + variation)
        return planar_entry_rates(
            radius,
            velocity,
            flight_path_angle,
            bank_cosine,
            density,
            motion.drag_factor,
            motion.lift_factor,
            motion.gravity,
        )

    controls = np.column_stack([np.full(len(states), control), np.full(len(states), motion.variation_mean)])
    model = linearize(rates, states, controls, (log_density, slope, states[:, 0]))
    return model.state_matrix, model.control_matrix[:, :, :1], model.control_matrix[:, :, 1]
