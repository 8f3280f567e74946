"""Artifact types of the funnels paper."""

import numpy as np

from marsedl.papers.ensembles import Moments, along
from marsedl.replication.records.fields import Axis, quantity, record

GAIN_UNIT = "rad/m, 1, 1, rad s/m, 1, 1"
OBSERVED_UNIT = "1, SI, W/m^2"
STATE = Axis(
    "motion", altitude="m", longitude="rad", latitude="rad", velocity="m/s", flight_path_angle="rad", heading="rad"
)
CAR_STATE = Axis("motion", x="m", y="m", heading="rad")  # of the Dubins car
DISTURBANCE = Axis("disturbance", "level", "slope")  # of the density: at all altitudes, and of its slope
WHITENED = Axis("coordinate", "y1", "y2", "y3", "y4", "y5", "y6", "w1", "w2")
PLANE = Axis("plane", "first", "second")  # of Fig. 4
GROUND = Axis("direction", "downrange", "crossrange")
FEEDBACK = Axis("feedback", "without", "with")
EXTREME = Axis("extreme", "least", "largest")
NORM = Axis("norm", "least", "median", "largest")
BIN = Axis("bin", "below", "inside", "above")
EDGE = Axis("edge", "lower", "upper")
PER_CAR_SLICE = ("funnel", "slices")
PER_CAR_STAGE = ("funnel", "stages")


@record
class Nominal:
    """The trajectory that is flown."""

    time: np.ndarray = quantity("s", ("time",), "nodes of the transcription", label="time from entry")
    state: np.ndarray = quantity(
        STATE.unit, ("time", STATE), "altitude, longitude, latitude, velocity, path angle, heading"
    )
    bank: np.ndarray = quantity("rad", ("time",), "bank angle at the nodes, linear in between", label="bank angle")
    bank_rate: np.ndarray = quantity("rad/s", ("intervals",), "bank rate on each interval", label="bank rate")
    cost: float = quantity("rad^2/s", (), "integral of the squared bank rate")
    heat_rate: np.ndarray = quantity(
        "W/m^2", ("time",), "heat rate at the nodes, where it is limited", label="heat rate"
    )
    peak_heat_rate: float = quantity("W/m^2", (), "largest heat rate between the nodes, flown")
    heat_rate_limit: float = quantity("W/m^2", (), "limit of the heat rate at the nodes")
    final_downrange: float = quantity("m", (), "distance flown to the east that is asked for")
    status: str = quantity("1", (), "how the solver ended", "str")
    iterations: int = quantity("1", (), "iterations of the solver")


@record
class Linearization:
    """Reference and Jacobians of Eq. 37 at the nodes of the fine grid and half-way between."""

    time: np.ndarray = quantity("s", ("time",), "nodes of the fine grid", label="time from entry")
    half_time: np.ndarray = quantity("s", ("half",), "nodes and the points half-way between", label="time from entry")
    state: np.ndarray = quantity(
        STATE.unit,
        ("half", STATE),
        "reference: altitude, longitude, latitude, velocity, path angle and heading",
    )
    bank: np.ndarray = quantity("rad", ("half",), "bank angle of the reference", label="bank angle")
    state_matrix: np.ndarray = quantity("SI", ("half", STATE, STATE), "derivative of the rates by the state")
    control_matrix: np.ndarray = quantity("SI", ("half", STATE), "by the bank angle")
    disturbance_matrix: np.ndarray = quantity("SI", ("half", STATE, DISTURBANCE), "by the disturbance of the density")
    heat_rate: np.ndarray = quantity("W/m^2", ("half",), "heat rate of the reference", label="heat rate")
    deceleration: np.ndarray = quantity("m/s^2", ("half",), "deceleration of the reference")


@record
class Gains:
    """Gain of the regulator, shapes of the slices at all nodes of the fine grid, and the level of the first one.

    V(xb) = 1/2 xb'P xb with P the shape; its unit is one over those of two states.
    """

    time: np.ndarray = quantity("s", ("time",), "nodes of the fine grid", label="time")
    half_gain: np.ndarray = quantity(
        GAIN_UNIT, ("half", STATE), "feedback of the deviation on the bank angle, at nodes and half-way between"
    )
    shape: np.ndarray = quantity("SI", ("time", STATE, STATE), "shape P of the slices")
    initial_level: float = quantity("1", (), "least level rho of the first slice that holds the initial set, Eq. 20")


