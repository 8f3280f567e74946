"""Sec. V.B, the Abstract and Sec. VI: the velocity trigger, Table 4, Fig. 13 and the headline."""

from typing import NamedTuple

import numpy as np

from marsedl.montecarlo.streaming import FinalMoments, is_streamed
from marsedl.papers.stochastic_entry.claims.measures import (
    ADJOINT,
    COVARIANCE,
    DEADBAND,
    DENSITY,
    FORM,
    LAW_NAMES,
    LAWS,
    PARTITION,
    RANGE_SIGN,
    ROWS,
    SIGNS,
    ComparedTails,
    Flights,
    Predicted,
    Tails,
    combined,
    correlation_of,
    finite,
    finite_count,
    half_tolerance,
    outcomes,
    ratio_of,
    reduction,
    velocity_errors,
    width,
)
from marsedl.papers.stochastic_entry.inputs import Air, Design, Mission
from marsedl.papers.stochastic_entry.objective import TRIGGER_NORMAL, final_weights, per_metre
from marsedl.papers.stochastic_entry.records import (
    CASES,
    DOWNRANGE,
    REVERSALS,
    STATES,
    TRIGGERS,
    VELOCITY,
    Combinations,
    ErrorBudget,
    Gains,
    Linearization,
    errors,
)
from marsedl.replication.claiming import Fails, claim, holds, measure, measured
from marsedl.replication.claims import Close, Evaluation, judge
from marsedl.replication.counterexamples import in_reading, scaled, shifted, spread
from marsedl.replication.thresholds import ROUNDING, STRONG, VISIBLE, WEAK

MOST_REVERSALS = 3  # of the nominal flight; where there are more, trials are told apart


# ---- Eqs. 76 to 79 ---------------------------------------------------------------------------------------------------


@claim()
def trigger_nu():
    return measured(TRIGGER_NORMAL)


@claim(
    """The density of `corrected` is fitted to these numbers, so their agreement is no evidence. The agreement of
    `desensitized_density` is evidence: nothing is fitted to its Mars-GRAM density here. It gives
    {desensitized_density[value][0]:.2f}, {desensitized_density[value][2]:.5f}, {desensitized_density[value][3]:.2f} and
    {desensitized_density[value][4]:.2e}.""",
    withheld=DENSITY,
    close=Close(
        "the entries follow from the mean density near the end, which the paper withholds. Mars-GRAM gives it to some "
        "per cent only, by version, place and season. Rounding alone is 3 % of the two small entries",
        relative=0.05,
    ),
    counterexample=scaled("linearization.trigger_projection", at=(slice(None), VELOCITY)),
)
def zf_column_velocity(air: Air, linearization: Linearization):
    rate = linearization.final_rates[VELOCITY]
    return measured(
        linearization.trigger_projection[:, VELOCITY],
        evidence=f"minus the nominal's final rates over its final rate of velocity, {rate:.4f} m/s^2",
        rate=rate,
        by_construction="the density is fitted to these numbers" if air.density_profile == "log_quadratic" else "",
    )


@claim(by_construction="an identity of Eq. 65 with the normal of Eq. 76")
def zf_structure(linearization: Linearization):
    other_columns = np.delete(linearization.trigger_projection - np.eye(STATES), VELOCITY, axis=1)
    return holds(measure("difference of the other columns from those of the identity", np.abs(other_columns)) <= 0)


def _preimage(projection, vector):
    """The least vector that the transpose of Z_f turns into a given one; Z_f' loses the trigger's normal only."""
    return np.linalg.lstsq(projection.T, vector, rcond=1e-10)[0]


@claim(by_construction="an identity: the weights are made by Eq. 78")
def af_velocity(design: Design, linearization: Linearization):
    units = np.array([design.weight_length, 1.0, 1.0, design.weight_length, 1.0])
    weight = final_weights(design, linearization)[1] * per_metre(design)
    return measured(
        _preimage(linearization.trigger_projection, weight) * units,
        evidence="least vector whose transform is the final weight of the velocity case, in the reading's unit of "
        "length",
    )


