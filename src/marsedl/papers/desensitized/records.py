"""What the stages of this paper store: fields with their units, shapes and meanings.

These types compile nothing and solve nothing: claims, figures and tables read them without the stages' libraries.
"""

import numpy as np

from marsedl.papers.ensembles import Ensemble, along
from marsedl.replication.records.fields import Axis, quantity, record

COLUMN_UNIT = "m/m, rad/m, rad/m, 1/s, 1/s, 1/s, rad/m, rad/(s m)"
GAIN_UNIT = "rad/(s^2 m), rad/(s^2 rad), rad/(s^2 rad), 1/(s m), 1/(s m), 1/(s m), 1/s^2, 1/s"

CHANNELS = ("radius", "crossrange", "downrange")
NO_DOC, RESHAPED, ALL_COLUMNS = "no_doc", "reshaped", "all_columns"
LAWS = (NO_DOC, RESHAPED, *CHANNELS, ALL_COLUMNS)
SOLUTIONS = ("nominal", "least fuel", "least energy beside it")  # of the study of least fuel
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
COMPARED = Axis("compared", "first", "second")  # of two errors at entry
BEYOND = Axis("side", "last", "beyond")  # of a fold: last on the branch, first beyond it


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


@record
class Tradeoff:
    """The path of solutions over the weight, where it changes its branch, and the rows of Table 3.

    Errors are those that the sensitivity gives for the radius error of Table 3. Rows are those of c1 = 0, of the
    printed weights, and of the weights that stand for an infinite one; a printed weight is missing if no solution has
    its control energy.
    """

    path_weight: np.ndarray = quantity(
        "deg^2/s^3", ("steps",), "weight on the norm of the sensitivity", label="weight $c$"
    )
    path_effort: np.ndarray = quantity("deg^2/s^3", ("steps",), "control energy J0", label="control energy $J_0$")
    path_error: np.ndarray = quantity("m", ("steps", POSITION), "final altitude, crossrange and downrange error")
    path_status: np.ndarray = quantity("1", ("steps",), "how the solver ended", "str")
    path_branch: np.ndarray = quantity("1", ("steps",), "number of the branch", "int64")
    branch: np.ndarray = quantity("1", ("branch",), "what the first solution of each branch is called", "str")
    fold_weight: np.ndarray = quantity("deg^2/s^3", ("folds", BEYOND), "last weight on a branch, first beyond it")
    fold_effort: np.ndarray = quantity("deg^2/s^3", ("folds", BEYOND), "control energy there")
    fold_error: np.ndarray = quantity("m", ("folds", BEYOND), "norm of the final position error there")
    fold_barrier: np.ndarray = quantity(
        "1", ("folds",), "initial barrier of the solver that went beyond; NaN: its own choice", allow_nan=True
    )
    printed_weight: np.ndarray = quantity("1", ("rows",), "the paper's c1; NaN: infinite", allow_nan=True)
    missing_weight: np.ndarray = quantity("1", ("missing",), "the paper's c1 without a row")
    missing_effort: np.ndarray = quantity("deg^2/s^3", ("missing",), "control energy that was looked for")
    missing_reason: np.ndarray = quantity("1", ("missing",), "why there is none", "str")
    weight: np.ndarray = quantity("deg^2/s^3", ("rows",), "weight on the norm of the sensitivity", label="weight $c$")
    time: np.ndarray = quantity("s", ("rows", "node"), "nodes", label="time from entry")
    state: np.ndarray = quantity(STATE.unit, ("rows", "node", STATE), "states as in the nominal")
    bank_acceleration: np.ndarray = quantity(
        "rad/s^2", ("rows", "intervals"), "bank acceleration on each interval", label="bank acceleration"
    )
    column: np.ndarray = quantity(
        COLUMN_UNIT, ("rows", "node", STATE), "sensitivity of the states to the radius at entry"
    )
    effort: np.ndarray = quantity("deg^2/s^3", ("rows",), "control energy J0", label="control energy $J_0$")
    cumulative: np.ndarray = quantity("rad/s", ("rows",), "integral of the absolute bank acceleration")
    propellant: np.ndarray = quantity("kg", ("rows",), "propellant of the reaction control system")
    error: np.ndarray = quantity("m", ("rows", POSITION), "final altitude, crossrange and downrange error")
    reversals: np.ndarray = quantity("1", ("rows",), "bank reversals", "int64")
    row_branch: np.ndarray = quantity("1", ("rows",), "number of the branch", "int64")
    largest_bank_rate: np.ndarray = quantity("rad/s", ("rows",), "largest bank rate, either way")
    largest_bank_acceleration: np.ndarray = quantity("rad/s^2", ("rows",), "largest bank acceleration, either way")
    miss: np.ndarray = quantity("m", ("rows", POSITION), "altitude, crossrange and downrange missed when flown again")
    status: np.ndarray = quantity("1", ("rows",), "how the solver ended", "str")
    iterations: np.ndarray = quantity("1", ("rows",), "iterations of the solver", "int64")
    solves: int = quantity("1", (), "solves on the path and for the rows")


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


_ALONG = along(
    state=FLIGHT_STATE,
    observed=OBSERVED,
    time="node",
    per=("law",),  # in the order of the gains
    outcome="0 flown to the end, 1 below the ground, 3 not finite",
    histogram="trials by observed; the first and last bin: beyond the edges",
    maximum_over_trials="largest observed values over the trials",
    kept_observed="observed of the kept trials",
)


@record
class FlightEnsemble(Ensemble):
    """All trials under all laws, every law with the same errors at entry."""

    inherited = _ALONG

    law: np.ndarray = quantity("1", ("law",), "name, as in the gains", "str")
    time: np.ndarray = quantity("s", ("law", "node"), "times of the moments", label="time from entry")
    nominal: np.ndarray = quantity(
        FLIGHT_STATE.unit, ("law", "node", FLIGHT_STATE), "the flight without errors", allow_nan=True
    )
    final_error: np.ndarray = quantity(
        "m", ("law", "trials", POSITION), "final radius, crossrange and downrange error; NaN if lost", allow_nan=True
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
