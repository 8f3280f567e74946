"""Tables 1 to 3, sensitivities and gains, the studies beside them, and what each reading gives."""

import numpy as np

from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.montecarlo.statistics import covariance_standard_errors
from marsedl.papers.desensitized import components, entry_problem
from marsedl.papers.desensitized.claims import Records, printed_rows
from marsedl.papers.desensitized.entry_problem import DEGREE, propellant
from marsedl.papers.desensitized.inputs import DesensitizedInputs, Design, Ensemble, Mission, Simulation, Vehicle
from marsedl.papers.desensitized.records import (
    ALL_COLUMNS,
    CHANNELS,
    EXACT,
    LOST,
    NO_DOC,
    RESHAPED,
    SOLUTIONS,
    Branches,
    Certificates,
    FlightEnsemble,
    FurtherPerturbations,
    Gains,
    GainStudy,
    MinimumFuel,
    Responses,
    Tradeoff,
)
from marsedl.papers.desensitized.tradeoff import last_finite_row

NO_VALUE = "–"
PAPER = "in the paper"
KILOMETRE = 1e3
LAW_NAMES = {
    NO_DOC: "no DOC",
    RESHAPED: "DOC without feedback",
    **{channel: f"gains against {channel} errors" for channel in CHANNELS},
    ALL_COLUMNS: "one set of gains",
}
GAINS_HEAD = "gains on altitude, latitude, longitude, radial, north, east velocity (rad/s^2 per scaled state)"
# Inputs in which readings may differ that say how much is computed, not what.
_SIZES = ("trials", "drawn_trials")


def _number(value, form):
    """A number, a dash where there is none; zero has no sign, and no number more digits than can be read."""
    if not np.isfinite(value):
        return NO_VALUE
    if form.endswith("f") and abs(value) >= 1e7:
        return f"{value:.3g}"
    return f"{value:{form.replace('.', 'z.', 1)}}"


def _list(values, form):
    return ", ".join(_number(value, form) for value in values)


def _printed(value):
    """A number with all the digits that the paper prints."""
    return _number(value, ".10g")


def _ratio(value, reference):
    return _number(value / reference, ".4f") if reference else NO_VALUE


def _c1(printed_weight):
    """The paper's c1 of a row; the artifact has NaN for an infinite one."""
    return float("inf") if np.isnan(printed_weight) else float(printed_weight)


def _weight_name(printed_weight):
    """The paper's c1 as its Table 3 writes it."""
    if printed_weight == 0.0:
        return "0 (no-DOC)"
    return f"{printed_weight:g}" if np.isfinite(printed_weight) else "infinity"


# ---- Tables 1 to 3 ---------------------------------------------------------------------------------------------------


def tab01(vehicle: Vehicle, published):
    """Table 1 from the inputs."""
    rows = (
        ("aeroshell diameter", "tab01_diameter", vehicle.aeroshell_diameter),
        ("ballistic coefficient", "tab01_ballistic_coefficient", vehicle.ballistic_coefficient),
        ("lift over drag", "tab01_lift_to_drag", vehicle.lift_to_drag),
        ("roll moment of inertia", "tab01_roll_inertia", vehicle.roll_inertia),
        ("yaw moment of inertia", "tab01_yaw_inertia", vehicle.yaw_inertia),
        ("roll moment arm", "tab01_roll_arm", vehicle.roll_arm),
        ("yaw moment arm", "tab01_yaw_arm", vehicle.yaw_arm),
        ("specific impulse of the reaction control system", "tab01_specific_impulse", vehicle.specific_impulse),
    )
    return [
        ("parameter", PAPER, "here", "unit"),
        *((name, f"{published[key].printed:g}", f"{value:g}", published[key].unit) for name, key, value in rows),
    ]


def tab02(mission: Mission):
    """Table 2 from the inputs, and below it the conditions that it does not mention."""

    def degrees(value):
        return "free" if value is None else f"{value / DEGREE:g}"

    return [
        ("parameter", "at the atmospheric interface", "at parachute deployment", "unit"),
        ("altitude", f"{mission.entry_altitude / KILOMETRE:g}", f"{mission.final_altitude / KILOMETRE:g}", "km"),
        ("velocity", f"{mission.entry_velocity:g}", f"{mission.final_velocity:g}", "m/s"),
        ("longitude", degrees(mission.entry_longitude), degrees(mission.final_longitude), "deg"),
        ("latitude", degrees(mission.entry_latitude), degrees(mission.final_latitude), "deg"),
        ("flight path angle", degrees(mission.entry_flight_path_angle), "not prescribed", "deg"),
        ("heading, clockwise from north (not in the paper)", degrees(mission.entry_azimuth), "free", "deg"),
        ("bank angle (not in the paper)", degrees(mission.initial_bank), degrees(mission.final_bank), "deg"),
        ("bank rate (not in the paper)", degrees(mission.initial_bank_rate), degrees(mission.final_bank_rate), "deg/s"),
    ]


