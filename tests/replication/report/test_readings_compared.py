"""What decides a verdict, and what errata and unprinted inputs change, on rows whose answers are worked out by hand."""

import math

import pytest

from marsedl.replication.claims.claim import Claim, Margin, Result
from marsedl.replication.pipeline.catalogue import Erratum
from marsedl.replication.report import one_line
from marsedl.replication.report.one_line import Causes, causes, in_line
from marsedl.replication.report.readings_compared import (
    Change,
    Compared,
    Input,
    Reading,
    VerdictChange,
    changes,
)

BASES = {
    "printed": None,
    "corrected": "printed",
    "slip": "corrected",  # keeps one erratum
    "air": "corrected",  # another density
    "air_slip": "air",  # both
    "lost": "corrected",  # has no result
    "coarse": "corrected",  # a coarse step
}
ASSUMED = "assumed: not printed"
INPUTS = {  # the value in the default reading, its source, and other values
    "air.density": ("sample", ASSUMED, {"air": "mean", "air_slip": "mean"}),
    "guidance.tail": ("0.01", "Table 1", {"slip": "0.1", "air_slip": "0.1", "printed": "0.1"}),
    "guidance.navigation": ("10", ASSUMED, {"lost": "0"}),
    "guidance.refusal": ("refuse", ASSUMED, {"lost": "report"}),
    "simulation.step": ("0.1", ASSUMED, {"coarse": "0.5"}),
    "simulation.trials": ("100000", ASSUMED, dict.fromkeys(set(BASES) - {"corrected"}, "5000")),
    "simulation.seed": ("7", ASSUMED, {}),
}
MEANINGS = {name: f"what {name} is" for name in INPUTS}


def reading(name, based_on):
    inputs = {key: Input(others.get(name, value), source) for key, (value, source, others) in INPUTS.items()}
    return Reading(name, "", based_on, False, inputs)


READINGS = {name: reading(name, base) for name, base in BASES.items()}


def compared(rows, *errata, readings=READINGS):
    return Compared(rows, errata, readings, MEANINGS)


def margin(measure, value, limit, distance=1.0, scale="limits", unit="", error=0.0):
    sizes = {"value": value, "limit": limit, "distance": distance, "standard_error": error}
    return Margin(measure=measure, unit=unit, scale=scale, **sizes)


def result(value, verdict, error=None, trials=None, **more):
    components = [verdict] * len(value) if isinstance(value, list) else None
    fields = {"value": value, "standard_error": error, "trials": trials, "verdict": verdict, "components": components}
    return Result(**{**fields, **more})


def fewer(value, error=None):
    return {"value": value, "standard_error": error, "trials": 5000, "verdict": "differs"}


def row(name, readings, **more):
    given = {"id": name, "kind": "monte_carlo", "unit": "m/s", "printed": 310, "resolution": 1.0}
    given |= {"paper": "p", "verdict": readings["corrected"].verdict, "reading": "corrected", "readings": readings}
    return Claim(**{**given, **more})


def statement(name, readings, **more):
    return row(name, readings, **{"kind": "qualitative", "unit": "1", "printed": True, "resolution": None, **more})


def delta_v(**more):
    """300 m/s from 100,000 flights, 306 from the first 5,000, as many as the other readings fly."""
    off = margin("difference from the printed value", -10.0, 1.0, 3.0, "standard errors")
    readings = {
        "corrected": result(300.0, "differs", 0.5, 100_000, margin=off, at_equal_trials=fewer(306.0, 3.0)),
        "printed": result(None, "differs", None, 5000),
        "slip": result(346.0, "differs", 4.0, 5000),
        "air": result(306.0, "differs", 3.0, 5000),
        "air_slip": result(311.0, "reproduced", 4.0, 5000),
        "lost": result(None, "differs", None, 5000),
        "coarse": result(307.0, "undetermined", 4.0, 5000),
    }
    return row("delta_v", readings, **{"headline": 1, **more})


# ------------------------------------------------------------------------------------------------------ one claim


def test_a_row_of_numbers_is_shown_whole_counted_or_by_its_ends():
    def of(value, error=None, components=None, unit="km"):
        one = result(value, "differs", error, 100, components=components)
        return one_line.shown(row("row", {"corrected": one}, unit=unit, resolution=0.1))

    assert of([1.0, -2.5], [0.1, 0.2], ["reproduced", "differs"]) == "1.00 ± 0.10, -2.50 ± 0.20 km"
    assert of([1.0, 2.0, 3.0], [0.1, 0.2, 0.3], ["reproduced", "close", "differs"]) == "2 of 3 agree"
    assert of([[1.0, 2.0], [3.0, 4.0]], None, [["close", "differs"], ["differs", "differs"]]) == "1 of 4 agree"
    assert of([1.0, 2.0, 3.0], None, None, "m, m/s, kg") == "1.000 m ... 3.000 kg"