@claim(by_construction="an identity: the adjoint is made by Eq. 79")
def adjoint_velocity(linearization: Linearization, gains: Gains):
    transform = "least vector whose transform is the final adjoint of the velocity case"
    return measured(_preimage(linearization.trigger_projection, gains.adjoint[1, -1]), evidence=transform)


# ---- the study of combinations ---------------------------------------------------------------------------------------


class Searched(dict):
    """What the study of combinations found of the headline and of the range with the fixed time, for reasons."""


def searched(published, combinations: Combinations | None = None) -> Searched:
    """Count the combinations that halve the range with the trigger, and the widths with the fixed time."""
    if combinations is None:  # which only the reading of the study has
        return Searched()
    saved, widths = {}, {aim: [] for aim in TRIGGERS}
    for combination in combined(combinations):
        form, aim, interval, signs = combination.choices
        ranges = {case: tail[DOWNRANGE] for case, tail in combination.tails.items()}
        # The adjoint for the fixed time changes nothing with the trigger.
        saved[form, interval, signs] = reduction(ranges["stochastic_velocity"], ranges["apollo_velocity"])
        widths[aim].append(width(ranges["apollo_time"])[0] / 1e3)
    headline, trials = published["headline_range_reduction"], combinations.trials
    verdicts = {
        choices: judge(headline, Evaluation(100 * part, 100 * error, trials)).verdict
        for choices, (part, error) in saved.items()
    }
    near = [choices for choices, verdict in verdicts.items() if verdict == "reproduced"]
    return Searched(
        tried=len(saved),
        near=len(near),
        unsure=list(verdicts.values()).count("undetermined"),
        near_blind=sum(form == "density_blind" for form, _, _ in near),
        near_opposite=sum(signs == "opposite" for _, _, signs in near),
        best_opposite=100 * max(part for (_, _, signs), (part, _) in saved.items() if signs == "opposite"),
        widest_time=max(widths["time"]),
        narrowest_velocity=min(widths["velocity"]),
        widest_velocity=max(widths["velocity"]),
    )


# ---- Table 4 ---------------------------------------------------------------------------------------------------------

_STATES = {"downrange": "downrange", "altitude": "altitude", "velocity": "velocity", "gamma": "flight_path_angle"}


def _cell(row, case, reason="", errata="", withheld=()):
    """A cell of Table 4: its claim, with what is changed until its verdict is another one."""
    return claim(
        reason,
        errata=errata,
        withheld=withheld,
        counterexample=spread(f"{case}.final_state", component=_STATES[row]),
        name=f"tab4_{row}_{case}",
        row=row,
        case=case,
    )


