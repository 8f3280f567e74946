"""Final errors under every combination of choices that the paper leaves open (E8, E12, E14), by flights."""

from dataclasses import replace
from itertools import product

import numpy as np

from marsedl.montecarlo.statistics import percentile
from marsedl.papers.stochastic_entry import flight
from marsedl.papers.stochastic_entry.gains import ApolloChoices, apollo_law, law, stochastic_solution
from marsedl.papers.stochastic_entry.inputs import (
    Air,
    Design,
    Guidance,
    Mission,
    Planet,
    Simulation,
    Vehicle,
    refuse_partial_periods,
)
from marsedl.papers.stochastic_entry.montecarlo import end_of, nominal_final, simulator_of
from marsedl.papers.stochastic_entry.records import (
    FINAL_ERROR,
    LEVELS,
    TRIGGERS,
    Combinations,
    Gains,
    Linearization,
    Nominal,
)
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import stage

FORMS = ("five_state", "drag", "density_blind")
SIGNS = {"opposite": -1.0, "same": 1.0, "none": 0.0}  # of the drag error, where the lift error is positive


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    air: Air,
    vehicle: Vehicle,
    mission: Mission,
    guidance: Guidance,
    design: Design,
    simulation: Simulation,
    nominal: Nominal,
    linearization: Linearization,
    gains: Gains,
) -> Combinations:
    """Fly the same trials under every law and with every sign of the aerodynamic errors.

    Raises MarsedlError if an interval is no multiple of the guidance period, a partition has no feasible law, or a
    trial is not finite.
    """
    try:
        refuse_partial_periods("design.combined_intervals", design.combined_intervals, guidance.guidance_period)
    except ValueError as error:
        raise MarsedlError(str(error)) from None
    plant = flight.plant_of(planet, air, vehicle, mission, guidance)
    plants = [_with_signs(plant, sign) for sign in SIGNS.values()]
    reference = nominal_final(nominal)[:FINAL_ERROR]

    def tails(trial_gains, case, of_plant):
        """Percentiles of the final errors with their standard errors, (2, states, 2)."""
        end, control_law = end_of(mission, nominal, case), law(guidance, linearization, trial_gains, case)
        final = simulator_of(of_plant, control_law, end, simulation)(0, simulation.combined_trials).final_state
        error = final[: len(reference)] - reference[:, np.newaxis]
        if not np.isfinite(error).all():
            raise MarsedlError(f"{case.replace('_', ', ')}: a trial of the study of combinations is not finite")
        return np.array([[percentile(row, level) for level in LEVELS] for row in error]).transpose(2, 0, 1)

    def flights(name, trial_gains):
        """Those of a law with all signs and triggers, (signs, triggers, 2, states, 2)."""
        return np.array([[tails(trial_gains, f"{name}_{trigger}", of) for trigger in TRIGGERS] for of in plants])

    apollo = np.empty((len(FORMS), len(TRIGGERS), len(SIGNS), len(TRIGGERS), 2, *reference.shape, len(LEVELS)))
    for (i, form), (j, adjoint) in product(enumerate(FORMS), enumerate(TRIGGERS)):
        choices = ApolloChoices(form, adjoint, design.overcontrol)
        tables = [apollo_law(guidance, linearization, choices, k)["table_gain"] for k in range(len(TRIGGERS))]
        apollo[i, j] = flights("apollo", replace(gains, table_gain=np.array(tables)))
    stochastic = []
    for interval in design.combined_intervals:
        gains_by_period = [
            stochastic_solution(guidance, design, linearization, k, interval)[1] for k in range(len(TRIGGERS))
        ]
        stochastic.append(flights("stochastic", replace(gains, stochastic_gain=np.array(gains_by_period))))
    stochastic = np.array(stochastic)
    return Combinations(
        apollo_form=np.array(FORMS),
        apollo_time_adjoint=np.array(TRIGGERS),
        partition_interval=design.combined_intervals,
        aerodynamic_errors=np.array(list(SIGNS)),
        apollo=apollo[..., 0, :, :],
        apollo_error=apollo[..., 1, :, :],
        stochastic=stochastic[..., 0, :, :],
        stochastic_error=stochastic[..., 1, :, :],
        trials=simulation.combined_trials,
    )


def _with_signs(plant, sign):
    """The plant with its aerodynamic errors of opposite signs, of the same, or without them."""
    drag, lift = abs(plant.dispersions.drag_error), abs(plant.dispersions.lift_error)
    errors = (sign * drag, lift) if sign != 0.0 else (0.0, 0.0)
    return plant._replace(dispersions=plant.dispersions._replace(drag_error=errors[0], lift_error=errors[1]))
