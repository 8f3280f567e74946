"""Tables 1 to 4, Eq. 77, the design's certificates, the error budget, and what each reading reproduces."""

from dataclasses import replace

import numpy as np

from marsedl.montecarlo.outcomes import COMPLETED
from marsedl.montecarlo.statistics import percentile_spread
from marsedl.montecarlo.streaming import FinalMoments, is_streamed, outcome_count
from marsedl.papers.stochastic_entry import dispersions
from marsedl.papers.stochastic_entry.claims import (
    FEASIBLE,
    LEVELS,
    ROUNDING,
    ROWS,
    SIGMAS,
    crossrange_of_azimuth,
    final_percentiles,
    finite,
    finite_count,
    halving,
    outcomes,
    reduction,
)
from marsedl.papers.stochastic_entry.inputs import (
    Air,
    Design,
    Guidance,
    Mission,
    Planet,
    Simulation,
    StochasticEntryInputs,
    Vehicle,
)
from marsedl.papers.stochastic_entry.records import (
    ALTITUDE,
    CASES,
    COARSE,
    DOWNRANGE,
    OUTCOMES,
    REVERSALS,
    START_SCALES,
    TRIGGERS,
    VELOCITY,
    Certificates,
    ErrorBudget,
    FlightEnsemble,
    Gains,
    Linearization,
    by_case,
    errors,
)
from marsedl.replication.claims import Evaluation, judge

NO_VALUE = "–"


def _case(name):
    return name.replace("_", ", ").capitalize()


def _km(metres):
    return f"{metres / 1e3:.2f}"


def _number(value, form):
    return f"{value:{form}}" if np.isfinite(value) else NO_VALUE


def tab01(vehicle: Vehicle):
    """Table 1 from the inputs."""
    body = dispersions.body_of(vehicle)
    area = f"{np.pi * vehicle.reference_diameter**2 / 4:.3f} (pi {vehicle.reference_diameter:g}^2 / 4)"
    return [
        ("property", "value", "unit"),
        ("mass", f"{vehicle.mass:g}", "kg"),
        ("reference area", area, "m^2"),
        ("trimmed angle of attack", f"{np.degrees(vehicle.trim_angle_of_attack):g}", "deg"),
        ("lift over drag", f"{vehicle.lift_to_drag:g}", "1"),
        ("ballistic coefficient", f"{vehicle.ballistic_coefficient:g}", "kg/m^2"),
        ("drag coefficient that follows", f"{body.drag_coefficient:.4f}", "1"),
        ("lift coefficient that follows", f"{body.lift_coefficient:.4f}", "1"),
    ]


def tab02(planet: Planet, mission: Mission):
    """Table 2 from the inputs."""

    def angles(value, deviation):
        return f"{np.degrees(value):g}", f"{np.degrees(deviation):g}"

    _, crossrange = crossrange_of_azimuth(planet, mission)
    velocity = f"{mission.entry_velocity / 1e3:g} km/s", f"{mission.entry_velocity_three_sigma:g} m/s"
    return [
        ("state", "nominal", "three sigma", "unit"),
        ("altitude", f"{planet.atmosphere_altitude / 1e3:g}", "0", "km"),
        ("velocity", *velocity, ""),
        (
            "flight path angle",
            *angles(mission.entry_flight_path_angle, mission.entry_flight_path_angle_three_sigma),
            "deg",
        ),
        ("heading azimuth", *angles(mission.entry_azimuth, mission.entry_azimuth_three_sigma), "deg"),
        ("downrange", "0", f"{mission.entry_downrange_three_sigma / 1e3:g}", "km"),
        ("crossrange", _km(crossrange), f"{mission.entry_crossrange_three_sigma / 1e3:g}", "km"),
    ]


def tab03(air: Air, vehicle: Vehicle):
    """Table 3 from the inputs, with the surrogate of the density samples."""
    low, high = np.degrees(vehicle.trim_interval)
    lift, drag = vehicle.lift_dispersion, vehicle.drag_dispersion
    return [
        ("source of uncertainty", "in the paper", "here"),
        ("state at entry", "Gaussian (Table 2)", "Gaussian (Table 2)"),
        (
            "density of the atmosphere",
            "Mars-GRAM samples",
            f"Ornstein-Uhlenbeck surrogate about the mean density `{air.density_profile}`, with exactly the "
            f"variance `{air.variance_profile}`",
        ),
        (
            "aerodynamics",
            "trim angle of attack uniform, about 0.15 in C_L and 0.02 in C_D",
            f"uniform between {low:g} and {high:g} deg, from {-lift:+g} to {lift:+g} in C_L and from {-drag:+g} to "
            f"{drag:+g} in C_D",
        ),
    ]


