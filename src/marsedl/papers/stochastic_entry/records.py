"""What the stages store: the artifacts' types, and where in their arrays a quantity stands."""

from dataclasses import dataclass

import numpy as np

from marsedl.papers import streamed
from marsedl.replication.artifacts import quantity

TRIGGERS = ("time", "velocity")
CASES = ("apollo_time", "apollo_velocity", "stochastic_time", "stochastic_velocity")  # law and trigger
COARSE = 10.0  # s, intervals of the design on which slow formulations are solved, and altitude limits compared
START_SCALES = (1.0, 0.01, 0.1, 10.0, 100.0, 1e-6)  # of the control weights from which the search over weights begins

# What flights store over time; the first five, with the radius for the altitude, are the state of the linear model.
ALTITUDE, VELOCITY, FLIGHT_PATH_ANGLE, DOWNRANGE, DENSITY, CROSSRANGE, BANK_COSINE = range(7)
HISTORY = 7
STATES = 5
BANK, BANK_CHANGE = range(2)
OBSERVED = 2
END_TIME, REVERSALS, NEGATIVE_DENSITIES = range(6, 9)  # of the final state, behind the first six of the history
FINAL = 9
OUTCOMES = {0: "completed", 1: "below the ground", 2: "trigger not reached within the time limit", 3: "not finite"}

_LINEAR_UNIT = "m, m/s, rad, m, kg/m^3"
_GAIN_UNIT = f"1/({_LINEAR_UNIT})"
_FEATURE_UNIT = f"{_LINEAR_UNIT}, m/s^2, m/s"
_HISTORY_UNIT = "m, m/s, rad, m, kg/m^3, m, 1"
_OBSERVED_UNIT = "rad"
_FINAL_UNIT = "m, m/s, rad, m, kg/m^3, m, s, 1, 1"


@dataclass(frozen=True)
class Nominal:
    """The nominal flight at every integration step, of which each guidance period has the same number."""

    time: np.ndarray = quantity("s", ("time",), "time from entry interface")
    altitude: np.ndarray = quantity("m", ("time",), "altitude")
    velocity: np.ndarray = quantity("m/s", ("time",), "planet-relative velocity")
    flight_path_angle: np.ndarray = quantity("rad", ("time",), "flight path angle")
    downrange: np.ndarray = quantity("m", ("time",), "downrange, negative before the target")
    density: np.ndarray = quantity("kg/m^3", ("time",), "mean density")
    crossrange: np.ndarray = quantity("m", ("time",), "crossrange of the target")
    bank: np.ndarray = quantity("rad", ("time",), "flown bank angle")
    commanded_cosine: np.ndarray = quantity("1", ("time",), "commanded bank cosine")
    drag: np.ndarray = quantity("m/s^2", ("time",), "drag acceleration")
    guidance_time: np.ndarray = quantity("s", ("cycles",), "times of the bank commands")
    deadband: np.ndarray = quantity("m", ("cycles",), "half width of the crossrange deadband at these times")
    deadband_margin: float = quantity("m", (), "least distance from the deadband at which a bank direction was decided")
    reversal_time: np.ndarray = quantity("s", ("reversals",), "times at which bank reversals were commanded")
    alignment_time: float = quantity("s", (), "start of the heading alignment")
    end_time: float = quantity("s", (), "time at which the end velocity is reached")