def test_the_causes_of_a_difference_are_what_the_claim_names_in_words():
    titles = {"E1": "The sign is wrong", "E2": "The unit is missing"}
    density = "the nominal density (`air.density_profile`, `air.density_table`)"
    named = delta_v(errata=["E2", "E1"], withheld=[density])
    assert causes(named, titles, {}, {}) == (["The unit is missing", "The sign is wrong"], ["the nominal density"])
    assert causes(named, titles, {}, {"E1": 2.0, "E2": 1.0}).errata == ["The sign is wrong", "The unit is missing"]
    meanings = {"recursion.shape": "shape of the slices: that of the cost, or of least volume"}
    assert causes(delta_v(withheld=["recursion.shape"]), {}, meanings, {}).withheld == ["shape of the slices"]
    assert causes(with_turned("holds", "fails", errata=["E1"]), titles, {}, {}) == Causes()


def test_a_line_holds_as_many_causes_as_fit():
    long = "One two three four five six seven"
    assert in_line(["The sign is wrong", "The unit is missing"]) == "The sign is wrong; The unit is missing"
    assert in_line([long, "The sign is wrong", "The unit is missing"]) == f"{long} and 2 more"
    assert in_line([f"{long}, eight nine ten eleven", "x"], 10) == f"{long} and 1 more"


# -------------------------------------------------------------------------------------------------- errata


def test_readings_are_compared_at_equal_numbers_of_trials():
    (change,) = changes(delta_v(), "slip", "corrected")
    # 346 - 306 from 5,000 flights each, not 346 - 300; three times the hypotenuse of 3 and 4, and half a digit
    assert change == Change("delta_v", "", (), "slip", "corrected", 306.0, 346.0, 40.0, 5.0, "m/s", 40 / 15.5, True)
    (same,) = changes(delta_v(), "air", "corrected")
    assert (same.difference, same.error, same.size) == (0.0, 0.0, 0.0), "the same flights"
    large = delta_v()
    alone = large.result.model_copy(update={"at_equal_trials": None})
    large = large.model_copy(update={"readings": {**large.readings, "corrected": alone}})
    (unequal,) = changes(large, "slip", "corrected")
    assert (unequal.difference, unequal.equal_trials) == (46.0, False)


def test_the_most_of_equal_trials_are_compared():
    both = {name: result(v, "differs", 1.0, 100_000, at_equal_trials=fewer(v + 9.0, 5.0))
            for name, v in (("corrected", 300.0), ("slip", 350.0))}  # fmt: skip
    (change,) = changes(row("delta_v", both), "slip", "corrected")
    assert (change.before, change.after) == (300.0, 350.0)


def test_statements_are_compared_by_their_measure():
    def change(scale, error=0.0, other="tightness"):
        readings = {
            "corrected": result(False, "fails", margin=margin("tightness", 5.0, 1.0, 40.0, scale, error=error)),
            "slip": result(False, "fails", margin=margin(other, 5.6, 1.0, 46.0, scale, error=error)),
        }
        return changes(statement("tight", readings), "slip", "corrected")

    (sampled,) = change("standard errors", 0.1)
    assert sampled.difference == pytest.approx(0.6)
    assert sampled.error == pytest.approx(math.hypot(0.1, 0.1))
    assert sampled.size == pytest.approx(0.6 / (3 * math.hypot(0.1, 0.1)))
    (exact,) = change("limits")
    assert exact.error == 0.0
    assert exact.size == pytest.approx(0.6 / 4.0), "a share of the way to its limit"
    assert not change("limits", other="another measure")


def erratum(name, *kept_by):
    return Erratum(name, "printed", "evidence", "used", f"Title of {name}", kept_by)


def moving(one, *errata):
    """The causes of a claim that move it."""
    moves = compared([one], *errata).causes()
    return causes(one, {e.id: e.title for e in errata}, MEANINGS, moves[one.id])


