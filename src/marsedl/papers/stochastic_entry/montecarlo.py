"""Monte Carlo flights of both laws to both triggers, scattered in chunks and gathered (Sec. V, Tables 3 and 4)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from marsedl.papers.density import TableExits
from marsedl.papers.ensembles import Chunk
from marsedl.papers.flights import described, flown_chunk, joined
from marsedl.papers.stochastic_entry import flight
from marsedl.papers.stochastic_entry.gains import law
from marsedl.papers.stochastic_entry.inputs import Inputs, Mission, Simulation
from marsedl.papers.stochastic_entry.records import (
    OUTCOMES,
    FlightEnsemble,
    Gains,
    Linearization,
    Nominal,
)
from marsedl.replication.pipeline.catalogue import Flown, Trial, stage

BANK_BINS = 72


class End(NamedTuple):
    """What ends a flight."""

    trigger: str  # "time" or "velocity"
    time: float  # s, the fixed final time, or the time limit of the velocity trigger


@stage()
def simulate(given: Inputs, nominal: Nominal, linearization: Linearization, gains: Gains, *, flown: Flown) -> Chunk:
    """Fly one chunk of a Monte Carlo case.

    The case is law and trigger, such as "apollo_velocity".
    """
    edges = np.linspace(-np.pi, np.pi, BANK_BINS + 1)
    return flown_chunk(
        block_simulator(given, nominal, linearization, gains, flown.case),
        flown,
        drawn=given.simulation.drawn_trials,
        exits=TableExits(given.air),
        histogram_edges=np.array([edges, edges]),
    )


def block_simulator(given: Inputs, nominal: Nominal, linearization: Linearization, gains: Gains, case: str) -> Callable:
    """Return the function `simulate_block(first, last)` of a Monte Carlo case, which also replays single trials."""
    plant = flight.plant_of(given)
    control_law, end = law(given.guidance, linearization, gains, case), end_of(given.mission, nominal, case)
    return simulator_of(plant, control_law, end, given.simulation)


def simulator_of(plant: flight.Plant, control_law: flight.Law, end: End, simulation: Simulation) -> Callable:
    """Return the function `simulate_block(first, last)` of any plant, law and end of the flight."""

    def simulate_block(first, last):
        return flight.fly(
            plant.settings,
            plant.atmosphere,
            control_law,
            flight.vehicles_of(plant.dispersions, simulation.seed, np.arange(first, last)),
            trigger=end.trigger,
            end_time=end.time,
            substeps=simulation.flight_substeps,
            seed=simulation.seed,
            first_trial=first,
        )

    return simulate_block


def end_of(mission: Mission, nominal: Nominal, case: str) -> End:
    """What ends the flights of a Monte Carlo case: the nominal's end time, or the velocity within the time limit."""
    trigger = case.split("_")[1]
    return End(trigger, nominal.end_time if trigger == "time" else mission.time_limit)


@stage()
def gather(given: Inputs, nominal: Nominal, chunks: list[Chunk], *, flown: Flown) -> FlightEnsemble:
    """Join the chunks of a case in the order of their trials."""
    end = end_of(given.mission, nominal, flown.case)
    time = flight.schedule(end.time, given.guidance.guidance_period, end.trigger).times
    return FlightEnsemble(time=time, nominal_final=nominal_final(nominal), **joined(FlightEnsemble, chunks))


def nominal_final(nominal):
    """The nominal's altitude, velocity, path angle, downrange, density and crossrange at its end."""
    names = ("altitude", "velocity", "flight_path_angle", "downrange", "density", "crossrange")
    return np.array([getattr(nominal, name)[-1] for name in names])


def replay(chunk: Chunk, *, trial: Trial) -> str:
    """Describe a trial that was flown again."""
    return described(FlightEnsemble, chunk, trial, OUTCOMES)