@dataclass(frozen=True)
class Linearization:
    """Deviations from the nominal flight: x_{k+1} = A_k x_k + B_k u_k + G_k w_k, one interval per guidance period."""

    time: np.ndarray = quantity("s", ("nodes",), "bounds of the intervals")
    state: np.ndarray = quantity(_LINEAR_UNIT, ("nodes", 5), "nominal radius, velocity, path angle, downrange, density")
    slope: np.ndarray = quantity("SI", ("nodes", 5), "their time derivatives over the neighbouring guidance periods")
    bank_cosine: np.ndarray = quantity("1", ("nodes",), "nominal bank cosine without reversals")
    bank_cosine_slope: np.ndarray = quantity("s/m", ("nodes",), "its derivative with velocity")
    drag: np.ndarray = quantity("m/s^2", ("nodes",), "nominal drag acceleration")
    inverse_scale_height: np.ndarray = quantity("1/m", ("nodes",), "inverse of the density's scale height")
    transition: np.ndarray = quantity("SI", ("intervals", 5, 5), "A_k")
    control: np.ndarray = quantity("SI", ("intervals", 5), "B_k; zero from the start of the heading alignment")
    noise: np.ndarray = quantity("SI", ("intervals", 5, 5), "G_k G_k'")
    slaved_transition: np.ndarray = quantity(
        "SI", ("intervals", 4, 4), "A_k without density state, density by altitude"
    )
    slaved_control: np.ndarray = quantity("SI", ("intervals", 4), "B_k of that model")
    initial_covariance: np.ndarray = quantity("SI", (5, 5), "covariance at entry (Eqs. 43, 44)")
    final_rates: np.ndarray = quantity("SI", (5,), "time derivative at the end, with the flown bank angle")
    trigger_projection: np.ndarray = quantity("SI", (5, 5), "Z_f of the velocity trigger (Eq. 65)")


@dataclass(frozen=True)
class Gains:
    """Gains by trigger (time, velocity), as they are flown and in the linear model, with predicted covariances."""

    time: np.ndarray = quantity("s", ("nodes",), "bounds of the guidance periods")
    partition_start: np.ndarray = quantity(
        "1", ("partition",), "guidance period in which each interval begins", "int64"
    )

    # The stochastic law.
    stochastic_gain: np.ndarray = quantity(
        _GAIN_UNIT, (2, "intervals", 5), "gain in every guidance period", allow_nan=True
    )
    stochastic_covariance: np.ndarray = quantity("SI", (2, "nodes", 5, 5), "predicted covariance", allow_nan=True)
    stochastic_control_variance: np.ndarray = quantity("1", (2, "intervals"), "of the bank cosine", allow_nan=True)
    control_limit: np.ndarray = quantity("1", ("partition",), "largest standard deviation of the control (Eq. 84)")
    final_limit: np.ndarray = quantity("m, rad", (2,), "largest final standard deviations of altitude, path angle (82)")
    control_ratio: np.ndarray = quantity("1", (2, "partition"), "standard deviation over its limit", allow_nan=True)
    final_ratio: np.ndarray = quantity("1", (2, 2), "final standard deviation over its limit", allow_nan=True)
    control_multiplier: np.ndarray = quantity("m^2", (2, "partition"), "Lagrange multipliers", allow_nan=True)
    final_multiplier: np.ndarray = quantity("1, m^2", (2, 2), "of the altitude and path angle limits", allow_nan=True)
    control_weight: float = quantity("m^2", (), "weight of the control variance, the range error being in metres")
    cost: np.ndarray = quantity("m^2", (2,), "objective of Problem 1 (Eq. 53)", allow_nan=True)
    dual_value: np.ndarray = quantity("m^2", (2,), "lower bound of the objective over all linear laws", allow_nan=True)
    gap: np.ndarray = quantity("1", (2,), "duality gap over the objective", allow_nan=True)
    gap_above_floor: np.ndarray = quantity("1", (2,), "duality gap over the controllable part", allow_nan=True)
    complementarity: np.ndarray = quantity("1", (2,), "largest multiplier times slack, relative", allow_nan=True)
    noise_floor: np.ndarray = quantity("m^2", (2,), "range variance from noise after the last control")
    iterations: np.ndarray = quantity("1", (2,), "of the dual's solver", "int64")
    status: np.ndarray = quantity("1", (2,), "of the dual's solver", "str")

    # The Apollo law.
    adjoint: np.ndarray = quantity("SI", (2, "nodes", 5), "sensitivity of the final range error to the state")
    control_adjoint: np.ndarray = quantity("m", (2, "intervals"), "and to a control held to the end")
    apollo_gain: np.ndarray = quantity(_GAIN_UNIT, (2, "intervals", 5), "gain against time (Eq. 50)")
    apollo_covariance: np.ndarray = quantity("SI", (2, "nodes", 5, 5), "predicted covariance of the flown law")
    apollo_control_variance: np.ndarray = quantity("1", (2, "intervals"), "of the bank cosine of the flown law")
    timed_covariance: np.ndarray = quantity("SI", (2, "nodes", 5, 5), "predicted covariance of the gain against time")
    timed_control_variance: np.ndarray = quantity("1", (2, "intervals"), "of the bank cosine, gain against time")
    table_velocity: np.ndarray = quantity("m/s", ("rows",), "velocities of the flown table, ascending")
    table_gain: np.ndarray = quantity(
        f"1/({_FEATURE_UNIT})", (2, "rows", 7), "gains of the flown law, with drag, climb rate"
    )
    table_reference: np.ndarray = quantity(_FEATURE_UNIT, ("rows", 7), "reference values of the flown law")


