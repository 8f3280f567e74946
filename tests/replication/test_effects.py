"""What decides a verdict, and what errata and unprinted inputs change, on rows whose answers are worked out by hand."""

import math

import pytest

from marsedl.replication import effects
from marsedl.replication.catalogue import Erratum
from marsedl.replication.effects import Change, VerdictChange
from marsedl.replication.report import InputEntry, InputValue, ReadingEntry

READINGS = [
    ReadingEntry("printed", "as printed"),
    ReadingEntry("corrected", "mended", "printed"),
    ReadingEntry("slip", "keeps one erratum", "corrected"),
    ReadingEntry("air", "another density", "corrected"),
    ReadingEntry("air_slip", "both", "air"),
    ReadingEntry("lost", "has no result", "corrected"),
    ReadingEntry("coarse", "a coarse step", "corrected"),
]
NAMES = [reading.name for reading in READINGS]


def margin(measure, value, limit, distance=1.0, scale="limits", unit="", error=0.0):
    written = {"measure": measure, "value": value, "limit": limit, "unit": unit, "distance": distance, "in": scale}
    return {**written, "standard_error": error}


def result(value, verdict, error=None, trials=None, **more):
    components = [verdict] * len(value) if isinstance(value, list) else None
    absent = {"margin": None, "z": None, "doubt": "", "evidence": "", "numbers": {}, "at_equal_trials": None}
    fields = {"value": value, "standard_error": error, "trials": trials, "verdict": verdict, "components": components}
    return {**absent, **fields, **more}


def row(name, readings, **more):
    first = readings["corrected"]
    given = {"id": name, "kind": "monte_carlo", "unit": "m/s", "printed": 310, "resolution": 1.0, "headline": None}
    given |= {"verdict": first["verdict"], "reading": "corrected", "errata": [], "withheld": [], "close": None}
    return {**given, "by_construction": "", "readings": readings, **more}


def statement(name, readings, **more):
    return row(name, readings, kind="qualitative", unit="1", printed=True, resolution=None, **more)


def delta_v(**more):
    """300 m/s from 100,000 flights, 306 from the first 5,000, as many as the other readings fly."""
    off = margin("difference from the printed value", -10.0, 1.0, 3.0, "standard errors")
    fewer = result(306.0, "differs", 3.0, 5000)
    readings = {
        "corrected": result(300.0, "differs", 0.5, 100_000, margin=off, at_equal_trials=fewer),
        "printed": result(None, "differs", None, 5000),
        "slip": result(346.0, "differs", 4.0, 5000),
        "air": result(306.0, "differs", 3.0, 5000),
        "air_slip": result(311.0, "reproduced", 4.0, 5000),
        "lost": result(None, "differs", None, 5000),
        "coarse": result(307.0, "undetermined", 4.0, 5000),
    }
    return row("delta_v", readings, **{"headline": 1, **more})


def entry(name, assumed=True, **values):
    source = "assumed: not printed" if assumed else "Table 1"
    default = values.pop("corrected")
    return InputEntry(
        name, "1", {one: InputValue(values.get(one, default), source) for one in NAMES}, f"what {name} is"
    )


INPUTS = [
    entry("air.density", corrected="sample", air="mean", air_slip="mean"),
    entry("guidance.tail", assumed=False, corrected="0.01", slip="0.1", air_slip="0.1", printed="0.1"),
    entry("guidance.navigation", corrected="10", lost="0"),
    entry("guidance.refusal", corrected="refuse", lost="report"),
    entry("simulation.step", corrected="0.1", coarse="0.5"),
    entry("simulation.trials", corrected="100000", **dict.fromkeys(set(NAMES) - {"corrected"}, "5000")),
    entry("simulation.seed", corrected="7"),
]


# ------------------------------------------------------------------------------------------------------ one claim


