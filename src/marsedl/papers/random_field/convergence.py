"""How the iteration ends: many more iterations than the paper's, with its end steps and with these halved."""

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers.random_field import gains, montecarlo
from marsedl.papers.random_field.flight_statistics import delta_v_percentile, lost
from marsedl.papers.random_field.inputs import Air, Guidance, Mission, Planet, Simulation, Studies, Vehicle
from marsedl.papers.random_field.linearization import motion_of, of_guess
from marsedl.papers.random_field.partition import with_halved_end_steps
from marsedl.papers.random_field.records import VARIANTS, Convergence, Gains, Nominal
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import Flown, stage


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
    """Run both variants for the study's number of iterations, and fly all of their laws as often as the paper."""
    guidance, rows = guidance.model_copy(update={"iterations": studies.convergence_iterations}), []
    halved = tuple(with_halved_end_steps(mission.partition, simulation.time_step))
    for variant, nodes in zip(VARIANTS, (mission.partition, halved), strict=True):
        flights = montecarlo.Flights(planet, air, vehicle, mission.model_copy(update={"partition": nodes}), simulation)
        laws = _design(flights, guidance, nominal)
        flown = Flown("aerocapture", simulation.paper_trials, ensembles.BLOCK_SIZE)
        chunk = montecarlo.simulate(*flights, nominal, laws, flown=flown)
        trials = montecarlo.gather(planet, flights.mission, simulation, [chunk])
        percentile, error = zip(*(delta_v_percentile(trials, law) for law in range(len(trials.delta_v))), strict=True)
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


def _design(flights: montecarlo.Flights, guidance: Guidance, nominal: Nominal) -> Gains:
    """The design of a variant; raises MarsedlError if its partition gives none."""
    motion = motion_of(*flights)
    linear = of_guess(flights.mission, guidance, motion, nominal)
    if linear.refused:
        raise MarsedlError(f"there is no design to study: {linear.refused}")
    planet, air, vehicle, mission, simulation = flights
    return gains.along_motion(planet, air, vehicle, mission, guidance, simulation, motion, nominal, linear)
