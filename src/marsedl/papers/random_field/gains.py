"""Iterative covariance steering of the aerocapture: the laws of all iterations and what they predict (Algorithm 1)."""

import numpy as np

from marsedl.methods.covariance_steering import block_program
from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.methods.covariance_steering.convexification import Run, Step, successive_convexification
from marsedl.methods.field_disturbance import condition_number, regularize
from marsedl.models import orbits
from marsedl.papers.random_field import environment, flight
from marsedl.papers.random_field.inputs import Guidance, Inputs, Vehicle
from marsedl.papers.random_field.linearization import UNITS, Motion, along, delta_v_gradient, motion_of
from marsedl.papers.random_field.nominal import (
    finite_or_nan,
    initial_root,
    initial_state,
    output_steps,
    output_times,
    states_of,
)
from marsedl.papers.random_field.records import BRANCHES, Gains, Linearization, Nominal
from marsedl.replication.errors import InfeasibleError, MarsedlError, SolverError
from marsedl.replication.pipeline.catalogue import stage
from marsedl.replication.records.fields import quantities

SPEED = {"km/s": 1e-3, "m/s": 1.0}  # factor from m/s to the unit in which delta-v enters the cost


@stage()
def compute(given: Inputs, nominal: Nominal, linearization: Linearization) -> Gains:
    """Run the iterations of the reading.

    Raises MarsedlError if the reading refuses ill-conditioned designs and this is one, if a program is infeasible, or
    if a nominal leaves the density table.
    """
    motion = motion_of(given)
    return along_motion(given, motion, nominal, linearization)


def along_motion(given: Inputs, motion: Motion, nominal: Nominal, linearization: Linearization) -> Gains:
    """Run the iterations for a motion that may be another than the reading's; raises as `compute`."""
    laws = [open_loop(given.guidance, given.vehicle, motion, nominal, linearization)]
    outcome, period = "refused", 0
    if not linearization.refused:
        start = initial_state(given.planet, given.vehicle, nominal.entry_flight_path_angle)
        plant = flight.plant_of(given)

        def fly(control):
            law = flight.open_loop(linearization.partition, control)
            times, states = flight.propagate_nominal(*plant, law, start, time_step=given.simulation.time_step / 2)
            environment.require_in_table(given.air, times, states[:, 0] - given.planet.planet_radius)
            return states

        run = iterate(given.guidance, given.vehicle, motion, fly, linearization.partition)
        laws, outcome, period = [*laws, *run.results], run.outcome, run.period
    time = output_times(given.mission, given.simulation)
    every = 2 * output_steps(given.mission, given.simulation)
    states = np.array([law["states"][::every] for law in laws])
    altitude = states[..., 0] - given.planet.planet_radius
    rows = {"laws": laws, "iterations": laws[1:]}
    columns = {
        name: np.array([row[name] for row in rows[declared.dims[0]]], dtype=declared.dtype)
        for name, declared in quantities(Gains).items()
        if name in laws[0]
    }
    return Gains(
        refused=linearization.refused,
        outcome=outcome,
        period=period,
        partition=linearization.partition,
        time=time,
        altitude=altitude,
        velocity=states[..., 1],
        flight_path_angle=states[..., 2],
        dynamic_pressure=0.5 * environment.mean_density(given.air, altitude) * states[..., 1] ** 2,
        variation_deviation=np.sqrt(motion.covariance(altitude, altitude)),
        **columns,
    )


def law(gains, number):
    """The law that flights fly: 0 for the open loop, or an iteration's."""
    return flight.Law(gains.partition, gains.control[number], gains.gain[number], gains.feedback_reference[number])


