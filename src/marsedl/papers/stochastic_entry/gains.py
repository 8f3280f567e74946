"""Feedback gains of both laws for both triggers, and the covariance that the linear model predicts (Sec. III.B, C)."""

import numpy as np

from marsedl.methods.covariance_steering.chance import chance_factor
from marsedl.methods.covariance_steering.lqg_dual import (
    ChanceConstrainedProblem,
    InfeasibleProblem,
    lqg_gains_as_printed,
    noise_floor,
    solve,
)
from marsedl.methods.guidance.apollo import adjoint_gains, drag_form
from marsedl.methods.lincov import compose, propagate
from marsedl.methods.state_trigger import velocity_indexed_gain
from marsedl.papers.stochastic_entry import flight
from marsedl.papers.stochastic_entry.inputs import Design, Guidance
from marsedl.papers.stochastic_entry.linearization import system
from marsedl.papers.stochastic_entry.objective import final_weights, per_metre
from marsedl.papers.stochastic_entry.records import (
    ALTITUDE,
    DOWNRANGE,
    FLIGHT_PATH_ANGLE,
    STATES,
    TRIGGERS,
    Gains,
    Linearization,
)
from marsedl.replication.errors import InfeasibleError, SolverError
from marsedl.replication.pipeline.catalogue import stage

# Radius, velocity, path angle, downrange, density: sizes of their deviations, for well-scaled linear algebra.
STATE_SCALE = np.array([1000.0, 100.0, 0.01, 1000.0, 5e-3])


def partition_starts(guidance: Guidance, design: Design, intervals, interval=None):
    """Guidance periods with which the control intervals of the design begin."""
    every = round((design.partition_interval if interval is None else interval) / guidance.guidance_period)
    return np.arange(0, intervals, every)


def problem(
    guidance: Guidance, design: Design, linearization, trigger, interval=None, altitude_limit=None
) -> ChanceConstrainedProblem:
    """Problem 1 for a trigger (0: time, 1: velocity), on the reading's partition or one of another interval (s)."""
    cosine = linearization.bank_cosine[:-1]
    starts = partition_starts(guidance, design, len(cosine), interval)
    deviation = np.minimum(design.control_limit, np.minimum(1.0 - cosine, 1.0 + cosine))  # Eq. 73
    altitude_limit = design.altitude_limit if altitude_limit is None else altitude_limit
    sigmas = chance_factor(design.chance_level)
    return ChanceConstrainedProblem(
        system=compose(system(linearization), starts),
        initial_covariance=linearization.initial_covariance,
        objective=final_weights(design, linearization)[trigger],
        control_weight=np.full(len(starts), design.control_weight / per_metre(design) ** 2),
        final_directions=np.eye(STATES)[[ALTITUDE, FLIGHT_PATH_ANGLE]],
        final_limits=np.array([altitude_limit, design.flight_path_angle_limit]) / sigmas,
        control_limits=np.minimum.reduceat(deviation, starts) / sigmas,
        state_scale=STATE_SCALE,
    )


def solved(posed):
    """The solution of a problem; SolverError unless it is optimal, InfeasibleProblem if there is none."""
    solution = solve(posed)
    if solution.status != "optimal":
        raise SolverError(
            f"the dual of the stochastic law: {solution.status}; a limit may lie at the least that can be attained: "
            "loosen altitude_limit, flight_path_angle_limit or control_limit a little",
            {"control_multiplier": solution.control_multipliers, "control_ratio": solution.control_ratio},
        )
    return solution


def held_covariance(fine, starts, gain, initial_covariance):
    """Covariance in every guidance period with the control held over the design's intervals.

    fine: `LinearSystem` of the guidance periods, N. starts: (M,), periods in which the control is updated. gain:
    (M, n). Returns covariance (N + 1, n, n).
    """
    intervals, n, _ = fine.control.shape
    to_both = ((0, 0), (0, 1), (0, 1))  # the state and the control of the period before
    control = np.concatenate([fine.control, np.ones((intervals, 1, 1))], axis=1)
    both = fine._replace(
        transition=np.pad(fine.transition, to_both), control=control, noise=np.pad(fine.noise, to_both)
    )
    feedback = np.zeros((intervals, 1, n + 1))
    feedback[:, 0, n] = 1.0
    feedback[starts, 0] = np.pad(gain, ((0, 0), (0, 1)))
    return propagate(both, feedback, np.pad(initial_covariance, (0, 1))).covariance[:, :n, :n]