@record
class Funnel:
    """Slices {1/2 xb'P xb <= rho} along the reference, the bounds that made them, and their checks.

    A stage leads from a slice to the next; levels and bounds are NaN from where the funnel does not exist.
    """

    outcome: str = quantity("1", (), "complete, or why the funnel ends where it does", "str")
    step: np.ndarray = quantity("1", ("slices",), "fine step of each slice", "int64")
    time: np.ndarray = quantity("s", ("slices",), "its time", label="time from entry")
    shape: np.ndarray = quantity("SI", ("slices", STATE, STATE), "its shape P")
    level: np.ndarray = quantity("1", ("slices",), "its level rho", allow_nan=True, label=r"level $\rho$")
    half_width: np.ndarray = quantity(
        STATE.unit, ("slices", STATE), "largest deviation of each state in it", allow_nan=True
    )
    log_volume: np.ndarray = quantity(
        "1", ("slices",), "natural logarithm of its volume, in the units of the states", allow_nan=True
    )
    feedback: np.ndarray = quantity("rad", ("slices",), "largest feedback bank angle in it", allow_nan=True)
    heat_rate: np.ndarray = quantity(
        "W/m^2", ("slices",), "largest heat rate in the slice with any disturbance of the density", allow_nan=True
    )
    rising: np.ndarray = quantity(
        "1", ("slices",), "share of random points of its boundary where V grows under the worst w", allow_nan=True
    )
    rising_undisturbed: np.ndarray = quantity("1", ("slices",), "the same share under no disturbance", allow_nan=True)
    literal_level: np.ndarray = quantity(
        "1",
        ("slices", EXTREME),
        "least and largest V/rho of the points of Eq. 26, in the units of raw_units",
        allow_nan=True,
    )
    literal_level_si: np.ndarray = quantity(
        "1", ("slices", EXTREME), "the same with states in m, rad and m/s", allow_nan=True
    )
    bound: np.ndarray = quantity("1", ("stages",), "proven bound of the polynomial over the level", allow_nan=True)
    growth: np.ndarray = quantity("1", ("stages",), "factor by which the stage raises the level", allow_nan=True)
    additive_growth: np.ndarray = quantity(
        "1", ("stages",), "V caused by disturbances that are added to the rates, which comes on top by its root"
    )
    true_maximum: np.ndarray = quantity(
        "1", ("stages",), "largest value of the integrated motion that was found, over the level", allow_nan=True
    )
    violation: np.ndarray = quantity(
        "1", ("stages",), "by how much that exceeds the bound, relative; negative if it does not", allow_nan=True
    )
    tightness: np.ndarray = quantity(
        "1",
        ("studied",),
        "how far the largest value of the polynomial found is below its bound, relative",
        allow_nan=True,
    )
    tightness_stage: np.ndarray = quantity("1", ("studied",), "number of that stage, from 1", "int64")
    gap: np.ndarray = quantity("1", ("stages",), "duality gap of the program, over the bound", allow_nan=True)
    residual: np.ndarray = quantity(
        "1", ("stages",), "largest violation of its equations, over the bound", allow_nan=True
    )
    iterations: np.ndarray = quantity("1", ("stages",), "iterations of its solver; 0: not solved", "int64")
    status: np.ndarray = quantity("1", ("stages",), "how the solver ended", "str")
    identity_error: np.ndarray = quantity(
        "1", ("stages",), "error of the sum of squares at fresh points, over the range of values", allow_nan=True
    )
    least_value: np.ndarray = quantity(
        "1", ("stages",), "least distance from the polynomial to its bound there, over that range", allow_nan=True
    )
    least_eigenvalue: np.ndarray = quantity("1", ("stages",), "of the Gram matrix", allow_nan=True)
    rounding_margin: np.ndarray = quantity("1", ("stages",), "what rounding may change of it", allow_nan=True)
    stage_sound: np.ndarray = quantity("1", ("stages",), "whether these checks are passed", "bool")
    sound: bool = quantity("1", (), "whether the funnel is complete and all stages are sound")
    memory: float = quantity(
        "1", (), "relative change of the second level when the first is ten times as large", allow_nan=True
    )
    samples: np.ndarray = quantity("1", ("sample", WHITENED), "points (y, w) at which the programs are matched")
    fig4_coordinate: np.ndarray = quantity("1", ("grid",), "whitened coordinates along both axes of Fig. 4")
    fig4_rate: np.ndarray = quantity(
        "1/s", ("grid", "grid"), "rate of V in that plane, without disturbance; rows: second coordinate", allow_nan=True
    )
    fig4_worst_rate: np.ndarray = quantity("1/s", ("grid", "grid"), "the same under the worst w", allow_nan=True)
    fig4_circle: np.ndarray = quantity("1", ("circle", PLANE), "points of the slice in that plane")
    fig4_circle_rate: np.ndarray = quantity("1/s", ("circle",), "rate of V there", allow_nan=True)
    fig4_circle_worst_rate: np.ndarray = quantity("1/s", ("circle",), "the same under the worst w", allow_nan=True)


