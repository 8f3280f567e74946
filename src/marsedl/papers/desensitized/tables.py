"""Tables 1 to 3, sensitivities and gains, and the studies beside them."""

import numpy as np

from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.montecarlo.statistics import covariance_standard_errors
from marsedl.papers.desensitized import components, entry_problem
from marsedl.papers.desensitized.claims.measures import is_papers, own_c1, printed_rows, row_c1
from marsedl.papers.desensitized.entry_problem import propellant
from marsedl.papers.desensitized.inputs import Design, Ensemble, Mission, Simulation, Vehicle
from marsedl.papers.desensitized.records import (
    ALL_COLUMNS,
    CHANNELS,
    MOTION,
    NO_DOC,
    RESHAPED,
    SOLUTIONS,
    FlightEnsemble,
    Gains,
    MinimumFuel,
    Responses,
    Tradeoff,
)
from marsedl.replication.records.tables import Column, table
from marsedl.replication.units import DEGREE, KM

PAPER = "in the paper"
LAW_NAMES = {
    NO_DOC: "no DOC",
    RESHAPED: "DOC without feedback",
    **{channel: f"gains against {channel} errors" for channel in CHANNELS},
    ALL_COLUMNS: "one set of gains",
}

C1 = Column("", "g", "the paper's weight")
WEIGHT = Column("deg^2/s^3", ".5g", "on the norm of the sensitivity; 0: no DOC")
EFFORT = Column("deg^2/s^3", ".4f", "control energy")
CUMULATIVE = Column("deg/s", ".4f", "integral of the absolute bank acceleration")
FUEL = Column("kg", ".4f", "propellant of the reaction control system")
REVERSALS = Column("", "d")
BRANCH = Column(meaning="its first solution, by its bank angle")
STATUS = Column(meaning="how it ended")
ITERATIONS = Column("", "d", "of the solver")
FINAL_ERROR = Column("m", ".5g", "norm of the final position error")
COSTS = {"J0": EFFORT, "cumulative bank rate": CUMULATIVE, "fuel": Column("kg", ".3f", FUEL.meaning)}
ERRORS = ("altitude", "crossrange", "downrange")  # of the final position


def _ratio(value, reference):
    return value / reference if reference else None


def _gain_columns(scaled):
    """Columns of gains (rows, 6) and their norm, for `_columns`."""
    gains = np.where(scaled.any(axis=1, keepdims=True), scaled, np.nan)
    column = Column("rad/s^2", "z.4f", "per scaled state; empty: no feedback")
    names = (f"gain on {MOTION.label(name)}" for name in MOTION.names)
    columns = {name: (gains[:, k], column) for k, name in enumerate(names)}
    return columns | {"norm of the gains": (np.linalg.norm(scaled, axis=1), Column("rad/s^2", ".4f"))}


def _columns(columns):
    """A table of values and what they are, by the columns' names."""
    values, described = ({name: pair[k] for name, pair in columns.items()} for k in range(2))
    return table(values, described)


# ---- Tables 1 to 3 ---------------------------------------------------------------------------------------------------


def tab01(vehicle: Vehicle, published):
    """Table 1 from the inputs."""
    parameters = {
        "aeroshell diameter": ("tab01_diameter", vehicle.aeroshell_diameter),
        "ballistic coefficient": ("tab01_ballistic_coefficient", vehicle.ballistic_coefficient),
        "lift over drag": ("tab01_lift_to_drag", vehicle.lift_to_drag),
        "roll moment of inertia": ("tab01_roll_inertia", vehicle.roll_inertia),
        "yaw moment of inertia": ("tab01_yaw_inertia", vehicle.yaw_inertia),
        "roll moment arm": ("tab01_roll_arm", vehicle.roll_arm),
        "yaw moment arm": ("tab01_yaw_arm", vehicle.yaw_arm),
        "specific impulse of the reaction control system": ("tab01_specific_impulse", vehicle.specific_impulse),
    }
    rows = [
        (name, published[claim].unit, published[claim].printed, value) for name, (claim, value) in parameters.items()
    ]
    unit, number = Column(meaning="of the two numbers that follow it"), Column("", "g")
    return table(rows, {"parameter": Column(), "unit": unit, PAPER: number, "here": number})