def test_a_row_of_numbers_is_shown_whole_counted_or_by_its_ends():
    def of(value, error=None, components=None, unit="km"):
        one = {**result(value, "differs", error, 100), "components": components}
        return effects.shown(row("row", {"corrected": one}, unit=unit, resolution=0.1))

    assert of([1.0, -2.5], [0.1, 0.2], ["reproduced", "differs"]) == "1.00 ± 0.10, -2.50 ± 0.20 km"
    assert of([1.0, 2.0, 3.0], [0.1, 0.2, 0.3], ["reproduced", "close", "differs"]) == "2 of 3 agree"
    assert of([[1.0, 2.0], [3.0, 4.0]], None, [["close", "differs"], ["differs", "differs"]]) == "1 of 4 agree"
    assert of([1.0, 2.0, 3.0], None, None, "m, m/s, kg") == "1.000 m ... 3.000 kg"


def test_the_line_names_the_cause_of_a_difference():
    titles = {"E1": "The sign is wrong", "E2": "The unit is missing", "E3": "One two three four five six seven"}
    assert effects.why(delta_v(errata=["E1"]), titles) == "The sign is wrong"
    assert effects.why(delta_v(errata=["E1", "E2"]), titles) == "The sign is wrong; The unit is missing"
    assert effects.why(delta_v(errata=["E3", "E1", "E2"]), titles) == f"{titles['E3']} and 2 more"
    density = "the nominal density (`air.density_profile`, `air.density_table`)"
    assert effects.why(delta_v(withheld=[density]), titles) == "not printed: the nominal density"
    meanings = {"recursion.shape": "shape of the slices: that of the cost, or of least volume"}
    assert effects.why(delta_v(withheld=["recursion.shape"]), {}, meanings) == "not printed: shape of the slices"
    assert effects.why(delta_v(), titles) == "outside rounding and sampling error"
    failed = statement("stated", {"corrected": result(False, "fails", margin=margin("it", 5.0, 1.25))})
    assert effects.why(failed, titles) == "limit 1.25"


# -------------------------------------------------------------------------------------------------- errata


def test_readings_are_compared_at_equal_numbers_of_trials():
    (change,) = effects._changes(delta_v(), "slip", "corrected")
    # 346 - 306 from 5,000 flights each, not 346 - 300; three times the hypotenuse of 3 and 4, and half a digit
    assert change == Change("delta_v", "", (), "slip", "corrected", 306.0, 346.0, 40.0, 5.0, "m/s", 40 / 15.5, True)
    (same,) = effects._changes(delta_v(), "air", "corrected")
    assert (same.difference, same.error, same.size) == (0.0, 0.0, 0.0), "the same flights"
    large = delta_v()
    large["readings"]["slip"]["at_equal_trials"] = None
    large["readings"]["corrected"]["at_equal_trials"] = None
    (unequal,) = effects._changes(large, "slip", "corrected")
    assert (unequal.difference, unequal.equal_trials) == (46.0, False)


def test_the_most_of_equal_trials_are_compared():
    both = {name: result(v, "differs", 1.0, 100_000, at_equal_trials=result(v + 9.0, "differs", 5.0, 5000))
            for name, v in (("corrected", 300.0), ("slip", 350.0))}  # fmt: skip
    (change,) = effects._changes(row("delta_v", both), "slip", "corrected")
    assert (change.before, change.after) == (300.0, 350.0)


def test_statements_are_compared_by_their_measure():
    def change(scale, error=0.0, other="tightness"):
        readings = {
            "corrected": result(False, "fails", margin=margin("tightness", 5.0, 1.0, 40.0, scale, error=error)),
            "slip": result(False, "fails", margin=margin(other, 5.6, 1.0, 46.0, scale, error=error)),
        }
        return effects._changes(statement("tight", readings), "slip", "corrected")

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


def shown_cause(one, *errata, inputs=INPUTS):
    moves = effects.causes([one], errata, inputs, READINGS)
    return effects.why(one, {e.id: e.title for e in errata}, {e.name: e.meaning for e in inputs}, moves[one["id"]])