def open_loop(guidance: Guidance, vehicle: Vehicle, motion: Motion, nominal: Nominal, linearization: Linearization):
    """The open loop as a law: guessed control, no feedback, and its linear covariance; as `_design` returns laws."""
    intervals = len(linearization.partition) - 1
    guess = np.full(intervals, guidance.initial_control)
    system = _system(vehicle, linearization, guess, _stacked(linearization.disturbance_covariance))
    covariance, _ = block_program.closed_loop(system, np.zeros((intervals, intervals + 1, 1, 3)))
    covariance = covariance * np.outer(UNITS, UNITS)
    sign = _signs(guidance, motion, nominal.apoapsis * motion.planet_radius)
    gradient = delta_v_gradient(motion.targets, linearization.state[-1], sign[0] if len(sign) == 1 else 0)
    deviation = float(np.sqrt(gradient @ covariance[-1] @ gradient))
    states = states_of(motion.planet_radius, nominal)
    nothing = np.zeros(intervals)
    return {
        "control": guess,
        "gain": np.zeros((intervals, intervals + 1, 3)),
        "reference": linearization.state,
        "feedback_reference": linearization.state,
        "covariance": covariance,
        "design_covariance": covariance,
        "control_deviation": nothing,
        "design_control_deviation": nothing,
        "delta_v_mean": linearization.delta_v,
        "delta_v_deviation": deviation,
        "design_delta_v_deviation": deviation,
        "percentile": linearization.delta_v + upper_quantile(guidance.percentile_tail) * deviation,
        "largest_gain": 0.0,
        "states": states,
        "apoapsis": nominal.apoapsis,
        "nominal_delta_v": nominal.delta_v,
        "objective": np.nan,
        "quadratic_cost": np.nan,
        "condition_number": linearization.condition_number,
        "status": "",
        "accepted_by": "",
        "solver_attempt": 0,
        "solver_iterations": 0,
        "solver_gap": np.nan,
        "solver_residual": np.nan,
    }


def iterate(guidance: Guidance, vehicle: Vehicle, motion: Motion, fly, partition) -> Run:
    """Iterations of Algorithm 1 from the guess; the results are laws as `_design` returns them, flown.

    fly: function of the mean control (N,), that returns the states of its nominal at every half integration step.
    """
    guess = np.full(len(partition) - 1, guidance.initial_control)
    nodes = np.rint(2 * np.asarray(partition) / motion.time_step).astype(int)
    current = fly(guess)

    def step(control) -> Step:
        nonlocal current
        model = along(motion, partition, control, current)
        posed, system = program(guidance, vehicle, motion, model, control)
        try:
            solution = block_program.solve(posed, accept_ill_conditioned=guidance.ill_conditioned == "report")
        except block_program.IllConditionedError as error:
            raise MarsedlError(
                f"covariance steering program: {error}: set navigation_deviations above zero, or ill_conditioned to "
                "'report'"
            ) from None
        except block_program.InfeasibleProgram as error:
            raise InfeasibleError(f"covariance steering program: {error}", {"control": control}) from None
        except RuntimeError as error:
            raise SolverError(str(error), {"control": control}) from None
        except ValueError as error:
            raise MarsedlError(f"covariance steering program: {error}") from None
        current = fly(solution.control[:, 0])
        end = current[-1]
        apoapsis = float(orbits.apoapsis_radius(*end, motion.gravity))
        delta_v = float(orbits.total_delta_v(*end, *motion.targets))
        design = _design(guidance, motion, model, system, posed, solution)
        references = {
            "mean": design["reference"],
            "expansion_point": model.state,
            "propagated_mean": current[nodes],
        }
        result = {
            **design,
            "feedback_reference": references[guidance.feedback_reference],
            "states": current,
            "apoapsis": finite_or_nan(apoapsis / motion.planet_radius),
            "nominal_delta_v": finite_or_nan(delta_v),
        }
        monitored = np.array([np.nan_to_num(result["apoapsis"], nan=np.inf), result["percentile"]])
        return Step(solution.control[:, 0], monitored, result)

    return successive_convexification(
        step,
        guess,
        iterations=guidance.iterations,
        tolerances=guidance.convergence_tolerances,
        stop=False,
    )


def program(guidance: Guidance, vehicle: Vehicle, motion: Motion, model, control):
    """The program of Eq. 56 about a trajectory, in units of 1 km, 100 m/s and 0.01 rad and deviations from it.

    Returns the program and its system with the true disturbances, without navigation errors.
    """
    system = _system(vehicle, model, control, model.disturbance_covariance)
    intervals = len(control)
    noisy = system._replace(
        disturbance_covariance=regularize(
            system.disturbance_covariance, np.array(guidance.navigation_deviations) / UNITS
        )
    )
    pressure = model.pressure_gradient * UNITS
    speed = SPEED[guidance.percentile_unit]
    burns = _burns(guidance, motion, model)
    tail = (1.0 - guidance.control_probability) / 2.0
    lower, upper = vehicle.control_limits
    posed = block_program.SteeringProgram(
        system=noisy,
        state_weight=pressure[:, :, np.newaxis] * pressure[:, np.newaxis, :],
        control_weight=np.full((intervals, 1, 1), guidance.control_variance_weight),
        mean_control_weight=np.full((intervals, 1, 1), guidance.mean_control_weight),
        control_constraints=tuple(
            block_program.HalfPlane(k, np.array([sign]), bound, tail, f"control limit {sign * bound:+g}")
            for k in range(intervals)
            for sign, bound in ((1.0, upper), (-1.0, -lower))
        ),
        percentiles=tuple(
            block_program.Percentile(speed * gradient * UNITS, speed * value, guidance.percentile_tail)
            for value, gradient in burns
        ),
        percentile_weight=guidance.percentile_weight,
        control_reference=np.asarray(control, dtype=float)[:, np.newaxis],
        control_trust=guidance.control_trust / np.sqrt(guidance.control_trust_weight),
        state_trust=(
            block_program.TrustRegion(
                intervals,
                model.apoapsis_gradient * UNITS / motion.planet_radius,
                0.0,
                guidance.apoapsis_trust,
            ),
        ),
    )
    return posed, system