@record
class LinearBounds:
    """Levels and largest deviations of the linearised closed loop."""

    time: np.ndarray = quantity("s", ("time",), "nodes of the fine grid", label="time from entry")
    slice_step: np.ndarray = quantity("1", ("slices",), "fine step at which a slice is", "int64")
    slice_time: np.ndarray = quantity("s", ("slices",), "its time", label="time from entry")

    exact_level: np.ndarray = quantity("1", ("slices",), "level, exact for linear dynamics")
    triangle_level: np.ndarray = quantity("1", ("slices",), "level by the triangle inequality")
    undisturbed_level: np.ndarray = quantity("1", ("slices",), "level without disturbance, exact for linear dynamics")
    exact_half_width: np.ndarray = quantity(
        STATE.unit, ("slices", STATE), "largest deviation of each state within the level of the first kind"
    )


@record
class OpenLoop:
    """Where flights from the first slice end without feedback, and what linear motion reaches without and with it.

    Starts and disturbances are those of the flights under constant disturbance.
    """

    trials: int = quantity("1", (), "flights without feedback")
    lost: int = quantity("1", (), "of which not finite")
    flown_half_width: np.ndarray = quantity("m", (GROUND,), "largest final deviation of the others", allow_nan=True)
    repeat_half_width: np.ndarray = quantity(
        "m", ("repeats", GROUND), "the same of ten parts of the flights", allow_nan=True
    )
    linear_half_width: np.ndarray = quantity(
        "m", (FEEDBACK, GROUND), "largest final deviation of linear motion from the first slice, any disturbance"
    )


@record
class StageStudy:
    """What the program of a stage needs, and what it gives in other forms.

    Bounds are of V at the next slice over the level of this one. The form "samples, rank one" is that of the funnel.
    """

    variety: np.ndarray = quantity("1", ("variety",), "spheres on which polynomials are bounded", "str")
    variables: np.ndarray = quantity("1", ("variety",), "their coordinates", "int64")
    monomials: np.ndarray = quantity("1", ("variety",), "monomials up to degree 2", "int64")
    basis_size: np.ndarray = quantity("1", ("variety",), "of which are independent there", "int64")
    coefficients: np.ndarray = quantity("1", ("variety",), "monomials up to degree 4", "int64")
    gram_unknowns: np.ndarray = quantity("1", ("variety",), "entries of a symmetric matrix over the basis", "int64")
    samples: np.ndarray = quantity("1", ("variety",), "least number of samples", "int64")
    basis_rank: np.ndarray = quantity("1", ("variety",), "rank of all monomials at samples; 0: not computed", "int64")
    product_rank: np.ndarray = quantity(
        "1", ("variety",), "rank of the products of the basis at more than enough samples; 0: not computed", "int64"
    )

    form: np.ndarray = quantity("1", ("form",), "form of the program and its solver", "str")
    form_bound: np.ndarray = quantity("1", ("form",), "bound", allow_nan=True)
    form_safe_bound: np.ndarray = quantity(
        "1", ("form",), "bound that holds in spite of residual and rounding", allow_nan=True
    )
    form_gap: np.ndarray = quantity("1", ("form",), "duality gap", allow_nan=True)
    form_residual: np.ndarray = quantity("1", ("form",), "largest violation of the equations", allow_nan=True)
    form_iterations: np.ndarray = quantity("1", ("form",), "iterations of the solver", "int64")
    form_status: np.ndarray = quantity("1", ("form",), "how it ended", "str")

    few_samples: np.ndarray = quantity("1", ("few_samples",), "numbers of random samples", "int64")
    few_rank: np.ndarray = quantity("1", ("few_samples",), "products of the basis that they determine", "int64")
    few_bound: np.ndarray = quantity("1", ("few_samples",), "bound from them")
    few_least_value: np.ndarray = quantity(
        "1", ("few_samples",), "its least distance to the polynomial at fresh points"
    )

    basis: np.ndarray = quantity("1", ("basis",), "coordinates and basis", "str")
    basis_condition: np.ndarray = quantity("1", ("basis",), "condition number at the samples, without null directions")


