"""What the paper leaves open, tried out: against its prior final mass, and against the mean final state of Eq. 54."""

from itertools import islice, product
from typing import NamedTuple

import numpy as np

from marsedl.montecarlo.statistics import covariance as sample_covariance
from marsedl.papers.powered_descent import flight, segments
from marsedl.papers.powered_descent.inputs import Design, Ensemble, Entry, Mission, Noise, Planet, Studies, Vehicle
from marsedl.papers.powered_descent.nominal import mass_passes
from marsedl.papers.powered_descent.records import Choices
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import stage

SIGNS = (1, -1)
PROFILES = ("converged", "first_pass", "first_pass_without_feedback")
CONTINUOUS = 0.0  # stands for a command that is not held


class Setup(NamedTuple):
    """What all choices have in common."""

    divert: segments.Divert  # on the grid of the study
    plant: flight.Plant
    start: flight.Start
    passes: int  # of the mass iteration
    transitions: list[np.ndarray]  # by segment: no choice moves them


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    entry: Entry,
    mission: Mission,
    noise: Noise,
    design: Design,
    ensemble: Ensemble,
    studies: Studies,
) -> Choices:
    """Try choices that the paper does not settle: of its prior final mass, and of its simulation.

    The final mass of each pass of Algorithm 3 is computed with all signs of the initial velocity, with sine and cosine
    exchanged, with each mass-flow constant, and with and without feedback in the flight of the pass. The mean final
    state is estimated for each scheme, step, held command and mass profile on the same random numbers. The estimate is
    the target plus the mean difference, trial by trial, from flights of the same trials with the prior mass: the motion
    of these is linear, so that their mean is the target exactly.
    """
    divert = segments.Divert(
        segments.grids(mission.segment_durations, studies.choice_design_interval),
        *segments.end_conditions(entry, mission),
        segments.design_noise_density(noise, design),
    )
    start = flight.Start(segments.initial_mean(entry), entry.initial_covariance, vehicle.wet_mass)
    models = [segments.linear_model(np.full(len(time), vehicle.wet_mass), planet.gravity) for time in divert.times]
    transitions = [problem.transition for problem in segments.problems_along(divert, models)]
    setup = Setup(divert, flight.plant_of(planet, vehicle, noise), start, studies.choice_passes, transitions)
    constants, intervals = studies.choice_mass_flow_constants, studies.choice_command_intervals
    intervals = np.concatenate([[CONTINUOUS], intervals])
    mean, covariance, error = _final_states(setup, studies.choice_steps, intervals, ensemble, studies.choice_trials)
    simulated = [("rk4", studies.choice_steps.max())]
    simulated += [(scheme, step) for scheme in flight.INTEGRATORS[1:] for step in studies.choice_steps]
    return Choices(
        downrange_sign=np.array(SIGNS),
        vertical_sign=np.array(SIGNS),
        exchanged=np.array([False, True]),
        mass_flow_constant=constants,
        feedback=np.array([True, False]),
        final_mass=_final_masses(setup, constants),
        profile=np.array(PROFILES),
        command_interval=intervals,
        scheme=np.array([scheme for scheme, _ in simulated]),
        step=np.array([step for _, step in simulated]),
        trials=studies.choice_trials,
        mean=mean,
        covariance=covariance,
        mean_error=error,
    )


def _final_masses(setup: Setup, constants):
    """Final mass after each pass, kg: (signs, signs, exchanged, constants, feedback, passes); NaN: no solution."""
    downrange, vertical = np.abs(setup.start.mean[2:])
    axes = (SIGNS, SIGNS, ((downrange, vertical), (vertical, downrange)), constants, (True, False))
    masses = np.full([len(axis) for axis in axes] + [setup.passes], np.nan)
    for index, (first, second, speeds, constant, feedback) in zip(
        np.ndindex(masses.shape[:-1]), product(*axes), strict=True
    ):
        mean = np.concatenate([setup.start.mean[:2], [first * speeds[0], second * speeds[1]]])
        other = setup._replace(
            divert=setup.divert._replace(means=[mean, *setup.divert.means[1:]]),
            plant=setup.plant._replace(mass_flow_constant=constant),
            start=setup.start._replace(mean=mean),
        )
        try:
            for number, (mass, _, _) in enumerate(_passes(other, feedback=feedback)):
                if not mass.min() > 0:
                    break
                masses[(*index, number)] = mass[-1]
        except MarsedlError:
            continue  # what has no solution stays without a number
    return masses


def _passes(setup: Setup, *, feedback):
    """The passes of the mass iteration, see `nominal.mass_passes`."""
    start = np.append(setup.start.mean, setup.start.wet_mass)
    quiet = setup.plant._replace(noise_density=0.0)
    passes = mass_passes(setup.divert, quiet, start, feedback=feedback, transitions=setup.transitions)
    return islice(passes, setup.passes)


def _final_states(setup: Setup, steps, intervals, ensemble: Ensemble, trials):
    """Mean (..., 4), covariance (..., 4, 4) and covariance of the mean's error of every simulation of every profile."""
    times, durations = setup.divert.times, [time[-1] for time in setup.divert.times]
    designs, prior_mass = _designs(setup)
    # All steps share the noise of the finest, of which the coarsest hold whole numbers.
    multiples = (steps / steps[0]).round().astype(int)
    common = np.lcm.reduce(multiples)
    finest = [common * int(np.ceil(duration / (common * steps[0]) - 1e-9)) for duration in durations]
    states = flight.initial_states(setup.start, ensemble.seed, np.arange(trials))

    def final_states(steerings, scheme, multiple, interval=CONTINUOUS, mass=None):
        schedules = []
        for number, steering in enumerate(steerings):
            tables = [steering.gain, steering.mean, steering.feedforward] + ([] if mass is None else [mass[number]])
            schedules.append(flight.schedule(times[number], tables, finest[number] // multiple))
        if interval != CONTINUOUS:
            schedules = [flight.with_held_command(schedule, interval) for schedule in schedules]
        draws, every = flight.Draws(ensemble.seed, increments=multiple), [schedule.steps for schedule in schedules]
        ends = flight.fly(schedules, setup.plant, states, draws, steps_per_output=every, integrator=scheme)
        return ends.final_state[:4].T

    coarsest = int(multiples.max())
    simulations = [("rk4", coarsest), *product(flight.INTEGRATORS[1:], multiples.tolist())]
    linear = final_states(designs[0], "rk4", coarsest, mass=prior_mass)
    shape = (len(designs), len(intervals), len(simulations))
    mean, covariance, error = np.empty((*shape, 4)), np.empty((*shape, 4, 4)), np.empty((*shape, 4, 4))
    for index in np.ndindex(shape):
        scheme, multiple = simulations[index[2]]
        ends = final_states(designs[index[0]], scheme, multiple, intervals[index[1]])
        difference = ends - linear
        mean[index] = setup.divert.means[-1] + difference.mean(axis=0)
        covariance[index] = sample_covariance(ends)
        error[index] = sample_covariance(difference) / len(ends)
    return mean, covariance, error


def _designs(setup: Setup):
    """The steering of both segments on each mass profile, and the converged profile by segment, kg."""
    closed, without = (list(_passes(setup, feedback=feedback)) for feedback in (True, False))
    _, segment = segments.joined_time(setup.divert.times)
    prior_mass = [part for (part,) in segments.split(segment, closed[-1][0])]
    # What a pass designs on is the profile of the pass before it.
    return [passes[number][1] for passes, number in ((closed, -1), (closed, 1), (without, 1))], prior_mass
