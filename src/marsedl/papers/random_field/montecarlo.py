"""Monte Carlo flights of every law through the true spatial field, scattered in chunks and gathered (Sec. V.B.4)."""

from dataclasses import dataclass, fields, replace

import numpy as np

from marsedl.models import orbits
from marsedl.montecarlo import ensembles
from marsedl.montecarlo.statistics import percentile
from marsedl.montecarlo.streams import normals
from marsedl.papers.random_field import environment, flight
from marsedl.papers.random_field.gains import Gains, law
from marsedl.papers.random_field.nominal import Nominal, initial_state, mission, output_times
from marsedl.replication.artifacts import quantity

STATE = "m, m/s, rad, 1, Pa, 1"
CONTROL_BINS = 40
ESCAPED, NOT_EXITED = 2, 4  # outcomes that only the exit state decides
OUTCOMES = {
    0: "captured",
    1: "below the ground",
    2: "not captured: hyperbolic at the exit",
    3: "not finite",
    4: "still in the atmosphere at the final time",
}


@dataclass(frozen=True)
class Flights:
    """What chunks and ensembles have in common; the first law is the open loop, then follow the iterations'.

    State: altitude, velocity, flight path angle, density variation, dynamic pressure, commanded control. Observed:
    commanded control and how far it lies beyond its limits (negative inside). Final state: altitude,
    velocity, path angle, steps at the density's floor.
    """

    histogram: np.ndarray = quantity(
        "1",
        ("laws", "time", 2, "bins"),
        "trials by commanded control; the first and last bin: beyond the limits",
        "int64",
    )
    histogram_edges: np.ndarray = quantity("1", ("laws", 2, "edges"), "edges of the inner bins")
    maximum_over_trials: np.ndarray = quantity(
        "1", ("laws", "time", 2), "largest values over the trials", allow_nan=True
    )
    final_state: np.ndarray = quantity("m, m/s, rad, 1", ("laws", "trials", 4), "state at the end", allow_nan=True)
    observed_maximum: np.ndarray = quantity(
        "1", ("laws", "trials", 2), "largest commanded control and excess over the limits", allow_nan=True
    )
    outcome: np.ndarray = quantity(
        "1", ("laws", "trials"), "0 captured, 1 below the ground, 2 hyperbolic, 3 not finite, 4 not exited", "int8"
    )
    kept_history: np.ndarray = quantity(STATE, ("laws", "kept", "time", 6), "states of the kept trials", allow_nan=True)
    kept_observed: np.ndarray = quantity("1", ("laws", "kept", "time", 2), "observed of them", allow_nan=True)


@dataclass(frozen=True)
class FlightChunk(Flights):
    """Reduced trials of one chunk, block by block."""

    time: np.ndarray = quantity("s", ("time",), "time from the start")
    first_trial: np.ndarray = quantity("1", ("laws",), "number of the first trial", "int64")
    block_size: np.ndarray = quantity("1", ("laws",), "trials in a block", "int64")
    block_counts: np.ndarray = quantity("1", ("laws", "blocks", "time"), "trials in the moments of each block", "int64")
    block_excluded: np.ndarray = quantity("1", ("laws", "blocks"), "non-finite trials of each block", "int64")
    block_mean: np.ndarray = quantity(STATE, ("laws", "blocks", "time", 6), "mean state of each block")
    block_second_moment: np.ndarray = quantity("SI", ("laws", "blocks", "time", 6, 6), "second moment about that mean")
    block_observed_mean: np.ndarray = quantity("1", ("laws", "blocks", "time", 2), "mean of the observed quantities")


@dataclass(frozen=True)
class FlightEnsemble(Flights):
    """All trials of the aerocapture under all laws, every law with the same density variations."""

    time: np.ndarray = quantity("s", ("time",), "time from the start")
    flying: np.ndarray = quantity("1", ("laws", "time"), "trials still flying, over which moments are taken", "int64")
    count: np.ndarray = quantity("1", ("laws",), "trials in the moments", "int64")
    excluded: np.ndarray = quantity("1", ("laws",), "trials left out of them because they are not finite", "int64")
    mean: np.ndarray = quantity(STATE, ("laws", "time", 6), "mean state", allow_nan=True)
    covariance: np.ndarray = quantity("SI", ("laws", "time", 6, 6), "sample covariance", allow_nan=True)
    observed_mean: np.ndarray = quantity("1", ("laws", "time", 2), "mean of the observed quantities", allow_nan=True)
    apoapsis: np.ndarray = quantity("1", ("laws", "trials"), "exit apoapsis, planet radii; NaN if lost", allow_nan=True)
    delta_v: np.ndarray = quantity("m/s", ("laws", "trials"), "total delta-v; NaN if lost", allow_nan=True)