@stage()
def compute(guidance: Guidance, design: Design, linearization: Linearization) -> Gains:
    """Design both laws for both triggers.

    Raises InfeasibleError if a chance constraint cannot be met, saying which one and by how much.
    """
    stochastic = [_stochastic(guidance, design, linearization, trigger) for trigger in range(len(TRIGGERS))]
    apollo = [_apollo(guidance, design, linearization, trigger) for trigger in range(len(TRIGGERS))]
    rows, posed = _table_rows(linearization), problem(guidance, design, linearization, 0)
    velocity = linearization.state[rows, 1]
    return Gains(
        time=linearization.time,
        partition_start=partition_starts(guidance, design, len(linearization.control)),
        control_weight=design.control_weight / per_metre(design) ** 2,
        control_limit=posed.control_limits,
        table_velocity=velocity,
        table_reference=_references(velocity, _features(linearization)[rows], design.apollo_table_end),
        **{name: np.array([law[name] for law in stochastic]) for name in stochastic[0]},
        **{name: np.array([law[name] for law in apollo]) for name in apollo[0]},
    )


def _interval_of(starts, periods):
    """Number of the design's interval that each guidance period belongs to, (periods,)."""
    return np.searchsorted(starts, np.arange(periods), side="right") - 1


def _stochastic(guidance: Guidance, design: Design, linearization, trigger):
    """Gains of Problem 1 by its Lagrange dual, or by Eq. 55a as printed, which solves no problem."""
    posed, fine = problem(guidance, design, linearization, trigger), system(linearization)
    starts = partition_starts(guidance, design, len(fine.control))
    floor = noise_floor(fine, posed.objective)
    if design.gain_equation == "printed":
        return _as_printed(guidance, design, linearization, trigger, posed, floor)
    try:
        solution = solved(posed)
    except InfeasibleProblem as error:
        raise InfeasibleError(
            f"the stochastic law of the {TRIGGERS[trigger]} trigger: {error}; final limit 0 is altitude_limit, 1 is "
            "flight_path_angle_limit: raise the one that is named, or control_limit",
            {"control_limit": posed.control_limits},
        ) from None
    interval_of_period = _interval_of(starts, len(fine.control))
    return {
        "stochastic_gain": solution.gain[interval_of_period],
        "stochastic_covariance": held_covariance(fine, starts, solution.gain, linearization.initial_covariance),
        "stochastic_control_variance": solution.control_variance[interval_of_period],
        "control_ratio": solution.control_ratio,
        "final_ratio": solution.final_ratio,
        "control_multiplier": solution.control_multipliers,
        "final_multiplier": solution.final_multipliers,
        "cost": solution.cost,
        "gap": solution.gap,
        "gap_above_floor": solution.gap_above_floor,
        "complementarity": solution.complementarity,
        "noise_floor": floor,
        "iterations": solution.iterations,
        "status": solution.status,
    }


def _as_printed(guidance: Guidance, design: Design, linearization, trigger, posed, floor):
    """Eq. 55a as printed, in SI and with the paper's weights: nothing of it is finite."""
    weight = final_weights(design, linearization)[trigger] * per_metre(design)
    gain, _ = lqg_gains_as_printed(
        posed.system, np.outer(weight, weight), np.full(len(posed.control_weight), design.control_weight)
    )
    finite = np.isfinite(gain).all(axis=1)
    fine, limits = len(linearization.control), len(posed.control_limits)
    nothing = {
        "stochastic_covariance": (fine + 1, STATES, STATES),
        "stochastic_control_variance": (fine,),
        "control_ratio": (limits,),
        "final_ratio": (2,),
        "control_multiplier": (limits,),
        "final_multiplier": (2,),
        **dict.fromkeys(("cost", "gap", "gap_above_floor", "complementarity"), ()),
    }
    interval_of_period = _interval_of(partition_starts(guidance, design, fine), fine)
    return {
        "stochastic_gain": np.where(finite[:, np.newaxis], gain, np.nan)[interval_of_period],
        **{name: np.full(shape, np.nan) for name, shape in nothing.items()},
        "noise_floor": floor,
        "iterations": 0,
        "status": f"as printed: {finite.sum()} of {len(finite)} gains are finite",
    }


