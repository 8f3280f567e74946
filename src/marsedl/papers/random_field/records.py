"""Artifact types of the random field, and the names and codes in which they are to be read."""

import numpy as np

from marsedl.montecarlo.outcomes import COMPLETED, CRASHED, ESCAPED, NON_FINITE
from marsedl.papers.ensembles import Ensemble, along
from marsedl.replication.records.fields import Axis, quantity, record

OPEN, CLOSED = 0, 1  # laws of the double integrator
BRANCHES = {"undershoot": 1, "mean": 0, "overshoot": -1}  # signs of the clean-up burn
# One linearised branch, as in the paper; both branches in the program; one branch and short end steps.
VARIANTS = ("as_designed", "short_end_steps")
MOTION = Axis("motion", radius="m", velocity="m/s", flight_path_angle="rad")
STATE = Axis(
    "state",
    altitude="m",
    velocity="m/s",
    flight_path_angle="rad",
    density_variation="1",
    dynamic_pressure="Pa",
    bank_cosine="1",
)
FINAL = Axis("final", altitude="m", velocity="m/s", flight_path_angle="rad", floored_steps="1")
OBSERVED = Axis("observed", control="1", excess="1")
BRANCH = Axis("branch", *BRANCHES)
POINT = Axis("motion", position="1", velocity="1")  # of the double integrator
POINT_STATE = Axis("state", **POINT.units, force="1", control="1")
LINE = Axis("line", "first", "second")  # that bound its states
LOW_ALTITUDE = 45e3  # m, where nominal flights are lowest
CAPTURED, NOT_EXITED = COMPLETED, 4  # beside the library's codes
OUTCOMES = {
    CAPTURED: "captured",
    CRASHED: "below the ground",
    ESCAPED: "not captured: hyperbolic at the exit",
    NON_FINITE: "not finite",
    NOT_EXITED: "still in the atmosphere at the final time",
}


@record
class Nominal:
    """The flight with zero control, at every half integration step."""

    entry_flight_path_angle: float = quantity("rad", (), "flight path angle at the start")
    time: np.ndarray = quantity("s", ("time",), "time from the start", label="time from entry")
    altitude: np.ndarray = quantity("m", ("time",), "altitude")
    velocity: np.ndarray = quantity("m/s", ("time",), "velocity")
    flight_path_angle: np.ndarray = quantity("rad", ("time",), "flight path angle")
    density: np.ndarray = quantity("kg/m^3", ("time",), "mean density", label="density")
    dynamic_pressure: np.ndarray = quantity("Pa", ("time",), "dynamic pressure")
    variation_deviation: np.ndarray = quantity(
        "1", ("time",), "standard deviation of the density variation met", label="density variation"
    )
    time_of_largest_dynamic_pressure: float = quantity("s", (), "of a parabola through the largest values")
    largest_dynamic_pressure: float = quantity("Pa", (), "the parabola's largest value")
    lowest_altitude: float = quantity("m", (), "lowest altitude")
    apoapsis: float = quantity("1", (), "apoapsis after the exit, planet radii", allow_nan=True)
    delta_v: float = quantity("m/s", (), "total delta-v of the two burns", allow_nan=True)


@record
class Linearization:
    """The model along the initial guess."""

    refused: str = quantity("1", (), "why no design can be made on the reading's partition; empty if one can", "str")
    partition: np.ndarray = quantity("s", ("nodes",), "times at which the control changes; both ends if refused")
    state: np.ndarray = quantity(
        MOTION.unit, ("nodes", MOTION), "nominal radius, velocity, flight path angle at these times"
    )
    transition: np.ndarray = quantity("SI", ("intervals", MOTION, MOTION), "A_k")
    control: np.ndarray = quantity("SI", ("intervals", MOTION), "B_k")
    disturbance_covariance: np.ndarray = quantity(
        "SI", ("intervals", MOTION, "intervals", MOTION), "Cov(w_k, w_l) (Eq. 26)"
    )
    condition_number: float = quantity(
        "1", (), "of Cov(W) in units of 1 km, 100 m/s, 0.01 rad; NaN if it is singular", allow_nan=True
    )
    pressure_gradient: np.ndarray = quantity(
        "1/m, s/m, 1", ("intervals", MOTION), "relative change of dynamic pressure"
    )
    apoapsis_gradient: np.ndarray = quantity("1, s, m", (MOTION,), "derivative of the exit apoapsis")
    delta_v: float = quantity("m/s", (), "total delta-v of the nominal", allow_nan=True)
    delta_v_gradient: np.ndarray = quantity(
        "1/s, 1, m/s",
        (BRANCH, MOTION),
        "derivatives of delta-v: undershoot, mean of both sides, overshoot",
        allow_nan=True,
    )