def compute(inputs, nominal: Nominal, gains: Gains, *, case: str, trials: int, block_size: int) -> FlightEnsemble:
    """Fly a whole Monte Carlo case; the arguments are those of `simulate`, and so is the result, gathered."""
    options = {"case": case, "trials": trials, "block_size": block_size}
    return gather(inputs, [simulate(inputs, nominal, gains, chunk=0, chunks=1, **options)])


def simulate(
    inputs, nominal: Nominal, gains: Gains, *, case: str, trials: int, chunk: int, chunks: int, block_size: int
) -> FlightChunk:
    """Fly one chunk of the trials under every law.

    case: "aerocapture". trials: of the whole case. chunk, chunks: number of this chunk and of all. block_size: trials
    in a block.
    """
    first, last = ensembles.chunk_bounds(trials, chunks, block_size)[chunk]
    lower, upper = inputs.control_limits
    edges = np.array([np.linspace(lower, upper, CONTROL_BINS + 1), np.linspace(lower - upper, 0.0, CONTROL_BINS + 1)])
    reduced = [
        ensembles.run_blocks(
            block_simulator(inputs, nominal, gains, case, number),
            first,
            last,
            block_size=block_size,
            histogram_edges=edges,
            kept=min(inputs.drawn_trials, trials),
        )
        for number in range(len(gains.control))
    ]
    return FlightChunk(
        time=output_times(inputs),
        **{
            field.name: ensembles.without_infinities(np.array([getattr(law, field.name) for law in reduced]))
            for field in fields(ensembles.Chunk)
        },
    )


def block_simulator(inputs, nominal, gains, case, number=-1, **changes):
    """Return the function `simulate_block(first, last)` under one law, which also replays single trials.

    number: 0 for the open loop, or an iteration, the last one unless given. changes: `covariance` of `environment.air`,
    `varied` of `flight.fly`.
    """
    air = environment.air(inputs, changes.pop("covariance", None))
    constants = flight.settings(inputs, air)
    flown_law = law(gains, number)
    mean = initial_state(inputs, nominal.entry_flight_path_angle)
    lower, upper = inputs.control_limits

    def simulate_block(first, last):
        drawn = normals(inputs.seed, flight.INITIAL_STREAM, np.arange(first, last), 3)
        flown = flight.fly(
            constants,
            air,
            flown_law,
            mean + drawn * np.array(inputs.initial_deviations),
            time_step=inputs.time_step,
            seed=inputs.seed,
            first_trial=first,
            every=round(inputs.output_interval / inputs.time_step),
            **changes,
        )
        completed = flown.outcome == ensembles.COMPLETED
        altitude, velocity, path_angle = flown.final_state[:3]
        bound = np.isfinite(
            orbits.apoapsis_radius(
                altitude + inputs.planet_radius, velocity, path_angle, inputs.gravitational_parameter
            )
        )
        flown.outcome[completed & ~bound] = ESCAPED
        flown.outcome[completed & (altitude < inputs.least_exit_altitude)] = NOT_EXITED
        command = flown.observed[:, 0]
        observed = np.stack([command, np.maximum(command - upper, lower - command)], axis=1)
        # Until a trial's end; what is stored behind is of no meaning.
        ended = np.arange(len(observed))[:, np.newaxis] >= flown.length
        largest = np.where(ended[:, np.newaxis], -np.inf, observed).max(axis=0)
        return replace(flown, observed=observed, observed_maximum=largest)

    return simulate_block