@_cell(
    "downrange",
    "apollo_time",
    """The printed interval is {printed_width:.1f} km wide. We flew combinations of the open choices. Those whose
    adjoint aims at the final time are at most {widest_time:.1f} km wide. Those whose adjoint aims at the trigger are
    {narrowest_velocity:.1f} to {widest_velocity:.1f} km wide. Among these, `velocity_adjoint` gives
    {velocity_adjoint[compared][0]:.2f} / {velocity_adjoint[compared][1]:.2f} km. A law that is also blind to density
    gives {density_blind_velocity_adjoint[compared][0]:.2f} / {density_blind_velocity_adjoint[compared][1]:.2f} km.""",
    "E14 E21",
    (ADJOINT, FORM, RANGE_SIGN, DEADBAND),
)
@_cell(
    "downrange",
    "apollo_velocity",
    """From equal numbers of flights we find {compared[0]:.2f} / {compared[1]:.2f} km. An Apollo law blind to density, a
    hypothesis, gives {density_blind[compared][0]:.2f} / {density_blind[compared][1]:.2f} km. With aerodynamic errors of
    the same sign and short errors counted as positive too, a calibration, it gives
    {density_blind_same_sign_short[compared][0]:.2f} / {density_blind_same_sign_short[compared][1]:.2f} km.""",
    "E8 E14 E21",
    (FORM, SIGNS, RANGE_SIGN, DENSITY, DEADBAND),
)
@_cell(
    "downrange",
    "stochastic_time",
    """The partition decides it. From equal numbers of flights we find {compared[0]:.2f} / {compared[1]:.2f} km. With
    `partition_24` it is {partition_24[compared][0]:.2f} / {partition_24[compared][1]:.2f} km, with `partition_20`
    {partition_20[compared][0]:.2f} / {partition_20[compared][1]:.2f} km. But with those the law is not silent after
    entry, although the text says so.""",
    "E12",
    (PARTITION, DENSITY, RANGE_SIGN),
)
@_cell(
    "downrange",
    "stochastic_velocity",
    """Flights with more bank reversals than the nominal land long: they are {more_reversals:+.2f} km off on average,
    others {few_reversals:+.2f} km. How many there are depends on the deadband. With the Mars-GRAM fit and its deadband
    the percentiles are {desensitized_density[compared][0]:.2f} / {desensitized_density[compared][1]:.2f} km, from equal
    numbers of flights. With aerodynamic errors of the same sign they are {same_sign[compared][0]:.2f} /
    {same_sign[compared][1]:.2f} km. Counted with short errors as positive, these are
    {density_blind_same_sign_short[compared][0]:.2f} / {density_blind_same_sign_short[compared][1]:.2f} km.""",
    "E8 E21 E22",
    (SIGNS, RANGE_SIGN, DEADBAND, DENSITY),
)
@_cell(
    "altitude",
    "apollo_time",
    """From equal numbers of flights we find {compared[0]:.2f} / {compared[1]:.2f} km. With the Mars-GRAM fit it is
    {desensitized_density[compared][0]:.2f} / {desensitized_density[compared][1]:.2f} km. With the trigger's adjoint it
    is {velocity_adjoint[compared][0]:.2f} / {velocity_adjoint[compared][1]:.2f} km.""",
    "E14",
    (ADJOINT, DENSITY, FORM),
)
@_cell(
    "altitude",
    "apollo_velocity",
    """From equal numbers of flights we find {compared[0]:.2f} / {compared[1]:.2f} km. With the Mars-GRAM fit it is
    {desensitized_density[compared][0]:.2f} / {desensitized_density[compared][1]:.2f} km. With an Apollo law blind to
    density it is {density_blind[compared][0]:.2f} / {density_blind[compared][1]:.2f} km.""",
    "E14",
    (FORM, DENSITY),
)
@_cell("altitude", "stochastic_time")
@_cell(
    "altitude",
    "stochastic_velocity",
    """From equal numbers of flights we find {compared[0]:.2f} / {compared[1]:.2f} km. With aerodynamic errors of the
    same sign it is {same_sign[compared][0]:.2f} / {same_sign[compared][1]:.2f} km. With the Mars-GRAM fit it is
    {desensitized_density[compared][0]:.2f} / {desensitized_density[compared][1]:.2f} km.""",
    "E8",
    (SIGNS, DENSITY),
)
@_cell(
    "velocity",
    "apollo_time",
    """From equal numbers of flights we find {compared[0]:.1f} / {compared[1]:.1f} m/s. With the Mars-GRAM fit it is
    {desensitized_density[compared][0]:.1f} / {desensitized_density[compared][1]:.1f} m/s. With an Apollo law blind to
    density it is {density_blind[compared][0]:.1f} / {density_blind[compared][1]:.1f} m/s.""",
    "E14",
    (FORM, DENSITY),
)
@_cell(
    "velocity",
    "stochastic_time",
    """From equal numbers of flights we find {compared[0]:.1f} / {compared[1]:.1f} m/s. With `partition_20` it is
    {partition_20[compared][0]:.1f} / {partition_20[compared][1]:.1f} m/s. With the Mars-GRAM fit it is
    {desensitized_density[compared][0]:.1f} / {desensitized_density[compared][1]:.1f} m/s.""",
    "E12",
    (PARTITION, DENSITY),
)
@_cell(
    "gamma",
    "apollo_time",
    """From equal numbers of flights we find {compared[0]:.2f} / {compared[1]:.2f} deg. With the trigger's adjoint it is
    {velocity_adjoint[compared][0]:.2f} / {velocity_adjoint[compared][1]:.2f} deg. With an Apollo law blind to density
    it is {density_blind[compared][0]:.2f} / {density_blind[compared][1]:.2f} deg.""",
    "E14",
    (FORM, ADJOINT, DENSITY),
)
@_cell(
    "gamma",
    "apollo_velocity",
    """From equal numbers of flights we find {compared[0]:.2f} / {compared[1]:.2f} deg. With an Apollo law blind to
    density it is {density_blind[compared][0]:.2f} / {density_blind[compared][1]:.2f} deg. With the Mars-GRAM fit it is
    {desensitized_density[compared][0]:.2f} / {desensitized_density[compared][1]:.2f} deg.""",
    "E14",
    (FORM, DENSITY),
)
@_cell(
    "gamma",
    "stochastic_time",
    """From equal numbers of flights we find {compared[0]:.2f} / {compared[1]:.2f} deg. With `partition_24` it is
    {partition_24[compared][0]:.2f} / {partition_24[compared][1]:.2f} deg. With `partition_20` it is
    {partition_20[compared][0]:.2f} / {partition_20[compared][1]:.2f} deg.""",
    "E12",
    (PARTITION, DENSITY),
)
@_cell(
    "gamma",
    "stochastic_velocity",
    """From equal numbers of flights we find {compared[0]:.2f} / {compared[1]:.2f} deg. With `partition_24` it is
    {partition_24[compared][0]:.2f} / {partition_24[compared][1]:.2f} deg. With aerodynamic errors of the same sign it
    is {same_sign[compared][0]:.2f} / {same_sign[compared][1]:.2f} deg. With the Mars-GRAM fit and its deadband it is
    {desensitized_density[compared][0]:.2f} / {desensitized_density[compared][1]:.2f} deg.""",
    "E8 E22",
    (SIGNS, DENSITY, DEADBAND),
)
def table_4(published, flights: Flights, tails: Tails, compared_tails: ComparedTails, searched: Searched, *, row, case):
    state, name, factor, unit = ROWS[[of[1] for of in ROWS].index(row)]
    ensemble, (values, errors_of_values) = flights[case], tails[case][state]
    trials, (mean, deviation) = finite_count(ensemble), _middle(ensemble, state, factor)
    evidence = f"mean {mean:+.3f}, standard deviation {deviation:.3f} {unit}" if trials else "no finite trial"
    return measured(
        values * factor,
        errors_of_values * factor,
        trials,
        "; ".join(filter(None, [evidence, outcomes(ensemble)])),
        compared=compared_tails[case][state][0] * factor,
        printed_width=float(np.ptp(published[f"tab4_{row}_{case}"].printed)),
        **(_by_number_of_reversals(ensemble) if name == "downrange" else {}),
        **(searched if (row, case) == ("downrange", "apollo_time") else {}),
    )


