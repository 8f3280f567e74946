"""Monte Carlo flights with random position errors at entry, under every law; the paper flies single errors only."""

from dataclasses import fields
from typing import NamedTuple

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.montecarlo.streams import normals
from marsedl.papers.density import TableExits
from marsedl.papers.desensitized import entry_problem, environment, flight
from marsedl.papers.desensitized.gains import flown_law
from marsedl.papers.desensitized.inputs import Ensemble, Planet, Simulation, Vehicle
from marsedl.papers.desensitized.records import FlightChunk, FlightEnsemble, Gains
from marsedl.replication.pipeline.catalogue import Flown, Trial, stage

ERROR_STREAM = 0
OUTCOMES = {0: "flown to the final time", 1: "below the ground", 3: "not finite"}
BINS = 40
OUTPUTS = 20  # stored times, besides the start; fewer where the intervals are not a multiple


class Flights(NamedTuple):
    """What is flown, how finely, and with which random numbers."""

    planet: Planet
    vehicle: Vehicle
    simulation: Simulation
    ensemble: Ensemble


@stage()
def simulate(
    planet: Planet, vehicle: Vehicle, simulation: Simulation, ensemble: Ensemble, gains: Gains, *, flown: Flown
) -> FlightChunk:
    """Fly one chunk of the trials under every law."""
    flights = Flights(planet, vehicle, simulation, ensemble)
    first, last = ensembles.chunk_bounds(flown.trials, flown.chunks, flown.block_size)[flown.chunk]
    bound = vehicle.bank_acceleration_bound
    edges = np.array([np.linspace(least, bound, BINS + 1) for least in (-bound, 0.0)])
    exits = TableExits(planet)
    reduced = [
        ensembles.run_blocks(
            exits.watching(block_simulator(flights, gains, number)),
            first,
            last,
            block_size=flown.block_size,
            histogram_edges=edges,
            kept=min(ensemble.drawn_trials, flown.trials),
        )
        for number in range(len(gains.law))
    ]
    exits.say(f"flights {first:,} to {last - 1:,}, under all laws")
    return FlightChunk(**_by_law(reduced))


def _by_law(parts):
    """The fields of one `Chunk` or `Ensemble` per law, stacked."""
    return {
        field.name: ensembles.without_infinities(np.array([getattr(part, field.name) for part in parts]))
        for field in fields(parts[0])
    }


def block_simulator(flights: Flights, gains: Gains, number):
    """Return the function `simulate_block(first, last)` under a law, by its number; it also replays single trials."""
    planet, ensemble = flights.planet, flights.ensemble
    air = environment.surroundings(planet, flights.vehicle)
    reference, gain = flown_law(gains, number)

    def simulate_block(first, last):
        errors = normals(ensemble.seed, ERROR_STREAM, np.arange(first, last), 3) * ensemble.initial_deviations
        states = environment.displaced(planet, reference.initial_state, errors)
        every = output_step(len(reference.bank_acceleration))
        return flight.fly(*air, reference, gain, states, substeps=flights.simulation.substeps, every=every)

    return simulate_block


def output_step(intervals):
    """Intervals between stored states: a divisor of all of them that makes `OUTPUTS` times or a few more."""
    longest = max(1, intervals // OUTPUTS)
    return max(step for step in range(1, longest + 1) if intervals % step == 0)


@stage()
def gather(
    planet: Planet, vehicle: Vehicle, simulation: Simulation, gains: Gains, chunks: list[FlightChunk]
) -> FlightEnsemble:
    """Join the chunks in the order of their trials, and take the final errors against the flight without any."""
    laws = range(len(gains.law))
    names = [field.name for field in fields(ensembles.Chunk)]
    merged = [
        ensembles.merge([ensembles.Chunk(**{name: getattr(chunk, name)[number] for name in names}) for chunk in chunks])
        for number in laws
    ]
    step = output_step(gains.bank_acceleration.shape[1])
    air, nominals = environment.surroundings(planet, vehicle), []
    for number in laws:
        reference, gain = flown_law(gains, number)
        start = reference.initial_state[np.newaxis]
        trajectories = flight.fly(*air, reference, gain, start, substeps=simulation.substeps, every=step)
        nominals.append(trajectories.history[:, :, 0])
    nominal, joined = np.array(nominals), _by_law(merged)
    ends = np.where(joined["outcome"][:, :, np.newaxis] == ensembles.COMPLETED, joined["final_state"], np.nan)
    return FlightEnsemble(
        law=gains.law,
        time=gains.time[:, ::step],
        nominal=nominal,
        final_error=entry_problem.position_errors(ends, nominal[:, -1:], planet.planet_radius),
        **joined,
    )


def replay(
    planet: Planet, vehicle: Vehicle, simulation: Simulation, ensemble: Ensemble, gains: Gains, *, trial: Trial
) -> str:
    """Fly one trial again under every law and describe it, compared with the ensemble's if that is stored."""
    flights, lines = Flights(planet, vehicle, simulation, ensemble), []
    for law_number, name in enumerate(gains.law):
        trajectories = ensembles.replay(block_simulator(flights, gains, law_number), trial.number)
        end = trajectories.final_state[:, 0]
        lines.append(f"trial {trial.number}, law {name}: {OUTCOMES[int(trajectories.outcome[0])]}")
        parts = zip(("altitude (m)", "latitude (rad)", "longitude (rad)"), end[:3], strict=True)
        lines += [f"  {part:26}{value:18.9f}" for part, value in parts]
        if trial.stored is not None:
            same = np.array_equal(end, trial.stored.final_state[law_number, trial.number], equal_nan=True)
            lines.append(
                "  the same to the last bit as in the stored ensemble" if same else "  DIFFERS from the stored ensemble"
            )
    return "\n".join(lines)
