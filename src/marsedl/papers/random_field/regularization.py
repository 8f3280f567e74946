"""What the navigation errors of the design do: gains, predictions and flights against their size."""

import numpy as np

from marsedl.papers.random_field.flight_statistics import lost, step_violations
from marsedl.papers.random_field.inputs import Air, Guidance, Mission, Planet, Simulation, Studies, Vehicle
from marsedl.papers.random_field.linearization import UNITS
from marsedl.papers.random_field.montecarlo import Flights
from marsedl.papers.random_field.records import Nominal, Regularization
from marsedl.papers.random_field.variants import design, ensemble, percentiles
from marsedl.replication.catalogue import stage


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
) -> Regularization:
    """Design and fly every size; ill-conditioned designs are made here, to show what comes of them."""
    flights, rows = Flights(planet, air, vehicle, mission, simulation), []
    for factor in studies.navigation_factors:
        nominal_deviations = guidance.navigation_deviations
        deviations = factor * np.where(nominal_deviations > 0.0, nominal_deviations, 0.01 * UNITS)
        steered = guidance.model_copy(update={"navigation_deviations": deviations, "ill_conditioned": "report"})
        laws = design(flights, steered, nominal)
        trials = ensemble(flights, nominal, laws, studies.study_trials)
        percentile, error = (values[-1] for values in percentiles(trials))
        by_step, at_any = step_violations(trials, laws.partition)
        captured = trials.delta_v[-1][np.isfinite(trials.delta_v[-1])]
        rows.append(
            {
                "factor": factor,
                "position_error": deviations[0],
                "condition_number": laws.condition_number[-1],
                "largest_gain": laws.largest_gain[-1],
                "predicted_deviation": laws.delta_v_deviation[-1],
                "design_deviation": laws.design_delta_v_deviation[-1],
                "flown_deviation": captured.std(ddof=1) if len(captured) > 1 else np.nan,
                "percentile": percentile,
                "percentile_error": error,
                "saturated": at_any[-1],
                "worst_step": by_step[-1].max(),
                "lost": lost(trials)[-1],
            }
        )
    return Regularization(**{name: np.array([row[name] for row in rows]) for name in rows[0]})
