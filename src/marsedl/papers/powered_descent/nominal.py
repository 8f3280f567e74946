"""Mass profile and mean trajectory: design, fly without noise, take the mass of that flight, repeat (Algorithm 3)."""

import numpy as np
from scipy.interpolate import CubicSpline

from marsedl.papers.powered_descent import flight, segments
from marsedl.papers.powered_descent.inputs import Inputs
from marsedl.papers.powered_descent.records import Nominal
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import stage


@stage()
def compute(given: Inputs) -> Nominal:
    """Iterate on the mass profile until it no longer changes (Algorithm 3, over both segments).

    The profile that is kept is the last one or that of the first pass, whichever the design asks for; mean, thrust and
    final state are those of the design on it.
    """
    design = given.design
    divert = segments.divert_of(given)
    plant = flight.Plant(given.planet.gravity, segments.mass_flow(given.vehicle), 0.0)
    start = np.append(divert.means[0], given.vehicle.wet_mass)
    time, segment = segments.joined_time(divert.times)
    passes, steered_passes, integrated = [np.full(len(time), given.vehicle.wet_mass)], [], []
    feedback = design.mass_profile != "first_pass_without_feedback"
    for mass, steerings, final_state in mass_passes(divert, plant, start, feedback=feedback):
        change = np.abs(mass - passes[-1])
        passes.append(mass)
        steered_passes.append((steerings, final_state))
        integrated.append(np.trapezoid(change, time))
        if not np.isfinite(change).all() or mass.min() <= 0:
            raise MarsedlError(
                f"pass {len(integrated)} of the mass iteration burns all of the mass; the divert needs too much thrust "
                "for wet_mass and specific_impulse: give the segments more time or a nearer target"
            )
        if integrated[-1] < design.mass_tolerance:
            break
        if len(integrated) == design.mass_iterations:
            raise MarsedlError(
                f"the mass iteration still changes by {integrated[-1]:.3g} kg s after {len(integrated)} passes; "
                "raise mass_iterations or mass_tolerance"
            )
    # The second pass is designed on the profile of the first; a profile that converges in one pass is its own.
    number = len(passes) - 1 if design.mass_profile == "converged" else 1
    steerings, final_state = steered_passes[-1 if design.mass_profile == "converged" else min(1, len(passes) - 2)]
    return Nominal(
        time=time,
        segment=segment,
        mass=passes[number],
        mass_of_pass=np.array(passes),
        integrated_change=np.array(integrated),
        mean=np.concatenate([steering.mean for steering in steerings]),
        feedforward=np.concatenate([steering.feedforward for steering in steerings]),
        flown=final_state,
    )


def mass_passes(divert, plant, start, *, feedback=True):
    """Yield the passes of Algorithm 3 from the constant wet mass, without end.

    Args:
        divert: `segments.Divert`.
        plant: `flight.Plant`.
        start: initial state with the wet mass, (5,), SI.
        feedback: whether the control of the simulated flight has the feedback; without it only the mean control flies.

    Yields:
        The mass at all nodes after the pass (k,), kg; `Steering` by segment of the design before it; the final state of
        the flight (4,).

    """
    time, segment = segments.joined_time(divert.times)
    mass, transitions = np.full(len(time), start[4]), None  # these do not depend on the mass
    while True:
        models = [segments.linear_model(part, plant.gravity) for (part,) in segments.split(segment, mass)]
        problems = segments.problems_along(divert, models, transitions)
        transitions = [problem.transition for problem in problems]
        steerings = segments.steered(problems)
        mass, final_state = fly_mean(divert.times, steerings, plant, start, feedback=feedback)
        yield mass, steerings, final_state


def fly_mean(times, steerings, plant, start, *, feedback=True):
    """Fly one state without noise under the control of the design.

    times: of the nodes, (k,) by segment, s. steerings: `Steering` by segment. plant: `Plant`. start: (5,), SI.
    feedback: whether the control has it. Returns the mass at all nodes (k,), kg, and the final state (4,).
    """
    # One step spans two cells of the design grid, whose nodes are then the half-steps.
    schedules = [
        flight.Schedule(2 * time[1], len(time) // 2, s.gain, s.mean, s.feedforward)
        for time, s in zip(times, steerings, strict=True)
    ]
    if not feedback:
        schedules = [flight.open_loop(schedule) for schedule in schedules]
    flight_of_mean = flight.fly(
        schedules, plant, start[np.newaxis], flight.Draws(seed=0), steps_per_output=[1] * len(times)
    )
    coarse = [time[::2] for time in times]
    _, segment = segments.joined_time(coarse)
    mass = flight_of_mean.history[:, 4, 0]
    nodes = [
        CubicSpline(some, part)(time)
        for some, time, (part,) in zip(coarse, times, segments.split(segment, mass), strict=True)
    ]
    return np.concatenate(nodes), flight_of_mean.final_state[:4, 0]