@record
class Gains:
    """The open loop (law 0) and the law of every iteration.

    "Predicted" is what linear covariance says along the trajectory about which the law's program was linearised. The
    design adds navigation errors to the disturbances; predictions leave them out unless they are called the design's.
    """

    refused: str = quantity("1", (), "why there is no law but the open loop; empty if there is", "str")
    outcome: str = quantity("1", (), "converged, cycling, stopped, or refused", "str")
    period: int = quantity("1", (), "iterations of a cycle; 1 if converged, 0 otherwise")
    partition: np.ndarray = quantity("s", ("nodes",), "times at which the control changes", label="time from entry")
    control: np.ndarray = quantity("1", ("laws", "intervals"), "mean control")
    gain: np.ndarray = quantity(
        "1/m, s/m, 1", ("laws", "intervals", "nodes", MOTION), "feedback gains on the state history"
    )
    reference: np.ndarray = quantity(MOTION.unit, ("laws", "nodes", MOTION), "predicted mean state")
    feedback_reference: np.ndarray = quantity(
        MOTION.unit, ("laws", "nodes", MOTION), "states from which the feedback takes deviations"
    )
    covariance: np.ndarray = quantity("SI", ("laws", "nodes", MOTION, MOTION), "predicted state covariance")
    design_covariance: np.ndarray = quantity("SI", ("laws", "nodes", MOTION, MOTION), "the same with navigation errors")
    control_deviation: np.ndarray = quantity("1", ("laws", "intervals"), "predicted standard deviation of the control")
    design_control_deviation: np.ndarray = quantity("1", ("laws", "intervals"), "the same with navigation errors")
    delta_v_mean: np.ndarray = quantity("m/s", ("laws",), "predicted mean of delta-v", allow_nan=True)
    delta_v_deviation: np.ndarray = quantity("m/s", ("laws",), "predicted standard deviation", allow_nan=True)
    design_delta_v_deviation: np.ndarray = quantity("m/s", ("laws",), "with navigation errors", allow_nan=True)
    percentile: np.ndarray = quantity(
        "m/s", ("laws",), "design's percentile of delta-v at the reading's tail", allow_nan=True
    )
    time: np.ndarray = quantity("s", ("time",), "times of the nominal trajectories", label="time from entry")
    altitude: np.ndarray = quantity("m", ("laws", "time"), "altitude of the law's nominal, flown in the mean density")
    velocity: np.ndarray = quantity("m/s", ("laws", "time"), "its velocity")
    flight_path_angle: np.ndarray = quantity("rad", ("laws", "time"), "its flight path angle")
    dynamic_pressure: np.ndarray = quantity("Pa", ("laws", "time"), "its dynamic pressure")
    variation_deviation: np.ndarray = quantity("1", ("laws", "time"), "standard deviation of the variation along it")
    apoapsis: np.ndarray = quantity(
        "1", ("laws",), "its exit apoapsis, planet radii", allow_nan=True, label="apoapsis of the nominal"
    )
    nominal_delta_v: np.ndarray = quantity("m/s", ("laws",), "its delta-v", allow_nan=True)
    largest_gain: np.ndarray = quantity("1", ("laws",), "largest gain in units of 1 km, 100 m/s, 0.01 rad")
    objective: np.ndarray = quantity("1", ("iterations",), "least cost of the program")
    quadratic_cost: np.ndarray = quantity("1", ("iterations",), "its part J1")
    condition_number: np.ndarray = quantity("1", ("iterations",), "of the design's Cov(W), same units")
    status: np.ndarray = quantity("1", ("iterations",), "of the solver", "str")
    accepted_by: np.ndarray = quantity("1", ("iterations",), "why it counts: status, or accuracy reached", "str")
    solver_attempt: np.ndarray = quantity("1", ("iterations",), "which of its settings gave the law", "int64")
    solver_iterations: np.ndarray = quantity("1", ("iterations",), "of the solver", "int64")
    solver_gap: np.ndarray = quantity("1", ("iterations",), "duality gap reached, of the scaled program")
    solver_residual: np.ndarray = quantity("1", ("iterations",), "larger of its residuals, primal and dual")


