"""What the stages of this paper store: fields with their units, shapes and meanings.

These types compile nothing and solve nothing: claims, figures and tables read them without the stages' libraries.
"""

import numpy as np

from marsedl.replication.artifacts import Axis, quantity, record

COLUMN_UNIT = "m/m, rad/m, rad/m, 1/s, 1/s, 1/s, rad/m, rad/(s m)"
GAIN_UNIT = "rad/(s^2 m), rad/(s^2 rad), rad/(s^2 rad), 1/(s m), 1/(s m), 1/(s m), 1/s^2, 1/s"
STUDIED = ("cases", "scheme", "meshes")

CHANNELS = ("radius", "crossrange", "downrange")
NO_DOC, RESHAPED, ALL_COLUMNS = "no_doc", "reshaped", "all_columns"
LAWS = (NO_DOC, RESHAPED, *CHANNELS, ALL_COLUMNS)
PERTURBATIONS = ("density", "velocity", "flight path angle", "radius", "crossrange", "downrange")
DENSITY = PERTURBATIONS.index("density")
SOLUTIONS = ("nominal", "least fuel", "least energy beside it")  # of the study of least fuel
EXACT, UNEXPANDED, APPROXIMATED = VARIANTS = ("exact", "exact, not expanded", "limited-memory")
STATE = Axis(
    "motion",
    altitude="m",
    latitude="rad",
    longitude="rad",
    radial_velocity="m/s",
    north_velocity="m/s",
    east_velocity="m/s",
    bank="rad",
    bank_rate="rad/s",
)
FLIGHT_STATE = Axis("state", **STATE.units, cumulative_bank_acceleration="rad/s")
MOTION = Axis("measured", *list(STATE.units)[:6])  # what feedback measures
OBSERVED = Axis("observed", bank_acceleration="rad/s^2", command_magnitude="rad/s^2")
CHANNEL = Axis("entry_error", *CHANNELS)  # of the errors at entry
POSITION = Axis("position", *CHANNELS)  # of the final errors; in radius and altitude they are the same
FLOWN_PERTURBATION = Axis("law_perturbation", "density", "radius")  # of every law
SIGN = Axis("sign", "positive", "negative")
COMPARED = Axis("compared", "first", "second")  # of two errors at entry
END_CONDITION = Axis("end_condition", "initial_bank", "initial_bank_rate", "final_bank", "final_bank_rate")
BEYOND = Axis("side", "last", "beyond")  # of a fold: last on the branch, first beyond it
ONE_SET = Axis("one_set", "linear", "tuned")  # gains for all channels
LOST = 1e9  # stands for a norm that is not finite, and sorts behind all others


@record
class Nominal:
    """The solution of least control energy on the wanted branch, and the same controls flown again."""

    time: np.ndarray = quantity("s", ("time",), "nodes of the transcription", label="time from entry")
    state: np.ndarray = quantity(
        STATE.unit, ("time", STATE), "altitude, latitude, longitude, radial, north and east velocity, bank and its rate"
    )
    bank_acceleration: np.ndarray = quantity(
        "rad/s^2", ("intervals",), "bank acceleration, constant on each interval", label="bank acceleration"
    )
    effort: float = quantity("deg^2/s^3", (), "control energy J0", label="control energy $J_0$")
    cumulative: float = quantity("rad/s", (), "integral of the absolute bank acceleration")
    propellant: float = quantity("kg", (), "propellant of the reaction control system")
    largest_bank_rate: float = quantity("rad/s", (), "largest bank rate, either way")
    largest_bank_acceleration: float = quantity("rad/s^2", (), "largest bank acceleration, either way")
    reversals: int = quantity("1", (), "bank reversals")
    reversal_times: np.ndarray = quantity("s", ("reversal_times",), "when the bank angle passes zero")
    branch: str = quantity("1", (), "what the solution is called by its bank angle", "str")
    flown: np.ndarray = quantity(STATE.unit, ("time", STATE), "the same controls flown by a method of order eight")
    miss: np.ndarray = quantity(
        "m", (POSITION,), "altitude, crossrange and downrange by which that flight misses the target"
    )
    costate: np.ndarray = quantity("SI", ("intervals", STATE), "multipliers of the equations of motion")
    status: str = quantity("1", (), "how the solver ended", "str")
    iterations: int = quantity("1", (), "iterations of the solver")
    worst_residual: float = quantity("SI", (), "largest violation of an equation or bound")


