"""The two consecutive segments of the flight: their time grids, their end conditions and their steering problems."""

from typing import NamedTuple

import numpy as np

from marsedl.methods.covariance_steering.closed_form import (
    SteeringError,
    SteeringProblem,
    equivalent_squared_noise_density,
    steer,
)
from marsedl.models.dynamics.powered_descent import mass_flow_constant
from marsedl.papers.powered_descent.inputs import Design, Entry, Inputs, Mission, Noise, Vehicle
from marsedl.papers.powered_descent.records import Linearization
from marsedl.replication.errors import InfeasibleError

SEGMENTS = 2
STATES = ("downrange", "altitude", "downrange_velocity", "vertical_velocity")  # under gravity alone, of an error


class Divert(NamedTuple):
    """What the design has to do in each segment."""

    times: list[np.ndarray]  # of the nodes, from the segment's start, s, (k,) by segment
    means: list[np.ndarray]  # at the start, at the switch and at the end (Eqs. 51-53), (4,) each
    covariances: list[np.ndarray]  # likewise, (4, 4) each
    noise_density: float  # that it designs for, N sqrt(s)


def divert_of(given: Inputs) -> Divert:
    """Return the grids, end conditions and noise density of the design."""
    times = grids(given.mission.segment_durations, given.design.design_interval)
    return Divert(times, *end_conditions(given.entry, given.mission), design_noise_density(given.noise, given.design))


def end_conditions(entry: Entry, mission: Mission) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Means (4,) and covariances (4, 4) at the start, at the switch and at the end (Eqs. 51-53), as two lists."""
    means = [initial_mean(entry), mission.intermediate_mean, mission.final_mean]
    return means, [entry.initial_covariance, mission.intermediate_covariance, mission.final_covariance]


def initial_mean(entry: Entry) -> np.ndarray:
    """Mean initial state (Eq. 51): downrange, altitude (m) and their rates (m/s), (4,)."""
    angle = entry.initial_velocity_angle
    velocity = entry.initial_speed * np.array([np.sin(angle), np.cos(angle)])
    return np.concatenate([entry.initial_position, velocity])


def mass_flow(vehicle: Vehicle) -> float:
    """Propellant mass per impulse, kg/(N s): as stated, or from the specific impulse."""
    if vehicle.mass_flow_constant is not None:
        return vehicle.mass_flow_constant
    return mass_flow_constant(vehicle.specific_impulse, vehicle.standard_gravity)


def plant_noise_density(noise: Noise) -> float:
    """Noise density of the simulated thrust, N sqrt(s): gamma in units of thrust (Eq. 49)."""
    return noise.noise_coefficient * noise.thrust_unit


def design_noise_density(noise: Noise, design: Design) -> float:
    """Noise density that the reading's boundary condition designs for, N sqrt(s); the plant's if it is correct."""
    squared = equivalent_squared_noise_density(noise.noise_coefficient, noise.thrust_unit, design.boundary_condition)
    return np.sqrt(squared)


def grids(durations, interval):
    """Uniform time grids of the segments, s from the start of each: even numbers of cells no longer than `interval`."""
    return [
        np.linspace(0.0, duration, 2 * int(np.ceil(duration / (2 * interval) - 1e-9)) + 1) for duration in durations
    ]


def joined_time(times):
    """Time from the start of the flight and the segment's number of all nodes; the switch stands twice, (k,), (k,)."""
    starts = np.concatenate([[0.0], np.cumsum([time[-1] for time in times])[:-1]])
    time = np.concatenate([start + time for start, time in zip(starts, times, strict=True)])
    return time, np.repeat(np.arange(len(times)), [len(time) for time in times])


def split(segment, *arrays):
    """Cut arrays along their first axis into the segments; returns a list with one tuple per segment."""
    return [tuple(array[segment == number] for array in arrays) for number in range(SEGMENTS)]


def linear_model(mass, gravity):
    """Linear model of the motion along a mass profile (Eq. 4), by exact differentiation of the plant.

    The plant is affine in position, velocity and thrust, so the point of linearization does not matter; the mass is a
    parameter (Sec. IV). mass: (k,), kg. Returns A (k, 4, 4), B (k, 4, 2), c (k, 4).
    """
    # Imported here: most jobs that use segments neither linearize nor fly.
    from marsedl.methods.linearization import linearize
    from marsedl.models.dynamics.powered_descent import powered_descent_rates

    def motion(downrange, altitude, downrange_velocity, vertical_velocity, thrust_downrange, thrust_vertical, mass):
        state = (downrange, altitude, downrange_velocity, vertical_velocity, mass)
        return powered_descent_rates(state, (thrust_downrange, thrust_vertical), (0.0, 0.0), gravity, 0.0)[:4]

    return linearize(motion, np.zeros((len(mass), 4)), np.zeros((len(mass), 2)), (mass,))


def problems_along(divert: Divert, models, transitions=None) -> list[SteeringProblem]:
    """Return the steering problems of the segments for linear models (A, B, c) at the nodes.

    transitions: those of the models, (k, 4, 4) by segment, if they are known; they do not depend on the mass.
    """
    return [
        SteeringProblem.from_linear_model(
            time, model, **_ends(divert, number), transition=None if transitions is None else transitions[number]
        )
        for number, (time, model) in enumerate(zip(divert.times, models, strict=True))
    ]


def problems_of(divert: Divert, linearization: Linearization) -> list[SteeringProblem]:
    """Return the steering problems of the segments from the stored linear model."""
    names = ("transition", "gramian", "affine_response", "control_matrix")
    parts = split(linearization.segment, *(getattr(linearization, name) for name in names))
    return [SteeringProblem(divert.times[number], *part, **_ends(divert, number)) for number, part in enumerate(parts)]


def _ends(divert: Divert, number: int) -> dict:
    """End conditions and noise density of a segment."""
    return {
        "initial_mean": divert.means[number],
        "final_mean": divert.means[number + 1],
        "initial_covariance": divert.covariances[number],
        "final_covariance": divert.covariances[number + 1],
        "noise_density": divert.noise_density,
    }


def steered(problems):
    """The steering of every segment; InfeasibleError that names the segment whose problem has no solution."""
    steerings = []
    for number, problem in enumerate(problems, start=1):
        try:
            steerings.append(steer(problem))
        except SteeringError as error:
            raise InfeasibleError(
                f"segment {number}: {error}; give the segment another duration or target covariance, or write "
                "boundary_condition 'corrected'",
                {"time": problem.time, **dict(zip(STATES, problem.affine_response.T, strict=True))},
            ) from None
    return steerings
