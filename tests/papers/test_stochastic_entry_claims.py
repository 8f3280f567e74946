"""Claims and tables of the entry-guidance paper: everything printed has its evaluator, verdicts follow the numbers."""

from dataclasses import replace

import numpy as np
import pytest

from marsedl.papers import catalogue
from marsedl.papers.stochastic_entry import records
from marsedl.papers.stochastic_entry.claims import measures
from marsedl.papers.stochastic_entry.records import CASES
from marsedl.replication.claims.verdicts import judge
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.records.tables import csv_text

RANGE = records.DOWNRANGE

PAPER = catalogue("stochastic_entry")
DECLARATIONS = claims_of("stochastic_entry").declarations


def evaluate(entry, reading="corrected", inputs=None, **replaced):
    return entry.evaluate(reading, entry.artifacts(reading) | replaced, inputs)


@pytest.fixture(scope="module")
def evaluations(entry):
    found = {"corrected": evaluate(entry)}
    # Of the law that is flown as in `corrected`, the covariance by its gains against time.
    return found | {"timed_covariance": entry.evaluate("timed_covariance", entry.artifacts("corrected"))}


STATE_NAMES = ("radius", "velocity", "flight path angle", "range", "density")


# --- values -----------------------------------------------------------------------------------------------------------


def test_values_of_table_4_are_percentiles_in_the_printed_units(entry, evaluations):
    artifacts = entry.artifacts("corrected")
    for case in CASES:
        ensemble = artifacts[case]
        error = ensemble.final_state[:, :5] - ensemble.nominal_final[:5]
        for state, name, factor, _ in measures.ROWS:
            evaluation = evaluations["corrected"][f"tab4_{name}_{case}"]
            assert evaluation.trials == len(error) == 2000
            if name == "velocity" and case.endswith("velocity"):
                assert (
                    evaluation.value[1]
                    == np.abs(ensemble.final_state[:, 1] - 500.0).max()
                    == -evaluation.value[0]
                    < 1e-9
                )
                continue
            np.testing.assert_allclose(
                evaluation.value, factor * np.quantile(error[:, state], [0.01, 0.99]), rtol=1e-12, atol=1e-15
            )
            assert (np.array(evaluation.standard_error) > 0).all()


@pytest.mark.parametrize(
    ("claim", "end"), [("headline_range_reduction", "velocity"), ("headline_range_reduction_time", "time")]
)
def test_headline_is_the_reduction_of_the_interval(evaluations, claim, end):
    corrected = evaluations["corrected"]
    low, high = (np.array(corrected[f"tab4_downrange_{law}_{end}"].value) for law in ("apollo", "stochastic"))
    errors = [np.hypot(*corrected[f"tab4_downrange_{law}_{end}"].standard_error) for law in ("apollo", "stochastic")]
    wide, narrow = np.ptp(low), np.ptp(high)
    headline = corrected[claim]
    assert headline.value == pytest.approx(100 * (1 - narrow / wide), rel=1e-12)
    # to first order, by perturbing either interval
    shares = errors[1] / wide, narrow * errors[0] / wide**2
    assert headline.standard_error == pytest.approx(100 * np.hypot(*shares), rel=1e-9)
    assert headline.numbers["remaining"] == pytest.approx(100 * narrow / wide, rel=1e-12)


def test_half_is_the_ratio_of_percentiles(evaluations):
    corrected = evaluations["corrected"]
    low, high = (corrected[f"tab4_downrange_{law}_velocity"].value for law in ("apollo", "stochastic"))
    assert corrected["halved_velocity_p1"].numbers["ratio"] == pytest.approx(high[0] / low[0], rel=1e-12)


def test_about_half_is_what_the_paper_calls_so(entry_published):
    """The rule accepts the paper's own percentiles, just."""
    tolerance = measures.half_tolerance(entry_published)
    assert tolerance == pytest.approx(0.5 - 1.19 / 3.04)
    apollo, stochastic = (measures.printed_range(entry_published, f"{law}_velocity") for law in measures.LAWS)
    for side in (0, 1):
        ratio, error = measures.ratio_of(stochastic, apollo, side)
        assert error == 0.0 and abs(ratio - 0.5) <= tolerance * (1.0 + 1e-12)
    assert measures.reduction(stochastic, apollo)[0] == pytest.approx(1 - 3.15 / 6.62)