@record
class Tradeoff:
    """The path of solutions over the weight, where it changes its branch, and the rows of Table 3.

    Errors are those that the sensitivity gives for the radius error of Table 3. Rows are those of c1 = 0, of the
    printed weights, and of the weights that stand for an infinite one.
    """

    path_weight: np.ndarray = quantity(
        "deg^2/s^3", ("steps",), "weight on the norm of the sensitivity", label="weight $c$"
    )
    path_effort: np.ndarray = quantity("deg^2/s^3", ("steps",), "control energy J0", label="control energy $J_0$")
    path_norm: np.ndarray = quantity("1", ("steps",), "norm of the sensitivity in the objective")
    path_cumulative: np.ndarray = quantity("rad/s", ("steps",), "integral of the absolute bank acceleration")
    path_error: np.ndarray = quantity("m", ("steps", POSITION), "final altitude, crossrange and downrange error")
    path_reversals: np.ndarray = quantity("1", ("steps",), "bank reversals", "int64")
    path_status: np.ndarray = quantity("1", ("steps",), "how the solver ended", "str")
    path_branch: np.ndarray = quantity("1", ("steps",), "number of the branch", "int64")
    branch: np.ndarray = quantity("1", ("branch",), "what the first solution of each branch is called", "str")
    fold_weight: np.ndarray = quantity("deg^2/s^3", ("folds", BEYOND), "last weight on a branch, first beyond it")
    fold_effort: np.ndarray = quantity("deg^2/s^3", ("folds", BEYOND), "control energy there")
    fold_error: np.ndarray = quantity("m", ("folds", BEYOND), "norm of the final position error there")
    printed_weight: np.ndarray = quantity("1", ("rows",), "the paper's c1; NaN: infinite", allow_nan=True)
    weight: np.ndarray = quantity("deg^2/s^3", ("rows",), "weight on the norm of the sensitivity", label="weight $c$")
    time: np.ndarray = quantity("s", ("rows", "node"), "nodes", label="time from entry")
    state: np.ndarray = quantity(STATE.unit, ("rows", "node", STATE), "states as in the nominal")
    bank_acceleration: np.ndarray = quantity(
        "rad/s^2", ("rows", "intervals"), "bank acceleration on each interval", label="bank acceleration"
    )
    column: np.ndarray = quantity(
        COLUMN_UNIT,
        ("rows", "node", STATE),
        "sensitivity of the states to the radius at entry",
    )
    effort: np.ndarray = quantity("deg^2/s^3", ("rows",), "control energy J0", label="control energy $J_0$")
    cumulative: np.ndarray = quantity("rad/s", ("rows",), "integral of the absolute bank acceleration")
    propellant: np.ndarray = quantity("kg", ("rows",), "propellant of the reaction control system")
    error: np.ndarray = quantity("m", ("rows", POSITION), "final altitude, crossrange and downrange error")
    norm: np.ndarray = quantity("1", ("rows",), "norm of the sensitivity in the objective")
    reversals: np.ndarray = quantity("1", ("rows",), "bank reversals", "int64")
    row_branch: np.ndarray = quantity("1", ("rows",), "number of the branch", "int64")
    largest_bank_rate: np.ndarray = quantity("rad/s", ("rows",), "largest bank rate, either way")
    largest_bank_acceleration: np.ndarray = quantity("rad/s^2", ("rows",), "largest bank acceleration, either way")
    miss: np.ndarray = quantity("m", ("rows", POSITION), "altitude, crossrange and downrange missed when flown again")
    status: np.ndarray = quantity("1", ("rows",), "how the solver ended", "str")
    iterations: np.ndarray = quantity("1", ("rows",), "iterations of the solver", "int64")
    solves: int = quantity("1", (), "solves on the path and for the rows")


@record
class LargerWeights:
    """The last row of Table 3 and its continuation to larger weights: what an infinite one costs.

    Errors are those that the sensitivity gives for the radius error of Table 3. Air is thin where density times squared
    velocity is below a hundredth of the flight's largest: bank motion there hardly turns the flight.
    """

    weight: np.ndarray = quantity(
        "deg^2/s^3", ("weights",), "weight on the norm of the sensitivity", label="weight $c$"
    )
    effort: np.ndarray = quantity("deg^2/s^3", ("weights",), "control energy J0", label="control energy $J_0$")
    cumulative: np.ndarray = quantity("rad/s", ("weights",), "integral of the absolute bank acceleration")
    propellant: np.ndarray = quantity(
        "kg", ("weights",), "propellant of the reaction control system", label="propellant"
    )
    error: np.ndarray = quantity("m", ("weights", POSITION), "final altitude, crossrange and downrange error")
    thin_air_share: np.ndarray = quantity(
        "1", ("weights",), "share of the cumulative bank rate that is spent in thin air"
    )
    reversals: np.ndarray = quantity("1", ("weights",), "bank reversals", "int64")
    at_bound: np.ndarray = quantity("1", ("weights",), "share of the intervals with the largest bank acceleration")
    status: np.ndarray = quantity("1", ("weights",), "how the solver ended", "str")
    iterations: np.ndarray = quantity("1", ("weights",), "iterations of the solver", "int64")
    ended: str = quantity("1", (), "where the continuation ends", "str")