@record
class Certificates:
    """How well everything agrees; a relative difference is one of the larger of two values."""

    objective: float = quantity("1", (), "least cost of the first program, innovations form, Clarabel")
    history_objective: float = quantity("1", (), "of the printed form in the history of states, Clarabel")
    history_gain_difference: float = quantity("1", (), "largest difference of a gain, units of 1 km, 100 m/s, 0.01 rad")
    other_objective: float = quantity("1", (), "of the innovations form by the other solver")
    other_solver: str = quantity("1", (), "its name", "str")
    identity_residual: float = quantity("1", (), "largest entry of (I + B L)(I - B K) - I")
    triangular_residual: float = quantity("1", (), "largest entry of K and L above their block diagonals")
    control_covariance_residual: float = quantity("1", (), "of Cov(U): from the gains against from the innovations")
    mean_shift: float = quantity("1", (), "change of the deviations' covariance when the mean control changes")
    gain_shift: float = quantity("1", (), "change of the mean when the gains change")
    convexity: float = quantity("1", (), "least excess of a chord over the cost, relative, along random segments")
    process_mean_score: float = quantity("1", (), "largest deviation of a sampled mean along the nominal, in errors")
    disturbance_mean_score: float = quantity("1", (), "likewise of the disturbances' mean (Eq. 25)")
    process_score: float = quantity(
        "1", (), "largest deviation of a sampled covariance along the nominal, in errors", allow_nan=True
    )
    disturbance_score: float = quantity("1", (), "likewise of the disturbances' covariance (Eq. 26)", allow_nan=True)
    normality_score: float = quantity(
        "1", (), "likewise of skewness and excess kurtosis of the disturbances", allow_nan=True
    )
    samples: int = quantity("1", (), "fields sampled")
    largest_correlation: float = quantity("1", (), "largest correlation between disturbances of different intervals")
    deviation_ratio: float = quantity("1", (), "largest over smallest standard deviation of a disturbance's component")
    history_information: float = quantity(
        "1", (), "largest share of a state's conditional variance, given the last state, that earlier states explain"
    )


@record
class Convergence:
    """Iteration histories of the variants; law 0 is the open loop."""

    variant: np.ndarray = quantity("1", ("variant",), "name of the variant", "str")
    outcome: np.ndarray = quantity("1", ("variant",), "converged, cycling or stopped", "str")
    period: np.ndarray = quantity("1", ("variant",), "of the cycle; 1 if converged, 0 if stopped", "int64")
    apoapsis: np.ndarray = quantity(
        "1",
        ("variant", "laws"),
        "nominal exit apoapsis, planet radii",
        allow_nan=True,
        label="apoapsis of the nominal",
    )
    nominal_delta_v: np.ndarray = quantity("m/s", ("variant", "laws"), "nominal delta-v", allow_nan=True)
    predicted: np.ndarray = quantity("m/s", ("variant", "laws"), "percentile that the program predicts", allow_nan=True)
    percentile: np.ndarray = quantity("m/s", ("variant", "laws"), "99th percentile over flights", allow_nan=True)
    percentile_error: np.ndarray = quantity("m/s", ("variant", "laws"), "its standard error", allow_nan=True)
    lost: np.ndarray = quantity("1", ("variant", "laws"), "lost trials", "int64")
    control_change: np.ndarray = quantity("1", ("variant", "laws"), "largest change of the mean control")


