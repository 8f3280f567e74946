"""Mass profile and mean trajectory: design, fly without noise, take the flown mass, repeat (Algorithm 3)."""

import numpy as np
from scipy.interpolate import CubicSpline

from marsedl.papers.powered_descent import flight, segments
from marsedl.papers.powered_descent.inputs import Design, Entry, Mission, Noise, Planet, Vehicle
from marsedl.papers.powered_descent.records import Nominal
from marsedl.replication.catalogue import stage
from marsedl.replication.errors import MarsedlError


@stage()
def compute(planet: Planet, vehicle: Vehicle, entry: Entry, mission: Mission, noise: Noise, design: Design) -> Nominal:
    """Iterate on the mass profile until it no longer changes (Algorithm 3, over both segments)."""
    divert = segments.divert_of(entry, mission, noise, design)
    plant = flight.Plant(planet.gravity, segments.mass_flow(vehicle), 0.0)
    start = np.append(divert.means[0], vehicle.wet_mass)
    time, segment = segments.joined_time(divert.times)
    passes, transitions = [np.full(len(time), vehicle.wet_mass)], None
    largest, integrated = [], []
    while True:
        masses = segments.split(segment, passes[-1])
        models = [segments.linear_model(mass, planet.gravity) for (mass,) in masses]
        problems = segments.problems_along(divert, models, transitions)
        transitions = [problem.transition for problem in problems]
        steerings = segments.steered(problems)
        mass, flown = fly_mean(divert.times, steerings, plant, start)
        change = np.abs(mass - passes[-1])
        passes.append(mass)
        largest.append(change.max())
        integrated.append(np.trapezoid(change, time))
        if not np.isfinite(change).all() or mass.min() <= 0:
            raise MarsedlError(
                f"pass {len(largest)} of the mass iteration burns all of the mass; the divert needs too much thrust "
                "for wet_mass and specific_impulse: give the segments more time or a nearer target"
            )
        if integrated[-1] < design.mass_tolerance:
            break
        if len(largest) == design.mass_iterations:
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


def fly_mean(times, steerings, plant, start):
    """Fly one state without noise under the mean control.

    times: of the nodes, (k,) by segment, s. steerings: `Steering` by segment. plant: `Plant`. start: (5,), SI. Returns
    the mass at all nodes (k,), kg, and the final state (4,).
    """
    # One step spans two cells of the design grid, whose nodes are then the half-steps.
    schedules = [
        flight.Schedule(2 * time[1], len(time) // 2, s.gain, s.mean, s.feedforward)
        for time, s in zip(times, steerings, strict=True)
    ]
    flown = flight.fly(schedules, plant, start[np.newaxis], flight.Draws(seed=0), steps_per_output=[1] * len(times))
    coarse = [time[::2] for time in times]
    _, segment = segments.joined_time(coarse)
    mass = flown.history[:, 4, 0]
    nodes = [
        CubicSpline(some, part)(time)
        for some, time, (part,) in zip(coarse, times, segments.split(segment, mass), strict=True)
    ]
    return np.concatenate(nodes), flown.final_state[:4, 0]