@record
class Linearization:
    """Linear model along the nominal, and sensitivities of it and of the rows of Table 3.

    Columns are those of the radius, crossrange and downrange at entry, per metre.
    """

    scheme: str = quantity("1", (), "transcription that the sensitivities obey", "str")
    time: np.ndarray = quantity("s", ("time",), "nodes of the nominal", label="time from entry")
    state_matrix: np.ndarray = quantity(
        "SI",
        ("intervals", "points", STATE, STATE),
        "df/dy where the scheme evaluates it: in the middle of each interval, at its ends, or at all three",
    )
    control_matrix: np.ndarray = quantity("SI", ("intervals", "points", STATE), "df/du there")
    sensitivity: np.ndarray = quantity(
        COLUMN_UNIT, ("time", STATE, CHANNEL), "states against position at entry, nominal"
    )
    adjoint: np.ndarray = quantity(
        "SI", ("time", POSITION, STATE), "final position (m, angles times radius) against the states"
    )
    final: np.ndarray = quantity(
        "m/m",
        ("rows", POSITION, CHANNEL),
        "final radius, crossrange and downrange against those at entry, rows of Table 3",
    )
    printed_weight: np.ndarray = quantity("1", ("rows",), "the paper's c1; NaN: infinite", allow_nan=True)


@record
class Gains:
    """What is flown: nominals without feedback, and with gains designed for one channel or for all.

    Laws: no_doc; reshaped, the row c1 = 1 of Table 3 without feedback; then those with feedback. A law with feedback
    flies the nominal, but for those that were solved for together with a trajectory.
    """

    law: np.ndarray = quantity("1", ("law",), "name", "str")
    time: np.ndarray = quantity(
        "s", ("law", "node"), "nodes of the trajectory that the law follows", label="time from entry"
    )
    state: np.ndarray = quantity(STATE.unit, ("law", "node", STATE), "states there")
    bank_acceleration: np.ndarray = quantity(
        "rad/s^2", ("law", "intervals"), "bank acceleration on each interval", label="bank acceleration"
    )
    scaled_gain: np.ndarray = quantity("rad/s^2", ("law", MOTION), "gains on position and velocity by their scales")
    gain: np.ndarray = quantity(GAIN_UNIT, ("law", STATE), "gains on the states")
    final: np.ndarray = quantity(
        "m/m", ("law", POSITION, CHANNEL), "final radius, crossrange and downrange against those at entry, closed loop"
    )
    effort: np.ndarray = quantity("deg^2/s^3", ("law",), "control energy of the trajectory")
    iterations: np.ndarray = quantity("1", ("law",), "iterations of the gains", "int64")
    converged: np.ndarray = quantity("1", ("law",), "whether they converged", "bool")
    ended: np.ndarray = quantity("1", ("law",), "how their search ended", "str")


@record
class Responses:
    """What position errors at entry come to; channels are radius, crossrange, downrange.

    A flight that comes below the ground or is not finite has NaN from there on.
    """

    law: np.ndarray = quantity("1", ("law",), "name, as in the gains", "str")
    time: np.ndarray = quantity("s", ("law", "node"), "nodes", label="time from entry")
    nominal: np.ndarray = quantity(
        STATE.unit, ("law", "node", STATE), "states of the unperturbed flight", allow_nan=True
    )
    nominal_acceleration: np.ndarray = quantity(
        "rad/s^2", ("law", "node"), "its bank acceleration", allow_nan=True, label="bank acceleration"
    )
    nominal_cumulative: np.ndarray = quantity(
        "rad/s", ("law",), "its integral of the absolute bank acceleration", allow_nan=True
    )
    drawn_error: np.ndarray = quantity("m", (CHANNEL,), "error at entry of the histories, by channel")
    state: np.ndarray = quantity(
        STATE.unit, ("law", CHANNEL, "node", STATE), "states with that error in each channel", allow_nan=True
    )
    error: np.ndarray = quantity(
        "m", ("law", CHANNEL, "node", POSITION), "radius, crossrange and downrange error in them", allow_nan=True
    )
    acceleration: np.ndarray = quantity("rad/s^2", ("law", CHANNEL, "node"), "bank acceleration flown", allow_nan=True)
    cumulative: np.ndarray = quantity(
        "rad/s", ("law", CHANNEL), "integral of the absolute bank acceleration", allow_nan=True
    )
    largest_command: np.ndarray = quantity(
        "rad/s^2", ("law", CHANNEL), "largest bank acceleration commanded, before its bound", allow_nan=True
    )
    largest_bank_rate: np.ndarray = quantity("rad/s", ("law", CHANNEL), "largest bank rate", allow_nan=True)
    compared_error: np.ndarray = quantity("m", (COMPARED,), "errors at entry, by which laws are compared")
    tabulated_error: np.ndarray = quantity(
        "m",
        ("law", CHANNEL, COMPARED, POSITION),
        "final errors after the two compared errors, in each channel",
        allow_nan=True,
    )
    wide: np.ndarray = quantity("m", (CHANNEL, "points"), "errors at entry of the wide sweeps, by channel")
    wide_error: np.ndarray = quantity("m", ("law", CHANNEL, "points", POSITION), "final errors", allow_nan=True)
    narrow: np.ndarray = quantity("m", (CHANNEL, "points"), "errors at entry of the zoomed sweeps, by channel")
    narrow_error: np.ndarray = quantity("m", ("law", CHANNEL, "points", POSITION), "final errors", allow_nan=True)


