"""Monte Carlo flights with random position errors at entry, under every law; the paper flies single errors only."""

import numpy as np

from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.montecarlo.streams import normals
from marsedl.papers.density import TableExits
from marsedl.papers.desensitized import entry_problem, environment, flight
from marsedl.papers.desensitized.gains import flown_law
from marsedl.papers.desensitized.inputs import Inputs
from marsedl.papers.desensitized.records import FlightEnsemble, Gains
from marsedl.papers.ensembles import Chunk
from marsedl.papers.flights import described, flown_chunk, joined
from marsedl.replication.pipeline.catalogue import Flown, Trial, stage

ERROR_STREAM = 0
OUTCOMES = {0: "flown to the final time", 1: "below the ground", 3: "not finite"}
BINS = 40
OUTPUTS = 20  # stored times, besides the start; fewer where the intervals are not a multiple


@stage()
def simulate(given: Inputs, gains: Gains, *, flown: Flown) -> Chunk:
    """Fly one chunk of the trials under every law."""
    bound = given.vehicle.bank_acceleration_bound
    edges = np.array([np.linspace(least, bound, BINS + 1) for least in (-bound, 0.0)])
    simulators = [block_simulator(given, flown_law(gains, number)) for number in range(len(gains.law))]
    return flown_chunk(
        simulators, flown, drawn=given.ensemble.drawn_trials, exits=TableExits(given.planet), histogram_edges=edges
    )


def block_simulator(given: Inputs, law):
    """Return the function `simulate_block(first, last)` under a law, its reference and gain."""
    air, (reference, gain) = environment.surroundings(given.planet, given.vehicle), law

    def simulate_block(first, last):
        errors = (
            normals(given.ensemble.seed, ERROR_STREAM, np.arange(first, last), 3) * given.ensemble.initial_deviations
        )
        states = environment.displaced(given.planet, reference.initial_state, errors)
        every = output_step(len(reference.bank_acceleration))
        return flight.fly(*air, reference, gain, states, substeps=given.simulation.substeps, every=every)

    return simulate_block


def output_step(intervals):
    """Intervals between stored states: a divisor of all of them that makes `OUTPUTS` times or a few more."""
    longest = max(1, intervals // OUTPUTS)
    return max(step for step in range(1, longest + 1) if intervals % step == 0)


@stage()
def gather(given: Inputs, gains: Gains, chunks: list[Chunk]) -> FlightEnsemble:
    """Join the chunks in the order of their trials, and take the final errors against the flight without any."""
    step = output_step(gains.bank_acceleration.shape[1])
    air, nominals = environment.surroundings(given.planet, given.vehicle), []
    for number in range(len(gains.law)):
        reference, gain = flown_law(gains, number)
        start = reference.initial_state[np.newaxis]
        trajectories = flight.fly(*air, reference, gain, start, substeps=given.simulation.substeps, every=step)
        nominals.append(trajectories.history[:, :, 0])
    nominal, merged = np.array(nominals), joined(FlightEnsemble, chunks)
    ends = np.where(merged["outcome"][:, :, np.newaxis] == COMPLETED, merged["final_state"], np.nan)
    return FlightEnsemble(
        law=gains.law,
        time=gains.time[:, ::step],
        nominal=nominal,
        final_error=entry_problem.position_errors(ends, nominal[:, -1:], given.planet.planet_radius),
        **merged,
    )


def replay(gains: Gains, chunk: Chunk, *, trial: Trial) -> str:
    """Describe a trial that was flown again under every law."""
    return described(FlightEnsemble, chunk, trial, OUTCOMES, laws=[f"law {name}" for name in gains.law])