@record
class Stationary:
    """Disturbances in which the Euler polynomial of a stage is stationary, and the gradient of Eq. 35."""

    stationary_converged: float = quantity("1", (), "share of deviations for which Newton's method finds a point of O")
    stationary_norm: np.ndarray = quantity("1", (NORM,), "least, median and largest norm of w there", allow_nan=True)
    stationary_inside: int = quantity("1", (), "how many of them are in W")
    stationary_value: float = quantity("1", (), "largest value of the Euler polynomial in them", allow_nan=True)
    boundary_value: float = quantity("1", (), "the same on the boundary of W")
    interior_better: int = quantity("1", (), "deviations for which a disturbance in W is worse than on its boundary")
    gradient_deviation: float = quantity("1", (), "largest relative deviation of Eq. 35 from differences of V'")


@record
class EulerStep:
    """What the Euler step of Eq. 22 leaves out, at the levels of the motion."""

    excess: np.ndarray = quantity(
        "1",
        ("stages",),
        "Euler bound over that of the motion from the same level, less one; negative: the Euler step bounds nothing",
        allow_nan=True,
    )


@record
class CoarseFunnels:
    """Funnels on the slices of the backward funnel by other programs and directions."""

    coarse_step: np.ndarray = quantity("1", ("coarse",), "fine steps at which coarse slices are", "int64")
    variant: np.ndarray = quantity("1", ("variant",), "funnels with coarse slices", "str")
    variant_level: np.ndarray = quantity("1", ("variant", "coarse"), "their levels", allow_nan=True)
    variant_outcome: np.ndarray = quantity("1", ("variant",), "complete, or why the funnel ends", "str")
    multiplier_status: np.ndarray = quantity(
        "1", ("coarse_stages",), "how the solver of the programs with multipliers ended", "str"
    )
    multiplier_difference: float = quantity(
        "1", (), "largest relative difference of levels by multipliers and by samples", allow_nan=True
    )
    backward_programs: np.ndarray = quantity("1", ("coarse_stages",), "programs for each backward stage", "int64")
    round_trip: float = quantity(
        "1", (), "largest relative difference of the backward funnel and its return", allow_nan=True
    )
    round_trip_shortfall: float = quantity(
        "1", (), "largest by which the return exceeds it; never above the rounding", allow_nan=True
    )


@record
class EquationsOfMotion:
    """How far the equations of motion are from those in an inertial frame."""

    position_rate_deviation: float = quantity(
        "1", (), "largest relative deviation of Eq. 37 from the inertial velocity, random states"
    )
    velocity_rate_deviation: float = quantity(
        "1", (), "the same from the inertial acceleration by gravity, lift and drag"
    )


@record
class Proven:
    """Levels within which every deviation from the first slice is proven to stay, at all nodes of the fine grid.

    Proven is this of the closed loop as integrated by the Runge-Kutta rule on the fine grid, for the reference and the
    gains as stored, under every disturbance of the density in the unit disc that is constant over each stage. Nothing
    is said of the error of that rule, and of times between its nodes. Taken for granted is that numpy's elementary
    functions are right to 1e-13, and that rounding outside of the enclosures, of the whitening and of polynomials at
    samples, changes no bound by more than 1e-9 of it, which is added. NaN where nothing is proven.
    """

    outcome: str = quantity("1", (), "complete, or why nothing is proven beyond some stage", "str")
    proven: bool = quantity("1", (), "whether all stages are proven")
    step: np.ndarray = quantity("1", ("slices",), "fine step of each slice", "int64")
    time: np.ndarray = quantity("s", ("slices",), "its time", label="time from entry")
    level: np.ndarray = quantity("1", ("slices",), "its proven level rho", allow_nan=True, label=r"level $\rho$")
    half_width: np.ndarray = quantity(
        STATE.unit, ("slices", STATE), "largest deviation of each state in it", allow_nan=True
    )
    node_time: np.ndarray = quantity("s", ("nodes",), "nodes of the fine grid", label="time from entry")
    node_level: np.ndarray = quantity("1", ("nodes",), "proven level there, between slices too", allow_nan=True)
    bound: np.ndarray = quantity(
        "1",
        ("stages",),
        "proven bound of V at the next slice, over the level: the sum of the next four",
        allow_nan=True,
    )
    polynomial_bound: np.ndarray = quantity(
        "1", ("stages",), "bound of its polynomial part, on the slice and for all of the disc", allow_nan=True
    )
    truncation: np.ndarray = quantity("1", ("stages",), "bound of known terms of higher degrees", allow_nan=True)
    remainder: np.ndarray = quantity("1", ("stages",), "bound of everything else", allow_nan=True)
    rise: np.ndarray = quantity(
        "1", ("stages",), "by how much the polynomial may be larger inside of the slice", allow_nan=True
    )
    basis_size: int = quantity("1", (), "polynomials in the basis, of the slice and a sphere whose shadow the disc is")
    samples: int = quantity("1", (), "samples there")