@record
class Flights:
    """What chunks and ensembles have in common, by law in the order of the gains.

    State: altitude, latitude, longitude, radial, north and east velocity, bank, bank rate, integral of the absolute
    bank acceleration. Observed: bank acceleration flown, magnitude of the one commanded.
    """

    histogram: np.ndarray = quantity(
        "1", ("law", "node", OBSERVED, "bins"), "trials by observed; the first and last bin: beyond the edges", "int64"
    )
    histogram_edges: np.ndarray = quantity("rad/s^2", ("law", OBSERVED, "edges"), "edges of the inner bins")
    maximum_over_trials: np.ndarray = quantity(
        "rad/s^2", ("law", "node", OBSERVED), "largest observed values over the trials", allow_nan=True
    )
    final_state: np.ndarray = quantity(
        FLIGHT_STATE.unit, ("law", "trials", FLIGHT_STATE), "state at the end", allow_nan=True
    )
    observed_maximum: np.ndarray = quantity(
        "rad/s^2", ("law", "trials", OBSERVED), "largest observed values", allow_nan=True
    )
    outcome: np.ndarray = quantity(
        "1", ("law", "trials"), "0 flown to the end, 1 below the ground, 3 not finite", "int8"
    )
    kept_history: np.ndarray = quantity(
        FLIGHT_STATE.unit, ("law", "kept", "node", FLIGHT_STATE), "states of the kept trials", allow_nan=True
    )
    kept_observed: np.ndarray = quantity(
        "rad/s^2", ("law", "kept", "node", OBSERVED), "observed of the kept trials", allow_nan=True
    )


@record
class FlightChunk(Flights):
    """Reduced trials of one chunk, block by block."""

    first_trial: np.ndarray = quantity("1", ("law",), "number of the first trial", "int64")
    block_size: np.ndarray = quantity("1", ("law",), "trials in a block", "int64")
    block_counts: np.ndarray = quantity("1", ("law", "blocks", "node"), "trials in the moments of each block", "int64")
    block_excluded: np.ndarray = quantity("1", ("law", "blocks"), "non-finite trials of each block", "int64")
    block_mean: np.ndarray = quantity(
        FLIGHT_STATE.unit, ("law", "blocks", "node", FLIGHT_STATE), "mean state of each block"
    )
    block_second_moment: np.ndarray = quantity(
        "SI", ("law", "blocks", "node", FLIGHT_STATE, FLIGHT_STATE), "second moment about that mean"
    )
    block_observed_mean: np.ndarray = quantity("rad/s^2", ("law", "blocks", "node", OBSERVED), "mean of the observed")


@record
class FlightEnsemble(Flights):
    """All trials under all laws, every law with the same errors at entry."""

    law: np.ndarray = quantity("1", ("law",), "name, as in the gains", "str")
    time: np.ndarray = quantity("s", ("law", "node"), "times of the moments", label="time from entry")
    nominal: np.ndarray = quantity(
        FLIGHT_STATE.unit, ("law", "node", FLIGHT_STATE), "the flight without errors", allow_nan=True
    )
    flying: np.ndarray = quantity("1", ("law", "node"), "trials still flying, over which moments are taken", "int64")
    count: np.ndarray = quantity("1", ("law",), "trials in the moments", "int64")
    excluded: np.ndarray = quantity("1", ("law",), "trials left out of them because they are not finite", "int64")
    mean: np.ndarray = quantity(FLIGHT_STATE.unit, ("law", "node", FLIGHT_STATE), "mean state", allow_nan=True)
    covariance: np.ndarray = quantity(
        "SI", ("law", "node", FLIGHT_STATE, FLIGHT_STATE), "sample covariance", allow_nan=True
    )
    observed_mean: np.ndarray = quantity("rad/s^2", ("law", "node", OBSERVED), "mean of the observed", allow_nan=True)
    final_error: np.ndarray = quantity(
        "m", ("law", "trials", POSITION), "final radius, crossrange and downrange error; NaN if lost", allow_nan=True
    )