def test_entry_numbers_that_follow_from_others(evaluations):
    corrected = evaluations["corrected"]
    assert corrected["tab2_crossrange"].value == [0.57, 0.5]
    assert "0.5705 km" in str(corrected["tab2_crossrange"].evidence)  # 11.027 deg of 3397 km, times 0.05 deg
    assert corrected["ou_limit_variance"].value == pytest.approx(0.25, abs=1e-12)
    assert corrected["chance_sigmas"].value == pytest.approx(3.0, abs=1e-4)
    np.testing.assert_allclose(corrected["af_velocity"].value, [0, 0, 0, 1e6, 0], atol=1e-6)
    np.testing.assert_allclose(corrected["adjoint_velocity"].value, [0, 0, 0, 1, 0], atol=1e-12)
    assert corrected["fig9_altitude_active"].numbers["three_sigma"] == pytest.approx(2.0, abs=1e-3)
    assert corrected["nominal_uprange"].value == pytest.approx(10.02, abs=0.005)
    assert corrected["zf_column_velocity"].value[1] == 0.0


def test_mirrored_percentiles_are_those_of_the_error_with_its_other_sign(entry):
    ensemble = entry.ensemble("corrected", "stochastic_velocity")
    error = ensemble.final_state[:, RANGE] - ensemble.nominal_final[RANGE]
    values, deviations = measures.mirrored(measures.final_percentiles(ensemble)[RANGE])
    np.testing.assert_allclose(values, np.quantile(-error, records.LEVELS), rtol=1e-12)
    assert (deviations > 0).all() and values[0] < values[1]


def test_the_covariance_of_the_apollo_law_is_that_of_the_reading(evaluations):
    """Eqs. 42, 45 and 50 alone make the bounds similar and the correlation positive; the flights are the same."""
    effective, timed = evaluations["corrected"], evaluations["timed_covariance"]
    for name, of_effective in (
        ("fig8_apollo_similar", False),
        ("fig8_more_aggressive", False),
        ("fig13_apollo_negative", True),
    ):
        assert (effective[name].value, timed[name].value) == (of_effective, not of_effective), name
    assert timed["tab4_downrange_apollo_time"].value == effective["tab4_downrange_apollo_time"].value


def test_a_reading_of_the_same_flights_flies_as_many(entry):
    """Fewer of them would give other verdicts on what does not differ."""
    inputs = {name: entry.study.readings[name].inputs.plain() for name in ("corrected", "timed_covariance")}
    different = {key for key in inputs["corrected"] if inputs["corrected"][key] != inputs["timed_covariance"][key]}
    assert different == {"design.apollo_covariance"}


# --- the tests of statements can fail ---------------------------------------------------------------------------------


def moved(ensemble, column, shift=0.0, factor=1.0):
    """An ensemble with a column of its final states scaled about the nominal end and shifted."""
    final = ensemble.final_state.copy()
    centre = ensemble.nominal_final[column] if column < len(ensemble.nominal_final) else final[:, column].mean()
    final[:, column] = centre + factor * (final[:, column] - centre) + shift
    return replace(ensemble, final_state=final)


def scaled(array, factor, *index):
    array = array.copy()
    array[index] *= factor
    return array


def unlike_identity(linearization):
    projection = linearization.trigger_projection.copy()
    projection[3, 0] = 1e-3
    return replace(linearization, trigger_projection=projection)


def test_every_counted_claim_is_turned_by_a_small_change(entry, evaluations):
    turned = entry.turned(entry.artifacts("corrected"), evaluations["corrected"])
    assert len(turned) > 40 and not [name for name, change in turned.items() if change is None]


@pytest.mark.parametrize("name", ["lofting_captured", "fig9_lc_worst_gamma", "crossrange_nulled"])
def test_a_statement_about_both_laws_fails_if_one_has_no_finite_deviation(entry, name):
    ensemble = entry.artifacts("corrected")["stochastic_time"]
    unknown = replace(ensemble, covariance=np.full_like(ensemble.covariance, np.nan))
    evaluation = evaluate(entry, stochastic_time=unknown)[name]
    assert evaluation.value is False and not evaluation.doubts


def test_numbers_are_decided_by_the_artifacts(entry, entry_published):
    """A velocity that misses the trigger, an end elsewhere and a late turn are noticed."""
    artifacts = entry.artifacts("corrected")
    missed = moved(artifacts["apollo_velocity"], records.VELOCITY, shift=2.0)
    nominal = replace(artifacts["nominal"], downrange=artifacts["nominal"].downrange - 600.0)
    gains = artifacts["gains"]
    late = replace(gains, stochastic_covariance=scaled(gains.stochastic_covariance, 9.0, 0, slice(150, None), 3, 3))
    new_evaluations = evaluate(entry, apollo_velocity=missed, nominal=nominal, gains=late)
    for name in ("tab4_velocity_apollo_velocity", "nominal_uprange", "fig9_range_error_turns"):
        assert judge(entry_published[name], new_evaluations[name], DECLARATIONS.get(name)).verdict == "differs", name