def gather(inputs, chunks: list[FlightChunk]) -> FlightEnsemble:
    """Join the chunks in the order of their trials, and compute apoapsis and delta-v of every trial."""
    laws = range(len(chunks[0].first_trial))
    merged = [
        ensembles.merge(
            [
                ensembles.Chunk(**{f.name: getattr(chunk, f.name)[number] for f in fields(ensembles.Chunk)})
                for chunk in chunks
            ]
        )
        for number in laws
    ]
    joined = {field.name: np.array([getattr(law, field.name) for law in merged]) for field in fields(merged[0])}
    apoapsis, delta_v = burns(inputs, joined["final_state"], joined["outcome"])
    return FlightEnsemble(time=chunks[0].time, apoapsis=apoapsis, delta_v=delta_v, **joined)


def burns(inputs, final_state, outcome):
    """Exit apoapsis (planet radii) and delta-v (m/s) of trials, NaN for those that are lost.

    final_state: (..., trials, 4). outcome: (..., trials).
    """
    captured = outcome == ensembles.COMPLETED
    exit_state = final_state[captured][:, :3] + np.array([inputs.planet_radius, 0.0, 0.0])
    apoapsis, delta_v = np.full(outcome.shape, np.nan), np.full(outcome.shape, np.nan)
    apoapsis[captured] = orbits.apoapsis_radius(*exit_state.T, inputs.gravitational_parameter) / inputs.planet_radius
    delta_v[captured] = orbits.total_delta_v(*exit_state.T, *mission(inputs))
    return apoapsis, delta_v


def lost(ensemble, trials=None):
    """Lost trials of every law, (laws,): all that are not captured."""
    return (ensemble.outcome[:, :trials] != ensembles.COMPLETED).sum(axis=1)


def percentile_with_lost(delta_v, level=0.99):
    """Percentile of delta-v and its standard error, m/s; a lost trial (NaN) counts as larger than any.

    NaN if so many are lost that the percentile lies among them.
    """
    captured = np.sort(delta_v[np.isfinite(delta_v)])
    if len(captured) < 2 or len(captured) < level * len(delta_v) + 1:
        return np.nan, np.nan
    # Lost trials lie above the percentile, so the largest value may stand for them.
    return percentile(np.concatenate([captured, np.full(len(delta_v) - len(captured), captured[-1])]), level)


def delta_v_percentile(ensemble, law, level=0.99, trials=None):
    """`percentile_with_lost` of a law's trials, of the first ones or of all."""
    return percentile_with_lost(ensemble.delta_v[law, :trials], level)


def step_violations(ensemble, partition):
    """Flights that command beyond the limits in each interval, (laws, intervals), and in any, (laws,)."""
    rows = np.searchsorted(ensemble.time, partition[:-1] + 1e-9 * partition[-1], side="right") - 1
    beyond = ensemble.histogram[:, rows, 0]  # of the commanded control
    return beyond[..., 0] + beyond[..., -1], (ensemble.observed_maximum[..., 1] > 0.0).sum(axis=1)


def replay(
    inputs,
    nominal: Nominal,
    gains: Gains,
    *,
    case: str,
    number: int,
    ensemble: FlightEnsemble | None = None,
) -> str:
    """Fly one trial again under every law and describe it, with its difference from the ensemble's if that is given."""
    lines = []
    for law_number in range(len(gains.control)):
        name = "open loop" if law_number == 0 else f"law of iteration {law_number}"
        trial = ensembles.replay(block_simulator(inputs, nominal, gains, case, law_number), number)
        end = trial.final_state[:, 0]
        lines.append(f"trial {number}, {name}: {OUTCOMES[int(trial.outcome[0])]}")
        parts = zip(("altitude (m)", "velocity (m/s)", "flight path angle (rad)"), end[:3], strict=True)
        lines += [f"  {part:26}{value:18.9f}" for part, value in parts]
        if trial.outcome[0] == ensembles.COMPLETED:
            exit_state = end[:3] + np.array([inputs.planet_radius, 0.0, 0.0])
            delta_v = float(orbits.total_delta_v(*exit_state, *mission(inputs)))
            lines.append(f"  {'delta-v (m/s)':26}{delta_v:18.9f}")
        if ensemble is not None:
            same = np.array_equal(end, ensemble.final_state[law_number, number], equal_nan=True)
            lines.append(
                "  the same to the last bit as in the stored ensemble" if same else "  DIFFERS from the stored ensemble"
            )
    return "\n".join(lines)