@claim(name="tab4_velocity_apollo_velocity", by_construction="the flight ends at this velocity", case="apollo_velocity")
@claim(
    name="tab4_velocity_stochastic_velocity",
    by_construction="the flight ends at this velocity",
    case="stochastic_velocity",
)
def table_4_velocity_at_the_trigger(mission: Mission, flights: Flights, *, case):
    ensemble = flights[case]
    trials = finite_count(ensemble)
    largest = float(velocity_errors(mission, ensemble).max()) if trials else np.nan
    evidence = f"largest distance from the trigger's velocity {largest:.1e} m/s"
    return measured([-largest, largest], None, trials, "; ".join(filter(None, [evidence, outcomes(ensemble)])))


def _middle(ensemble, state, factor):
    """Mean and standard deviation of a final error over the finite trials, times a factor; NaN without any."""
    if is_streamed(ensemble):
        moments = FinalMoments(ensemble, state)
        return (moments.mean - ensemble.nominal_final[state]) * factor, moments.population_deviation * factor
    error = errors(ensemble)[finite(ensemble), state] * factor
    return (error.mean(), error.std()) if len(error) else (np.nan, np.nan)


def _by_number_of_reversals(ensemble):
    """Mean range error, km, of the trials with up to three bank reversals, and with more; NaN where there is none.

    Of a streamed ensemble it is that of its first trials.
    """
    completed = finite(ensemble)
    more = ensemble.final_state[completed, REVERSALS] > MOST_REVERSALS
    error = errors(ensemble)[completed, DOWNRANGE] / 1e3
    means = [float(error[some].mean()) if some.any() else np.nan for some in (~more, more)]
    return dict(zip(("few_reversals", "more_reversals"), means, strict=True))