@record
class Branches:
    """Local minima of the problem without weight, sorted by control energy, and what begins at them.

    Solutions are counted once with their mirror images, where the problem has them, and with whole turns of the bank
    angle added. Errors are those that the sensitivity gives for the radius error of Table 3, weights those on the norm
    of the radius column in metres per metre, unless told otherwise. Rows are those of Table 3 with a finite weight.
    """

    name: np.ndarray = quantity("1", ("solutions",), "what the solution is called by its bank angle", "str")
    effort: np.ndarray = quantity("deg^2/s^3", ("solutions",), "control energy J0", label="control energy $J_0$")
    cumulative: np.ndarray = quantity("rad/s", ("solutions",), "integral of the absolute bank acceleration")
    propellant: np.ndarray = quantity("kg", ("solutions",), "propellant of the reaction control system")
    final_time: np.ndarray = quantity("s", ("solutions",), "time from entry to deployment")
    reversals: np.ndarray = quantity("1", ("solutions",), "bank reversals", "int64")
    rolls: np.ndarray = quantity("1", ("solutions",), "full turns of the bank angle", "int64")
    error: np.ndarray = quantity("m", ("solutions", POSITION), "final altitude, crossrange and downrange error")
    time: np.ndarray = quantity("s", ("solutions", "node"), "nodes", label="time from entry")
    bank: np.ndarray = quantity("rad", ("solutions", "node"), "bank angle", label="bank angle")
    found: np.ndarray = quantity("1", ("solutions",), "random starts that led to it", "int64")
    returned: np.ndarray = quantity(
        "rad", ("solutions",), "bank angle's largest change when shaken and solved again; NaN: failed", allow_nan=True
    )
    nominal: int = quantity("1", (), "number of the nominal among the solutions")
    starts: int = quantity("1", (), "random starts")
    failed_starts: int = quantity("1", (), "random starts that led to no solution")
    roll: np.ndarray = quantity("rad", ("roll",), "turn of the bank angle in a guess")
    roll_status: np.ndarray = quantity("1", ("roll",), "how the solver ended from that guess", "str")

    set_fixed: np.ndarray = quantity(
        "1", ("sets", END_CONDITION), "whether initial bank, its rate, final bank, its rate are fixed", "bool"
    )
    set_status: np.ndarray = quantity("1", ("sets",), "how the solver ended, from the nominal", "str")
    set_effort: np.ndarray = quantity("deg^2/s^3", ("sets",), "control energy J0; NaN: not solved", allow_nan=True)
    set_cumulative: np.ndarray = quantity(
        "rad/s", ("sets",), "integral of the absolute bank acceleration; NaN: not solved", allow_nan=True
    )
    set_reversals: np.ndarray = quantity(
        "1", ("sets",), "bank reversals; others than the nominal's: its branch is lost", "int64"
    )

    curve_error: np.ndarray = quantity("m", ("points",), "norm of the final error on the nominal's branch")
    curve_effort: np.ndarray = quantity("deg^2/s^3", ("points",), "least control energy there")
    curve_weight: np.ndarray = quantity(
        "deg^2/s^3", ("points",), "weight of which the point is a stationary one", label="weight $c$"
    )
    curve_final_bank: np.ndarray = quantity("rad", ("points",), "bank angle at deployment")
    fold_weight: float = quantity("deg^2/s^3", (), "largest weight on that branch; NaN: no fold", allow_nan=True)
    fold_error: float = quantity("m", (), "norm of the final error there", allow_nan=True)

    continued_solution: np.ndarray = quantity("1", ("continued",), "solution at which the branch begins", "int64")
    continued_weight: np.ndarray = quantity(
        "deg^2/s^3", ("continued",), "weight on the norm as in the trade-off, of the branches beside the nominal's"
    )
    continued_effort: np.ndarray = quantity(
        "deg^2/s^3", ("continued",), "control energy J0", label="control energy $J_0$"
    )
    continued_cumulative: np.ndarray = quantity("rad/s", ("continued",), "integral of the absolute bank acceleration")
    continued_error: np.ndarray = quantity(
        "m", ("continued", POSITION), "final altitude, crossrange and downrange error"
    )

    row_weight: np.ndarray = quantity("1", ("rows",), "the paper's c1")
    row_error: np.ndarray = quantity("m", ("rows",), "norm of the row's final error")
    row_effort: np.ndarray = quantity("deg^2/s^3", ("rows",), "the row's control energy")
    least_effort: np.ndarray = quantity("deg^2/s^3", ("rows",), "least one found anywhere at no larger error")
    least_solution: np.ndarray = quantity(
        "1", ("rows",), "solution at which that branch begins; -1: the row itself has the least", "int64"
    )


