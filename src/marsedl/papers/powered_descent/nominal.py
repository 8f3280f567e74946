"""Mass profile and mean trajectory: design, fly without noise, take the flown mass, repeat (Algorithm 3)."""

from dataclasses import dataclass

import numpy as np

from marsedl.papers.powered_descent import segments
from marsedl.replication.artifacts import quantity
from marsedl.replication.errors import MarsedlError


@dataclass(frozen=True)
class Nominal:
    """Mass profile of Algorithm 3 and the mean trajectory that belongs to it."""

    time: np.ndarray = quantity("s", ("time",), "time from the start of the flight; the switch stands twice")
    segment: np.ndarray = quantity("1", ("time",), "number of the segment", "int64")
    mass: np.ndarray = quantity("kg", ("time",), "prior mass profile: the last pass")
    mass_of_pass: np.ndarray = quantity(
        "kg", ("passes", "time"), "mass profile after each pass; the first is the guess"
    )
    largest_change: np.ndarray = quantity("kg", ("changes",), "largest change of the mass in each pass")
    integrated_change: np.ndarray = quantity("kg s", ("changes",), "integral of the change of the mass in each pass")
    mean: np.ndarray = quantity("m, m, m/s, m/s", ("time", 4), "mean state: downrange, altitude and their rates")
    feedforward: np.ndarray = quantity("N", ("time", 2), "mean thrust")
    flown: np.ndarray = quantity("m, m, m/s, m/s", (4,), "final state of the noise-free flight of the nonlinear plant")


def compute(inputs) -> Nominal:
    """Iterate on the mass profile until it no longer changes (Algorithm 3, over both segments)."""
    times = segments.grids(inputs.segment_durations, inputs.design_interval)
    time, segment = segments.joined_time(times)
    passes = [np.full(len(time), inputs.wet_mass)]
    largest, integrated = [], []
    while True:
        steerings = design(inputs, times, segments.split(segment, passes[-1]))
        mass, flown = fly_mean(inputs, times, steerings)
        change = np.abs(mass - passes[-1])
        passes.append(mass)
        largest.append(change.max())
        integrated.append(np.trapezoid(change, time))
        if not np.isfinite(change).all() or mass.min() <= 0:
            raise MarsedlError(
                f"pass {len(largest)} of the mass iteration burns all of the mass; the divert needs too much thrust "
                f"for "
                f"wet_mass and specific_impulse: give the segments more time or a nearer target"
            )
        if integrated[-1] < inputs.mass_tolerance:
            break
        if len(largest) == inputs.mass_iterations:
            raise MarsedlError(
                f"the mass iteration still changes by {integrated[-1]:.3g} kg s after {len(largest)} passes; "
                "raise mass_iterations or mass_tolerance"
            )
    return Nominal(
        time=time,
        segment=segment,
        mass=passes[-1],
        mass_of_pass=np.array(passes),
        largest_change=np.array(largest),
        integrated_change=np.array(integrated),
        mean=np.concatenate([steering.mean for steering in steerings]),
        feedforward=np.concatenate([steering.feedforward for steering in steerings]),
        flown=flown,
    )


def design(inputs, times, masses):
    """Steering of both segments for given mass profiles; a list of `Steering`."""
    models = [segments.linear_model(mass, inputs.gravity) for (mass,) in masses]
    return segments.steered(segments.steering_problems(inputs, times, models))


def fly_mean(inputs, times, steerings):
    """Fly the mean initial state without noise; returns the mass at all nodes (k,), kg, and the final state (4,)."""
    from scipy.interpolate import CubicSpline

    from marsedl.papers.powered_descent import flight  # here, as later stages load this module for its artifact

    # One step spans two cells of the design grid, whose nodes are then the half-steps.
    schedules = [
        flight.Schedule(2 * time[1], len(time) // 2, s.gain, s.mean, s.feedforward)
        for time, s in zip(times, steerings, strict=True)
    ]
    plant = flight.Plant(inputs.gravity, segments.mass_flow(inputs), 0.0)
    start = np.append(segments.initial_mean(inputs), inputs.wet_mass)[np.newaxis]
    flown = flight.fly(schedules, plant, start, steps_per_output=[1] * len(times), seed=0)
    coarse = [time[::2] for time in times]
    _, segment = segments.joined_time(coarse)
    mass = flown.history[:, 4, 0]
    nodes = [
        CubicSpline(some, part)(time)
        for some, time, (part,) in zip(coarse, times, segments.split(segment, mass), strict=True)
    ]
    return np.concatenate(nodes), flown.final_state[:4, 0]