@record
class DoubleIntegrator:
    """The open loop (law 0) and the law of the single iteration (law 1)."""

    partition: np.ndarray = quantity("1", ("nodes",), "times at which the control changes")
    transition: np.ndarray = quantity("1", ("intervals", POINT, POINT), "A_k")
    input: np.ndarray = quantity("1", ("intervals", POINT), "B_k")
    disturbance_covariance: np.ndarray = quantity(
        "1", ("intervals", POINT, "intervals", POINT), "Cov(w_k, w_l) (Eq. 26)"
    )
    control: np.ndarray = quantity("1", ("laws", "intervals"), "mean control")
    gain: np.ndarray = quantity("1", ("laws", "intervals", "nodes", POINT), "feedback gains on the state history")
    mean: np.ndarray = quantity("1", ("laws", "nodes", POINT), "predicted mean position and velocity")
    covariance: np.ndarray = quantity("1", ("laws", "nodes", POINT, POINT), "predicted covariance")
    control_deviation: np.ndarray = quantity("1", ("laws", "intervals"), "predicted standard deviation of the control")
    objective: float = quantity("1", (), "least cost of the program")
    unconstrained_objective: float = quantity("1", (), "without the state constraints")
    support: np.ndarray = quantity(
        "1", ("laws", "nodes", LINE), "largest value of a'x over the ellipse, less the bound: above zero it protrudes"
    )
    status: str = quantity("1", (), "of the solver", "str")
    accepted_by: str = quantity("1", (), "why it counts: status, or accuracy reached", "str")
    solver_attempt: int = quantity("1", (), "which of its settings gave the law")
    solver_iterations: int = quantity("1", (), "of the solver")
    solver_gap: float = quantity("1", (), "duality gap reached, of the scaled program")
    solver_residual: float = quantity("1", (), "larger of its residuals, primal and dual")


@record
class DoubleIntegratorFlights:
    """All trials under both laws, in the same forces. State: position, velocity, force, control."""

    time: np.ndarray = quantity("1", ("time",), "time")
    node: np.ndarray = quantity("1", ("nodes",), "index of each node of the partition among these times", "int64")
    count: np.ndarray = quantity("1", ("laws",), "trials", "int64")
    excluded: np.ndarray = quantity("1", ("laws",), "trials that are not finite", "int64")
    mean: np.ndarray = quantity("1", ("laws", "time", POINT_STATE), "mean state")
    covariance: np.ndarray = quantity(
        "1", ("laws", "time", POINT_STATE, POINT_STATE), "sample covariance", allow_nan=True
    )
    violations: np.ndarray = quantity("1", ("laws", "nodes", LINE), "trials beyond each line at each node", "int64")
    paper_violations: np.ndarray = quantity("1", ("laws", "nodes", LINE), "those among the first trials", "int64")
    any_violations: np.ndarray = quantity("1", ("laws", "nodes"), "trials beyond either line at each node", "int64")
    paper_any_violations: np.ndarray = quantity("1", ("laws", "nodes"), "those among the first trials", "int64")
    paper_trials: int = quantity("1", (), "number of the first trials, as many as the paper flies")
    kept_history: np.ndarray = quantity("1", ("laws", "kept", "time", POINT_STATE), "states of the first trials")


_ALONG = along(
    state=STATE,
    observed=OBSERVED,
    final=FINAL,
    per=("laws",),  # the first law is the open loop, then follow the iterations'
    outcome="0 captured, 1 below the ground, 2 hyperbolic, 3 not finite, 4 not exited",
    histogram="trials by commanded control; the first and last bin: beyond the limits",
    observed_maximum="largest commanded control and excess over the limits",  # negative inside
    kept_observed="observed of them",
    observed_mean="mean of the observed quantities",
)


@record
class FlightEnsemble(Ensemble):
    """All trials of the aerocapture under all laws, every law with the same density variations."""

    inherited = _ALONG

    time: np.ndarray = quantity("s", ("time",), "time from the start", label="time from entry")
    apoapsis: np.ndarray = quantity(
        "1", ("laws", "trials"), "exit apoapsis, planet radii; NaN if lost", allow_nan=True, label="exit apoapsis"
    )
    delta_v: np.ndarray = quantity(
        "m/s", ("laws", "trials"), "total delta-v; NaN if lost", allow_nan=True, label=r"$\Delta v$"
    )
