"""Monte Carlo flights around the reference, held against the funnel (robust entry funnels, Sec. 4, Fig. 3).

Flights of the entry are the paper's Monte Carlo cases; runs of the Dubins car are stages of their own, which do not
depend on the entry.
"""

from dataclasses import replace

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.papers.ensembles import Chunk
from marsedl.papers.flights import described, flown_chunk, joined
from marsedl.papers.funnels import flight
from marsedl.papers.funnels.inputs import Car, Ensemble, Inputs
from marsedl.papers.funnels.records import Dubins, FlightEnsemble, Funnel, Gains, Linearization
from marsedl.replication.pipeline.catalogue import Flown, Trial, stage

REPEATS = 10
OUTCOMES = {0: "flown to the end", 3: "not finite"}


@stage()
def simulate(given: Inputs, linearization: Linearization, gains: Gains, funnel: Funnel, *, flown: Flown) -> Chunk:
    """Fly one chunk of the trials of a case.

    The case is "constant" (one disturbance a flight, from the boundary of the disc), "redrawn" (another one every
    `redraw_steps`) or "adversarial" (at every step that which raises V fastest).
    """
    setting = flight.entry_setting(given, linearization, gains, funnel)
    draws = flight.Draws(
        given.ensemble.seed, flown.case, given.ensemble.redraw_steps, given.ensemble.adversarial_directions
    )
    return _reduced(setting, draws, flown, given.ensemble.drawn_trials)


@stage()
def dubins_calm(ensemble: Ensemble, car: Car, dubins: Dubins) -> FlightEnsemble:
    """Run the Dubins car without wind."""
    setting = flight.car_setting(dubins, "flow", car.dubins_speed)
    return _car_runs(setting, ensemble.seed, car.dubins_trials, ensemble.drawn_trials)


@stage()
def dubins_wind(ensemble: Ensemble, car: Car, dubins: Dubins) -> FlightEnsemble:
    """Run the Dubins car, each time in a constant wind from the boundary of its disc."""
    setting = flight.car_setting(dubins, "wind", car.dubins_speed, car.dubins_wind)
    return _car_runs(setting, ensemble.seed, car.dubins_wind_trials, ensemble.drawn_trials)


def _car_runs(setting, seed, trials, drawn_trials):
    """Runs of the car, held against one of its funnels."""
    flown = Flown("dubins", trials, ensembles.BLOCK_SIZE)
    return _held(setting, [_reduced(setting, flight.Draws(seed), flown, drawn_trials)])


def _reduced(setting, draws, flown, drawn_trials):
    """The trials of a job, reduced."""
    simulate_block = flight.simulator(setting, draws)
    repeat_maximum = np.full((REPEATS, len(setting.level), len(setting.observed)), np.nan)

    def recorded(first, last):
        block = simulate_block(first, last)
        for repeat in range(REPEATS):
            values = block.observed[..., block.finite & (np.arange(first, last) % REPEATS == repeat)]
            if values.size:
                np.fmax(repeat_maximum[repeat], values.max(axis=-1), out=repeat_maximum[repeat])
        return block

    chunk = flown_chunk(recorded, flown, drawn=drawn_trials)
    return replace(chunk, maximum_of_parts=repeat_maximum[np.newaxis])


@stage()
def gather(
    given: Inputs, linearization: Linearization, gains: Gains, funnel: Funnel, chunks: list[Chunk]
) -> FlightEnsemble:
    """Join the chunks in the order of their trials, and count what lies outside of the funnel."""
    return _held(flight.entry_setting(given, linearization, gains, funnel), chunks)


def _held(setting, chunks):
    """The trials of chunks, held against a funnel."""
    merged = joined(FlightEnsemble, chunks)
    # A ratio that is not a number is one of a trial that is nowhere.
    at_slices, between = ~(merged["final_state"][:, -2:] <= 1.0).T
    lasting = merged["outcome"] == COMPLETED
    return FlightEnsemble(
        time=setting.loop.time,
        level=setting.level,
        observed_name=np.array(setting.observed),
        repeat_maximum=np.fmax.reduce([chunk.maximum_of_parts[0] for chunk in chunks]),
        outside_at_slices=int(np.count_nonzero(at_slices)),
        outside_between=int(np.count_nonzero(between)),
        largest_ratio=float(merged["final_state"][lasting, -2:].max()) if lasting.any() else np.nan,
        **merged,
    )


def replay(chunk: Chunk, *, trial: Trial) -> str:
    """Describe a trial that was flown again."""
    deviations = [f"deviation of state {number + 1}" for number in range(chunk.kept_history.shape[-1])]
    names = [*deviations, "largest V/rho at slices", "largest V/rho between them"]
    return described(FlightEnsemble, chunk, trial, OUTCOMES, names=names)