def tab02(mission: Mission):
    """Table 2 from the inputs, and below it the conditions that it does not mention."""

    def degrees(*values):
        return [None if value is None else value / DEGREE for value in values]

    angles = (
        ("longitude", "deg", True, mission.entry_longitude, mission.final_longitude),
        ("latitude", "deg", True, mission.entry_latitude, mission.final_latitude),
        ("flight path angle", "deg", True, mission.entry_flight_path_angle, None),
        ("heading, clockwise from north", "deg", False, mission.entry_azimuth, None),
        ("bank angle", "deg", False, mission.initial_bank, mission.final_bank),
        ("bank rate", "deg/s", False, mission.initial_bank_rate, mission.final_bank_rate),
    )
    rows = [
        ("altitude", "km", True, mission.entry_altitude / KM, mission.final_altitude / KM),
        ("velocity", "m/s", True, mission.entry_velocity, mission.final_velocity),
        *((name, unit, stated, *degrees(*values)) for name, unit, stated, *values in angles),
    ]
    names = {"parameter": Column(), "unit": Column(meaning="of the two conditions"), "stated in the paper": Column()}
    ends = ("at the atmospheric interface", "at parachute deployment")
    return table(rows, names | dict.fromkeys(ends, Column("", "g", "empty: free")))


def _row_numbers(tradeoff, number):
    """The four numbers of a row of Table 3 in the units of the paper."""
    return (
        tradeoff.effort[number],
        tradeoff.cumulative[number] / DEGREE,
        tradeoff.propellant[number],
        np.linalg.norm(tradeoff.error[number]),
    )


def tab03(design: Design, simulation: Simulation, published, tradeoff: Tradeoff):
    """Table 3: the four numbers of every row as printed, as computed here, and the ratio of the two."""
    rows, printed = [], printed_rows(published)
    for number, printed_weight in enumerate(tradeoff.printed_weight):
        known = is_papers(design, printed, printed_weight)
        paper = printed[row_c1(printed_weight)] if known else [None] * 4
        cells = [
            cell
            for value, reference in zip(_row_numbers(tradeoff, number), paper, strict=True)
            for cell in (reference, value, _ratio(value, reference))
        ]
        rows.append((own_c1(design, printed, printed_weight), tradeoff.weight[number], *cells))
    error = f"for {simulation.tabulated_error:+g} m of radius at entry"
    columns = {"c1": C1, "weight": WEIGHT}
    for name, column in (COSTS | {"final position error": Column("m", ".1f", error)}).items():
        columns |= {
            f"{name} {PAPER}": Column(column.unit, ".10g", column.meaning),
            f"{name} here": column,
            f"{name} over the paper's": Column("", ".4f", "here over printed"),
        }
    return table(rows, columns)


def tab03_solutions(design: Design, simulation: Simulation, published, tradeoff: Tradeoff):
    """What the solutions behind the rows of Table 3 are: errors, branch, bank motion, and what flights miss."""
    printed, error = printed_rows(published), Column("m", "z.1f")
    at_entry = f"for {simulation.tabulated_error:+g} m of radius at entry"
    return _columns(
        {
            "c1": ([own_c1(design, printed, c1) for c1 in tradeoff.printed_weight], C1),
            "weight": (tradeoff.weight, WEIGHT),
            "final position error": (np.linalg.norm(tradeoff.error, axis=1), Column("m", ".1f", at_entry)),
            **{f"its {name}": (tradeoff.error[:, k], error) for k, name in enumerate(ERRORS)},
            "branch": (tradeoff.row_branch + 1, Column("", "d", "in the order of the path over the weight")),
            "branch begins with": (tradeoff.branch[tradeoff.row_branch], BRANCH),
            "bank reversals": (tradeoff.reversals, REVERSALS),
            "largest bank rate": (tradeoff.largest_bank_rate / DEGREE, Column("deg/s", ".3f")),
            "largest bank acceleration": (tradeoff.largest_bank_acceleration / DEGREE, Column("deg/s^2", ".4f")),
            "target missed": (np.linalg.norm(tradeoff.miss, axis=1), Column("m", ".1f", "when flown again")),
            "solver": (tradeoff.status, STATUS),
            "iterations": (tradeoff.iterations, ITERATIONS),
        }
    )


