"""Monte Carlo flights around the reference, held against the funnel (robust entry funnels, Sec. 4, Fig. 3).

Flights of the entry are the paper's Monte Carlo cases; runs of the Dubins car are stages of their own, which do not
depend on the entry.
"""

from dataclasses import fields

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers.funnels import flight
from marsedl.papers.funnels.inputs import Car, Ensemble, Planet, Uncertainty, Vehicle
from marsedl.papers.funnels.records import Dubins, FlightChunk, FlightEnsemble, Funnel, Gains, Linearization
from marsedl.replication.pipeline.catalogue import Flown, Trial, stage

REPEATS = 10
OUTCOMES = {0: "flown to the end", 3: "not finite"}


@stage()
def simulate(
    planet: Planet,
    vehicle: Vehicle,
    uncertainty: Uncertainty,
    ensemble: Ensemble,
    linearization: Linearization,
    gains: Gains,
    funnel: Funnel,
    *,
    flown: Flown,
) -> FlightChunk:
    """Fly one chunk of the trials of a case.

    The case is "constant" (one disturbance a flight, from the boundary of the disc), "redrawn" (another one every
    `redraw_steps`) or "adversarial" (at every step that which raises V fastest).
    """
    numbers = ensembles.chunk_bounds(flown.trials, flown.chunks, flown.block_size)[flown.chunk]
    setting = flight.entry_setting(planet, vehicle, uncertainty, linearization, gains, funnel)
    kept_trials = min(ensemble.drawn_trials, flown.trials)
    return _reduced(setting, _draws(ensemble, flown.case), numbers, kept_trials, flown.block_size)


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
    return gather([_reduced(setting, flight.Draws(seed), (0, trials), min(drawn_trials, trials))])


def _draws(ensemble: Ensemble, case):
    """The random numbers and disturbances of a case."""
    return flight.Draws(ensemble.seed, case, ensemble.redraw_steps, ensemble.adversarial_directions)


def _reduced(setting, draws, numbers, kept_trials, block_size=ensembles.BLOCK_SIZE):
    """The trials from one number up to another, reduced."""
    simulate_block = flight.simulator(setting, draws)
    repeat_maximum = np.full((REPEATS, len(setting.level), len(setting.observed)), np.nan)

    def recorded(first, last):
        block = simulate_block(first, last)
        finite = np.isfinite(block.final_state).all(axis=0) & np.isfinite(block.observed_maximum).all(axis=0)
        for repeat in range(REPEATS):
            values = block.observed[..., finite & (np.arange(first, last) % REPEATS == repeat)]
            if values.size:
                np.fmax(repeat_maximum[repeat], values.max(axis=-1), out=repeat_maximum[repeat])
        return block

    reduced = ensembles.run_blocks(recorded, *numbers, block_size=block_size, kept=kept_trials)
    return FlightChunk(
        time=setting.loop.time,
        level=setting.level,
        observed_name=np.array(setting.observed),
        repeat_maximum=repeat_maximum,
        **_finite_fields(reduced),
    )


@stage()
def gather(chunks: list[FlightChunk]) -> FlightEnsemble:
    """Join the chunks in the order of their trials, and count what lies outside of the funnel."""
    names = [field.name for field in fields(ensembles.Chunk)]
    merged = ensembles.merge([ensembles.Chunk(**{name: getattr(chunk, name) for name in names}) for chunk in chunks])
    joined = _finite_fields(merged)
    for name in ("histogram", "histogram_edges", "flying", "observed_mean"):
        del joined[name]
    # A ratio that is not a number is one of a trial that is nowhere.
    at_slices, between = ~(merged.final_state[:, -2:] <= 1.0).T
    lasting = merged.outcome == ensembles.COMPLETED
    return FlightEnsemble(
        time=chunks[0].time,
        level=chunks[0].level,
        observed_name=chunks[0].observed_name,
        repeat_maximum=np.fmax.reduce([chunk.repeat_maximum for chunk in chunks]),
        outside_at_slices=int(np.count_nonzero(at_slices)),
        outside_between=int(np.count_nonzero(between)),
        largest_ratio=float(merged.final_state[lasting, -2:].max()) if lasting.any() else np.nan,
        **joined,
    )


def _finite_fields(record):
    """The fields of a `Chunk` or `Ensemble`, without infinities."""
    return {field.name: ensembles.without_infinities(getattr(record, field.name)) for field in fields(record)}


def replay(
    planet: Planet,
    vehicle: Vehicle,
    uncertainty: Uncertainty,
    ensemble: Ensemble,
    linearization: Linearization,
    gains: Gains,
    funnel: Funnel,
    *,
    trial: Trial,
) -> str:
    """Fly one trial again and describe it, with its difference from the ensemble's if that is stored."""
    setting = flight.entry_setting(planet, vehicle, uncertainty, linearization, gains, funnel)
    result = ensembles.replay(flight.simulator(setting, _draws(ensemble, trial.case)), trial.number)
    end = ensembles.without_infinities(result.final_state[:, 0])
    outcome = ensembles.COMPLETED if np.isfinite(result.final_state).all() else ensembles.NON_FINITE
    lines = [f"trial {trial.number}, {trial.case}: {OUTCOMES[outcome]}"]
    names = [f"deviation of state {i + 1}" for i in range(len(end) - 2)]
    names += ["largest V/rho at slices", "largest V/rho between them"]
    lines += [f"  {name:28}{value:18.9g}" for name, value in zip(names, end, strict=True)]
    if trial.stored is not None:
        same = np.array_equal(end, trial.stored.final_state[trial.number], equal_nan=True)
        lines.append(
            "  the same to the last bit as in the stored ensemble" if same else "  DIFFERS from the stored ensemble"
        )
    return "\n".join(lines)