@record
class Certificates:
    """What the solutions are worth.

    Errors are of the final altitude, crossrange and downrange. Sensitivities are metric, in metres per metre. Cases:
    the nominal, then the row of the largest finite weight. What a solver could not solve has its status and NaN.
    """

    weight: np.ndarray = quantity("deg^2/s^3", ("cases",), "weight on the norm of the sensitivity", label="weight $c$")
    scheme: np.ndarray = quantity("1", ("scheme",), "transcription", "str")
    intervals: np.ndarray = quantity("1", ("meshes",), "intervals of the mesh", "int64", label="intervals")

    mesh_status: np.ndarray = quantity("1", STUDIED, "how the solver ended", "str")
    mesh_iterations: np.ndarray = quantity("1", STUDIED, "iterations from the solution on a mesh beside it", "int64")
    mesh_effort: np.ndarray = quantity(
        "deg^2/s^3", STUDIED, "control energy J0", allow_nan=True, label="control energy $J_0$"
    )
    mesh_cumulative: np.ndarray = quantity(
        "rad/s", STUDIED, "integral of the absolute bank acceleration", allow_nan=True
    )
    mesh_bank_change: np.ndarray = quantity(
        "rad", STUDIED, "largest difference of the bank angle to the inputs' mesh", allow_nan=True
    )
    mesh_error: np.ndarray = quantity(
        "m", (*STUDIED, POSITION), "error for the radius error of Table 3, by the columns of the scheme", allow_nan=True
    )
    mesh_flown_error: np.ndarray = quantity(
        "m", (*STUDIED, POSITION), "the same by central differences of flights of these controls", allow_nan=True
    )
    mesh_miss: np.ndarray = quantity(
        "m", (*STUDIED, POSITION), "by which such a flight without error misses the target", allow_nan=True
    )
    miss_order: np.ndarray = quantity(
        "1", ("cases", "scheme", "refinements"), "order of the miss from mesh to mesh", allow_nan=True
    )
    error_order: np.ndarray = quantity(
        "1", ("cases", "scheme", "refinements"), "order of the error's difference to flights", allow_nan=True
    )

    mesh_longitude_deviation: np.ndarray = quantity(
        "m/m", STUDIED, "largest deviation of the longitude column from its unit vector, all nodes", allow_nan=True
    )
    mesh_crossrange_deviation: np.ndarray = quantity(
        "m/m", STUDIED, "of the final crossrange column from that of a turned flight", allow_nan=True
    )
    mesh_solver_deviation: np.ndarray = quantity(
        "1", STUDIED, "relative, of the solver's radius column from the recursion; NaN without weight", allow_nan=True
    )
    flow_deviation: np.ndarray = quantity(
        "1",
        ("cases", "scheme"),
        "relative, of the sensitivity on the inputs' mesh from differences of the discrete flow",
        allow_nan=True,
    )

    row_weight: np.ndarray = quantity("deg^2/s^3", ("rows",), "weight of the rows of Table 3")
    row_longitude_deviation: np.ndarray = quantity("m/m", ("rows",), "as of the meshes, for the rows of Table 3")
    row_crossrange_deviation: np.ndarray = quantity("m/m", ("rows",), "as of the meshes")
    row_solver_deviation: np.ndarray = quantity("1", ("rows",), "as of the meshes, all nodes")
    row_adjoint_deviation: np.ndarray = quantity("m/m", ("rows",), "largest difference of adjoint and forward")
    row_frobenius_deviation: np.ndarray = quantity(
        "1", ("rows",), "relative, of the squared norm of all columns from that of the radius column and the turn"
    )
    row_defect: np.ndarray = quantity("1", ("rows",), "largest defect of an interval in the scales of the states")
    mirrored_defect: np.ndarray = quantity("1", ("rows",), "the same of the flight seen in a mirror")
    shifted_defect: np.ndarray = quantity("1", ("rows",), "the same of the flight moved in longitude")
    mirrored_error_deviation: np.ndarray = quantity("m", ("rows",), "largest change of the error in the mirror")
    shifted_error_deviation: np.ndarray = quantity("m", ("rows",), "largest change of the error when moved")

    slope_weight: np.ndarray = quantity("deg^2/s^3", ("slopes",), "weights at which the slope of the curve is taken")
    slope_deviation: np.ndarray = quantity(
        "1", ("slopes",), "relative deviation of dJ0/d(norm), by differences, from minus the weight", allow_nan=True
    )

    variant: np.ndarray = quantity("1", ("variant",), "derivatives and how the equations are traced", "str")
    variant_status: np.ndarray = quantity("1", ("cases", "variant"), "how the solver ended", "str")
    variant_iterations: np.ndarray = quantity(
        "1", ("cases", "variant"), "iterations from one and the same start", "int64"
    )
    variant_effort: np.ndarray = quantity("deg^2/s^3", ("cases", "variant"), "control energy J0 of the last iterate")
    variant_reversals: np.ndarray = quantity("1", ("cases", "variant"), "its bank reversals", "int64")

    radius_error: np.ndarray = quantity("m", ("radius_error",), "radius errors at entry", label="radius error at entry")
    linear_error: np.ndarray = quantity("m", ("cases", "radius_error", POSITION), "final errors by the sensitivity")
    flown_error: np.ndarray = quantity(
        "m", ("cases", "radius_error", POSITION), "final errors as flown", allow_nan=True
    )