def test_a_cause_that_does_not_move_the_number_towards_what_is_printed_is_not_shown():
    away, still, unknown, none = erratum("E1", "slip"), erratum("E2", "coarse"), erratum("E3"), erratum("E4", "lost")
    towards = erratum("E5", "near")
    claim = delta_v(errata=["E1", "E2", "E3", "E4", "E5"], withheld=["the step (`simulation.step`)"])
    claim["readings"]["near"] = result(309.9, "differs", 0.1, 5000)
    claim["readings"]["corrected"]["at_equal_trials"]["standard_error"] = 0.1
    readings = [*READINGS, ReadingEntry("near", "another", "corrected")]
    inputs = [InputEntry(e.name, "1", {**e.values, "near": e.values["air"]}, e.meaning) for e in INPUTS]
    moves = effects.causes([claim], [away, still, unknown, none, towards], inputs, readings)["delta_v"]
    # 309.9 is 3.9 from 306, of which three times the root of two tenths and half a digit are nothing
    assert moves == {
        "E1": 0.0,
        "E2": 0.0,
        "E4": 0.0,
        "the step (`simulation.step`)": 0.0,
        "E5": pytest.approx(3.9 / (3 * math.hypot(0.1, 0.1) + 0.5)),
    }
    titles = {one.id: one.title for one in (away, still, unknown, none, towards)}
    assert effects.why(claim, titles, {}, moves) == "Title of E5; Title of E3"


def test_without_a_cause_that_moves_it_a_claim_is_outside_of_its_limits():
    assert shown_cause(delta_v(errata=["E1"]), erratum("E1", "slip")) == "outside rounding and sampling error"
    held = delta_v(errata=["E1"], withheld=["the density (`air.density`)", "the seed (`simulation.seed`)"])
    assert shown_cause(held, erratum("E1", "slip")) == "not printed: the seed"


def test_a_reading_in_which_a_claim_stands_shows_its_cause():
    turned = with_turned("fails", "holds") | {"errata": ["E1"]}
    assert shown_cause(turned, erratum("E1", "slip")) == "Title of E1"
    nearer = {name: result(False, "fails", margin=margin("it", value, 1.0, 40.0, "standard errors", error=0.1))
              for name, value in (("corrected", 5.0), ("slip", 3.0), ("air", 7.0))}  # fmt: skip
    stated = statement("stated", nearer, errata=["E1", "E2"])
    assert shown_cause(stated, erratum("E1", "air"), erratum("E2", "slip")) == "Title of E2"


def with_turned(before, after, reading="slip", trials=None):
    readings = {"corrected": result(True, before), reading: result(False, after, trials=trials)}
    return statement("turned", readings)


def test_errata_are_ranked_by_what_they_change():
    rows = [delta_v(), with_turned("holds", "fails", "air")]
    errata = [
        erratum("E1"),
        erratum("E2", "coarse"),
        erratum("E3", "air"),
        erratum("E4", "slip"),
        erratum("E5", "lost"),
    ]
    effect_of_id = {effect.id: effect for effect in effects.errata_effects(rows, errata, READINGS)}
    assert {name: effect.rank for name, effect in effect_of_id.items()} == {
        "E5": "no_result",
        "E4": "headline",
        "E3": "verdict",
        "E2": "verdict",  # from differs to undetermined
        "E1": "not_isolated",
    }
    assert list(effect_of_id) == ["E5", "E4", "E2", "E3", "E1"], "in the order of the catalogue within a rank"
    assert effect_of_id["E5"].no_result == (("delta_v", "lost"),)
    (change,) = effect_of_id["E4"].headline
    assert (change.reading, change.difference, change.counts) == ("slip", 40.0, True)
    assert effect_of_id["E3"].verdicts == (VerdictChange("turned", "air", "corrected", "holds", "fails", True),)
    assert effect_of_id["E4"].title == "Title of E4"


def test_a_reading_is_compared_with_its_nearest_base_that_mends_the_erratum():
    (effect,) = effects.errata_effects([delta_v()], [erratum("E1", "slip", "air_slip")], READINGS)
    assert effect.readings == (("slip", "corrected"), ("air_slip", "air"))
    (effect,) = effects.errata_effects([delta_v()], [erratum("E1", "air", "air_slip")], READINGS)
    assert effect.readings == (("air", "corrected"), ("air_slip", "corrected"))


def test_what_fewer_trials_may_leave_open_is_no_change():
    rows = [with_turned("holds", "undetermined", trials=5000)]
    assert effects.changing(rows).claims == {}
    rows = [with_turned("holds", "fails", trials=5000)]
    assert not effects.changing(rows).claims["turned"][0].equal_trials
    assert effects.changing([with_turned("holds", "by_construction")]).claims == {}, "it is not counted there"