# ---- headline --------------------------------------------------------------------------------------------------------


class TriggerTails(NamedTuple):
    """Percentiles of the range error with the velocity trigger."""

    apollo: tuple  # as of `final_percentiles`
    stochastic: tuple
    trials: int  # finite ones, of the law that has fewer


def trigger_tails(flights: Flights, tails: Tails) -> TriggerTails:
    """Those of both laws."""
    trials = _fewest(flights)
    if trials < 2:
        raise Fails("fewer than two finite trials of one of the laws", trials)
    return TriggerTails(*(tails[f"{law}_velocity"][DOWNRANGE] for law in LAWS), trials)


def _fewest(flights):
    """Finite trials with the velocity trigger, of the law that has fewer."""
    return min(finite_count(flights[f"{law}_velocity"]) for law in LAWS)


@claim(
    """With the velocity trigger the interval between the percentiles is {apollo_velocity_width:.2f} km under the Apollo
    law. Under the stochastic law it is {stochastic_velocity_width:.2f} km. We flew {tried} combinations of what the
    Apollo law feeds back, the partition and the signs of the aerodynamic errors. For certain {near} of them come to
    what is printed. For {unsure} more, sampling error decides. Of the former, {near_blind} have an Apollo law blind to
    density and {near_opposite} have errors of opposite signs. One trim angle causes opposite signs, and with these the
    most is {best_opposite:.0f} %. From equal numbers of flights, a law blind to density gives
    {density_blind[compared]:.0f} %. With errors of the same sign, a calibration, it gives
    {density_blind_same_sign[compared]:.0f} %. Two things speak against that: the signs, and the effect of the trigger.
    It then changes the interval by {density_blind_same_sign[trigger_apollo]:+.0f} % (Apollo) and
    {density_blind_same_sign[trigger_stochastic]:+.0f} % (stochastic). The paper has {printed_trigger_apollo:+.0f} and
    {printed_trigger_stochastic:+.0f} %.""",
    errata="E8 E14",
    withheld=(FORM, SIGNS, DENSITY, DEADBAND),
    counterexample=spread("stochastic_velocity.final_state", component="downrange"),
)
def headline_range_reduction(
    published, flights: Flights, tails: Tails, compared_tails: ComparedTails, searched: Searched
):
    ranges = {case: tails[case][DOWNRANGE] for case in CASES}
    widths = {case: width(ranges[case])[0] / 1e3 for case in CASES}
    saved, error = (100 * part for part in reduction(ranges["stochastic_velocity"], ranges["apollo_velocity"]))
    saved_time, error_time = (100 * part for part in reduction(ranges["stochastic_time"], ranges["apollo_time"]))
    compared = {case: compared_tails[case][DOWNRANGE] for case in CASES}
    printed = {case: np.ptp(published[f"tab4_downrange_{case}"].printed) for case in CASES}

    def written_width(law, trigger):
        values, deviations = ranges[f"{law}_{trigger}"]
        low, high = (f"{v / 1e3:.3f} ± {e / 1e3:.3f}" for v, e in zip(values, deviations, strict=True))
        return f"{widths[f'{law}_{trigger}']:.2f} km ({LAW_NAMES[law]} {low} / {high} km)"

    return measured(
        saved,
        error,
        _fewest(flights),
        f"width between the percentiles with the velocity trigger {written_width('apollo', 'velocity')}, "
        f"{written_width('stochastic', 'velocity')}; with the fixed time {written_width('apollo', 'time')}, "
        f"{written_width('stochastic', 'time')}, {saved_time:.1f} ± {error_time:.1f} % less",
        time=saved_time,
        time_error=error_time,
        compared=100 * reduction(compared["stochastic_velocity"], compared["apollo_velocity"])[0],
        **{f"{case}_width": value for case, value in widths.items()},
        **{f"trigger_{law}": 100 * (widths[f"{law}_velocity"] / widths[f"{law}_time"] - 1) for law in LAWS},
        **{f"printed_trigger_{law}": 100 * (printed[f"{law}_velocity"] / printed[f"{law}_time"] - 1) for law in LAWS},
        **searched,
    )


