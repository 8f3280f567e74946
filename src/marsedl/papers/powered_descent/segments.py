"""The two consecutive segments of the flight: their time grids, their end conditions and their steering problems."""

import numpy as np

from marsedl.methods.covariance_steering.closed_form import (
    SteeringError,
    SteeringProblem,
    equivalent_squared_noise_density,
    steer,
)
from marsedl.replication.errors import MarsedlError

SEGMENTS = 2


def initial_mean(inputs):
    """Mean initial state (Eq. 51): downrange, altitude (m) and their rates (m/s), (4,)."""
    angle = inputs.initial_velocity_angle
    velocity = inputs.initial_speed * np.array([np.sin(angle), np.cos(angle)])
    return np.concatenate([inputs.initial_position, velocity])


def end_conditions(inputs):
    """Means (4,) and covariances (4, 4) at the start, at the switch and at the end (Eqs. 51-53), as two lists."""
    means = [initial_mean(inputs), inputs.intermediate_mean, inputs.final_mean]
    return means, [inputs.initial_covariance, inputs.intermediate_covariance, inputs.final_covariance]


def mass_flow(inputs):
    """Propellant mass per impulse, kg/(N s): as stated, or from the specific impulse."""
    from marsedl.models.dynamics.powered_descent import mass_flow_constant

    if inputs.mass_flow_constant is not None:
        return inputs.mass_flow_constant
    return mass_flow_constant(inputs.specific_impulse, inputs.standard_gravity)


def plant_noise_density(inputs):
    """Noise density of the simulated thrust, N sqrt(s): gamma in units of thrust (Eq. 49)."""
    return inputs.noise_coefficient * inputs.thrust_unit


def design_noise_density(inputs):
    """Noise density that the reading's boundary condition designs for, N sqrt(s); the plant's if it is correct."""
    squared = equivalent_squared_noise_density(inputs.noise_coefficient, inputs.thrust_unit, inputs.boundary_condition)
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
        return powered_descent_rates(*state, thrust_downrange, thrust_vertical, 0.0, 0.0, gravity, 0.0)[:4]

    return linearize(motion, np.zeros((len(mass), 4)), np.zeros((len(mass), 2)), (mass,))


def steering_problems(inputs, times, models):
    """Steering problems of the segments for the reading's design noise density.

    times: local times (k,) by segment. models: (A, B, c) by segment. Returns a list of `SteeringProblem`.
    """
    means, covariances = end_conditions(inputs)
    return [
        SteeringProblem.from_linear_model(
            time,
            *model,
            initial_mean=means[number],
            final_mean=means[number + 1],
            initial_covariance=covariances[number],
            final_covariance=covariances[number + 1],
            noise_density=design_noise_density(inputs),
        )
        for number, (time, model) in enumerate(zip(times, models, strict=True))
    ]


def steered(problems):
    """The steering of every segment; MarsedlError that names the segment whose problem has no solution."""
    found = []
    for number, problem in enumerate(problems, start=1):
        try:
            found.append(steer(problem))
        except SteeringError as error:
            raise MarsedlError(
                f"segment {number}: {error}; give the segment another duration or target covariance, or write "
                "boundary_condition 'corrected'"
            ) from None
    return found
