"""How the iteration ends, and what mends it: many iterations with one and with both branches of the clean-up burn."""

import numpy as np

from marsedl.papers.random_field.flight_statistics import lost
from marsedl.papers.random_field.inputs import Air, Guidance, Mission, Planet, Simulation, Studies, Vehicle
from marsedl.papers.random_field.montecarlo import Flights
from marsedl.papers.random_field.partition import with_short_end_steps
from marsedl.papers.random_field.records import VARIANTS, Convergence, Nominal
from marsedl.papers.random_field.variants import design, ensemble, percentiles
from marsedl.replication.pipeline.catalogue import stage


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
) -> Convergence:
    """Run every variant for the study's number of iterations, and fly all of its laws."""
    rows = []
    for variant in VARIANTS:
        branch = "both" if variant == "both_branches" else "mean"
        changes = {"iterations": studies.convergence_iterations, "clean_up_branch": branch}
        times = {}
        if variant == "short_end_steps":
            nodes = with_short_end_steps(mission.partition, studies.end_step_parts, simulation.time_step)
            times["partition"] = tuple(nodes)
        steered, timed = guidance.model_copy(update=changes), mission.model_copy(update=times)
        flights = Flights(planet, air, vehicle, timed, simulation)
        laws = design(flights, steered, nominal)
        trials = ensemble(flights, nominal, laws, studies.study_trials)
        percentile, error = percentiles(trials)
        change = np.abs(np.diff(laws.control, axis=0)).max(axis=1)
        rows.append(
            {
                "variant": variant,
                "outcome": laws.outcome,
                "period": laws.period,
                "apoapsis": laws.apoapsis,
                "nominal_delta_v": laws.nominal_delta_v,
                "predicted": laws.percentile,
                "percentile": percentile,
                "percentile_error": error,
                "lost": lost(trials),
                "control_change": np.append(0.0, change),
            }
        )
    return Convergence(**{name: np.array([row[name] for row in rows]) for name in rows[0]})