def _paper_row(printed, printed_weight):
    """The four numbers of a row of Table 3, NaN where the paper has no such row."""
    return np.array(printed.get(_c1(printed_weight), [np.nan] * 4))


def _row_numbers(tradeoff, number):
    """The four numbers of a row of Table 3 in the units of the paper."""
    return np.array(
        [
            tradeoff.effort[number],
            tradeoff.cumulative[number] / DEGREE,
            tradeoff.propellant[number],
            np.linalg.norm(tradeoff.error[number]),
        ]
    )


def _row_cells(numbers):
    return [_number(value, form) for value, form in zip(numbers, (".4f", ".4f", ".3f", ".1f"), strict=True)]


def tab03(simulation: Simulation, published, tradeoff: Tradeoff):
    """Table 3: every row as printed, as found here, and the ratio of the two."""
    header = (
        *("c1", "source", "weight on the sensitivity (deg^2/s^3)"),
        *("J0 (deg^2/s^3)", "cumulative bank rate (deg/s)", "fuel (kg)"),
        f"final position error for {simulation.tabulated_error:+g} m of radius (m)",
        *("its altitude (m)", "its crossrange (m)", "its downrange (m)"),
        *("branch", "bank reversals", "largest bank rate (deg/s)", "largest bank acceleration (deg/s^2)"),
        *("target missed when flown again (m)", "solver"),
    )
    rows, printed, told = [header], printed_rows(published), set()
    for number, printed_weight in enumerate(tradeoff.printed_weight):
        name = _weight_name(printed_weight)
        paper, found = _paper_row(printed, printed_weight), _row_numbers(tradeoff, number)
        known = np.isfinite(paper).all()
        if known and name not in told:
            rows.append((name, PAPER, "", *map(_printed, paper), *[""] * 9))
            told.add(name)
        rows.append(
            (
                name,
                "here",
                f"{tradeoff.weight[number]:.5g}",
                *_row_cells(found),
                *(_number(value, ".1f") for value in tradeoff.error[number]),
                f"{tradeoff.row_branch[number] + 1} (begins with {tradeoff.branch[tradeoff.row_branch[number]]})",
                f"{tradeoff.reversals[number]}",
                _number(tradeoff.largest_bank_rate[number] / DEGREE, ".3f"),
                _number(tradeoff.largest_bank_acceleration[number] / DEGREE, ".4f"),
                _number(np.linalg.norm(tradeoff.miss[number]), ".1f"),
                f"{tradeoff.status[number]}, {tradeoff.iterations[number]} iterations",
            )
        )
        if known:
            rows.append((name, "here over the paper's", "", *map(_ratio, found, paper), *[""] * 9))
    return rows


# ---- sensitivities and gains -----------------------------------------------------------------------------------------


def sensitivity_blocks(gains: Gains):
    """The block S_p of every law as lengths: final radius, crossrange and downrange against those at entry."""
    per_km = KILOMETRE * gains.final
    rows = [("law", "final error in", *(f"per km of {channel} at entry (m)" for channel in CHANNELS), "all three (m)")]
    for number, law in enumerate(gains.law):
        name = LAW_NAMES[str(law)]
        rows += [
            (name, channel, *(_number(value, ".1f") for value in per_km[number, k]), "")
            for k, channel in enumerate(CHANNELS)
        ]
        norms = [*np.linalg.norm(per_km[number], axis=0), np.linalg.norm(per_km[number])]
        rows.append((name, "norm", *(_number(value, ".1f") for value in norms)))
    return rows