def tab04(
    simulation: Simulation,
    published,
    apollo_time: FlightEnsemble,
    apollo_velocity: FlightEnsemble,
    stochastic_time: FlightEnsemble,
    stochastic_velocity: FlightEnsemble,
):
    """Percentiles of the final errors beside Table 4, from the paper's number of trials and from all."""
    flights = by_case(apollo_time, apollo_velocity, stochastic_time, stochastic_velocity)
    size = int(simulation.paper_trials)
    rows = [
        (
            "final error",
            "law, trigger",
            "percentile",
            "in the paper",
            f"first {size:,} trials",
            "standard error",
            f"spread over sets of {size:,}",
            "all trials",
            "standard error (all)",
            "distance in combined standard errors",
            "trials",
        )
    ]
    for state, name, factor, unit in ROWS:
        for case, ensemble in flights.items():
            first, whole = (final_percentiles(ensemble, trials, [state])[state] for trials in (size, None))
            sample = errors(ensemble)[finite(ensemble), state] * factor
            claim = published[f"tab4_{name}_{case}"]
            for side, level in enumerate(LEVELS):
                printed, resolution = claim.printed[side], claim.resolution[side]
                value, error = whole[0][side] * factor, whole[1][side] * factor
                try:
                    spread = _number(percentile_spread(sample, level, size)[1], ".3f")
                except ValueError:  # too few trials for two sets
                    spread = NO_VALUE
                cell = replace(claim, printed=printed, resolution=resolution)
                _, judged = judge(cell, Evaluation(value, error, finite_count(ensemble)))
                distance = judged["largest"] if judged else np.nan
                rows.append(
                    (
                        f"{name.replace('gamma', 'flight path angle')} ({unit})",
                        _case(case),
                        f"{100 * level:g}",
                        f"{printed:g}",
                        _number(first[0][side] * factor, ".3f"),
                        _number(first[1][side] * factor, ".3f"),
                        spread,
                        _number(value, ".3f"),
                        _number(error, ".3f"),
                        _number(distance, "+.1f"),
                        f"{finite_count(ensemble):,}",
                    )
                )
    for case, ensemble in flights.items():
        completed, trials = outcome_count(ensemble, COMPLETED), ensemble.count + ensemble.excluded
        told = f"{completed:,} {OUTCOMES[COMPLETED]}" + (", " + outcomes(ensemble) if outcomes(ensemble) else "")
        rows.append(("how trials ended", _case(case), *[""] * 5, told, "", "", f"{trials:,}"))
    return rows


def zf(air: Air, published, linearization: Linearization):
    """Z_f element by element beside Eq. 77."""
    claim = published["zf_column_velocity"]
    states = ("radius", "velocity", "flight path angle", "range", "density")
    fitted = air.density_profile == "log_quadratic"
    rows = [("row", "column", "in the paper", "here", "difference", "within the printed rounding")]
    for i, j in np.ndindex(linearization.trigger_projection.shape):
        value = linearization.trigger_projection[i, j]
        printed, resolution = (claim.printed[i], claim.resolution[i]) if j == VELOCITY else (float(i == j), ROUNDING)
        verdict, _ = judge(replace(claim, printed=printed, resolution=resolution), Evaluation(value))
        within = "yes" if verdict == "reproduced" else "no"
        rows.append((states[i], states[j], f"{printed:g}", f"{value:.6g}", f"{value - printed:+.2g}", within))
    if fitted:
        fit = "this density is fitted to the velocity column: its agreement is no evidence"
        rows.append(("", "", "", fit, "", ""))
    return rows


