"""Monte Carlo flights of both laws to both triggers, scattered in chunks and gathered (Sec. V, Tables 3 and 4)."""

from dataclasses import dataclass, fields

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers import streamed
from marsedl.papers.stochastic_entry import environment, flight
from marsedl.papers.stochastic_entry.gains import Gains, law
from marsedl.papers.stochastic_entry.linearization import Linearization
from marsedl.papers.stochastic_entry.nominal import Nominal
from marsedl.replication.artifacts import quantity

STATE = "m, m/s, rad, m, kg/m^3, m, 1"
OBSERVED = "rad"
FINAL = "m, m/s, rad, m, kg/m^3, m, s, 1, 1"
STATES, FINALS = flight.HISTORY, flight.FINAL
BANK_BINS = 72
OUTCOMES = {0: "completed", 1: "below the ground", 2: "trigger not reached within the time limit", 3: "not finite"}


@dataclass(frozen=True)
class Flights:
    """What chunks and ensembles have in common.

    State: altitude, velocity, flight path angle, downrange, density, crossrange, commanded bank cosine. Final state:
    the first six of them, then end time, bank reversals, tabulated densities that were set to zero.
    """

    histogram: np.ndarray = quantity("1", ("time", 2, "bins"), "trials by bank angle and its change", "int64")
    histogram_edges: np.ndarray = quantity(OBSERVED, (2, "edges"), "edges of the histogram's inner bins")
    maximum_over_trials: np.ndarray = quantity(OBSERVED, ("time", 2), "largest values over the trials", allow_nan=True)
    final_state: np.ndarray = quantity(FINAL, ("trials", FINALS), "state at the end of the flight", allow_nan=True)
    observed_maximum: np.ndarray = quantity(
        OBSERVED, ("trials", 2), "largest bank angle and largest change of it in a guidance period", allow_nan=True
    )
    outcome: np.ndarray = quantity(
        "1", ("trials",), "0 completed, 1 below the ground, 2 trigger not reached, 3 not finite", "int8"
    )
    kept_history: np.ndarray = quantity(STATE, ("kept", "time", STATES), "state of the kept trials", allow_nan=True)
    kept_observed: np.ndarray = quantity(OBSERVED, ("kept", "time", 2), "bank angle and its change", allow_nan=True)


@dataclass(frozen=True)
class FlightChunk(Flights):
    """Reduced trials of one chunk, block by block."""

    time: np.ndarray = quantity("s", ("time",), "time from entry interface")
    nominal_final: np.ndarray = quantity("m, m/s, rad, m, kg/m^3, m", (6,), "end of the nominal flight")
    first_trial: int = quantity("1", (), "number of the first trial")
    block_size: int = quantity("1", (), "trials in a block")
    block_counts: np.ndarray = quantity("1", ("blocks", "time"), "trials in the moments of each block", "int64")
    block_excluded: np.ndarray = quantity("1", ("blocks",), "non-finite trials of each block", "int64")
    block_mean: np.ndarray = quantity(STATE, ("blocks", "time", STATES), "mean state of each block")
    block_second_moment: np.ndarray = quantity(
        "SI", ("blocks", "time", STATES, STATES), "second moment about the block's mean"
    )
    block_observed_mean: np.ndarray = quantity(OBSERVED, ("blocks", "time", 2), "mean of the observed quantities")


@dataclass(frozen=True)
class FlightEnsemble(Flights):
    """All trials of one Monte Carlo case."""

    time: np.ndarray = quantity("s", ("time",), "time from entry interface")
    flying: np.ndarray = quantity("1", ("time",), "trials still flying, over which the moments are taken", "int64")
    nominal_final: np.ndarray = quantity("m, m/s, rad, m, kg/m^3, m", (6,), "end of the nominal flight")
    count: int = quantity("1", (), "trials in the moments")
    excluded: int = quantity("1", (), "trials left out of the moments because they are not finite")
    mean: np.ndarray = quantity(STATE, ("time", STATES), "mean state", allow_nan=True)
    covariance: np.ndarray = quantity("SI", ("time", STATES, STATES), "sample covariance", allow_nan=True)
    observed_mean: np.ndarray = quantity(OBSERVED, ("time", 2), "mean of the observed quantities", allow_nan=True)


@dataclass(frozen=True)
class StreamedFlightChunk(FlightChunk, streamed.StreamedChunk):
    """Reduced trials of one chunk of a large case, of which only the first trials are kept one by one."""


@dataclass(frozen=True)
class StreamedFlightEnsemble(FlightEnsemble, streamed.StreamedEnsemble):
    """All trials of a large Monte Carlo case, of which only the first are kept one by one."""


def compute(
    inputs, nominal: Nominal, linearization: Linearization, gains: Gains, *, case: str, trials: int, block_size: int
) -> FlightEnsemble:
    """Fly a whole Monte Carlo case; the arguments are those of `simulate`, and so is the result, gathered."""
    options = {"case": case, "trials": trials, "block_size": block_size}
    return gather(inputs, [simulate(inputs, nominal, linearization, gains, chunk=0, chunks=1, **options)])


def simulate(
    inputs,
    nominal: Nominal,
    linearization: Linearization,
    gains: Gains,
    *,
    case: str,
    trials: int,
    chunk: int,
    chunks: int,
    block_size: int,
) -> FlightChunk:
    """Fly one chunk of a Monte Carlo case.

    case: law and trigger, such as "apollo_velocity". trials: of the whole case. chunk, chunks: number of this chunk and
    of all. block_size: trials in a block.
    """
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

    changes: further arguments of `flight.vehicles`, and `varied` of `flight.fly`.
    """
    air = environment.air(inputs)
    constants = flight.settings(inputs, air)
    flown_law = law(inputs, linearization, gains, case)
    varied = changes.pop("varied", True)
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
            varied=varied,
        )

    return simulate_block


def _end(inputs, nominal, case):
    """End time (s; of the velocity trigger: the time limit), guidance period and trigger of a Monte Carlo case."""
    trigger = case.split("_")[1]
    return nominal.end_time if trigger == "time" else inputs.time_limit, inputs.guidance_period, trigger


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


def errors(ensemble, trials=None):
    """Final errors of altitude, velocity, path angle, downrange (positive: long) and density, (trials, 5).

    Of a streamed ensemble they are those of its first trials.
    """
    return ensemble.final_state[:trials, :5] - ensemble.nominal_final[:5]


def replay(
    inputs,
    nominal: Nominal,
    linearization: Linearization,
    gains: Gains,
    *,
    case: str,
    number: int,
    ensemble: FlightEnsemble | None = None,
) -> str:
    """Fly one trial again and describe it, with its difference from the ensemble's if that is given."""
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
    lines.append(
        f"  end time                  {end[flight.END_TIME]:18.9f} s, {int(end[flight.REVERSALS])} bank reversals"
    )
    if ensemble is not None:
        same = np.array_equal(end, ensemble.final_state[number], equal_nan=True)
        lines.append(
            "  the same to the last bit as in the stored ensemble" if same else "  DIFFERS from the stored ensemble"
        )
    return "\n".join(lines)