def gain_sets(simulation: Simulation, gains: Gains, responses: Responses):
    """Every law and every channel that it is for: gains, how their search ended, and what flights come to."""
    size = simulation.tabulated_error
    rows = [
        (
            "law",
            "error at entry in",
            GAINS_HEAD,
            "norm of the gains (rad/s^2)",
            "iterations",
            "converged",
            "how the search ended",
            "J0 of the trajectory (deg^2/s^3)",
            "linear sensitivity (m per km)",
            "drawn error at entry (m)",
            "final error (m)",
            "its radius, crossrange, downrange (m)",
            f"final error for {size:+g} m (m)",
            f"final error for {-size:+g} m (m)",
            "cumulative bank rate without error at entry (deg/s)",
            "with the drawn error (deg/s)",
            "largest commanded bank acceleration (deg/s^2)",
        )
    ]
    for number, law in enumerate(gains.law):
        own = [CHANNELS.index(law)] if law in CHANNELS else range(len(CHANNELS))
        for channel in own:
            final = responses.error[number, channel, -1]
            rows.append(
                (
                    LAW_NAMES[str(law)],
                    CHANNELS[channel],
                    _list(gains.scaled_gain[number], ".4f") if gains.scaled_gain[number].any() else "none",
                    _number(np.linalg.norm(gains.scaled_gain[number]), ".4f"),
                    f"{gains.iterations[number]}",
                    "yes" if gains.converged[number] else "no",
                    str(gains.ended[number]),
                    _number(gains.effort[number], ".4f"),
                    _number(KILOMETRE * np.linalg.norm(gains.final[number, :, channel]), ".3f"),
                    f"{responses.drawn_error[channel]:g}",
                    _number(np.linalg.norm(final), ".1f"),
                    _list(final, ".1f"),
                    *(_number(np.linalg.norm(error), ".1f") for error in responses.tabulated_error[number, channel]),
                    _number(responses.nominal_cumulative[number] / DEGREE, ".3f"),
                    _number(responses.cumulative[number, channel] / DEGREE, ".3f"),
                    _number(responses.largest_command[number, channel] / DEGREE, ".4f"),
                )
            )
    return rows


def candidate_gains(gain_study: GainStudy):
    """Gains that meet the paper's problem as well, by channel and rank, and one set for all channels."""
    study = gain_study
    sizes = np.unique([*study.tuning_error, *study.all_sizes])
    rows = [
        (
            "against errors in",
            "rank",
            "how found",
            "starts that led there",
            GAINS_HEAD,
            "norm of the gains (rad/s^2)",
            "linear sensitivity (m per km)",
            *(f"final error for {size:+g} m (m)" for size in sizes),
            "root mean square of final over initial errors",
        )
    ]

    def flown(known, errors):
        by_size = dict(zip(known, errors, strict=True))
        return [_number(by_size[size], ".1f") if size in by_size else "" for size in sizes]

    def candidate(number):
        gain, norm = study.scaled_gain[number], study.flown_norm[number]
        return (
            CHANNELS[study.channel[number]],
            f"{study.rank[number] + 1}",
            str(study.method[number]),
            f"{study.found[number]}",
            _list(gain, ".4f"),
            _number(np.linalg.norm(gain), ".4f"),
            _number(KILOMETRE * np.linalg.norm(study.linear_error[number]), ".3f"),
            *flown(study.tuning_error, study.flown_error[number]),
            _number(norm, ".4g") if norm < LOST else "lost",
        )

    for channel, name in enumerate(CHANNELS):
        own = np.flatnonzero(study.channel == channel)
        rows += [candidate(number) for number in own[np.argsort(study.rank[own])]]
        failed = f"{study.least_failed[channel]} of {study.least_starts[channel]}"
        rows.append((name, NO_VALUE, "random starts that led to no least gains", failed, *[""] * (len(rows[0]) - 4)))
    ended = "" if study.all_tuned else ", not converged"
    for method, gain, errors in zip(
        ("regularised least squares, with the trajectory", f"tuned to flown errors{ended}"),
        study.all_scaled_gain,
        study.all_flown_error,
        strict=True,
    ):
        for channel, name in enumerate(CHANNELS):
            known = flown(study.all_sizes, errors[channel])
            cells = _list(gain, ".4f"), _number(np.linalg.norm(gain), ".4f"), ""
            mean_square = np.mean((errors[channel] / study.all_sizes) ** 2)
            rows.append((f"all three: {name}", "", method, "", *cells, *known, _number(np.sqrt(mean_square), ".4g")))
    return rows