def certificates(gains: Gains, certificates: Certificates):
    """The stochastic law against independent formulations, by trigger."""

    def both(values, form=".1e"):
        return [_number(value, form) for value in values]

    rows = [("check of the stochastic law", *(f"{trigger} trigger" for trigger in TRIGGERS))]
    rows += [
        ("deviation of the objective (m)", *both(np.sqrt(gains.cost), ".4f")),
        ("floor that noise after the last control makes (m)", *both(np.sqrt(gains.noise_floor), ".4f")),
        ("duality gap over the objective", *both(gains.gap)),
        ("duality gap over what is above the floor", *both(gains.gap_above_floor)),
        ("largest control deviation over its limit", *both(gains.control_ratio.max(axis=1), ".6f")),
        ("final altitude deviation over its limit", *both(gains.final_ratio[:, 0], ".6f")),
        ("final path angle deviation over its limit", *both(gains.final_ratio[:, 1], ".6f")),
        ("multiplier of the altitude limit (m^2 per m^2)", *both(gains.final_multiplier[:, 0], ".3g")),
        ("multiplier of the path angle limit (m^2 per rad^2)", *both(gains.final_multiplier[:, 1], ".3g")),
        ("control limits reached", *(f"{np.sum(ratio > 1.0 - FEASIBLE)}" for ratio in gains.control_ratio)),
        ("complementarity", *both(gains.complementarity)),
        ("solver of the dual", *(f"{s}, {n:,} sweeps" for s, n in zip(gains.status, gains.iterations, strict=True))),
        ("multipliers as LQG weights: largest error of the gains", *both(certificates.weights_gain_error)),
        ("perturbed gains: least change of the Lagrangian", *both(certificates.perturbed_cost, "+.1e")),
        (f"on intervals of {COARSE:g} s: duality gap", *both(certificates.coarse_gap)),
        ("cone program, cost over the dual's less one", *both(certificates.cone_ratio - 1.0, "+.1e")),
        (
            "cone program, solver",
            *(
                f"{s}, {n} iterations"
                for s, n in zip(certificates.cone_status, certificates.cone_iterations, strict=True)
            ),
        ),
    ]
    for start, scale in enumerate(START_SCALES):
        found = (
            f"{ratio:.5f}, {worst:.4g}, {evaluations:,}, {'yes' if done else 'no'}"
            for ratio, worst, evaluations, done in zip(
                *(
                    getattr(certificates, f"search_{field}")[:, start]
                    for field in ("ratio", "worst", "evaluations", "success")
                ),
                strict=True,
            )
        )
        outputs = "cost ratio, worst limit ratio, sweeps, success"
        rows.append((f"search over LQG weights, control weights times {scale:g}: {outputs}", *found))
    return rows


def sources(error_budget: ErrorBudget):
    """Range deviation by law, trigger and source, with its share of the variance from all sources together."""
    budget = error_budget
    sources = [str(source) for source in budget.source]
    whole = sources.index("all")
    rows = [
        (
            "source",
            *(
                f"{law}, {trigger}: {what}"
                for law in budget.law
                for trigger in TRIGGERS
                for what in ("deviation (m)", "%")
            ),
        )
    ]
    share = 100 * budget.deviation**2 / budget.deviation[..., whole, np.newaxis] ** 2

    def row(name, deviation, portion):
        cells = []
        for index in np.ndindex(deviation.shape):
            cells += [_number(deviation[index], ".1f"), _number(portion[index], ".1f")]
        rows.append((name, *cells))

    for number, source in enumerate(sources):
        row(source, budget.deviation[..., number], share[..., number])
    alone = np.delete(budget.deviation, whole, axis=-1)
    total = np.sqrt((alone**2).sum(axis=-1))
    row("root of the sum of squares of all sources alone", total, 100 * total**2 / budget.deviation[..., whole] ** 2)
    floor = np.broadcast_to(budget.floor, total.shape)
    row("floor: density noise after the last control", floor, 100 * floor**2 / budget.deviation[..., whole] ** 2)
    missed = budget.missed.sum(axis=-1)
    cells = [cell for index in np.ndindex(missed.shape) for cell in (f"{missed[index]}", "")]
    rows.append((f"flights that did not end as they should, of {budget.trials:,} per source", *cells))
    return rows


def reversal_split(
    apollo_time: FlightEnsemble,
    apollo_velocity: FlightEnsemble,
    stochastic_time: FlightEnsemble,
    stochastic_velocity: FlightEnsemble,
):
    """Final range error by the number of bank reversals; of a streamed ensemble in its first trials."""
    flights = by_case(apollo_time, apollo_velocity, stochastic_time, stochastic_velocity)
    rows = [
        (
            "law, trigger",
            "bank reversals",
            "trials",
            "share (%)",
            "mean range error (km)",
            "1st percentile (km)",
            "99th percentile (km)",
        )
    ]
    for case, ensemble in flights.items():
        known = finite(ensemble)
        error, number = errors(ensemble)[known, DOWNRANGE], ensemble.final_state[known, REVERSALS]
        groups = [(f"{int(n)}", number == n) for n in np.unique(number)] + [("any", np.ones(len(number), bool))]
        for label, chosen in groups:
            if not chosen.any():
                rows.append((_case(case), "no finite trial", "0", *[NO_VALUE] * 4))
                continue
            low, high = np.quantile(error[chosen], LEVELS)
            share = 100 * chosen.sum() / len(ensemble.outcome)
            values = f"{chosen.sum():,}", f"{share:.2f}", _km(error[chosen].mean()), _km(low), _km(high)
            rows.append((_case(case), label, *values))
    return rows


