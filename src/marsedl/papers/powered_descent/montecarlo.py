"""Monte Carlo flights of the nonlinear plant, closed and open loop, scattered in chunks and gathered."""

from dataclasses import dataclass, fields

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers import streamed
from marsedl.papers.powered_descent import flight, segments
from marsedl.papers.powered_descent.gains import Gains
from marsedl.replication.artifacts import quantity

STATE = "m, m, m/s, m/s, kg"
OBSERVED = "N, m"
THRUST_BINS, LARGEST_THRUST = 4000, 4.0  # bins up to this multiple of the maximum thrust
DEPTH_RANGE = (-2000.0, 2000.0)


@dataclass(frozen=True)
class Flights:
    """What chunks and ensembles have in common."""

    histogram: np.ndarray = quantity("1", ("time", 2, "bins"), "trials by thrust and depth over time", "int64")
    histogram_edges: np.ndarray = quantity(OBSERVED, (2, "edges"), "edges of the histogram's inner bins")
    maximum_over_trials: np.ndarray = quantity(OBSERVED, ("time", 2), "largest values over the trials", allow_nan=True)
    final_state: np.ndarray = quantity(STATE, ("trials", 5), "final state", allow_nan=True)
    observed_maximum: np.ndarray = quantity(OBSERVED, ("trials", 2), "largest thrust and depth", allow_nan=True)
    outcome: np.ndarray = quantity("1", ("trials",), "0 completed, 1 below the ground, 3 not finite", "int8")
    kept_history: np.ndarray = quantity(
        STATE, ("kept", "time", 5), "state over time of the kept trials", allow_nan=True
    )
    kept_observed: np.ndarray = quantity(OBSERVED, ("kept", "time", 2), "thrust and depth of them", allow_nan=True)


@dataclass(frozen=True)
class FlightChunk(Flights):
    """Reduced trials of one chunk, block by block."""

    first_trial: int = quantity("1", (), "number of the first trial")
    block_size: int = quantity("1", (), "trials in a block")
    block_counts: np.ndarray = quantity("1", ("blocks", "time"), "trials in the moments of each block", "int64")
    block_excluded: np.ndarray = quantity("1", ("blocks",), "non-finite trials of each block", "int64")
    block_mean: np.ndarray = quantity(STATE, ("blocks", "time", 5), "mean state of each block")
    block_second_moment: np.ndarray = quantity("SI", ("blocks", "time", 5, 5), "second moment about the block's mean")
    block_observed_mean: np.ndarray = quantity(OBSERVED, ("blocks", "time", 2), "mean thrust and depth of each block")


@dataclass(frozen=True)
class FlightEnsemble(Flights):
    """All trials of one Monte Carlo case."""

    time: np.ndarray = quantity("s", ("time",), "time from the start of the flight; the switch stands twice")
    segment: np.ndarray = quantity("1", ("time",), "number of the segment", "int64")
    count: int = quantity("1", (), "trials in the moments")
    flying: np.ndarray = quantity("1", ("time",), "trials in the moments over time: here all of them", "int64")
    excluded: int = quantity("1", (), "trials left out of the moments because they are not finite")
    mean: np.ndarray = quantity(STATE, ("time", 5), "mean state", allow_nan=True)
    covariance: np.ndarray = quantity("SI", ("time", 5, 5), "sample covariance", allow_nan=True)
    observed_mean: np.ndarray = quantity(OBSERVED, ("time", 2), "mean thrust and depth", allow_nan=True)


@dataclass(frozen=True)
class StreamedFlightChunk(FlightChunk, streamed.StreamedChunk):
    """Reduced trials of one chunk of a large case, of which only the first trials are kept one by one."""


@dataclass(frozen=True)
class StreamedFlightEnsemble(FlightEnsemble, streamed.StreamedEnsemble):
    """All trials of a large Monte Carlo case, of which only the first are kept one by one."""


def compute(inputs, gains: Gains, *, case: str, trials: int, block_size: int) -> FlightEnsemble:
    """Fly a whole Monte Carlo case; the arguments are those of `simulate`, and so is the result, gathered."""
    options = {"case": case, "trials": trials, "block_size": block_size}
    return gather(inputs, [simulate(inputs, gains, chunk=0, chunks=1, **options)])