def test_a_cause_that_does_not_move_the_number_towards_what_is_printed_is_not_shown():
    away, still, unknown, none = erratum("E1", "slip"), erratum("E2", "coarse"), erratum("E3"), erratum("E4", "lost")
    towards = erratum("E5", "near")
    claim = delta_v(errata=["E1", "E2", "E3", "E4", "E5"], withheld=["the step (`simulation.step`)"])
    default = result(300.0, "differs", 0.5, 100_000, at_equal_trials=fewer(306.0, 0.1))
    results = {**claim.readings, "near": result(309.9, "differs", 0.1, 5000), "corrected": default}
    claim = claim.model_copy(update={"readings": results})
    readings = {**READINGS, "near": Reading("near", "", "corrected", False, READINGS["air"].inputs)}
    moves = compared([claim], away, still, unknown, none, towards, readings=readings).causes()["delta_v"]
    # 309.9 is 3.9 from 306, of which three times the root of two tenths and half a digit are nothing
    assert moves == {
        "E1": 0.0,
        "E2": 0.0,
        "E4": 0.0,
        "the step (`simulation.step`)": 0.0,
        "E5": pytest.approx(3.9 / (3 * math.hypot(0.1, 0.1) + 0.5)),
    }
    titles = {one.id: one.title for one in (away, still, unknown, none, towards)}
    assert causes(claim, titles, {}, moves).errata == ["Title of E5", "Title of E3"]


def test_without_a_cause_that_moves_it_a_claim_is_outside_of_its_limits():
    assert moving(delta_v(errata=["E1"]), erratum("E1", "slip")) == ([], [])
    held = delta_v(errata=["E1"], withheld=["the density (`air.density`)", "the seed (`simulation.seed`)"])
    assert moving(held, erratum("E1", "slip")) == ([], ["the seed"])


def test_a_reading_in_which_a_claim_stands_shows_its_cause():
    turned = with_turned("fails", "holds", errata=["E1"])
    assert moving(turned, erratum("E1", "slip")).errata == ["Title of E1"]
    nearer = {name: result(False, "fails", margin=margin("it", value, 1.0, 40.0, "standard errors", error=0.1))
              for name, value in (("corrected", 5.0), ("slip", 3.0), ("air", 7.0))}  # fmt: skip
    stated = statement("stated", nearer, errata=["E1", "E2"])
    assert moving(stated, erratum("E1", "air"), erratum("E2", "slip")).errata == ["Title of E2"]


def with_turned(before, after, reading="slip", trials=None, **more):
    readings = {"corrected": result(True, before), reading: result(False, after, trials=trials)}
    return statement("turned", readings, **more)


def test_errata_are_ranked_by_what_they_change():
    rows = [delta_v(), with_turned("holds", "fails", "air")]
    errata = [
        erratum("E1"),
        erratum("E2", "coarse"),
        erratum("E3", "air"),
        erratum("E4", "slip"),
        erratum("E5", "lost"),
    ]
    effect_of_id = {effect.erratum.id: effect for effect in compared(rows, *errata).effects()}
    assert {name: effect.rank for name, effect in effect_of_id.items()} == {
        "E5": "no_result",
        "E4": "headline",
        "E3": "verdict",
        "E2": "verdict",  # from differs to undetermined
        "E1": "not_isolated",
    }
    assert list(effect_of_id) == ["E5", "E4", "E2", "E3", "E1"], "in the order of the catalogue within a rank"
    assert effect_of_id["E5"].no_result == [("delta_v", "lost")]
    (change,) = effect_of_id["E4"].headline
    assert (change.reading, change.difference, change.counts) == ("slip", 40.0, True)
    assert effect_of_id["E3"].verdicts == [VerdictChange("turned", "air", "corrected", "holds", "fails", True)]


def test_a_reading_is_compared_with_its_nearest_base_that_mends_the_erratum():
    (effect,) = compared([delta_v()], erratum("E1", "slip", "air_slip")).effects()
    assert effect.readings == [("slip", "corrected"), ("air_slip", "air")]
    (effect,) = compared([delta_v()], erratum("E1", "air", "air_slip")).effects()
    assert effect.readings == [("air", "corrected"), ("air_slip", "corrected")]


def test_what_fewer_trials_may_leave_open_is_no_change():
    rows = [with_turned("holds", "undetermined", trials=5000)]
    assert compared(rows).changed_verdicts() == {}
    rows = [with_turned("holds", "fails", trials=5000)]
    assert not compared(rows).changed_verdicts()["slip"][0].equal_trials
    rows = [with_turned("holds", "by_construction")]
    assert compared(rows).changed_verdicts() == {}, "it is not counted there"


# ------------------------------------------------------------------------------------------------ what decides