# ------------------------------------------------------------------------------------------------ what decides


def test_the_deciding_number_is_that_of_the_first_headline_claim_with_numbers():
    rows = [statement("first", {"corrected": result(True, "holds")}, headline=1), delta_v(headline=2)]
    deciding = effects.deciding(rows, READINGS, INPUTS, [erratum("E4", "slip")])
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
    deciding = effects.deciding(rows, READINGS, INPUTS, [])
    assert (deciding.component, deciding.unit, deciding.value, deciding.printed) == ((1,), "m^2", 5.0, 3.9)
    assert deciding.choices[0].change.difference == -1.0


def test_without_a_headline_number_the_measure_of_a_statement_decides():
    alone = {"corrected": result(False, "fails", margin=margin("excess", 0.1, 0.0)), "slip": result(False, "fails")}
    tight = {
        "corrected": result(False, "fails", margin=margin("tightness", 5.0, 1.25, unit="%")),
        "slip": result(False, "fails", margin=margin("tightness", 4.0, 1.25, unit="%")),
    }
    rows = [statement("bound", alone, headline=1), statement("tight", tight, headline=2)]
    deciding = effects.deciding(rows, READINGS, INPUTS, [])
    assert (deciding.claim, deciding.measure, deciding.limit, deciding.printed) == ("tight", "tightness", 1.25, None)
    assert [choice.change.after for choice in deciding.choices] == [4.0]
    assert effects.deciding(rows[:1], READINGS, INPUTS, []) is None


# ------------------------------------------------------------------------------------------------- unprinted inputs


def open_by_label(rows):
    return {one.label: one for one in effects.open_inputs(rows, INPUTS, READINGS)}


def test_open_inputs_have_the_range_that_readings_give_the_number():
    rows = [delta_v(withheld=["the step (`simulation.step`)"]), with_turned("fails", "fails")]
    inputs_by_label = open_by_label(rows)
    step = inputs_by_label["the step"]
    assert (step.inputs, step.used, step.low, step.high) == (("simulation.step",), ("0.1",), 306.0, 307.0)
    assert (step.named, step.refuted, step.claims) == (1, 2, ("delta_v",))
    assert next(iter(inputs_by_label)) == "the step", "most named first"
    density = inputs_by_label["what air.density is"]
    assert [(change.reading, change.against) for change in density.changes] == [("air", "corrected")]
    assert (density.low, density.high, density.named) == (306.0, 306.0, 0)


def test_an_input_that_accompanies_another_is_no_choice_of_its_own():
    rows = [delta_v(withheld=["what keeps gains finite (`guidance.navigation`)"])]
    inputs_by_label = open_by_label(rows)
    gains = inputs_by_label["what keeps gains finite"]
    assert (gains.no_result, gains.changes, gains.together) == (("lost",), (), ())
    assert inputs_by_label["what guidance.refusal is"].no_result == ()
    assert "what guidance.tail is" not in inputs_by_label, "it is printed"
    assert inputs_by_label["what simulation.seed is"].low is None


def test_open_inputs_that_no_reading_varies_alone_name_each_other():
    rows = [delta_v(withheld=["gains (`guidance.navigation`)", "refusal (`guidance.refusal`)", "the machine"])]
    inputs_by_label = open_by_label(rows)
    assert inputs_by_label["gains"].together == ("guidance.refusal",)
    assert inputs_by_label["refusal"].together == ("guidance.navigation",)
    assert (inputs_by_label["the machine"].inputs, inputs_by_label["the machine"].named) == ((), 1)


# -------------------------------------------------------------------------------------------------- changed verdicts


def test_readings_that_change_no_verdict_are_named():
    changing = effects.changing([delta_v()])
    assert list(changing.claims) == ["delta_v"]
    assert [(change.reading, change.after) for change in changing.claims["delta_v"]] == [
        ("air_slip", "reproduced"),
        ("coarse", "undetermined"),
    ]
    assert changing.same == ("printed", "slip", "air", "lost")
