"""What the stages store: the artifacts' types, and where in their arrays a quantity stands."""

import numpy as np

from marsedl.papers.ensembles import Ensemble, along
from marsedl.replication.records.fields import Axis, quantity, record

TRIGGERS = ("time", "velocity")
CASES = ("apollo_time", "apollo_velocity", "stochastic_time", "stochastic_velocity")  # law and trigger
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

TRIGGER = Axis("trigger", *TRIGGERS)
LINEAR_STATE = Axis("motion", radius="m", velocity="m/s", flight_path_angle="rad", downrange="m", density="kg/m^3")
SLAVED_STATE = Axis("slaved_motion", radius="m", velocity="m/s", flight_path_angle="rad", downrange="m")
FEATURE = Axis("feature", **LINEAR_STATE.units, drag="m/s^2", climb_rate="m/s")  # of the flown Apollo law
LIMITED = Axis("limited", altitude="m", flight_path_angle="rad")  # final errors that Eq. 82 limits
NOMINAL_FINAL = Axis(
    "nominal_state",
    altitude="m",
    velocity="m/s",
    flight_path_angle="rad",
    downrange="m",
    density="kg/m^3",
    crossrange="m",
)
FLIGHT_STATE = Axis("state", **NOMINAL_FINAL.units, bank_cosine="1")
FINAL_STATE = Axis("final", **NOMINAL_FINAL.units, end_time="s", reversals="1", negative_densities="1")
LEVELS = (0.01, 0.99)  # of the percentiles of Table 4
OBSERVED_BANK = Axis("observed", bank="rad", bank_change="rad")  # change in a guidance period
GAIN_UNIT = f"1/({LINEAR_STATE.unit})"


@record
class Nominal:
    """The nominal flight at every integration step, of which each guidance period has the same number."""

    time: np.ndarray = quantity("s", ("time",), "time from entry interface", label="time from entry")
    altitude: np.ndarray = quantity("m", ("time",), "altitude")
    longitude: np.ndarray = quantity("rad", ("time",), "longitude")
    latitude: np.ndarray = quantity("rad", ("time",), "latitude")
    velocity: np.ndarray = quantity("m/s", ("time",), "planet-relative velocity", label="velocity")
    flight_path_angle: np.ndarray = quantity("rad", ("time",), "flight path angle")
    azimuth: np.ndarray = quantity(
        "rad", ("time",), "azimuth of the planet-relative velocity, clockwise from north", label="heading azimuth"
    )
    downrange: np.ndarray = quantity("m", ("time",), "downrange, negative before the target")
    density: np.ndarray = quantity("kg/m^3", ("time",), "mean density", label="density")
    crossrange: np.ndarray = quantity("m", ("time",), "crossrange of the target")
    bank: np.ndarray = quantity("rad", ("time",), "flown bank angle", label="bank angle")
    drag: np.ndarray = quantity("m/s^2", ("time",), "drag acceleration", label="drag acceleration")
    guidance_time: np.ndarray = quantity("s", ("guidance_time",), "times of the bank commands", label="time from entry")
    deadband: np.ndarray = quantity("m", ("guidance_time",), "half width of the crossrange deadband at these times")
    deadband_margin: float = quantity("m", (), "least distance from the deadband at which a bank direction was decided")
    reversal_time: np.ndarray = quantity("s", ("reversal_time",), "times at which bank reversals were commanded")
    alignment_time: float = quantity("s", (), "start of the heading alignment")
    end_time: float = quantity("s", (), "time at which the end velocity is reached")