def dispersions(vehicle: Vehicle, ensemble: Ensemble, gains: Gains, entry_errors: FlightEnsemble):
    """Final errors under random position errors at entry, flown and by linear covariance, and what they cost."""
    bound = vehicle.bank_acceleration_bound
    drawn = ", ".join(f"{deviation:g}" for deviation in ensemble.initial_deviations)
    rows = [
        (
            f"law (deviations at entry: {drawn} m in {', '.join(CHANNELS)})",
            *(
                f"{channel}: {what}"
                for channel in CHANNELS
                for what in ("deviation (m)", "by linear covariance (m)", "flown over linear")
            ),
            "final error: median (m)",
            "99th percentile (m)",
            "lost trials",
            "trials with a clipped command (%)",
            "propellant without errors at entry (kg)",
            "mean propellant (kg)",
            "its deviation (kg)",
            "trials",
        )
    ]
    for number, law in enumerate(entry_errors.law):
        flown = entry_errors.outcome[number] == COMPLETED
        error, trials = entry_errors.final_error[number, flown], len(flown)
        known = len(error) > 1
        linear = np.sqrt((gains.final[number] * ensemble.initial_deviations) ** 2 @ np.ones(len(CHANNELS)))
        spread = error.std(axis=0, ddof=1) if known else np.full(len(CHANNELS), np.nan)
        cells = []
        for channel, uncertainty in enumerate(_deviation_errors(error, spread)):
            cells += [
                f"{_number(spread[channel], '.1f')} ± {_number(uncertainty, '.1f')}" if known else NO_VALUE,
                _number(linear[channel], ".1f"),
                _number(spread[channel] / linear[channel], ".4g") if linear[channel] > 0.0 else NO_VALUE,
            ]
        # A lost trial is worse than any other.
        size = np.where(flown, np.linalg.norm(entry_errors.final_error[number], axis=1), np.inf)
        command = entry_errors.observed_maximum[number, :, components.COMMAND_MAGNITUDE]
        clipped = np.count_nonzero(~(command <= (1.0 + entry_problem.ROUNDING) * bound))
        fuel = propellant(vehicle, entry_errors.final_state[number, flown, components.CUMULATIVE])
        rows.append(
            (
                LAW_NAMES[str(law)],
                *cells,
                *(_number(np.quantile(size, level, method="higher"), ".1f") for level in (0.5, 0.99)),
                f"{trials - len(error):,}",
                f"{100 * clipped / trials:.2f}",
                _number(propellant(vehicle, entry_errors.nominal[number, -1, components.CUMULATIVE]), ".4f"),
                *(_number(value, ".4f") for value in ((fuel.mean(), fuel.std(ddof=1)) if known else (np.nan, np.nan))),
                f"{trials:,}",
            )
        )
    return rows


def _deviation_errors(samples, deviation):
    """Standard errors of the standard deviations of samples (count, n), of any distribution."""
    if len(samples) < 3:
        return np.full(len(deviation), np.nan)
    of_variance = np.diag(covariance_standard_errors(samples))
    return np.divide(of_variance, 2.0 * deviation, out=np.zeros(len(deviation)), where=deviation > 0.0)


# ---- certificates ----------------------------------------------------------------------------------------------------


def _case_name(weight):
    return f"c = {weight:.4g}" if weight else "no-DOC"


def discretisation_errors(certificates: Certificates):
    """Both cases by every scheme on every mesh: effort, errors by the scheme and as flown, and orders."""
    found = certificates
    rows = [
        (
            "case",
            "scheme",
            "intervals",
            "J0 (deg^2/s^3)",
            "cumulative bank rate (deg/s)",
            "largest change of the bank angle from the inputs' mesh (deg)",
            "final error by the scheme's sensitivity (m)",
            "by differences of flights (m)",
            "norm of their difference (m)",
            "order",
            "target missed when flown again (m)",
            "order of the miss",
            "solver",
        )
    ]
    for case, scheme, mesh in np.ndindex(found.mesh_status.shape):
        run = (case, scheme, mesh)
        error, flown = found.mesh_error[run], found.mesh_flown_error[run]
        orders = [
            values[case, scheme, mesh - 1] if mesh else np.nan for values in (found.error_order, found.miss_order)
        ]
        rows.append(
            (
                _case_name(found.weight[case]),
                str(found.scheme[scheme]),
                f"{found.intervals[mesh]}",
                _number(found.mesh_effort[run], ".5f"),
                _number(found.mesh_cumulative[run] / DEGREE, ".4f"),
                _number(found.mesh_bank_change[run] / DEGREE, ".3f"),
                _number(np.linalg.norm(error), ".2f"),
                _number(np.linalg.norm(flown), ".2f"),
                _number(np.linalg.norm(error - flown), ".3g"),
                _number(orders[0], ".2f"),
                _number(np.linalg.norm(found.mesh_miss[run]), ".3g"),
                _number(orders[1], ".2f"),
                f"{found.mesh_status[run]}, {found.mesh_iterations[run]} iterations",
            )
        )
    return rows