def _system(vehicle: Vehicle, model, control, disturbance_covariance):
    """The model in scaled deviations from its trajectory, where the control enters as it is."""
    intervals = len(control)
    scale = np.tile(UNITS, intervals)
    root = initial_root(vehicle) / UNITS[:, np.newaxis]
    return block_program.BlockSystem(
        transition=model.transition * UNITS / UNITS[:, np.newaxis],
        control=(model.control / UNITS)[:, :, np.newaxis],
        affine=-model.control / UNITS * np.asarray(control, dtype=float)[:, np.newaxis],
        initial_mean=np.zeros(3),
        initial_covariance=root @ root.T,
        disturbance_covariance=disturbance_covariance / np.outer(scale, scale),
    )


def _design(guidance: Guidance, motion: Motion, model, system, posed, solution):
    """The law in SI units, with what linear covariance predicts of it: one row of the fields of `Gains`, by name.

    Its nominal is missing: "apoapsis", "nominal_delta_v", and "states" at every half integration step, which are not
    stored.
    """
    state, control = block_program.closed_loop(system, solution.gain)
    both = np.outer(UNITS, UNITS)
    covariance, design_covariance = state * both, solution.covariance * both
    mean = solution.mean * UNITS
    # Where both branches are in the program, the prediction shown is that of the branch on which the mean lies.
    value, gradient = max(_burns(guidance, motion, model), key=lambda burn: burn[0] + burn[1] @ mean[-1])

    def along_gradient(matrix):
        return float(np.sqrt(gradient @ matrix @ gradient))

    return {
        "control": solution.control[:, 0],
        "gain": solution.gain[:, :, 0, :] / UNITS,
        "reference": model.state + mean,
        "covariance": covariance,
        "design_covariance": design_covariance,
        "control_deviation": np.sqrt(np.maximum(control[:, 0, 0], 0.0)),
        "design_control_deviation": np.sqrt(np.maximum(solution.control_covariance[:, 0, 0], 0.0)),
        "delta_v_mean": float(value + gradient @ mean[-1]),
        "delta_v_deviation": along_gradient(covariance[-1]),
        "design_delta_v_deviation": along_gradient(design_covariance[-1]),
        "percentile": solution.percentile / SPEED[guidance.percentile_unit],
        "largest_gain": solution.largest_gain,
        "objective": solution.objective,
        "quadratic_cost": solution.quadratic_cost,
        "condition_number": condition_number(posed.system.disturbance_covariance, np.ones(3)),
        "status": solution.status,
        "accepted_by": solution.accepted_by,
        "solver_attempt": solution.attempt,
        "solver_iterations": solution.iterations,
        "solver_gap": solution.duality_gap,
        "solver_residual": max(solution.primal_residual, solution.dual_residual),
    }


def _burns(guidance: Guidance, motion: Motion, model):
    """Delta-v and its gradient at the exit, one pair per branch of the clean-up burn in the program (Eqs. 75-76)."""
    pairs = []
    for sign in _signs(guidance, motion, model.apoapsis):
        value = orbits.total_delta_v(*model.state[-1], *motion.targets, branch=sign)
        pairs.append((float(value), delta_v_gradient(motion.targets, model.state[-1], sign)))
    return pairs


def _signs(guidance: Guidance, motion: Motion, apoapsis):
    """Signs of the clean-up burn in the program: that of the nominal, the reading's if that is zero, or both."""
    if guidance.clean_up_branch == "both":
        return 1, -1
    sign = orbits.branch_of(apoapsis, motion.targets[0], guidance.branch_tolerance)
    return (int(sign) if sign else BRANCHES[guidance.clean_up_branch],)


def _stacked(covariance):
    return covariance.reshape(covariance.shape[0] * 3, -1)