def test_the_deciding_number_is_that_of_the_first_headline_claim_with_numbers():
    rows = [statement("first", {"corrected": result(True, "holds")}, headline=1), delta_v(headline=2)]
    deciding = compared(rows, erratum("E4", "slip")).deciding()
    assert (deciding.claim, deciding.value, deciding.error, deciding.trials) == ("delta_v", 300.0, 0.5, 100_000)
    assert (deciding.printed, deciding.limit, deciding.unit, deciding.component) == (310, None, "m/s", ())
    assert [choice.reading for choice in deciding.choices] == ["slip", "air_slip", "coarse", "air", "lost"]
    slip, both, *_, lost = deciding.choices
    assert (slip.inputs, slip.errata) == (("guidance.tail",), ("E4",)), "numbers of trials are none"
    assert both.inputs == ("air.density", "guidance.tail")
    assert lost.change is None


def test_of_a_row_the_number_that_decides_is_followed():
    off = margin("difference from the printed value", 1.1, 0.5, 3.0, "standard errors")
    readings = {
        "corrected": result([0.25, 5.0], "differs", [0.01, 0.1], 100, margin=off),
        "slip": result([0.35, 4.0], "differs", [0.01, 0.1], 100),
    }
    rows = [row("variances", readings, printed=[0.24, 3.9], unit="(m/s)^2, m^2", resolution=0.01, headline=1)]
    deciding = compared(rows).deciding()
    assert (deciding.component, deciding.unit, deciding.value, deciding.printed) == ((1,), "m^2", 5.0, 3.9)
    assert deciding.choices[0].change.difference == -1.0


def test_without_a_headline_number_the_measure_of_a_statement_decides():
    alone = {"corrected": result(False, "fails", margin=margin("excess", 0.1, 0.0)), "slip": result(False, "fails")}
    tight = {
        "corrected": result(False, "fails", margin=margin("tightness", 5.0, 1.25, unit="%")),
        "slip": result(False, "fails", margin=margin("tightness", 4.0, 1.25, unit="%")),
    }
    rows = [statement("bound", alone, headline=1), statement("tight", tight, headline=2)]
    deciding = compared(rows).deciding()
    assert (deciding.claim, deciding.measure, deciding.limit, deciding.printed) == ("tight", "tightness", 1.25, None)
    assert [choice.change.after for choice in deciding.choices] == [4.0]
    assert compared(rows[:1]).deciding() is None


# ------------------------------------------------------------------------------------------------- unprinted inputs


def open_by_label(rows):
    return {one.label: one for one in compared(rows).open_inputs()}


def test_open_inputs_have_the_range_that_readings_give_the_number():
    rows = [delta_v(withheld=["the step (`simulation.step`)"]), with_turned("fails", "fails")]
    inputs_by_label = open_by_label(rows)
    step = inputs_by_label["the step"]
    assert (step.inputs, step.used, step.low, step.high) == (("simulation.step",), ["0.1"], 306.0, 307.0)
    assert (step.named, step.refuted, step.claims) == (1, 2, ["delta_v"])
    assert next(iter(inputs_by_label)) == "the step", "most named first"
    density = inputs_by_label["what air.density is"]
    assert [(change.reading, change.against) for change in density.changes] == [("air", "corrected")]
    assert (density.low, density.high, density.named) == (306.0, 306.0, 0)


def test_an_input_that_accompanies_another_is_no_choice_of_its_own():
    rows = [delta_v(withheld=["what keeps gains finite (`guidance.navigation`)"])]
    inputs_by_label = open_by_label(rows)
    gains = inputs_by_label["what keeps gains finite"]
    assert (gains.no_result, gains.changes, gains.together) == (["lost"], [], ())
    assert inputs_by_label["what guidance.refusal is"].no_result == []
    assert "what guidance.tail is" not in inputs_by_label, "it is printed"
    assert inputs_by_label["what simulation.seed is"].low is None


def test_open_inputs_that_no_reading_varies_alone_name_each_other():
    rows = [delta_v(withheld=["gains (`guidance.navigation`)", "refusal (`guidance.refusal`)", "the machine"])]
    inputs_by_label = open_by_label(rows)
    assert inputs_by_label["gains"].together == ("guidance.refusal",)
    assert inputs_by_label["refusal"].together == ("guidance.navigation",)
    assert (inputs_by_label["the machine"].inputs, inputs_by_label["the machine"].named) == ((), 1)


# -------------------------------------------------------------------------------------------------- changed verdicts


def test_readings_that_change_a_verdict_are_named():
    changed = compared([delta_v()]).changed_verdicts()
    assert {name: [(change.claim, change.after) for change in verdicts] for name, verdicts in changed.items()} == {
        "air_slip": [("delta_v", "reproduced")],
        "coarse": [("delta_v", "undetermined")],
    }