@record
class Linearization:
    """Deviations from the nominal flight: x_{k+1} = A_k x_k + B_k u_k + G_k w_k, one interval per guidance period."""

    time: np.ndarray = quantity("s", ("nodes",), "bounds of the intervals", label="time from entry")
    state: np.ndarray = quantity(
        LINEAR_STATE.unit, ("nodes", LINEAR_STATE), "nominal radius, velocity, path angle, downrange, density"
    )
    slope: np.ndarray = quantity(
        "SI", ("nodes", LINEAR_STATE), "their time derivatives over the neighbouring guidance periods"
    )
    bank_cosine: np.ndarray = quantity("1", ("nodes",), "nominal bank cosine without reversals")
    bank_cosine_slope: np.ndarray = quantity("s/m", ("nodes",), "its derivative with velocity")
    drag: np.ndarray = quantity("m/s^2", ("nodes",), "nominal drag acceleration")
    inverse_scale_height: np.ndarray = quantity("1/m", ("nodes",), "inverse of the density's scale height")
    transition: np.ndarray = quantity("SI", ("intervals", LINEAR_STATE, LINEAR_STATE), "A_k")
    control: np.ndarray = quantity(
        "SI", ("intervals", LINEAR_STATE), "B_k; zero from the start of the heading alignment"
    )
    noise: np.ndarray = quantity("SI", ("intervals", LINEAR_STATE, LINEAR_STATE), "G_k G_k'")
    slaved_transition: np.ndarray = quantity(
        "SI", ("intervals", SLAVED_STATE, SLAVED_STATE), "A_k without density state, density by altitude"
    )
    slaved_control: np.ndarray = quantity("SI", ("intervals", SLAVED_STATE), "B_k of that model")
    initial_covariance: np.ndarray = quantity("SI", (LINEAR_STATE, LINEAR_STATE), "covariance at entry (Eqs. 43, 44)")
    final_rates: np.ndarray = quantity("SI", (LINEAR_STATE,), "time derivative at the end, with the flown bank angle")
    trigger_projection: np.ndarray = quantity(
        "SI", (LINEAR_STATE, LINEAR_STATE), "Z_f of the velocity trigger (Eq. 65)"
    )


@record
class Gains:
    """Gains by trigger (time, velocity), as they are flown and in the linear model, with predicted covariances."""

    time: np.ndarray = quantity("s", ("nodes",), "bounds of the guidance periods", label="time from entry")
    partition_start: np.ndarray = quantity(
        "1", ("partition",), "guidance period in which each interval begins", "int64"
    )

    # The stochastic law.
    stochastic_gain: np.ndarray = quantity(
        GAIN_UNIT, (TRIGGER, "intervals", LINEAR_STATE), "gain in every guidance period", allow_nan=True
    )
    stochastic_covariance: np.ndarray = quantity(
        "SI", (TRIGGER, "nodes", LINEAR_STATE, LINEAR_STATE), "predicted covariance", allow_nan=True
    )
    stochastic_control_variance: np.ndarray = quantity(
        "1", (TRIGGER, "intervals"), "of the bank cosine", allow_nan=True
    )
    control_limit: np.ndarray = quantity("1", ("partition",), "largest standard deviation of the control (Eq. 84)")
    control_ratio: np.ndarray = quantity(
        "1", (TRIGGER, "partition"), "standard deviation over its limit", allow_nan=True
    )
    final_ratio: np.ndarray = quantity(
        "1", (TRIGGER, LIMITED), "final standard deviation over its limit", allow_nan=True
    )
    control_multiplier: np.ndarray = quantity("m^2", (TRIGGER, "partition"), "Lagrange multipliers", allow_nan=True)
    final_multiplier: np.ndarray = quantity(
        "1, m^2", (TRIGGER, LIMITED), "of the altitude and path angle limits", allow_nan=True
    )
    control_weight: float = quantity("m^2", (), "weight of the control variance, the range error being in metres")
    cost: np.ndarray = quantity("m^2", (TRIGGER,), "objective of Problem 1 (Eq. 53)", allow_nan=True)
    gap: np.ndarray = quantity("1", (TRIGGER,), "duality gap over the objective", allow_nan=True)
    gap_above_floor: np.ndarray = quantity("1", (TRIGGER,), "duality gap over the controllable part", allow_nan=True)
    complementarity: np.ndarray = quantity("1", (TRIGGER,), "largest multiplier times slack, relative", allow_nan=True)
    noise_floor: np.ndarray = quantity("m^2", (TRIGGER,), "range variance from noise after the last control")
    iterations: np.ndarray = quantity("1", (TRIGGER,), "of the dual's solver", "int64")
    status: np.ndarray = quantity("1", (TRIGGER,), "of the dual's solver", "str")

    # The Apollo law.
    adjoint: np.ndarray = quantity(
        "SI", (TRIGGER, "nodes", LINEAR_STATE), "sensitivity of the final range error to the state"
    )
    apollo_covariance: np.ndarray = quantity(
        "SI", (TRIGGER, "nodes", LINEAR_STATE, LINEAR_STATE), "predicted covariance of the flown law"
    )
    apollo_control_variance: np.ndarray = quantity("1", (TRIGGER, "intervals"), "of the bank cosine of the flown law")
    timed_covariance: np.ndarray = quantity(
        "SI", (TRIGGER, "nodes", LINEAR_STATE, LINEAR_STATE), "predicted covariance of the gain against time"
    )
    timed_control_variance: np.ndarray = quantity("1", (TRIGGER, "intervals"), "of the bank cosine, gain against time")
    table_velocity: np.ndarray = quantity("m/s", ("table_velocity",), "velocities of the flown table, ascending")
    table_gain: np.ndarray = quantity(
        f"1/({FEATURE.unit})", (TRIGGER, "table_velocity", FEATURE), "gains of the flown law, with drag, climb rate"
    )
    table_reference: np.ndarray = quantity(
        FEATURE.unit, ("table_velocity", FEATURE), "reference values of the flown law"
    )