def test_trials_that_ended_otherwise_are_counted_in_the_evidence(entry):
    ensemble = entry.artifacts("corrected")["apollo_velocity"]
    outcome = ensemble.outcome.copy()
    outcome[:3], outcome[3] = 1, 2
    final = ensemble.final_state.copy()
    outcome[4], final[4] = 3, np.nan
    new_evaluations = evaluate(entry, apollo_velocity=replace(ensemble, outcome=outcome, final_state=final))
    evaluation = new_evaluations["tab4_downrange_apollo_velocity"]
    assert "3 below the ground, 1 trigger not reached, 1 not finite" in str(evaluation.evidence)
    assert evaluation.trials == 1999 and np.isfinite(evaluation.value).all()


def verdict_of(entry, published, name, **replaced):
    return judge(published[name], evaluate(entry, **replaced)[name], DECLARATIONS[name]).verdict


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "holds"), (0.9, "fails"), (1.1, "fails")])
def test_an_altitude_that_equals_its_limit_is_neither_below_nor_above_it(entry, entry_published, factor, verdict):
    gains = entry.artifacts("corrected")["gains"]
    covariance = scaled(gains.stochastic_covariance, factor**2, 0, -1, records.ALTITUDE, records.ALTITUDE)
    changed = replace(gains, stochastic_covariance=covariance)
    assert verdict_of(entry, entry_published, "fig9_altitude_active", gains=changed) == verdict


@pytest.mark.parametrize(("factor", "verdict"), [(0.5, "fails"), (1.0, "undetermined"), (5.0, "holds")])
def test_large_deviations_are_much_larger_than_those_of_the_other_law(entry, entry_published, factor, verdict):
    ensemble = entry.artifacts("corrected")["stochastic_time"]
    wider = replace(ensemble, covariance=ensemble.covariance * factor**2)
    assert verdict_of(entry, entry_published, "fig9_large_deviations", stochastic_time=wider) == verdict


def test_a_smaller_variance_of_the_range_can_fail(entry, entry_published):
    """Where the design is free, Apollo's gains against time have the same least variance: rounding decides nothing."""
    gains = entry.artifacts("corrected")["gains"]
    wide = replace(gains, stochastic_covariance=scaled(gains.stochastic_covariance, 100.0, 0, -1, RANGE, RANGE))
    equal = replace(gains, apollo_covariance=gains.stochastic_covariance * (1.0 + 1e-11))
    for changed in (wide, equal):
        assert verdict_of(entry, entry_published, "fig13_stochastic_time_variance", gains=changed) == "fails"


def test_a_construction_rests_on_its_premise(entry, entry_published):
    """Bounds that the design does not keep, and rates that flights do not limit, are judged."""
    artifacts = entry.artifacts("corrected")
    gains = artifacts["gains"]
    broken = replace(
        gains,
        control_ratio=3.0 * gains.control_ratio,
        stochastic_control_variance=9.0 * gains.stochastic_control_variance,
    )
    assert verdict_of(entry, entry_published, "fig8_stochastic_inside") == "by_construction"
    assert verdict_of(entry, entry_published, "fig8_stochastic_inside", gains=broken) == "fails"
    for reading, verdict in (("corrected", "by_construction"), ("printed", "fails")):
        evaluation = evaluate(entry, reading)["bank_rate_respected"]
        assert (
            judge(entry_published["bank_rate_respected"], evaluation, DECLARATIONS["bank_rate_respected"]).verdict
            == verdict
        )


@pytest.mark.parametrize(("angle", "verdict"), [(1e-3, "by_construction"), (-1e-3, "fails")])
def test_the_density_process_needs_no_step_that_turns(entry, entry_published, angle, verdict):
    """A step on which the flight goes from sinking to climbing is none of the process in altitude."""
    linearization = entry.linearization()
    state, noise = linearization.state.copy(), linearization.noise.copy()
    state[60, records.FLIGHT_PATH_ANGLE] = angle
    noise[59:61, records.DENSITY, records.DENSITY] *= 2.0
    turning = replace(linearization, state=state, noise=noise)
    assert verdict_of(entry, entry_published, "sde_diffusion_sink_rate", linearization=turning) == verdict


def test_what_is_left_of_the_crossrange_errs_as_what_is_added_does(entry, evaluations):
    """Where little is added in flight, its own sampling error decides."""
    artifacts = entry.artifacts("corrected")
    margin = evaluations["corrected"]["crossrange_nulled"].margin
    pairs = [measures.crossrange_interval(artifacts[f"{law}_time"]) for law in measures.LAWS]
    widest = [
        np.sqrt(artifacts[f"{law}_time"].covariance[:, records.CROSSRANGE, records.CROSSRANGE].max())
        for law in measures.LAWS
    ]
    added = 2 * 2.326 * (widest[1] - widest[0])
    of_added = 2 * 2.326 * np.hypot(*widest) / np.sqrt(2 * 2000)
    expected = 100 * np.hypot(np.hypot(pairs[0][1], pairs[1][1]), margin.value / 100 * of_added) / added
    assert margin.standard_error == pytest.approx(expected, rel=1e-9)


