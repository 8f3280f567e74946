"""What the open loop would need to reach the printed percentile: other correlations and larger variances."""

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers.random_field import environment, montecarlo
from marsedl.papers.random_field.flight_statistics import percentile_with_lost
from marsedl.papers.random_field.inputs import Air, Mission, Planet, Simulation, Studies, Vehicle
from marsedl.papers.random_field.records import CAPTURED, LOW_ALTITUDE, FieldStudy, Gains, Nominal
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
def compute(
    planet: Planet,
    air: Air,
    vehicle: Vehicle,
    mission: Mission,
    simulation: Simulation,
    studies: Studies,
    nominal: Nominal,
    gains: Gains,
) -> FieldStudy:
    """Fly the open loop through every field."""
    flights = montecarlo.Flights(planet, air, vehicle, mission, simulation)

    def flown(covariance):
        simulate_block = montecarlo.block_simulator(flights, nominal, gains, number=0, covariance=covariance)
        return _open_loop(simulate_block, planet, mission, studies.study_trials)

    rows = []
    for changes in HYPOTHESES.values():
        covariance = _kernel(air, changes)
        low = float(np.sqrt(covariance(LOW_ALTITUDE, LOW_ALTITUDE)))
        rows.append((*flown(covariance), low))
    variances = studies.variance_factors * air.variance_at_top
    scaled = [flown(environment.kernel(air, variance=variance)) for variance in variances]
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
        trials=studies.study_trials,
    )


def _kernel(air: Air, changes):
    changes = dict(changes)
    if "growth_length" in changes:
        changes["growth_length"] *= air.variance_growth_length
    if "upper_altitude" in changes:
        changes["upper_altitude"] += air.variance_top_altitude
    return environment.kernel(air, **changes)


def _open_loop(simulate_block, planet: Planet, mission: Mission, trials):
    """99th percentile, its standard error and the lost trials of what `simulate_block` flies."""
    chunk = ensembles.run_blocks(simulate_block, 0, trials)
    delta_v = montecarlo.burns(planet, mission, chunk.final_state, chunk.outcome)[1]
    return *percentile_with_lost(delta_v), int((chunk.outcome != CAPTURED).sum())