@claim(
    """The ratio is {compared:.2f}, from equal numbers of flights, where that of the paper is {printed_ratio:.2f}. With
    the Mars-GRAM fit it is {desensitized_density[compared]:.2f}. Against an Apollo law blind to density, a hypothesis,
    it is {density_blind[compared]:.2f}. With aerodynamic errors of the same sign too, a calibration, it is
    {density_blind_same_sign[compared]:.2f}.""",
    errata="E8 E14",
    withheld=(FORM, SIGNS, DENSITY, DEADBAND),
    counterexample=spread("stochastic_velocity.final_state", component="downrange"),
    name="halved_velocity_p1",
    side=0,
)
@claim(
    """The ratio is {compared:.2f}, from equal numbers of flights, where that of the paper is {printed_ratio:.2f}. With
    the Mars-GRAM fit it is {desensitized_density[compared]:.2f}. Against an Apollo law blind to density, a hypothesis,
    it is {density_blind[compared]:.2f}. With aerodynamic errors of the same sign too, a calibration, it is
    {density_blind_same_sign[compared]:.2f}.""",
    errata="E8 E14 E22",
    withheld=(FORM, SIGNS, DENSITY, DEADBAND),
    counterexample=spread("stochastic_velocity.final_state", component="downrange"),
    name="halved_velocity_p99",
    side=1,
)
def halved_velocity(published, tails: TriggerTails, compared_tails: ComparedTails, *, side):
    apollo, stochastic = tails.apollo[0][side] / 1e3, tails.stochastic[0][side] / 1e3
    ratio, error = ratio_of(tails.stochastic, tails.apollo, side)
    printed = [published[f"tab4_downrange_{law}_velocity"].printed[side] for law in LAWS]
    compared = ratio_of(*(compared_tails[f"{law}_velocity"][DOWNRANGE] for law in reversed(LAWS)), side)
    return holds(
        f"{stochastic:.3f} km over {apollo:.3f} km is {ratio:.3f} ± {error:.3f}",
        # What the paper calls about half is its own threshold: the further of its two ratios from one half.
        measure("distance of this ratio from one half", abs(ratio - 0.5), error=error)
        <= half_tolerance(published) * (1.0 + ROUNDING),
        f"the paper's ratio is {printed[1] / printed[0]:.3f}",
        trials=tails.trials,
        ratio=ratio,
        compared=compared[0],
        printed_ratio=printed[1] / printed[0],
    )


@claim(
    """From the fixed time to the trigger the interval of the range error changes by {change:+.0f} %. With the Mars-GRAM
    fit it changes by {desensitized_density[change]:+.0f} %, with aerodynamic errors of the same sign by
    {same_sign[change]:+.0f} %. The trigger helps where the design for the fixed time is poor. If that design aims at
    the trigger, the change is {velocity_adjoint[change]:+.0f} %.""",
    errata="E8 E14",
    withheld=(ADJOINT, SIGNS, DENSITY, FORM),
    counterexample=spread("apollo_velocity.final_state", component="downrange"),
    name="velocity_trigger_helps_apollo",
    law="apollo",
)
@claim(
    """From the fixed time to the trigger the interval of the range error changes by {change:+.0f} %. With the Mars-GRAM
    fit it changes by {desensitized_density[change]:+.0f} %. The trigger helps where the design for the fixed time is
    poor: the change is {partition_24[change]:+.0f} % with `partition_24` and {partition_20[change]:+.0f} % with
    `partition_20`.""",
    errata="E12",
    withheld=(PARTITION, DENSITY),
    counterexample=spread("stochastic_velocity.final_state", component="downrange"),
    name="velocity_trigger_helps_stochastic",
    law="stochastic",
)
def velocity_trigger_helps(flights: Flights, tails: Tails, *, law):
    with_trigger, fixed = tails[f"{law}_velocity"][DOWNRANGE], tails[f"{law}_time"][DOWNRANGE]
    saved, error = (100 * part for part in reduction(with_trigger, fixed))
    subject = f"reduction of the {LAW_NAMES[law]} law's interval from the fixed time to the velocity trigger"
    return holds(
        measure(subject, saved, "%", error=error) > 0,
        trials=min(finite_count(flights[f"{law}_{trigger}"]) for trigger in TRIGGERS),
        change=-saved,
    )