# ---- sensitivities and gains -----------------------------------------------------------------------------------------


def sensitivity_blocks(gains: Gains):
    """The block S_p of every law as lengths: final radius, crossrange and downrange against those at entry."""
    per_km = KM * gains.final
    rows = [
        (LAW_NAMES[str(law)], channel, *errors)
        for law, block in zip(gains.law, per_km, strict=True)
        for channel, errors in zip(CHANNELS, block, strict=True)
    ]
    column = Column("m per km", "z.1f", "final error per error at entry")
    columns = {f"{channel} at entry": column for channel in CHANNELS}
    return table(rows, {"law": Column(), "final error in": Column(), **columns})


def gain_sets(gains: Gains, responses: Responses):
    """Every law: its gains, how their search ended, and what its trajectory takes."""
    cumulative = responses.nominal_cumulative / DEGREE
    return _columns(
        {
            "law": ([LAW_NAMES[str(law)] for law in gains.law], Column()),
            **_gain_columns(gains.scaled_gain),
            "iterations": (gains.iterations, Column("", "d", "of the search for the gains")),
            "converged": (gains.converged, Column()),
            "how the search ended": (gains.ended, Column()),
            "J0": (gains.effort, Column("deg^2/s^3", ".4f", "of the trajectory")),
            "cumulative bank rate": (cumulative, Column("deg/s", ".3f", "flown without error at entry")),
        }
    )


def gain_responses(gains: Gains, responses: Responses):
    """Final errors under every law for errors at entry in the channels that it is for, and the bank motion."""
    cases = [
        (number, channel)
        for number, law in enumerate(gains.law)
        for channel in ([CHANNELS.index(law)] if law in CHANNELS else range(len(CHANNELS)))
    ]
    number, channel = np.transpose(cases)
    final, compared = responses.error[number, channel, -1], responses.tabulated_error[number, channel]
    sensitivity = Column("m per km", ".3f", "norm of the final position against the error at entry")
    size = Column("m", ".5g", "for the drawn error")
    command = Column("deg/s^2", ".4f", "with the drawn error, before its bound")
    return _columns(
        {
            "law": ([LAW_NAMES[str(law)] for law in gains.law[number]], Column()),
            "error at entry in": ([CHANNELS[k] for k in channel], Column()),
            "linear sensitivity": ([KM * np.linalg.norm(gains.final[n, :, k]) for n, k in cases], sensitivity),
            "drawn error at entry": (responses.drawn_error[channel], Column("m", "g")),
            "final position error": ([np.linalg.norm(error) for error in final], size),
            **{f"its {name}": (final[:, k], Column("m", ".5g")) for k, name in enumerate(ERRORS)},
            **{
                f"final error for {error:+g} m": (np.linalg.norm(compared[:, k], axis=-1), FINAL_ERROR)
                for k, error in enumerate(responses.compared_error)
            },
            "cumulative bank rate": (
                responses.cumulative[number, channel] / DEGREE,
                Column("deg/s", ".3f", "with the drawn error"),
            ),
            "largest commanded bank acceleration": (responses.largest_command[number, channel] / DEGREE, command),
        }
    )