@record
class MinimumFuel:
    """Solutions under each bound of the bank acceleration: of least control energy, least fuel, and energy beside it.

    The last one is what the least fuel is fairly compared with: where the nominal's branch ends on the way from energy
    to fuel, the solution of least fuel lies on another. A burst that is shorter than an interval is spread over it, and
    then does not come to the bound. What was not solved has NaN.
    """

    bound: np.ndarray = quantity("rad/s^2", ("bound",), "bound of the bank acceleration")
    solution: np.ndarray = quantity("1", ("solution",), "what is minimised", "str")
    status: np.ndarray = quantity("1", ("bound", "solution"), "how the solver ended", "str")
    time: np.ndarray = quantity("s", ("bound", "solution", "node"), "nodes", allow_nan=True, label="time from entry")
    bank: np.ndarray = quantity("rad", ("bound", "solution", "node"), "bank angle", allow_nan=True, label="bank angle")
    bank_acceleration: np.ndarray = quantity(
        "rad/s^2", ("bound", "solution", "intervals"), "bank acceleration on each interval", allow_nan=True
    )
    effort: np.ndarray = quantity(
        "deg^2/s^3", ("bound", "solution"), "control energy J0", allow_nan=True, label="control energy $J_0$"
    )
    cumulative: np.ndarray = quantity(
        "rad/s", ("bound", "solution"), "integral of the absolute bank acceleration", allow_nan=True
    )
    propellant: np.ndarray = quantity(
        "kg", ("bound", "solution"), "propellant of the reaction control system", allow_nan=True
    )
    reversals: np.ndarray = quantity("1", ("bound", "solution"), "bank reversals; -1: not solved", "int64")
    coasting: np.ndarray = quantity(
        "1", ("bound", "solution"), "share of the intervals without thrust, below 0.001 of the bound", allow_nan=True
    )
    at_bound: np.ndarray = quantity(
        "1", ("bound", "solution"), "share of the intervals at the bound, up to 0.001 of it", allow_nan=True
    )
    bursts: np.ndarray = quantity(
        "1",
        ("bound", "solution"),
        "times of thrust with coasting between, or of the other sign; -1: not solved",
        "int64",
    )
    switching: np.ndarray = quantity(
        "1",
        ("bound", "intervals"),
        "switching function of the least fuel: what bank rate saves over what it costs; thrust pays from 1 on",
        allow_nan=True,
    )
    switching_violation: np.ndarray = quantity(
        "1", ("bound",), "by how much it contradicts thrust or coasting on any interval", allow_nan=True
    )
    branch_share: np.ndarray = quantity(
        "1",
        ("bound",),
        "share of the fuel in the cost as far as the nominal's branch goes; 1: to the end",
        allow_nan=True,
    )
    branch_cumulative: np.ndarray = quantity(
        "rad/s", ("bound",), "integral of the absolute bank acceleration there", allow_nan=True
    )