@claim(by_construction="the flight ends at this velocity")
def velocity_trigger_ends_at_velocity(mission: Mission, flights: Flights):
    off = max(velocity_errors(mission, flights[f"{law}_velocity"]).max(initial=0.0) for law in LAWS)
    return holds(
        measure("largest final velocity error", off, "m/s") < ROUNDING * mission.end_velocity, trials=_fewest(flights)
    )


@claim(
    """The interval changes by {change:+.0f} %, with the Mars-GRAM fit by {desensitized_density[change]:+.0f} %. Neither
    design knows of errors of the aerodynamics. With the trigger these alone make a deviation of
    {apollo_aerodynamics:.2f} km (Apollo) and {stochastic_aerodynamics:.2f} km (stochastic). All sources together make
    {apollo_all:.2f} and {stochastic_all:.2f} km. Against an Apollo law blind to density, a hypothesis, the interval
    changes by {density_blind[change]:+.0f} %. With errors of the same sign too it changes by
    {density_blind_same_sign[change]:+.0f} %.""",
    errata="E8 E14",
    withheld=(FORM, SIGNS, DENSITY, DEADBAND),
    counterexample=spread("stochastic_velocity.final_state", component="downrange"),
)
def improvement_visible_velocity(tails: TriggerTails, error_budget: ErrorBudget | None = None):
    saved, error = (100 * part for part in reduction(tails.stochastic, tails.apollo))
    subject = "reduction of the interval between the percentiles of the range by the stochastic law"
    return holds(
        measure(subject, saved, "%", error=error) > 100 * VISIBLE,
        trials=tails.trials,
        change=-saved,
        **_alone(error_budget),
    )


def _alone(error_budget):
    """Range deviation with the velocity trigger, km, from aerodynamics alone and from all sources; NaN if not done."""
    deviation = {f"{law}_{source}": np.nan for law in LAWS for source in ("aerodynamics", "all")}
    if error_budget is not None:
        laws, sources = list(error_budget.law), list(error_budget.source)
        for name in deviation:
            law, source = name.split("_")
            deviation[name] = error_budget.deviation[laws.index(law), 1, sources.index(source)] / 1e3
    return deviation


# ---- Fig. 13 ---------------------------------------------------------------------------------------------------------


class FinalCovariances(dict):
    """Covariances of range and velocity in the linear model at the final time by case, (2, 2)."""

    def of(self, case: str) -> np.ndarray:
        """Return that of a case, which has to be finite."""
        if not np.isfinite(self[case]).all():
            raise Fails(f"no finite covariance of {case.replace('_', ', ')}")
        return self[case]

    def correlation(self, case: str) -> float:
        """Correlation of range and velocity."""
        return correlation_of(self.of(case), 0, 1)


def final_covariances(predicted: Predicted) -> FinalCovariances:
    """Those of both laws and triggers."""
    plane = np.ix_([DOWNRANGE, VELOCITY], [DOWNRANGE, VELOCITY])
    return FinalCovariances(
        {f"{law}_{trigger}": predicted[law][k, -1][plane] for law in LAWS for k, trigger in enumerate(TRIGGERS)}
    )


