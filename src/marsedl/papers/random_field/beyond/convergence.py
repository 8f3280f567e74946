"""How the iteration ends: many more iterations than the paper's, with its end steps and with these halved."""

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers.random_field import gains, montecarlo
from marsedl.papers.random_field.flight_statistics import delta_v_percentile, lost
from marsedl.papers.random_field.inputs import Inputs
from marsedl.papers.random_field.linearization import motion_of, of_guess
from marsedl.papers.random_field.partition import with_halved_end_steps
from marsedl.papers.random_field.records import VARIANTS, Convergence, Gains, Nominal
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import Flown, stage


@stage(claimed_in=("corrected",))
def compute(given: Inputs, nominal: Nominal) -> Convergence:
    """Run both variants for the study's number of iterations, and fly all of their laws as often as the paper."""
    longer = given.guidance.model_copy(update={"iterations": given.studies.convergence_iterations})
    rows = []
    halved = tuple(with_halved_end_steps(given.mission.partition, given.simulation.time_step))
    for variant, nodes in zip(VARIANTS, (given.mission.partition, halved), strict=True):
        on_nodes = given.mission.model_copy(update={"partition": nodes})
        varied = given.model_copy(update={"guidance": longer, "mission": on_nodes})
        laws = _design(varied, nominal)
        flown = Flown("aerocapture", given.simulation.paper_trials, ensembles.BLOCK_SIZE)
        trials = montecarlo.gather(varied, [montecarlo.simulate(varied, nominal, laws, flown=flown)])
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


def _design(given: Inputs, nominal: Nominal) -> Gains:
    """The design of a variant; raises MarsedlError if its partition gives none."""
    motion = motion_of(given)
    linear = of_guess(given.mission, given.guidance, motion, nominal)
    if linear.refused:
        raise MarsedlError(f"there is no design to study: {linear.refused}")
    return gains.along_motion(given, motion, nominal, linear)