@pytest.mark.filterwarnings("default::RuntimeWarning")
@pytest.mark.parametrize("trials", [1, 3])
def test_few_flights_leave_cells_empty(entry, trials):
    flown = {case: entry.fly("corrected", entry.gains(), case, trials=trials) for case in CASES}
    found = evaluate(entry, **flown)
    assert found["tab3_state"].value is False and "more than three flights" in str(found["tab3_state"].evidence)
    assert np.isnan(found["tab4_downrange_apollo_time"].value).all() == (trials == 1)


# --- tables -----------------------------------------------------------------------------------------------------------


def table(entry, published, stem, reading="corrected", **replaced):
    """A table from what the catalogue declares for it, and no more; CSV gives it back."""
    product = PAPER.tables[stem]
    artifacts = entry.artifacts(reading) | replaced
    items = {need.split(".")[-1]: artifacts[need.split(".")[-1]] for need in product.needs}
    result = entry.product("tables", stem, reading, items, published=published)
    assert csv_text(result)
    return result


def row(rows, **cells):
    """The only row with these cells, by head."""
    (number,) = np.flatnonzero(np.all([rows[head] == cell for head, cell in cells.items()], axis=0))
    return rows.iloc[number]


def test_table_4_beside_the_paper(entry, entry_published, evaluations):
    rows = table(entry, entry_published, "tab04")
    assert len(rows) == 32
    cell = row(rows, **{"final error": "downrange", "law": "stochastic", "trigger": "velocity", "percentile": 99.0})
    evaluation = evaluations["corrected"]["tab4_downrange_stochastic_velocity"]
    assert (cell["unit"], cell["in the paper"], cell["trials"]) == ("km", 1.19, 2000)
    assert cell["all trials"] == pytest.approx(evaluation.value[1], rel=1e-12)
    error = evaluation.standard_error[1]
    assert cell["all trials: standard error"] == pytest.approx(error, rel=1e-12)
    distance = (evaluation.value[1] - 1.19 - 0.005) / np.sqrt(error**2 * (1 + 2000 / 1000))
    assert cell["z"] == pytest.approx(distance, abs=0.051)
    ensemble = entry.artifacts("corrected")["stochastic_velocity"]
    sets = np.split((ensemble.final_state[:, RANGE] - ensemble.nominal_final[RANGE]) / 1e3, 2)
    assert cell["first 1,000 trials"] == pytest.approx(np.quantile(sets[0], 0.99), rel=1e-12)
    spread = np.std([np.quantile(each, 0.99) for each in sets], ddof=1)
    assert cell["spread over sets of 1,000"] == pytest.approx(spread, rel=1e-9)


def test_endings_count_every_trial(entry, entry_published):
    rows = table(entry, entry_published, "endings")
    assert [f"{law}_{trigger}" for law, trigger in zip(rows["law"], rows["trigger"], strict=True)] == list(CASES)
    assert set(rows["trials"]) == set(rows["completed"]) == {2000}
    ensemble = entry.artifacts("corrected")["apollo_velocity"]
    outcome, final = ensemble.outcome.copy(), ensemble.final_state.copy()
    outcome[:5], final[:5] = [1, 1, 1, 2, 3], np.nan
    lost = replace(ensemble, outcome=outcome, final_state=final)
    cells = table(entry, entry_published, "endings", apollo_velocity=lost).iloc[1]
    assert list(cells[2:7]) == [2000, 1995, 3, 1, 1]


def test_transformation_of_the_trigger_beside_eq_77(entry, entry_published):
    rows = table(entry, entry_published, "zf")
    assert list(zip(rows["row"], rows["column"], strict=True)) == [(i, j) for i in STATE_NAMES for j in STATE_NAMES]
    np.testing.assert_array_equal(rows["here"].to_numpy().reshape(5, 5), entry.linearization().trigger_projection)
    velocity = rows["column"] == "velocity"
    within = rows["within the printed rounding"]
    assert list(within[velocity]) == [False, True, True, False, False]
    assert within[~velocity].all()
    wrong = table(entry, entry_published, "zf", linearization=unlike_identity(entry.linearization()))
    assert not wrong["within the printed rounding"][~velocity].all()
    assert not table(entry, entry_published, "zf", "desensitized_density")["fitted"].any()