@record
class Dubins:
    """Path, regulator and funnels of the car.

    The state is x, y and heading. A slice is {1/2 xb'P xb <= rho} with P the cost-to-go of the regulator.
    """

    time: np.ndarray = quantity("s", ("time",), "nodes of the fine grid", label="time")
    half_time: np.ndarray = quantity("s", ("half",), "nodes and the points half-way between", label="time")
    state: np.ndarray = quantity(CAR_STATE.unit, ("half", CAR_STATE), "nominal path: x, y and heading")
    turn_rate: np.ndarray = quantity("1/s", ("half",), "nominal turn rate, radians per second")
    half_gain: np.ndarray = quantity(
        "1/(m s), 1/(m s), 1/s",
        ("half", CAR_STATE),
        "feedback of the deviation on the turn rate, at nodes and half-way between",
    )
    shape: np.ndarray = quantity(
        "SI", ("time", CAR_STATE, CAR_STATE), "cost-to-go of the regulator, shape P of the slices"
    )

    slice_step: np.ndarray = quantity("1", ("slices",), "fine step at which a slice is", "int64")
    slice_time: np.ndarray = quantity("s", ("slices",), "its time", label="time")
    funnel: np.ndarray = quantity("1", ("funnel",), "flow and Euler condition without wind, flow with wind", "str")
    level: np.ndarray = quantity("1", PER_CAR_SLICE, "level of the slice", label=r"level $\rho$")
    bound: np.ndarray = quantity(
        "1", PER_CAR_STAGE, "bound of V at the next slice by the program, relative to the level"
    )
    status: np.ndarray = quantity("1", PER_CAR_STAGE, "how the solver ended", "str")
    sound: np.ndarray = quantity("1", PER_CAR_STAGE, "whether all of this is as it should be", "bool")

    samples: np.ndarray = quantity("1", ("funnel",), "samples", "int64")
    rank: np.ndarray = quantity("1", ("funnel",), "products of the basis that they determine", "int64")


@record
class DubinsStudy:
    """Levels of linear dynamics, backwards from the last one, and proven."""

    linear_level: np.ndarray = quantity("1", PER_CAR_SLICE, "level for linear dynamics, exact")
    backward_level: np.ndarray = quantity("1", ("slices",), "level backwards from the end of the first funnel")

    proven_funnel: np.ndarray = quantity("1", ("proven",), "funnels whose levels are proven", "str")
    proven_level: np.ndarray = quantity("1", ("proven", "slices"), "level of the integrated motion, proven")


_ALONG = along(
    state=("states", "SI"),  # less those of the reference
    observed=("observed", OBSERVED_UNIT),  # V, magnitude of the feedback (rad; rad/s of the car), and heat rate
    final=("final", "SI"),
    bins=BIN,
    edges=EDGE,
    outcome="0 flown to the end, 3 not finite",
    histogram="trials below 0, within 0 and 1, above",
    histogram_edges="0 and 1",
    maximum_over_trials="largest observed values over the trials",
    final_state="deviation at the end; largest V/rho at slices, and between them",
    kept_history="deviations of the kept trials",
    kept_observed="observed of the kept trials",
    count="finite trials",
    excluded="trials that are not finite",
    mean="mean deviation",
)


@record
class FlightEnsemble(Moments):
    """All trials of a case. The ones that are not finite count as outside of the funnel; no maximum holds them."""

    inherited = _ALONG

    time: np.ndarray = quantity("s", ("time",), "nodes of the fine grid", label="time")
    level: np.ndarray = quantity(
        "1", ("time",), "level rho of the funnel, linear between slices; NaN where there is none", allow_nan=True
    )
    observed_name: np.ndarray = quantity("1", ("observed",), "what is observed", "str")
    repeat_maximum: np.ndarray = quantity(
        OBSERVED_UNIT, ("repeats", "time", "observed"), "the same of ten parts of the trials", allow_nan=True
    )
    outside_at_slices: int = quantity("1", (), "trials outside of the funnel at a slice after the first")
    outside_between: int = quantity("1", (), "trials outside of the funnel at a node between slices")
    largest_ratio: float = quantity("1", (), "largest V/rho of the finite trials after the start", allow_nan=True)
