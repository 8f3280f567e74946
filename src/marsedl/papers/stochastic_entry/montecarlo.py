"""Monte Carlo flights of both laws to both triggers, scattered in chunks and gathered (Sec. V, Tables 3 and 4)."""

from dataclasses import fields

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers.stochastic_entry import environment, flight
from marsedl.papers.stochastic_entry.gains import law
from marsedl.papers.stochastic_entry.records import (
    END_TIME,
    OUTCOMES,
    REVERSALS,
    FlightChunk,
    FlightEnsemble,
    Gains,
    Linearization,
    Nominal,
    StreamedFlightChunk,
    StreamedFlightEnsemble,
)
from marsedl.replication.catalogue import Flown, Trial, stage

BANK_BINS = 72


@stage()
def simulate(
    inputs,
    nominal: Nominal,
    linearization: Linearization,
    gains: Gains,
    *,
    flown: Flown,
) -> FlightChunk:
    """Fly one chunk of a Monte Carlo case.

    case: law and trigger, such as "apollo_velocity". trials: of the whole case. chunk, chunks: number of this chunk and
    of all. block_size: trials in a block.
    """
    case, trials, block_size, chunk, chunks = flown
    first, last = ensembles.chunk_bounds(trials, chunks, block_size)[chunk]
    edges = np.linspace(-np.pi, np.pi, BANK_BINS + 1)
    reduced = ensembles.run_blocks(
        block_simulator(inputs, nominal, linearization, gains, case),
        first,
        last,
        block_size=block_size,
        histogram_edges=np.array([edges, edges]),
        kept=min(inputs.drawn_trials, trials),
        trials=trials,
        # Percentiles are those of errors; the end time varies about the nominal's, counts are best resolved at zero.
        centre=np.concatenate([nominal_final(nominal), [nominal.end_time, 0.0, 0.0]]),
    )
    kind = StreamedFlightChunk if isinstance(reduced, ensembles.StreamedChunk) else FlightChunk
    return kind(
        time=flight.outputs(*_end(inputs, nominal, case)),
        nominal_final=nominal_final(nominal),
        **{field.name: ensembles.without_infinities(getattr(reduced, field.name)) for field in fields(reduced)},
    )


def block_simulator(inputs, nominal, linearization, gains, case, **changes):
    """Return the function `simulate_block(first, last)` of a Monte Carlo case, which also replays single trials.

    changes: further arguments of `flight.vehicles`, and `varied`, False for the mean density.
    """
    air = environment.air(inputs)
    constants = flight.settings(inputs, air)
    flown_law = law(inputs, linearization, gains, case)
    if not changes.pop("varied", True):
        air = environment.undisturbed(air)
    end_time, _, trigger = _end(inputs, nominal, case)

    def simulate_block(first, last):
        return flight.fly(
            constants,
            air,
            flown_law,
            flight.vehicles(inputs, np.arange(first, last), **changes),
            trigger=trigger,
            end_time=end_time,
            substeps=inputs.flight_substeps,
            seed=inputs.seed,
            first_trial=first,
        )

    return simulate_block


def _end(inputs, nominal, case):
    """End time (s; of the velocity trigger: the time limit), guidance period and trigger of a Monte Carlo case."""
    trigger = case.split("_")[1]
    return nominal.end_time if trigger == "time" else inputs.time_limit, inputs.guidance_period, trigger


@stage()
def gather(inputs, chunks: list[FlightChunk]) -> FlightEnsemble:
    """Join the chunks of a case in the order of their trials."""
    large = isinstance(chunks[0], StreamedFlightChunk)
    kind = ensembles.StreamedChunk if large else ensembles.Chunk
    merged = ensembles.merge([kind(**{f.name: getattr(chunk, f.name) for f in fields(kind)}) for chunk in chunks])
    return (StreamedFlightEnsemble if large else FlightEnsemble)(
        time=chunks[0].time,
        nominal_final=chunks[0].nominal_final,
        **{field.name: getattr(merged, field.name) for field in fields(merged)},
    )


def nominal_final(nominal):
    """The nominal's altitude, velocity, path angle, downrange, density and crossrange at its end."""
    names = ("altitude", "velocity", "flight_path_angle", "downrange", "density", "crossrange")
    return np.array([getattr(nominal, name)[-1] for name in names])


def replay(
    inputs,
    nominal: Nominal,
    linearization: Linearization,
    gains: Gains,
    *,
    trial: Trial,
) -> str:
    """Fly one trial again and describe it, with its difference from the ensemble's if that is given."""
    case, number, ensemble = trial
    trial = ensembles.replay(block_simulator(inputs, nominal, linearization, gains, case), number)
    names = (
        "altitude (m)",
        "velocity (m/s)",
        "flight path angle (rad)",
        "downrange (m)",
        "density (kg/m^3)",
        "crossrange (m)",
    )
    lines = [f"trial {number} of {case}: {OUTCOMES[int(trial.outcome[0])]}"]
    start, end = trial.history[0, :, 0], trial.final_state[:, 0]
    lines += [f"  {name:26}{a:18.9f} -> {b:18.9f}" for name, a, b in zip(names, start[:6], end[:6], strict=True)]
    lines.append(f"  end time                  {end[END_TIME]:18.9f} s, {int(end[REVERSALS])} bank reversals")
    if ensemble is not None:
        same = np.array_equal(end, ensemble.final_state[number], equal_nan=True)
        lines.append(
            "  the same to the last bit as in the stored ensemble" if same else "  DIFFERS from the stored ensemble"
        )
    return "\n".join(lines)