def dispersions(vehicle: Vehicle, ensemble: Ensemble, gains: Gains, entry_errors: FlightEnsemble):
    """Final errors under random position errors at entry, flown and by linear covariance, and what they cost."""
    rows = []
    for number, law in enumerate(entry_errors.law):
        completed = entry_errors.outcome[number] == COMPLETED
        error, trials = entry_errors.final_error[number, completed], len(completed)
        has_spread = len(error) > 1
        linear = np.sqrt((gains.final[number] * ensemble.initial_deviations) ** 2 @ np.ones(len(CHANNELS)))
        spread = error.std(axis=0, ddof=1) if has_spread else np.full(len(CHANNELS), np.nan)
        cells = []
        for channel, uncertainty in enumerate(_deviation_errors(error, spread)):
            cells += [spread[channel], uncertainty, linear[channel], _ratio(spread[channel], linear[channel])]
        # A lost trial is worse than any other.
        size = np.where(completed, np.linalg.norm(entry_errors.final_error[number], axis=1), np.inf)
        levels = (np.quantile(size, level, method="higher") for level in (0.5, 0.99))
        command = entry_errors.observed_maximum[number, :, components.COMMAND_MAGNITUDE]
        clipped = np.count_nonzero(~(command <= (1.0 + entry_problem.ROUNDING) * vehicle.bank_acceleration_bound))
        fuel = propellant(vehicle, entry_errors.final_state[number, completed, components.CUMULATIVE])
        rows.append(
            (
                LAW_NAMES[str(law)],
                *cells,
                *(level if np.isfinite(level) else None for level in levels),
                trials - len(error),
                100 * clipped / trials,
                propellant(vehicle, entry_errors.nominal[number, -1, components.CUMULATIVE]),
                *((fuel.mean(), fuel.std(ddof=1)) if has_spread else (None, None)),
                trials,
            )
        )
    columns, flown = {"law": Column()}, Column("kg", ".4f", "over the trials that are not lost")
    for channel, deviation in zip(CHANNELS, ensemble.initial_deviations, strict=True):
        error = f"{channel}: standard error"
        columns |= {
            f"{channel}: deviation": Column("m", ".1f", f"of the final error, {deviation:g} m at entry", error=error),
            error: Column("m"),
            f"{channel}: by linear covariance": Column("m", ".1f"),
            f"{channel}: flown over linear": Column("", ".4g"),
        }
    return table(
        rows,
        {
            **columns,
            **dict.fromkeys(("median", "99th percentile"), Column("m", ".1f", FINAL_ERROR.meaning)),
            "lost trials": Column(),
            "trials with a clipped command": Column("%", ".2f"),
            "propellant without errors at entry": Column("kg", ".4f"),
            **dict.fromkeys(("mean propellant", "deviation of the propellant"), flown),
            "trials": Column(),
        },
    )


def _deviation_errors(samples, deviation):
    """Standard errors of the standard deviations of samples (count, n), of any distribution."""
    if len(samples) < 3:
        return np.full(len(deviation), np.nan)
    of_variance = np.diag(covariance_standard_errors(samples))
    return np.divide(of_variance, 2.0 * deviation, out=np.zeros(len(deviation)), where=deviation > 0.0)


# ---- other solutions -------------------------------------------------------------------------------------------------


def least_fuel(minimum_fuel: MinimumFuel):
    """Least control energy and least fuel under each bound of the bank acceleration, and how the thrust is spread."""
    study, least = minimum_fuel, SOLUTIONS.index("least fuel")
    bound, solution = np.indices(study.status.shape).reshape(2, -1)
    over_least = study.cumulative / study.cumulative[:, [least]]
    contradiction = Column("", ".1e", "of thrust and switching function, least fuel")
    branch_end = Column("", ".4g", "share of the fuel in the cost where the nominal's branch ends")

    def counts(values):
        return [number if number >= 0 else None for number in values.ravel()]

    def of_least_fuel(values):
        return np.where(solution == least, values[bound], np.nan)

    return _columns(
        {
            "solution": (study.solution[solution], Column()),
            "bound of the bank acceleration": (study.bound[bound] / DEGREE, Column("deg/s^2", "g")),
            "J0": (study.effort.ravel(), EFFORT),
            "cumulative bank rate": (study.cumulative.ravel() / DEGREE, CUMULATIVE),
            "cumulative bank rate over the least": (over_least.ravel(), Column("", ".4f", "under this bound")),
            "fuel": (study.propellant.ravel(), FUEL),
            "final time": (study.time[..., -1].ravel(), Column("s", ".2f")),
            "bank reversals": (counts(study.reversals), REVERSALS),
            "intervals without thrust": (100.0 * study.coasting.ravel(), Column("%", ".1f")),
            "intervals at the bound": (100.0 * study.at_bound.ravel(), Column("%", ".1f")),
            "bursts of thrust": (counts(study.bursts), Column()),
            "contradiction": (of_least_fuel(study.switching_violation), contradiction),
            "branch ends at": (of_least_fuel(study.branch_share), branch_end),
            "solver": (study.status.ravel(), STATUS),
        }
    )
