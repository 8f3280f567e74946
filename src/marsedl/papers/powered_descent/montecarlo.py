"""Monte Carlo flights of the nonlinear plant, closed and open loop, scattered in chunks and gathered."""

from collections.abc import Callable

import numpy as np

from marsedl.montecarlo.outcomes import COMPLETED, CRASHED, NON_FINITE
from marsedl.papers.ensembles import Chunk
from marsedl.papers.flights import described, flown_chunk, joined
from marsedl.papers.powered_descent import flight, segments
from marsedl.papers.powered_descent.inputs import Inputs, Mission, Simulation
from marsedl.papers.powered_descent.records import (
    FlightEnsemble,
    Gains,
    Nominal,
)
from marsedl.replication.pipeline.catalogue import Flown, Trial, stage

LARGE = "_large"  # ends the name of a case that flies the same trials and more


@stage()
def simulate(given: Inputs, nominal: Nominal, gains: Gains, *, flown: Flown) -> Chunk:
    """Fly one chunk of a Monte Carlo case.

    The case is "closed_loop", "open_loop", "prior_mass" (the plant flies the mass that the design assumes) or
    "wide_switch" (the second segment begins with too wide a scatter), with the suffix "_large" for the large ensembles,
    which fly the same trials and more. All cases start from the same states and meet the same noise.
    """
    thrust_edges = np.linspace(
        0.0, given.ensemble.thrust_range * given.vehicle.maximum_thrust, given.ensemble.thrust_bins + 1
    )
    return flown_chunk(
        block_simulator(given, nominal, gains, flown.case),
        flown,
        drawn=given.ensemble.drawn_trials,
        histogram_edges=thrust_edges[np.newaxis],
    )


def block_simulator(given: Inputs, nominal: Nominal, gains: Gains, case: str) -> Callable:
    """Return the function `simulate_block(first, last)` of a Monte Carlo case, which also replays single trials."""
    vehicle, entry, simulation = given.vehicle, given.entry, given.simulation
    durations, seed = given.mission.segment_durations, given.ensemble.seed
    steps = [flight.step_count(d, simulation.time_step, simulation.output_interval) for d in durations]
    times = segments.grids(durations, given.design.design_interval)
    kind = case.removesuffix(LARGE)
    prior_mass = nominal.mass if kind == "prior_mass" else None
    schedules = flight.schedules_of(times, gains, [number for number, _ in steps], prior_mass)
    if kind == "open_loop":
        schedules = [flight.open_loop(schedule) for schedule in schedules]
    if simulation.command_interval is not None:
        schedules = [flight.with_held_command(schedule, simulation.command_interval) for schedule in schedules]
    widening = given.ensemble.wide_switch_factor if kind == "wide_switch" else 1.0
    plant = flight.Plant(given.planet.gravity, segments.mass_flow(vehicle), gains.noise_density_plant)
    start = flight.Start(segments.initial_mean(entry), entry.initial_covariance, vehicle.wet_mass)

    def simulate_block(first, last):
        states = flight.initial_states(start, seed, np.arange(first, last))
        return flight.fly(
            schedules,
            plant,
            states,
            flight.Draws(seed, first),
            steps_per_output=[every for _, every in steps],
            integrator=simulation.integrator,
            widening=widening,
        )

    return simulate_block


@stage()
def gather(mission: Mission, simulation: Simulation, chunks: list[Chunk]) -> FlightEnsemble:
    """Join the chunks of a case in the order of their trials."""
    merged = joined(FlightEnsemble, chunks)
    outputs = [
        np.linspace(0.0, duration, flight.step_count(duration, np.inf, simulation.output_interval)[0] + 1)
        for duration in mission.segment_durations
    ]
    time, segment = segments.joined_time(outputs)
    return FlightEnsemble(time=time, segment=segment, **merged)


def replay(chunk: Chunk, *, trial: Trial) -> str:
    """Describe a trial that was flown again."""
    outcomes = {COMPLETED: "completed", CRASHED: "below the ground", NON_FINITE: "not finite"}
    return described(FlightEnsemble, chunk, trial, outcomes)