def simulate(inputs, gains: Gains, *, case: str, trials: int, chunk: int, chunks: int, block_size: int) -> FlightChunk:
    """Fly one chunk of a Monte Carlo case.

    case: "closed_loop" or "open_loop", with the suffix "_large" for the large ensembles, which fly the same trials and
    more. trials: of the whole case. chunk, chunks: number of this chunk and of all. block_size: trials in a block.
    """
    first, last = ensembles.chunk_bounds(trials, chunks, block_size)[chunk]
    thrust_edges = np.linspace(0.0, LARGEST_THRUST * inputs.maximum_thrust, THRUST_BINS + 1)
    reduced = ensembles.run_blocks(
        block_simulator(inputs, gains, case),
        first,
        last,
        block_size=block_size,
        histogram_edges=np.array([thrust_edges, np.linspace(*DEPTH_RANGE, THRUST_BINS + 1)]),
        kept=min(inputs.drawn_trials, trials),
        trials=trials,
        centre=np.append(gains.mean[-1], _mass_without_feedback(inputs, gains)),
    )
    kind = StreamedFlightChunk if isinstance(reduced, ensembles.StreamedChunk) else FlightChunk
    return kind(**{field.name: ensembles.without_infinities(getattr(reduced, field.name)) for field in fields(reduced)})


def _mass_without_feedback(inputs, gains):
    """Final mass under the mean control alone, kg; trials end within a few kilograms of it."""
    thrust = np.linalg.norm(gains.feedforward, axis=1)
    return inputs.wet_mass - flight.plant_of(inputs).mass_flow_constant * np.trapezoid(thrust, gains.time)


def block_simulator(inputs, gains, case):
    """Return the function `simulate_block(first, last)` of a Monte Carlo case, which also replays single trials."""
    steps = [flight.step_count(d, inputs.time_step, inputs.output_interval) for d in inputs.segment_durations]
    schedules = flight.schedules_of(inputs, gains, [number for number, _ in steps])
    if case.startswith("open_loop"):
        schedules = [flight.open_loop(schedule) for schedule in schedules]
    plant = flight.plant_of(inputs)
    mean = segments.initial_mean(inputs)

    def simulate_block(first, last):
        states = flight.initial_states(
            mean, inputs.initial_covariance, inputs.wet_mass, inputs.seed, np.arange(first, last)
        )
        return flight.fly(
            schedules,
            plant,
            states,
            steps_per_output=[every for _, every in steps],
            seed=inputs.seed,
            first_trial=first,
            integrator=inputs.integrator,
        )

    return simulate_block


def gather(inputs, chunks: list[FlightChunk]) -> FlightEnsemble:
    """Join the chunks of a case in the order of their trials."""
    large = isinstance(chunks[0], StreamedFlightChunk)
    kind = ensembles.StreamedChunk if large else ensembles.Chunk
    merged = ensembles.merge([kind(**{f.name: getattr(chunk, f.name) for f in fields(kind)}) for chunk in chunks])
    outputs = [
        np.linspace(0.0, duration, flight.step_count(duration, np.inf, inputs.output_interval)[0] + 1)
        for duration in inputs.segment_durations
    ]
    time, segment = segments.joined_time(outputs)
    return (StreamedFlightEnsemble if large else FlightEnsemble)(
        time=time, segment=segment, **{field.name: getattr(merged, field.name) for field in fields(merged)}
    )


def replay(inputs, gains: Gains, *, case: str, number: int, ensemble: FlightEnsemble | None = None) -> str:
    """Fly one trial again and describe it, with its difference from the ensemble's if that is given."""
    trial = ensembles.replay(block_simulator(inputs, gains, case), number)
    names = ("downrange (m)", "altitude (m)", "downrange velocity (m/s)", "vertical velocity (m/s)", "mass (kg)")
    outcome = {0: "completed", 1: "below the ground", 3: "not finite"}[int(trial.outcome[0])]
    lines = [f"trial {number} of {case}: {outcome}"]
    start, end = trial.history[0, :, 0], trial.final_state[:, 0]
    lines += [f"  {name:26}{a:18.9f} -> {b:18.9f}" for name, a, b in zip(names, start, end, strict=True)]
    thrust = trial.observed_maximum[flight.THRUST, 0]
    lines.append(f"  largest control           {thrust:18.9f} N, {thrust / inputs.maximum_thrust:.6f} of the maximum")
    if ensemble is not None:
        same = np.array_equal(end, ensemble.final_state[number], equal_nan=True)
        lines.append(
            "  the same to the last bit as in the stored ensemble" if same else "  DIFFERS from the stored ensemble"
        )
    return "\n".join(lines)