def readings(readings, published):
    """What each reading reproduces: the nominal's end, Z_f, and range errors with bank reversals of all cases.

    readings: inputs and `Records` by reading. published: claims by id. Returns rows of text.
    """
    header = ["reading", "end short of the target (km)", "Z_f: range (m per m/s)", "Z_f: radius (m per m/s)"]
    for case in CASES:
        header += [f"{_case(case)}: 1st / 99th percentile of the range error (km)", f"{_case(case)}: bank reversals"]
    rows = [(*header, "trials")]
    zf_column = published["zf_column_velocity"].printed
    printed = [published[f"tab4_downrange_{case}"].printed for case in CASES]
    told = [cell for low, high in printed for cell in (f"{low:.2f} / {high:.2f}", "")]
    uprange = published["nominal_uprange"].printed
    rows.append(
        (
            "in the paper",
            f"{uprange:g}",
            f"{zf_column[DOWNRANGE]:g}",
            f"{zf_column[ALTITUDE]:g}",
            *told,
            f"{published['mc_trials'].printed:,}",
        )
    )
    for name, (inputs, records) in readings.items():
        flights = records.flights()
        projection = records.linearization.trigger_projection[:, VELOCITY]
        cells = [_km(-records.nominal.downrange[-1]), f"{projection[DOWNRANGE]:.2f}", f"{projection[ALTITUDE]:.2f}"]
        for case in CASES:
            cells += [_interval(flights[case]), _mean_reversals(flights[case])]
        trials = flights[CASES[0]].count + flights[CASES[0]].excluded
        rows.append((label_of(name, inputs), *cells, f"{trials:,}"))
    return rows


def headline(readings, published):
    """The headline in each reading, with a verdict computed from the numbers; arguments as of `readings`."""
    rows = [
        (
            "reading",
            "fixed time: narrower by (%)",
            "velocity trigger: narrower by (%)",
            "ratio of the 1st percentiles",
            "halved",
            "ratio of the 99th percentiles",
            "halved (99th)",
            "with the velocity trigger",
        )
    ]
    paper = {case: (np.array(published[f"tab4_downrange_{case}"].printed), np.zeros(2)) for case in CASES}
    rows.append(("in the paper", *_headline_row(paper)))
    for name, (inputs, records) in readings.items():
        flights = records.flights()
        tails = {case: final_percentiles(flights[case], index=[DOWNRANGE])[DOWNRANGE] for case in CASES}
        rows.append((label_of(name, inputs), *_headline_row(tails)))
    return rows


def _headline_row(tails):
    cells = []
    for trigger in TRIGGERS:
        saved, error = reduction(tails[f"stochastic_{trigger}"], tails[f"apollo_{trigger}"])
        cells.append(f"{100 * saved:.1f} ± {100 * error:.1f}" if np.isfinite(saved) else "not finite")
    halved = []
    for side in (0, 1):
        ratio, error, half = halving(tails["stochastic_velocity"], tails["apollo_velocity"], side)
        halved.append(half)
        known = np.isfinite(ratio)
        cells += [f"{ratio:.2f} ± {error:.2f}", "yes" if half else "no"] if known else ["not finite", NO_VALUE]
    if not np.isfinite(saved):
        verdict = "no finite trial under one of the laws"
    elif all(halved):
        verdict = "both percentiles are about halved"
    elif any(halved):
        verdict = f"only the {'1st' if halved[0] else '99th'} percentile is about halved"
    elif saved > SIGMAS * error:
        verdict = "narrower, but neither percentile is about halved"
    elif saved < -SIGMAS * error:
        verdict = "the stochastic law is wider"
    else:
        verdict = "no difference beyond sampling error"
    return (*cells, verdict)


def label_of(reading, inputs: StochasticEntryInputs):
    """The name of a reading, with a remark if it is a hypothesis."""
    return f"{reading} (hypothesis)" if hypothesis(inputs.guidance, inputs.design) else reading


def hypothesis(guidance: Guidance, design: Design):
    """Whether a reading assumes something of the laws that the paper does not print."""
    own = design.partition_interval == guidance.guidance_period
    return not (own and design.apollo_form == "five_state" and design.apollo_time_adjoint == "time")


def _interval(ensemble):
    values, deviations = final_percentiles(ensemble, index=[DOWNRANGE])[DOWNRANGE]
    if not np.isfinite(values).all():
        return "not finite"
    return " / ".join(f"{v / 1e3:.2f} ± {e / 1e3:.2f}" for v, e in zip(values, deviations, strict=True))


def _mean_reversals(ensemble):
    if is_streamed(ensemble):
        return _number(FinalMoments(ensemble, REVERSALS).mean, ".2f")
    number = ensemble.final_state[finite(ensemble), REVERSALS]
    return f"{number.mean():.2f}" if len(number) else NO_VALUE