@dataclass(frozen=True)
class Certificates:
    """By trigger (time, velocity); costs over the cost of the dual's gains on the same coarse partition."""

    coarse_cost: np.ndarray = quantity("m^2", (2,), "cost of the dual's gains on the coarse partition")
    coarse_gap: np.ndarray = quantity("1", (2,), "their duality gap")
    cone_ratio: np.ndarray = quantity("1", (2,), "cost of the semidefinite program over it")
    cone_status: np.ndarray = quantity("1", (2,), "of its solver", "str")
    cone_iterations: np.ndarray = quantity("1", (2,), "of its solver", "int64")
    search_ratio: np.ndarray = quantity("1", (2, "starts"), "cost of the search over weights, by START_SCALES")
    search_worst: np.ndarray = quantity("1", (2, "starts"), "its largest standard deviation over the limit")
    search_evaluations: np.ndarray = quantity("1", (2, "starts"), "covariance sweeps of the search", "int64")
    search_success: np.ndarray = quantity("1", (2, "starts"), "1: converged within the limits", "int8")
    weights_gain_error: np.ndarray = quantity(
        "1", (2,), "gains by Eq. 55 with the multipliers as weights, in another form, against the law's", allow_nan=True
    )
    perturbed_cost: np.ndarray = quantity(
        "1", (2,), "least rise of the Lagrangian with perturbed gains over its part above the floor", allow_nan=True
    )


@dataclass(frozen=True)
class Tradeoff:
    """Standard deviation of the range error that each trigger's objective holds, predicted by the linear model."""

    interval: np.ndarray = quantity("s", ("partitions",), "interval over which the control is held")
    range_deviation: np.ndarray = quantity("m", (2, "partitions"), "optimum by trigger (time, velocity)")
    early_control: np.ndarray = quantity("1", (2, "partitions"), "three sigma of the control in the first interval")
    gap: np.ndarray = quantity("1", (2, "partitions"), "duality gap")
    altitude_limit: np.ndarray = quantity("m", ("limits",), "limit of the final altitude error")
    limited_interval: np.ndarray = quantity("s", (2,), "partitions of the study of limits")
    limited_deviation: np.ndarray = quantity(
        "m", (2, 2, "limits"), "optimum by partition, trigger and limit; NaN: infeasible", allow_nan=True
    )
    floor: np.ndarray = quantity("m", (2,), "deviation from noise after the last control")


@dataclass(frozen=True)
class ErrorBudget:
    """Range error at the end by law, trigger (time, velocity) and source; the nominal law makes no corrections."""

    source: np.ndarray = quantity("1", ("sources",), "source of uncertainty that is switched on", "str")
    law: np.ndarray = quantity("1", ("laws",), "range-control law", "str")
    deviation: np.ndarray = quantity("m", ("laws", 2, "sources"), "standard deviation over the flights", allow_nan=True)
    mean: np.ndarray = quantity("m", ("laws", 2, "sources"), "mean over the flights", allow_nan=True)
    largest: np.ndarray = quantity(
        "m", ("laws", 2, "sources"), "largest error over the flights, absolute", allow_nan=True
    )
    missed: np.ndarray = quantity("1", ("laws", 2, "sources"), "flights that did not end as they should", "int64")
    trials: int = quantity("1", (), "flights of each source")
    floor: np.ndarray = quantity("m", (2,), "deviation from density after the start of the heading alignment, linear")


