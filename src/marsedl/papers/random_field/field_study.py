"""What other random fields would give: the open loop in fields of other correlation, all laws in larger variances."""

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers.random_field import environment, montecarlo
from marsedl.papers.random_field.flight_statistics import percentile_with_lost
from marsedl.papers.random_field.inputs import Air, Guidance, Mission, Planet, Simulation, Studies, Vehicle
from marsedl.papers.random_field.nominal import output_times
from marsedl.papers.random_field.records import CAPTURED, LOW_ALTITUDE, SPEED_UNITS, FieldStudy, Gains, Nominal
from marsedl.papers.random_field.variants import design
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
    guidance: Guidance,
    simulation: Simulation,
    studies: Studies,
    nominal: Nominal,
    gains: Gains,
) -> FieldStudy:
    """Fly the open loop through every field, and in every variance the laws that are designed for it.

    A hypothesis that makes no covariance with the reading's other parameters has no flights: all count as lost.
    """
    flights = montecarlo.Flights(planet, air, vehicle, mission, simulation)
    trials = studies.study_trials

    def fly(laws, number, covariance):
        simulate_block = montecarlo.block_simulator(flights, nominal, laws, number=number, covariance=covariance)
        return _percentile_and_violations(simulate_block, vehicle.control_limits, flights, laws.partition, trials)

    hypotheses = []
    for changes in HYPOTHESES.values():
        covariance = _kernel(air, changes)
        low = float(np.sqrt(covariance(LOW_ALTITUDE, LOW_ALTITUDE)))
        numbers = np.nan, np.nan, trials
        if _is_covariance(air, covariance):
            *numbers, _ = fly(gains, 0, covariance)
        hypotheses.append((*numbers, low))
    percentile, error, lost, deviation = (np.array(column) for column in zip(*hypotheses, strict=True))
    variances = studies.variance_factors * air.variance_at_top
    rows = []
    for unit in SPEED_UNITS:
        for variance in variances:
            covariance = environment.kernel(air, variance=variance)
            laws = design(flights, guidance.model_copy(update={"percentile_unit": unit}), nominal, covariance)
            rows.append([fly(laws, number, covariance) for number in range(len(laws.control))])
    shape = len(SPEED_UNITS), len(variances), -1
    law_percentile, law_error, law_lost, worst = (np.array(part).reshape(shape) for part in np.moveaxis(rows, -1, 0))
    return FieldStudy(
        hypothesis=np.array(list(HYPOTHESES)),
        percentile=percentile,
        percentile_error=error,
        lost=lost,
        deviation_at_45_km=deviation,
        variance=variances,
        # Without control the unit of the cost is of no matter.
        variance_percentile=law_percentile[0, :, 0],
        variance_percentile_error=law_error[0, :, 0],
        variance_lost=law_lost[0, :, 0].astype(int),
        law_percentile=law_percentile,
        law_percentile_error=law_error,
        law_lost=law_lost.astype(int),
        law_worst_step=worst.astype(int),
        trials=trials,
    )


def _kernel(air: Air, changes):
    changes = dict(changes)
    if "growth_length" in changes:
        changes["growth_length"] *= air.variance_growth_length
    if "upper_altitude" in changes:
        changes["upper_altitude"] += air.variance_top_altitude
    return environment.kernel(air, **changes)


def _is_covariance(air: Air, covariance):
    """Whether there is such a field: the higher altitude's variance with a long correlation makes none."""
    try:
        environment.air_tables(air, covariance)
    except ValueError:
        return False
    return True


def _percentile_and_violations(simulate_block, limits, flights: montecarlo.Flights, partition, trials):
    """99th percentile, its standard error, lost trials, and trials beyond the limits at the worst step."""
    lower, upper = limits
    chunk = ensembles.run_blocks(
        simulate_block, 0, trials, histogram_edges=np.array([[lower, upper], [lower - upper, 0.0]])
    )
    planet, mission = flights.planet, flights.mission
    delta_v = montecarlo.burns(planet, mission, chunk.final_state, chunk.outcome)[1]
    rows = np.searchsorted(output_times(mission, flights.simulation), partition[:-1] - 1e-9)
    beyond = chunk.histogram[rows, 0, 0] + chunk.histogram[rows, 0, -1]
    return *percentile_with_lost(delta_v), int((chunk.outcome != CAPTURED).sum()), int(beyond.max())