@record
class FurtherPerturbations:
    """Sensitivity to further perturbations, a nominal desensitized against density, and feedback against it.

    Errors are of the final altitude, crossrange and downrange. Perturbations: density, velocity along its direction,
    flight path angle, radius, crossrange, downrange. Linear errors are by the scheme of the transcription. Flown errors
    are those of the perturbation either way, first the positive one; NaN: below the ground before the end. Designs are
    the nominal and the solutions at the wanted weights on density.
    """

    perturbation: np.ndarray = quantity("1", ("perturbation",), "name", "str")
    size: np.ndarray = quantity("1, m/s, rad, m, m, m", ("perturbation",), "size")
    row_weight: np.ndarray = quantity("deg^2/s^3", ("rows",), "weight on the radius of the rows of Table 3")
    row_linear_error: np.ndarray = quantity(
        "m", ("rows", "perturbation", POSITION), "by the sensitivity, rows of Table 3"
    )
    row_flown_error: np.ndarray = quantity(
        "m", ("rows", "perturbation", SIGN, POSITION), "as flown, rows of Table 3", allow_nan=True
    )

    path_weight: np.ndarray = quantity("deg^2/s^3", ("steps",), "weight on the norm of the sensitivity to density")
    path_effort: np.ndarray = quantity("deg^2/s^3", ("steps",), "control energy J0", label="control energy $J_0$")
    path_cumulative: np.ndarray = quantity("rad/s", ("steps",), "integral of the absolute bank acceleration")
    path_error: np.ndarray = quantity("m", ("steps", POSITION), "for the density error, by the columns of the solver")
    path_reversals: np.ndarray = quantity("1", ("steps",), "bank reversals", "int64")
    path_branch: np.ndarray = quantity("1", ("steps",), "number of the branch", "int64")
    branch: np.ndarray = quantity("1", ("branch",), "what the first solution of each branch is called", "str")
    path_end: str = quantity("1", (), "why the path ends where it does", "str")

    design_weight: np.ndarray = quantity("deg^2/s^3", ("designs",), "weight on the sensitivity to density")
    design_time: np.ndarray = quantity("s", ("designs", "node"), "nodes", label="time from entry")
    design_bank: np.ndarray = quantity("rad", ("designs", "node"), "bank angle", label="bank angle")
    design_bank_acceleration: np.ndarray = quantity("rad/s^2", ("designs", "intervals"), "on each interval")
    design_effort: np.ndarray = quantity("deg^2/s^3", ("designs",), "control energy J0", label="control energy $J_0$")
    design_cumulative: np.ndarray = quantity("rad/s", ("designs",), "integral of the absolute bank acceleration")
    design_propellant: np.ndarray = quantity("kg", ("designs",), "propellant of the reaction control system")
    design_branch: np.ndarray = quantity("1", ("designs",), "number of the branch", "int64")
    design_linear_error: np.ndarray = quantity("m", ("designs", "perturbation", POSITION), "by the sensitivity")
    design_flown_error: np.ndarray = quantity(
        "m", ("designs", "perturbation", SIGN, POSITION), "as flown", allow_nan=True
    )

    law: np.ndarray = quantity("1", ("law",), "feedback on the nominal", "str")
    scaled_gain: np.ndarray = quantity("rad/s^2", ("law", MOTION), "gains on position and velocity by their scales")
    gain: np.ndarray = quantity(GAIN_UNIT, ("law", STATE), "gains on the states")
    converged: np.ndarray = quantity("1", ("law",), "whether the search for them converged", "bool")
    ended: np.ndarray = quantity("1", ("law",), "how it ended", "str")
    law_linear_error: np.ndarray = quantity(
        "m", ("law", FLOWN_PERTURBATION, POSITION), "by the sensitivity, for density and radius error", allow_nan=True
    )
    density_error: np.ndarray = quantity("1", ("density_error",), "relative errors of the density under every law")
    density_flown_error: np.ndarray = quantity("m", ("law", "density_error", POSITION), "as flown", allow_nan=True)
    radius_error: np.ndarray = quantity(
        "m", ("radius_error",), "radius errors under every law", label="radius error at entry"
    )
    radius_flown_error: np.ndarray = quantity("m", ("law", "radius_error", POSITION), "as flown", allow_nan=True)


@record
class GainStudy:
    """Candidates of every channel in the order of their flown errors, and gains for all channels at once."""

    channel: np.ndarray = quantity("1", ("candidates",), "radius, crossrange or downrange, as a number", "int64")
    method: np.ndarray = quantity("1", ("candidates",), "how the gains were found", "str")
    found: np.ndarray = quantity("1", ("candidates",), "starts that led there", "int64")
    rank: np.ndarray = quantity("1", ("candidates",), "place among the channel's candidates, 0 the best", "int64")
    scaled_gain: np.ndarray = quantity(
        "rad/s^2", ("candidates", MOTION), "gains on position and velocity by their scales"
    )
    linear_error: np.ndarray = quantity(
        "m/m", ("candidates", POSITION), "final radius, crossrange and downrange by the linear sensitivity"
    )
    flown_norm: np.ndarray = quantity("1", ("candidates",), "root mean square of the flown errors per initial error")
    tuning_error: np.ndarray = quantity("m", ("tuning_error",), "initial errors flown", label="error at entry")
    flown_error: np.ndarray = quantity(
        "m",
        ("candidates", "tuning_error"),
        "norm of the final error they lead to",
        allow_nan=True,
        label="final position error",
    )
    least_starts: np.ndarray = quantity("1", (CHANNEL,), "random starts of the least gains, by channel", "int64")
    least_failed: np.ndarray = quantity("1", (CHANNEL,), "those that did not converge", "int64")
    all_sizes: np.ndarray = quantity(
        "m", ("all_sizes",), "initial errors of every channel, flown with one set of gains", label="error at entry"
    )
    all_scaled_gain: np.ndarray = quantity(
        "rad/s^2", (ONE_SET, MOTION), "one set of gains: of the linear problem, and tuned"
    )
    all_flown_error: np.ndarray = quantity(
        "m",
        (ONE_SET, CHANNEL, "all_sizes"),
        "norm of the final error that they lead to, by channel",
        allow_nan=True,
        label="final position error",
    )
    all_tuned: bool = quantity("1", (), "whether the tuning of the one set came to an end")