@dataclass(frozen=True)
class Flights:
    """What chunks and ensembles have in common.

    State: altitude, velocity, flight path angle, downrange, density, crossrange, commanded bank cosine. Final state:
    the first six of them, then end time, bank reversals, tabulated densities that were set to zero.
    """

    histogram: np.ndarray = quantity("1", ("time", 2, "bins"), "trials by bank angle and its change", "int64")
    histogram_edges: np.ndarray = quantity(_OBSERVED_UNIT, (2, "edges"), "edges of the histogram's inner bins")
    maximum_over_trials: np.ndarray = quantity(
        _OBSERVED_UNIT, ("time", 2), "largest values over the trials", allow_nan=True
    )
    final_state: np.ndarray = quantity(_FINAL_UNIT, ("trials", FINAL), "state at the end of the flight", allow_nan=True)
    observed_maximum: np.ndarray = quantity(
        _OBSERVED_UNIT,
        ("trials", 2),
        "largest bank angle and largest change of it in a guidance period",
        allow_nan=True,
    )
    outcome: np.ndarray = quantity(
        "1", ("trials",), "0 completed, 1 below the ground, 2 trigger not reached, 3 not finite", "int8"
    )
    kept_history: np.ndarray = quantity(
        _HISTORY_UNIT, ("kept", "time", HISTORY), "state of the kept trials", allow_nan=True
    )
    kept_observed: np.ndarray = quantity(
        _OBSERVED_UNIT, ("kept", "time", 2), "bank angle and its change", allow_nan=True
    )


@dataclass(frozen=True)
class FlightChunk(Flights):
    """Reduced trials of one chunk, block by block."""

    time: np.ndarray = quantity("s", ("time",), "time from entry interface")
    nominal_final: np.ndarray = quantity("m, m/s, rad, m, kg/m^3, m", (6,), "end of the nominal flight")
    first_trial: int = quantity("1", (), "number of the first trial")
    block_size: int = quantity("1", (), "trials in a block")
    block_counts: np.ndarray = quantity("1", ("blocks", "time"), "trials in the moments of each block", "int64")
    block_excluded: np.ndarray = quantity("1", ("blocks",), "non-finite trials of each block", "int64")
    block_mean: np.ndarray = quantity(_HISTORY_UNIT, ("blocks", "time", HISTORY), "mean state of each block")
    block_second_moment: np.ndarray = quantity(
        "SI", ("blocks", "time", HISTORY, HISTORY), "second moment about the block's mean"
    )
    block_observed_mean: np.ndarray = quantity(_OBSERVED_UNIT, ("blocks", "time", 2), "mean of the observed quantities")


@dataclass(frozen=True)
class FlightEnsemble(Flights):
    """All trials of one Monte Carlo case."""

    time: np.ndarray = quantity("s", ("time",), "time from entry interface")
    flying: np.ndarray = quantity("1", ("time",), "trials still flying, over which the moments are taken", "int64")
    nominal_final: np.ndarray = quantity("m, m/s, rad, m, kg/m^3, m", (6,), "end of the nominal flight")
    count: int = quantity("1", (), "trials in the moments")
    excluded: int = quantity("1", (), "trials left out of the moments because they are not finite")
    mean: np.ndarray = quantity(_HISTORY_UNIT, ("time", HISTORY), "mean state", allow_nan=True)
    covariance: np.ndarray = quantity("SI", ("time", HISTORY, HISTORY), "sample covariance", allow_nan=True)
    observed_mean: np.ndarray = quantity(_OBSERVED_UNIT, ("time", 2), "mean of the observed quantities", allow_nan=True)


@dataclass(frozen=True)
class StreamedFlightChunk(FlightChunk, streamed.StreamedChunk):
    """Reduced trials of one chunk of a large case, of which only the first trials are kept one by one."""


@dataclass(frozen=True)
class StreamedFlightEnsemble(FlightEnsemble, streamed.StreamedEnsemble):
    """All trials of a large Monte Carlo case, of which only the first are kept one by one."""


def by_case(apollo_time, apollo_velocity, stochastic_time, stochastic_velocity):
    """The four Monte Carlo ensembles by the name of their case, in the order of `CASES`."""
    return dict(zip(CASES, (apollo_time, apollo_velocity, stochastic_time, stochastic_velocity), strict=True))


def errors(ensemble, trials=None):
    """Final errors of altitude, velocity, path angle, downrange (positive: long) and density, (trials, 5).

    Of a streamed ensemble they are those of its first trials.
    """
    return ensemble.final_state[:trials, :5] - ensemble.nominal_final[:5]