def _sampled(flights, law):
    """Correlation of range and velocity of the trials at the fixed final time."""
    return correlation_of(flights[f"{law}_time"].covariance[-1], DOWNRANGE, VELOCITY)


@claim(
    """This is for the law as it is flown, against velocity. With `timed_covariance`, as in Eqs. 42, 45 and 50, the
    correlation is {timed:+.2f}. The flights have {sampled:+.2f}.""",
    errata="E15",
    withheld=COVARIANCE,
    counterexample=in_reading("timed_covariance"),
)
def fig13_apollo_negative(gains: Gains, flights: Flights, final: FinalCovariances):
    timed = correlation_of(gains.timed_covariance[0, -1], DOWNRANGE, VELOCITY)
    sampled, count = _sampled(flights, "apollo"), flights["apollo_time"].count
    subject = "correlation of range and velocity at the final time"
    return holds(
        measure(f"{subject} in the linear model", final.correlation("apollo_time")) < 0,
        measure("correlation over the flights", sampled, error=(1 - sampled**2) / np.sqrt(max(count, 1))) < 0,
        f"for gains against time, which nobody flies, {timed:+.3f}",
        timed=timed,
        sampled=sampled,
        trials=flights["apollo_time"].count,
    )


@claim(
    """With `timed_covariance` the trigger's adjoint changes the correlation by {timed_covariance[change]:+.2f}.""",
    errata="E15",
    withheld=COVARIANCE,
    counterexample=scaled("gains.apollo_covariance", at=(1, -1, DOWNRANGE, VELOCITY)),
)
def fig13_apollo_more_negative(final: FinalCovariances):
    time, velocity = (final.correlation(f"apollo_{trigger}") for trigger in TRIGGERS)
    subject = "correlation of range and velocity with the trigger's adjoint in the linear model"
    return holds(measure(subject, velocity) < time, f"with that of the fixed time {time:+.3f}", change=velocity - time)


@claim(by_construction="it is what the law minimises")
def fig13_stochastic_time_variance(final: FinalCovariances):
    apollo, stochastic = (np.sqrt(final.of(f"{law}_time")[0, 0]) / 1e3 for law in LAWS)
    return holds(measure("predicted range deviation, against Apollo's", stochastic, "km") < apollo)


@claim(
    "With `partition_24` the correlation is {partition_24[correlation]:+.2f}.",
    errata="E12",
    withheld=PARTITION,
    counterexample=scaled("gains.stochastic_covariance", at=(0, -1, DOWNRANGE, VELOCITY)),
)
def fig13_stochastic_time_uncorrelated(flights: Flights, final: FinalCovariances):
    correlation, sampled = final.correlation("stochastic_time"), _sampled(flights, "stochastic")
    return holds(
        f"correlation of range and velocity in the linear model {correlation:+.3f}, of the trials {sampled:+.3f}",
        measure("magnitude of the correlation in the linear model", abs(correlation)) < WEAK,
        correlation=correlation,
    )


@claim(counterexample=scaled("gains.stochastic_covariance", at=(1, -1, DOWNRANGE, VELOCITY)))
def fig13_stochastic_velocity_correlated(final: FinalCovariances):
    correlation = final.correlation("stochastic_velocity")
    return holds(
        f"correlation of range and velocity in the linear model {correlation:+.3f}",
        measure("magnitude of the correlation", abs(correlation)) > 1.0 - STRONG,
    )


@claim(counterexample=shifted("gains.stochastic_covariance", at=(0, -1, DOWNRANGE, VELOCITY)))
def fig13_clear_difference(final: FinalCovariances):
    time, velocity = (final.of(f"stochastic_{trigger}") for trigger in TRIGGERS)
    eigenvalues = np.linalg.eigvals(np.linalg.solve(time, velocity)).real
    unlike = np.sqrt(max(eigenvalues.max(), 1.0 / eigenvalues.min()))
    apart = abs(final.correlation("stochastic_time") - final.correlation("stochastic_velocity"))
    return holds(
        measure("difference of the correlations of range and velocity under the two designs", apart) > VISIBLE,
        f"in some direction the two ellipses differ by a factor of {unlike:.1f}",
    )