def identities(certificates: Certificates):
    """Identities, symmetries, stationarity and derivatives by row of Table 3; some are examined in some rows only."""
    found = certificates
    rows = [("check", *(_case_name(weight) for weight in found.row_weight))]

    def by_row(name, values):
        rows.append((name, *(_number(value, ".1e") for value in values)))

    def at(row_weights, name, values):
        """Values that belong to rows of these weights, texts already."""
        known = dict(zip(row_weights, values, strict=True))
        rows.append((name, *(known.get(weight, "") for weight in found.row_weight)))

    by_row("longitude column less its unit vector, largest at any node (m/m)", found.row_longitude_deviation)
    by_row("final crossrange column less that of a turned flight (m/m)", found.row_crossrange_deviation)
    by_row("solver's radius column against the recursion, relative", found.row_solver_deviation)
    by_row("adjoint against forward (m/m)", found.row_adjoint_deviation)
    by_row(
        "squared norm of all columns against that of the radius column and the turn, relative",
        found.row_frobenius_deviation,
    )
    by_row("largest defect of an interval, in the scales of the states", found.row_defect)
    by_row("the same of the flight seen in a mirror", found.mirrored_defect)
    by_row("the same of the flight moved in longitude", found.shifted_defect)
    by_row("change of the final error in the mirror (m)", found.mirrored_error_deviation)
    by_row("change of the final error when moved (m)", found.shifted_error_deviation)
    at(
        found.slope_weight,
        "dJ0/d(norm) over minus the weight, less one",
        [_number(value, "+.1e") for value in found.slope_deviation],
    )

    def largest(values, form=".1e"):
        """Largest over schemes and meshes, of what was solved."""
        return [_number(np.max(case, initial=-np.inf, where=np.isfinite(case)), form) for case in values]

    at(found.weight, "longitude column, largest over schemes and meshes (m/m)", largest(found.mesh_longitude_deviation))
    at(
        found.weight,
        "crossrange column, largest over schemes and meshes (m/m)",
        largest(found.mesh_crossrange_deviation),
    )
    at(found.weight, "sensitivity against differences of the discrete flow, relative", largest(found.flow_deviation))
    exact = list(found.variant).index(EXACT)
    for number, variant in enumerate(found.variant):
        told = [
            f"{s}, {i} iterations"
            for s, i in zip(found.variant_status[:, number], found.variant_iterations[:, number], strict=True)
        ]
        at(found.weight, f"derivatives {variant}: solver", told)
        if number != exact:
            change = found.variant_effort[:, number] / found.variant_effort[:, exact] - 1.0
            at(
                found.weight,
                f"derivatives {variant}: J0 over that of {EXACT} ones, less one",
                [_number(v, "+.1e") for v in change],
            )
    flown, linear = (np.linalg.norm(errors, axis=-1) for errors in (found.flown_error, found.linear_error))
    for number, size in enumerate(found.radius_error):
        ratios = [_number(value, ".5f") for value in flown[:, number] / linear[:, number]]
        at(found.weight, f"flown over linear final error for {size:+g} m of radius", ratios)
    return rows


# ---- other solutions -------------------------------------------------------------------------------------------------


def local_minima(simulation: Simulation, branches: Branches):
    """Local minima of the problem without weight, by control energy, and how they were found."""
    found = branches
    rows = [
        (
            "solution",
            "J0 (deg^2/s^3)",
            "cumulative bank rate (deg/s)",
            "fuel (kg)",
            "final time (s)",
            "bank reversals",
            "full rolls",
            f"final position error for {simulation.tabulated_error:+g} m of radius (m)",
            "its altitude, crossrange, downrange (m)",
            f"random starts that led there, of {found.starts}",
            "bank angle's largest change when shaken and solved again (deg)",
        )
    ]
    for number, name in enumerate(found.name):
        rows.append(
            (
                f"{name} (the nominal)" if number == found.nominal else str(name),
                _number(found.effort[number], ".4f"),
                _number(found.cumulative[number] / DEGREE, ".3f"),
                _number(found.propellant[number], ".4f"),
                _number(found.final_time[number], ".2f"),
                f"{found.reversals[number]}",
                f"{found.rolls[number]}",
                _number(np.linalg.norm(found.error[number]), ".1f"),
                _list(found.error[number], ".1f"),
                f"{found.found[number]}",
                _number(found.returned[number] / DEGREE, ".1e"),
            )
        )
    rows.append(("starts that led to none", *[""] * 8, f"{found.failed_starts}", ""))
    return rows


def bank_conditions(mission: Mission, published, branches: Branches):
    """Every choice of conditions on the bank, solved from the nominal; first what meets the first row best."""
    found, (effort, cumulative) = branches, published["tab03_c0"].printed[:2]
    values = mission.initial_bank, mission.initial_bank_rate, mission.final_bank, mission.final_bank_rate
    rows = [
        (
            "initial bank angle (deg)",
            "initial bank rate (deg/s)",
            "final bank angle (deg)",
            "final bank rate (deg/s)",
            "J0 (deg^2/s^3)",
            "over the printed",
            "cumulative bank rate (deg/s)",
            "over the printed (cumulative)",
            "distance from both (%)",
            "bank reversals",
            "used here",
            "solver",
        )
    ]
    own = np.array([value is not None for value in values])
    ratios = np.column_stack([found.set_effort / effort, found.set_cumulative / DEGREE / cumulative])
    distance = np.linalg.norm(ratios - 1.0, axis=1)
    for number in np.argsort(distance):  # NaN last
        fixed = found.set_fixed[number]
        rows.append(
            (
                *(
                    f"{(value or 0.0) / DEGREE:g}" if held else "free"
                    for value, held in zip(values, fixed, strict=True)
                ),
                _number(found.set_effort[number], ".4f"),
                _number(ratios[number, 0], ".4f"),
                _number(found.set_cumulative[number] / DEGREE, ".4f"),
                _number(ratios[number, 1], ".4f"),
                _number(100.0 * distance[number], ".2f"),
                f"{found.set_reversals[number]}" if np.isfinite(distance[number]) else NO_VALUE,
                "yes" if np.array_equal(fixed, own) else "",
                str(found.set_status[number]),
            )
        )
    return rows


