"""Monte Carlo flights of every law through the true spatial field, scattered in chunks and gathered (Sec. V.B.4)."""

from dataclasses import replace

import numpy as np

from marsedl.models import orbits, random_field
from marsedl.montecarlo.outcomes import ESCAPED
from marsedl.montecarlo.streams import normals
from marsedl.papers.density import TableExits
from marsedl.papers.ensembles import Chunk
from marsedl.papers.flights import described, flown_chunk, joined
from marsedl.papers.random_field import flight
from marsedl.papers.random_field.environment import targets
from marsedl.papers.random_field.gains import law
from marsedl.papers.random_field.inputs import Inputs, Mission, Planet
from marsedl.papers.random_field.nominal import initial_root, initial_state, output_steps, output_times
from marsedl.papers.random_field.records import (
    CAPTURED,
    NOT_EXITED,
    OUTCOMES,
    FlightEnsemble,
    Gains,
    Nominal,
)
from marsedl.replication.pipeline.catalogue import Flown, Trial, stage

CONTROL_BINS = 40


@stage()
def simulate(given: Inputs, nominal: Nominal, gains: Gains, *, flown: Flown) -> Chunk:
    """Fly one chunk of the trials under every law."""
    lower, upper = given.vehicle.control_limits
    edges = np.array([np.linspace(lower, upper, CONTROL_BINS + 1), np.linspace(lower - upper, 0.0, CONTROL_BINS + 1)])
    simulators = [block_simulator(given, nominal, gains, number) for number in range(len(gains.control))]
    return flown_chunk(
        simulators, flown, drawn=given.simulation.drawn_trials, exits=TableExits(given.air), histogram_edges=edges
    )


def block_simulator(given: Inputs, nominal: Nominal, gains: Gains, number=-1):
    """Return the function `simulate_block(first, last)` under one law, which also replays single trials.

    number: 0 for the open loop, or an iteration, the last one unless given.
    """
    planet, vehicle, simulation = given.planet, given.vehicle, given.simulation
    least_exit_altitude = given.mission.least_exit_altitude
    plant = flight.plant_of(given)
    flown_law = law(gains, number)
    mean, root = initial_state(planet, vehicle, nominal.entry_flight_path_angle), initial_root(vehicle)
    every = output_steps(given.mission, simulation)
    lower, upper = vehicle.control_limits

    def simulate_block(first, last):
        normal_numbers = normals(simulation.seed, flight.INITIAL_STREAM, np.arange(first, last), 3)
        trajectories = flight.fly(
            *plant,
            flown_law,
            mean + random_field.sample(normal_numbers, root),
            time_step=simulation.time_step,
            seed=simulation.seed,
            first_trial=first,
            every=every,
        )
        completed = trajectories.outcome == CAPTURED
        altitude, velocity, path_angle = trajectories.final_state[:3]
        bound = np.isfinite(
            orbits.apoapsis_radius(
                altitude + planet.planet_radius, velocity, path_angle, planet.gravitational_parameter
            )
        )
        trajectories.outcome[completed & ~bound] = ESCAPED
        trajectories.outcome[completed & (altitude < least_exit_altitude)] = NOT_EXITED
        command = trajectories.observed[:, 0]
        observed = np.stack([command, np.maximum(command - upper, lower - command)], axis=1)
        # Until a trial's end; what is stored behind is of no meaning.
        largest = np.where(trajectories.after_end[:, np.newaxis], -np.inf, observed).max(axis=0)
        return replace(trajectories, observed=observed, observed_maximum=largest)

    return simulate_block


@stage()
def gather(given: Inputs, chunks: list[Chunk]) -> FlightEnsemble:
    """Join the chunks in the order of their trials, and compute apoapsis and delta-v of every trial."""
    merged, time = joined(FlightEnsemble, chunks), output_times(given.mission, given.simulation)
    apoapsis, delta_v = burns(given.planet, given.mission, merged["final_state"], merged["outcome"])
    return FlightEnsemble(time=time, apoapsis=apoapsis, delta_v=delta_v, **merged)


def burns(planet: Planet, mission: Mission, final_state, outcome):
    """Exit apoapsis (planet radii) and delta-v (m/s) of trials, NaN for those that are lost.

    final_state: (..., trials, 4). outcome: (..., trials).
    """
    captured = outcome == CAPTURED
    exit_state = final_state[captured][:, :3] + np.array([planet.planet_radius, 0.0, 0.0])
    apoapsis, delta_v = np.full(outcome.shape, np.nan), np.full(outcome.shape, np.nan)
    apoapsis[captured] = orbits.apoapsis_radius(*exit_state.T, planet.gravitational_parameter) / planet.planet_radius
    delta_v[captured] = orbits.total_delta_v(*exit_state.T, *targets(planet, mission))
    return apoapsis, delta_v


def replay(planet: Planet, mission: Mission, chunk: Chunk, *, trial: Trial) -> str:
    """Describe a trial that was flown again under every law."""
    laws = ["open loop", *(f"law of iteration {number}" for number in range(1, len(chunk.outcome)))]
    delta_v = burns(planet, mission, chunk.final_state, chunk.outcome)[1]
    further = [{"delta-v (m/s)": one} for one in delta_v[:, 0]]
    return described(FlightEnsemble, chunk, trial, OUTCOMES, laws=laws, further=further)