@record
class Certificates:
    """By trigger (time, velocity); costs over the cost of the dual's gains on the same coarse partition."""

    coarse_gap: np.ndarray = quantity("1", (TRIGGER,), "their duality gap")
    cone_ratio: np.ndarray = quantity("1", (TRIGGER,), "cost of the semidefinite program over it")
    cone_status: np.ndarray = quantity("1", (TRIGGER,), "of its solver", "str")
    cone_iterations: np.ndarray = quantity("1", (TRIGGER,), "of its solver", "int64")
    search_ratio: np.ndarray = quantity("1", (TRIGGER, "starts"), "cost of the search over weights, by START_SCALES")
    search_worst: np.ndarray = quantity("1", (TRIGGER, "starts"), "its largest standard deviation over the limit")
    weights_gain_error: np.ndarray = quantity(
        "1",
        (TRIGGER,),
        "gains by Eq. 55 with the multipliers as weights, in another form, against the law's",
        allow_nan=True,
    )
    perturbed_cost: np.ndarray = quantity(
        "1",
        (TRIGGER,),
        "least rise of the Lagrangian with perturbed gains over its part above the floor",
        allow_nan=True,
    )


@record
class Tradeoff:
    """Standard deviation of the range error with the fixed time, by the linear model, against the altitude limit."""

    altitude_limit: np.ndarray = quantity("m", ("altitude_limit",), "limit of the final altitude error")
    control_interval: np.ndarray = quantity("s", ("control_interval",), "intervals over which the control is held")
    deviation: np.ndarray = quantity(
        "m",
        ("control_interval", "altitude_limit"),
        "least deviation by interval and limit; NaN: infeasible",
        allow_nan=True,
    )
    noise_deviation: float = quantity("m", (), "deviation from noise after the last control")


_ALONG = along(
    state=FLIGHT_STATE,
    observed=OBSERVED_BANK,
    final=FINAL_STATE,
    outcome="0 completed, 1 below the ground, 2 trigger not reached, 3 not finite",
    histogram="trials by bank angle and its change",
    histogram_edges="edges of the histogram's inner bins",
    final_state="state at the end of the flight",
    observed_maximum="largest bank angle and largest change of it in a guidance period",
    kept_history="state of the kept trials",
    kept_observed="bank angle and its change",
    observed_mean="mean of the observed quantities",
    flying="trials still flying, over which the moments are taken",
    excluded="trials left out of the moments because they are not finite",
)


@record
class FlightEnsemble(Ensemble):
    """All trials of one Monte Carlo case."""

    inherited = _ALONG

    time: np.ndarray = quantity("s", ("time",), "time from entry interface", label="time from entry")
    nominal_final: np.ndarray = quantity(NOMINAL_FINAL.unit, (NOMINAL_FINAL,), "end of the nominal flight")


def by_case(apollo_time, apollo_velocity, stochastic_time, stochastic_velocity):
    """The four Monte Carlo ensembles by the name of their case, in the order of `CASES`."""
    return dict(zip(CASES, (apollo_time, apollo_velocity, stochastic_time, stochastic_velocity), strict=True))


def errors(ensemble, trials=None):
    """Final errors of altitude, velocity, path angle, downrange (positive: long) and density, (trials, 5)."""
    return ensemble.final_state[:trials, :5] - ensemble.nominal_final[:5]