def fold(tradeoff: Tradeoff, branches: Branches):
    """The nominal's branch at given final errors, through its fold, and where the path over the weight leaves it."""
    found = branches
    rows = [
        (
            "point",
            "final position error (m)",
            "least J0 (deg^2/s^3)",
            "weight of which it is stationary (deg^2/s^3)",
            "bank angle at deployment (deg)",
        )
    ]
    beyond = found.curve_error < found.fold_error  # nowhere, if there is none
    for number, error in enumerate(found.curve_error):
        rows.append(
            (
                "beyond the fold" if beyond[number] else "on the branch",
                _number(error, ".2f"),
                _number(found.curve_effort[number], ".6f"),
                _number(found.curve_weight[number], ".7f"),
                _number(found.curve_final_bank[number] / DEGREE, ".2f"),
            )
        )
    top = _number(found.fold_error, ".2f"), NO_VALUE, _number(found.fold_weight, ".7f"), NO_VALUE
    rows.insert(
        1 + np.count_nonzero(~beyond), ("fold, largest weight" if np.isfinite(found.fold_weight) else "no fold", *top)
    )
    for ends in zip(tradeoff.fold_error, tradeoff.fold_effort, tradeoff.fold_weight, strict=True):
        for side, name in enumerate(("last before it leaves a branch", "first on the next branch")):
            error, effort, weight = (values[side] for values in ends)
            cells = _number(error, ".2f"), _number(effort, ".6f"), _number(weight, ".7f"), NO_VALUE
            rows.append((f"path over the weight: {name}", *cells))
    return rows


def dominance(branches: Branches):
    """Rows of Table 3 against the least control energy found on any branch at no larger error."""
    found = branches
    rows = [
        (
            "c1",
            "final position error (m)",
            "J0 of the row (deg^2/s^3)",
            "least J0 found at no larger error (deg^2/s^3)",
            "over the row's",
            "on the branch that begins at",
        )
    ]
    for number, weight in enumerate(found.row_weight):
        solution = found.least_solution[number]
        start = f"{found.name[solution]}, J0 {found.effort[solution]:.4g}" if solution >= 0 else "the row itself"
        rows.append(
            (
                _weight_name(weight),
                _number(found.row_error[number], ".1f"),
                _number(found.row_effort[number], ".4f"),
                _number(found.least_effort[number], ".4f"),
                _ratio(found.least_effort[number], found.row_effort[number]),
                start,
            )
        )
    return rows


def least_fuel(minimum_fuel: MinimumFuel):
    """Least control energy and least fuel under each bound of the bank acceleration, and how the thrust is spread."""
    found, least = minimum_fuel, SOLUTIONS.index("least fuel")
    rows = [
        (
            "solution",
            "bound of the bank acceleration (deg/s^2)",
            "J0 (deg^2/s^3)",
            "cumulative bank rate (deg/s)",
            "over the least",
            "fuel (kg)",
            "final time (s)",
            "bank reversals",
            "intervals without thrust (%)",
            "intervals at the bound (%)",
            "bursts of thrust",
            "contradiction of thrust and switching function",
            "nominal's branch ends at a share of the fuel in the cost of",
            "solver",
        )
    ]

    def count(number):
        return f"{number}" if number >= 0 else NO_VALUE

    for case in np.ndindex(found.status.shape):
        bound, solution = case
        of_fuel = solution == least
        rows.append(
            (
                str(found.solution[solution]),
                f"{found.bound[bound] / DEGREE:g}",
                _number(found.effort[case], ".4f"),
                _number(found.cumulative[case] / DEGREE, ".4f"),
                _ratio(found.cumulative[case], found.cumulative[bound, least]),
                _number(found.propellant[case], ".4f"),
                _number(found.time[case][-1], ".2f"),
                count(found.reversals[case]),
                _number(100.0 * found.coasting[case], ".1f"),
                _number(100.0 * found.at_bound[case], ".1f"),
                count(found.bursts[case]),
                _number(found.switching_violation[bound], ".1e") if of_fuel else "",
                _number(found.branch_share[bound], ".4g") if of_fuel else "",
                str(found.status[case]),
            )
        )
    return rows


