"""Other gains that meet the paper's problem as well: what it leaves open, ranked by flown errors.

All candidates but the tuned ones make the final position insensitive to first order. What tells them apart is how far
from the nominal that holds.
"""

from typing import NamedTuple

import numpy as np

from marsedl.methods import sensitivity_gains
from marsedl.papers.desensitized import environment
from marsedl.papers.desensitized.entry_problem import gain_vector
from marsedl.papers.desensitized.gains import (
    STARTS_PER_TUNING,
    Tuning,
    flown_law,
    gain_problem,
    least_gains,
    random_starts,
    simulated_errors,
    tuned,
)
from marsedl.papers.desensitized.inputs import Design, Ensemble, Planet, Simulation, Vehicle
from marsedl.papers.desensitized.linearization import position_columns
from marsedl.papers.desensitized.records import ALL_COLUMNS, CHANNELS, LOST, Gains, GainStudy, Linearization
from marsedl.replication.catalogue import stage

SAME = 1e-3  # scaled gains nearer to each other than this are one candidate


class Candidate(NamedTuple):
    """Gains of a channel, how they were found, and from how many starts."""

    method: str
    scaled_gain: np.ndarray
    start_count: int = 1


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    design: Design,
    simulation: Simulation,
    ensemble: Ensemble,
    linearization: Linearization,
    gains: Gains,
) -> GainStudy:
    """Collect candidates for every channel, and rank them by the errors at which gains are tuned."""
    tuning = Tuning(planet, vehicle, design, simulation, ensemble)
    reference, _ = flown_law(gains, 0)
    rows, failed, sizes = [], [], design.tuning_errors
    air = environment.surroundings(planet, vehicle)
    for number in range(len(CHANNELS)):
        problem = gain_problem(planet, design, linearization, position_columns(planet)[:, [number]])
        simulate = simulated_errors(tuning, reference, number)
        candidates, lost = collected(tuning, linearization, problem, reference, number)
        failed.append(lost)
        ranking = sensitivity_gains.rank([c.scaled_gain for c in candidates], simulate)
        for place, index in enumerate(ranking.order):
            candidate = candidates[index]
            final_errors = environment.final_errors(
                planet,
                simulation,
                air,
                reference,
                gain_vector(planet, design, candidate.scaled_gain),
                environment.along_channel(number, sizes),
            )
            norm = float(ranking.norms[index]) / np.sqrt(len(sizes))
            rows.append(
                {
                    "channel": number,
                    "method": candidate.method,
                    "found": candidate.start_count,
                    "rank": place,
                    "scaled_gain": candidate.scaled_gain,
                    "linear_error": sensitivity_gains.final_errors(problem, candidate.scaled_gain[np.newaxis])[:, 0],
                    "flown_norm": norm if np.isfinite(norm) else LOST,
                    "flown_error": np.linalg.norm(final_errors, axis=1),
                }
            )
    return GainStudy(
        **{name: np.array([row[name] for row in rows]) for name in rows[0]},
        tuning_error=sizes,
        least_starts=np.full(3, starts_of(design)),
        least_failed=np.array(failed),
        **for_all(tuning, gains),
    )


def starts_of(design: Design):
    """Random starts of the least gains in each channel."""
    return STARTS_PER_TUNING * design.tuning_starts


def collected(tuning: Tuning, linearization, problem, reference, number):
    """Candidates of a channel, by its number, and how many random starts led to none."""
    design = tuning.design
    least = least_gains(tuning.planet, design, tuning.ensemble, linearization, CHANNELS[number])
    candidates = [Candidate("least gains", np.ravel(least.k))]
    lost = 0
    for start in random_starts(design, tuning.ensemble, CHANNELS[number])[: starts_of(design)]:
        gains = sensitivity_gains.minimum_norm(
            problem,
            start[np.newaxis],
            step_limit=design.gain_step_limit,
            tolerance=design.gain_tolerance,
            iterations=design.gain_iterations,
        )
        if not gains.converged:
            lost += 1
            continue
        keep(candidates, "least gains, another start", gains.k)
    weights = design.all_columns_regularization
    keep(candidates, "regularised least squares", sensitivity_gains.regularized(problem, weights)[-1].k)
    for result in tuned(tuning, reference, number, least.k):
        keep(candidates, "tuned to flown errors", result.k)
    return candidates, lost


def keep(candidates, method, scaled_gain):
    """Add a candidate to the list, or count it to the one that it equals."""
    gain = np.ravel(scaled_gain)
    for k, candidate in enumerate(candidates):
        if np.linalg.norm(candidate.scaled_gain - gain) < SAME * np.linalg.norm(gain):
            candidates[k] = candidate._replace(start_count=candidate.start_count + 1)
            return
    candidates.append(Candidate(method, gain))


def for_all(tuning: Tuning, gains: Gains):
    """One set of gains for all channels, as solved for and tuned to flown errors of the smallest size, by field."""
    planet, design = tuning.planet, tuning.design
    number = list(gains.law).index(ALL_COLUMNS)
    reference, _ = flown_law(gains, number)
    air = environment.surroundings(planet, tuning.vehicle)
    sizes = np.unique(np.abs(design.tuning_errors))
    every = np.sort(np.concatenate([-sizes, sizes]))

    def final_errors(scaled_gain, errors):
        """Final errors (3, errors, 3) of the errors of every channel, all in one call."""
        gain = gain_vector(planet, design, np.ravel(scaled_gain))
        positions = np.vstack([environment.along_channel(channel, errors) for channel in range(len(CHANNELS))])
        final = environment.final_errors(planet, tuning.simulation, air, reference, gain, positions)
        return final.reshape(len(CHANNELS), len(errors), len(CHANNELS))

    def residual(scaled_gain):
        return np.ravel(final_errors(scaled_gain, sizes[0] * np.array([-1.0, 1.0])) / sizes[0])

    start = gains.scaled_gain[number]
    both, ended = [start, start], False
    if np.isfinite(residual(start)).all():
        result = sensitivity_gains.tune(residual, start, iterations=design.gain_iterations)
        both, ended = [start, np.ravel(result.k)], bool(result.converged)
    return {
        "all_sizes": every,
        "all_scaled_gain": np.array(both),
        "all_flown_error": np.array([np.linalg.norm(final_errors(k, every), axis=2) for k in both]),
        "all_tuned": ended,
    }
