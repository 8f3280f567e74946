"""What the open loop would need to reach the printed percentile: other correlations and larger variances."""

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers.random_field import environment, montecarlo
from marsedl.papers.random_field.flight_statistics import percentile_with_lost
from marsedl.papers.random_field.records import LOW_ALTITUDE, FieldStudy, Gains, Nominal
from marsedl.replication.catalogue import stage

# Hypotheses on the field, as changes of the kernel's parameters: a field that is fully correlated over altitude, the
# higher instead of the lower altitude in Eq. 73, a variance that falls half as fast, one that begins to fall lower.
HYPOTHESES = {
    "as in the reading": {},
    "fully correlated": {"correlation_length": np.inf, "correlation_altitude": "both"},
    "higher altitude in Eq. 73": {"correlation_altitude": "upper"},
    "growth length doubled": {"growth_length": 2.0},
    "top altitude 20 km lower": {"upper_altitude": -20e3},
}


@stage(claimed_in=("corrected",))
def compute(inputs, nominal: Nominal, gains: Gains) -> FieldStudy:
    """Fly the open loop through every field."""
    rows = []
    for changes in HYPOTHESES.values():
        covariance = _kernel(inputs, changes)
        low = float(np.sqrt(covariance(LOW_ALTITUDE, LOW_ALTITUDE)))
        rows.append((*_open_loop(inputs, nominal, gains, covariance), low))
    variances = inputs.variance_factors * inputs.variance_at_top
    scaled = [
        _open_loop(inputs, nominal, gains, environment.kernel(inputs, variance=variance)) for variance in variances
    ]
    percentile, error, lost, deviation = (np.array(column) for column in zip(*rows, strict=True))
    scaled_percentile, scaled_error, scaled_lost = (np.array(column) for column in zip(*scaled, strict=True))
    return FieldStudy(
        hypothesis=np.array(list(HYPOTHESES)),
        percentile=percentile,
        percentile_error=error,
        lost=lost,
        deviation_at_45_km=deviation,
        variance=variances,
        variance_percentile=scaled_percentile,
        variance_percentile_error=scaled_error,
        variance_lost=scaled_lost,
        trials=inputs.study_trials,
    )


def _kernel(inputs, changes):
    changes = dict(changes)
    if "growth_length" in changes:
        changes["growth_length"] *= inputs.variance_growth_length
    if "upper_altitude" in changes:
        changes["upper_altitude"] += inputs.variance_top_altitude
    return environment.kernel(inputs, **changes)


def _open_loop(inputs, nominal, gains, covariance):
    """99th percentile, its standard error and the lost trials of the open loop in a field of another covariance."""
    simulate_block = montecarlo.block_simulator(inputs, nominal, gains, "aerocapture", 0, covariance=covariance)
    chunk = ensembles.run_blocks(simulate_block, 0, inputs.study_trials)
    delta_v = montecarlo.burns(inputs, chunk.final_state, chunk.outcome)[1]
    return *percentile_with_lost(delta_v), int((chunk.outcome != ensembles.COMPLETED).sum())