# ---- further perturbations -------------------------------------------------------------------------------------------


def other_perturbations(tradeoff: Tradeoff, further_perturbations: FurtherPerturbations):
    """What other errors come to in the rows of Table 3, and in solutions that weigh density instead of radius."""
    found = further_perturbations
    names = [_size_and_name(*pair) for pair in zip(found.perturbation, found.size, strict=True)]
    rows = [
        (
            "sensitivity weighed",
            "weight (deg^2/s^3)",
            "J0 (deg^2/s^3)",
            "fuel (kg)",
            "branch begins with",
            *(f"{name}: final error {how} (m)" for name in names for how in ("by the sensitivity", "flown, + / -")),
        )
    ]

    def row(name, weight, effort, fuel, branch, linear, flown):
        cells = []
        for one, (plus, minus) in zip(np.linalg.norm(linear, axis=-1), np.linalg.norm(flown, axis=-1), strict=True):
            cells += [_number(one, ".1f"), f"{_number(plus, '.1f')} / {_number(minus, '.1f')}"]
        return (name, f"{weight:.4g}", _number(effort, ".4f"), _number(fuel, ".4f"), str(branch), *cells)

    for number, weight in enumerate(found.row_weight):
        name = f"radius: c1 = {_weight_name(tradeoff.printed_weight[number])}"
        branch = tradeoff.branch[tradeoff.row_branch[number]]
        cost = tradeoff.effort[number], tradeoff.propellant[number]
        rows.append(row(name, weight, *cost, branch, found.row_linear_error[number], found.row_flown_error[number]))
    for number, weight in enumerate(found.design_weight):
        if weight > 0.0:  # without weight it is the nominal again
            branch = found.branch[found.design_branch[number]]
            cost = found.design_effort[number], found.design_propellant[number]
            errors = found.design_linear_error[number], found.design_flown_error[number]
            rows.append(row("density", weight, *cost, branch, *errors))
    rows.append((f"density: the path ends {found.path_end}", *[""] * (len(rows[0]) - 1)))
    return rows


def _size_and_name(perturbation, size):
    """A perturbation with its size in the unit of a table."""
    units = {"density": (100.0, " %"), "velocity": (1.0, " m/s"), "flight path angle": (1.0 / DEGREE, " deg")}
    factor, unit = units.get(str(perturbation), (1.0, " m"))
    return f"{perturbation} {size * factor:g}{unit}"


def density_feedback(further_perturbations: FurtherPerturbations):
    """Feedback on the nominal against density errors: gains, and final errors of density and radius, flown."""
    found = further_perturbations
    known = dict(zip(found.perturbation, found.size, strict=True))
    rows = [
        (
            "feedback",
            GAINS_HEAD,
            "converged",
            "how the search ended",
            *(f"{_size_and_name(name, known[name])}: by the sensitivity (m)" for name in ("density", "radius")),
            *(f"density {100 * error:+g} %: flown (m)" for error in found.density_error),
            *(f"radius {error:+g} m: flown (m)" for error in found.radius_error),
        )
    ]
    for number, law in enumerate(found.law):
        errors = (found.law_linear_error, found.density_flown_error, found.radius_flown_error)
        norms = np.concatenate([np.linalg.norm(values[number], axis=-1) for values in errors])
        rows.append(
            (
                str(law),
                _list(found.scaled_gain[number], ".4f") if found.scaled_gain[number].any() else "none",
                "yes" if found.converged[number] else "no",
                str(found.ended[number]),
                *(_number(value, ".1f") for value in norms),
            )
        )
    return rows


# ---- over all readings -----------------------------------------------------------------------------------------------