def _apollo(guidance: Guidance, design: Design, linearization, trigger):
    """Gains of the Apollo law (Eqs. 47-50) against time, as flown against velocity, and their covariances.

    Returns the fields of `Gains` that one trigger has, by name.
    """
    fine = system(linearization)
    aim = TRIGGERS.index(design.apollo_time_adjoint) if trigger == 0 else 1
    downrange = np.eye(STATES)[DOWNRANGE]
    final_adjoint = (downrange, linearization.trigger_projection.T @ downrange)[aim]  # Eq. 79
    adjoint = adjoint_gains(linearization.transition, linearization.control, final_adjoint, design.overcontrol)
    timed, equivalent, table = adjoint.gain, adjoint.gain, np.zeros((len(adjoint.gain), flight.FEATURES))
    if design.apollo_form == "density_blind":
        # The final adjoint without density: the trigger's projection has none of it in its downrange row.
        slaved = adjoint_gains(
            linearization.slaved_transition, linearization.slaved_control, final_adjoint[:4], design.overcontrol
        )
        equivalent = np.column_stack([slaved.gain, np.zeros(len(slaved.gain))])
        timed = equivalent
    if design.apollo_form == "drag":
        state = linearization.state[:-1]
        drag, cosine = linearization.drag[:-1], np.cos(state[:, 2])
        gains = drag_form(
            adjoint.gain, state[:, 4], drag, 1.0 / linearization.inverse_scale_height[:-1], state[:, 1], state[:, 2]
        )
        table[:, [DOWNRANGE, flight.DRAG, flight.ALTITUDE_RATE]] = gains
        # At the reference velocity, drag deviations are density deviations.
        zero = np.zeros(len(drag))
        equivalent = np.column_stack(
            [zero, zero, gains[:, 2] * state[:, 1] * cosine, gains[:, 0], gains[:, 1] * drag / state[:, 4]]
        )
    else:
        table[:, :STATES] = equivalent
    fed_back = _fed_back(guidance, linearization)[:-1]
    effective = velocity_indexed_gain(
        np.where(fed_back[:, np.newaxis], equivalent, 0.0),
        linearization.slope[:-1],
        1,
        linearization.bank_cosine_slope[:-1],
    )
    effective[linearization.control.any(axis=1) == 0] = 0.0
    effective_law = propagate(fine, effective[:, np.newaxis], linearization.initial_covariance)
    against_time = propagate(fine, timed[:, np.newaxis], linearization.initial_covariance)
    rows = _table_rows(linearization)
    # The table ends where the heading alignment begins; its last gain is the last with any control authority.
    last = np.flatnonzero(linearization.control.any(axis=1))[-1]
    return {
        "adjoint": adjoint.adjoint,
        "apollo_covariance": effective_law.covariance,
        "apollo_control_variance": effective_law.control_covariance[:, 0, 0],
        "timed_covariance": against_time.covariance,
        "timed_control_variance": against_time.control_covariance[:, 0, 0],
        "table_gain": table[np.minimum(rows, last)],
    }


def _features(linearization):
    """Reference values of what the laws feed back, (nodes, 7)."""
    state = linearization.state
    return np.column_stack([state, linearization.drag, state[:, 1] * np.sin(state[:, 2])])


def _references(velocity, reference, end):
    """References of the flown table; its first row, at the start of the heading alignment, has no gain of its own."""
    if end == "held":
        reference[0] = reference[1]
    if end == "extrapolated":
        beyond = (velocity[0] - velocity[1]) / (velocity[1] - velocity[2])
        reference[0] = reference[1] + beyond * (reference[1] - reference[2])
    return reference


def _fed_back(guidance: Guidance, linearization):
    """Nodes at which the Apollo law corrects: after the velocity's peak, with enough drag."""
    velocity = linearization.state[:, 1]
    after = np.arange(len(velocity)) >= np.argmax(velocity)
    return after & (linearization.drag >= guidance.apollo_least_drag)


def _table_rows(linearization):
    """Nodes of the flown Apollo table by ascending velocity: from the velocity's peak to the heading alignment."""
    peak = np.argmax(linearization.state[:, 1])
    last = np.flatnonzero(linearization.control.any(axis=1))[-1] + 1
    return np.arange(last, peak - 1, -1)


def law(guidance: Guidance, linearization, gains, case):
    """The law of a Monte Carlo case as the flight takes it."""
    name, trigger = case.split("_")
    number = TRIGGERS.index(trigger)
    if name == "apollo":
        return flight.Law(
            flight.BY_VELOCITY,
            gains.table_velocity,
            gains.table_gain[number],
            gains.table_reference,
            np.zeros(len(gains.table_velocity)),
            guidance.apollo_least_drag,
            guidance.apollo_end == "at_passage",
        )
    count = len(gains.stochastic_gain[number]) + 1
    gain = np.zeros((count, flight.FEATURES))
    gain[:-1, :STATES] = gains.stochastic_gain[number]
    # Where the nominal aligns its heading there is no gain: whoever is still in range control keeps the nominal cosine.
    return flight.Law(
        flight.BY_TIME,
        np.zeros(2),
        gain,
        _features(linearization),
        linearization.bank_cosine,
        0.0,
    )