def readings(readings: dict[str, tuple[DesensitizedInputs, Records]], published):
    """What each reading gives.

    readings: inputs and `Records` by reading. published: claims by id. Returns rows of text.
    """
    rows = [
        (
            "reading",
            "inputs that differ from corrected (SI)",
            "no DOC: J0 (deg^2/s^3)",
            "cumulative bank rate (deg/s)",
            "fuel (kg)",
            "final position error (m)",
            "bank reversals",
            "largest finite c1: weight (deg^2/s^3)",
            "its final position error (m)",
            "largest reduction (%)",
            *(f"{channel}: error at entry, final without and with feedback (m)" for channel in CHANNELS),
            "gains that did not converge",
            "trials lost, by law",
            "trials",
        ),
        (
            PAPER,
            "",
            *map(_printed, published["tab03_c0"].printed),
            f"{published['nodoc_two_reversals'].printed}",
            f"c1 = {max(c1 for c1 in published['c1_values'].printed if np.isfinite(c1)):g}",
            f"{published['tab03_c1'].printed[-1]:g}",
            f"{published['max_reduction_percent'].printed:g}",
            *[""] * (len(CHANNELS) + 3),
        ),
    ]
    default = readings["corrected"][0]
    for name, (inputs, records) in readings.items():
        tradeoff, gains, responses, ensemble = (
            *(records.tradeoff, records.gains),
            *(records.responses, records.entry_errors),
        )
        errors, row = np.linalg.norm(tradeoff.error, axis=1), last_finite_row(tradeoff)
        laws, flown = list(gains.law), np.linalg.norm(responses.error[:, :, -1], axis=-1)
        against = (
            (responses.drawn_error[k], flown[laws.index(NO_DOC), k], flown[laws.index(channel), k])
            for k, channel in enumerate(CHANNELS)
        )
        lost = np.count_nonzero(ensemble.outcome != COMPLETED, axis=1)
        rows.append(
            (
                name,
                _differences(inputs, default),
                *_row_cells(_row_numbers(tradeoff, 0)),
                f"{tradeoff.reversals[0]}",
                f"{tradeoff.weight[row]:.4g}",
                _number(errors[row], ".1f"),
                _number(100.0 * (1.0 - errors.min() / errors[0]), ".1f"),
                *(
                    ", ".join((f"{size:g}", _number(without, ".1f"), _number(fed, ".1f")))
                    for size, without, fed in against
                ),
                ", ".join(LAW_NAMES[str(law)] for law in gains.law[~gains.converged]) or "none",
                ", ".join(f"{number:,}" for number in lost),
                f"{ensemble.outcome.shape[1]:,}",
            )
        )
    return rows


def _differences(of_reading: DesensitizedInputs, default: DesensitizedInputs):
    """Inputs that differ from the default reading's, with their values where these are short."""
    told = []
    for name, path in sorted((path.partition(".")[2], path) for path in of_reading.names()):
        value = of_reading.get(path)
        if name in _SIZES or np.array_equal(value, default.get(path)):
            continue
        if isinstance(value, np.ndarray):
            told.append(name)
        else:
            told.append(f"{name} {'free' if value is None else value if isinstance(value, str) else f'{value:.6g}'}")
    return ", ".join(told)


def weights(readings: dict[str, tuple[DesensitizedInputs, Records]], published):
    """Table 3 of all readings, row by row: by the printed weights, and at the printed control energies.

    Readings share a line where they have the same row. readings: inputs and `Records` by reading. published: claims by
    id. Returns rows of text.
    """
    rows = [
        (
            "c1",
            "reading",
            "row taken",
            "norm of the sensitivity: columns, length that counts as a radian",
            "weight (deg^2/s^3)",
            "weight over c1",
            "J0 (deg^2/s^3)",
            "cumulative bank rate (deg/s)",
            "fuel (kg)",
            "final position error (m)",
            "branch begins with",
            "bank reversals",
        )
    ]
    printed = printed_rows(published)
    found = sorted(readings.items(), key=lambda item: item[1][0].design.weight_rule != "proportional")
    wanted = {_c1(value) for _, records in readings.values() for value in records.tradeoff.printed_weight}
    for c1 in sorted(wanted | set(printed)):
        lines = {}
        for name, (inputs, records) in found:
            tradeoff = records.tradeoff
            for number in (k for k, value in enumerate(tradeoff.printed_weight) if _c1(value) == c1):
                cells = _weight_cells(inputs.design, tradeoff, number, c1)
                lines.setdefault(cells, []).append(name)
        rows.append((_weight_name(c1), PAPER, *[""] * 4, *map(_printed, _paper_row(printed, c1)), "", ""))
        rows += [(_weight_name(c1), ", ".join(names), *cells) for cells, names in lines.items()]
    return rows


def _weight_cells(design: Design, tradeoff, number, c1):
    """A reading's row of Table 3 as `weights` shows it."""
    weight, rule, over = tradeoff.weight[number], "", ""
    if 0.0 < c1 < np.inf:
        proportional = design.weight_rule == "proportional"
        rule = f"c = {design.weight_factor:g} c1" if proportional else "at the printed J0"
        over = f"{weight / c1:.4g}"
    columns = "all" if design.sensitivity_columns == "all" else "radius"
    return (
        rule,
        f"{columns}, {design.sensitivity_length / KILOMETRE:g} km" if weight else "",
        f"{weight:.5g}",
        over,
        *_row_cells(_row_numbers(tradeoff, number)),
        str(tradeoff.branch[tradeoff.row_branch[number]]),
        f"{tradeoff.reversals[number]}",
    )
