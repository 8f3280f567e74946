"""What moves if something is set otherwise, and universes by their numbers."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from PIL import Image

from marsedl.papers import catalogue, input_model
from marsedl.plotting.style import save_side_by_side
from marsedl.replication.checks.compare import apart, difference, in_numbers
from marsedl.replication.claims.claim import Claim, Margin, Result
from marsedl.replication.claims.moved import Entry
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.verdicts import Declaration, Evaluation, judge
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.readings import load_studies, load_study
from marsedl.replication.records import store
from marsedl.replication.universes.designs import AGAIN, FIRST, Universe, design, numbered
from marsedl.replication.universes.judging import Judge
from marsedl.replication.universes.table import Evaluator, Outcome, Row, table_of
from marsedl.replication.universes.what_if import (
    Alternative,
    WhatIf,
    changes_of,
    entries_of_reading,
    entries_of_universe,
    figure_entry,
    found,
    moved_claims,
)

ROOT = Path(__file__).parents[3]
SLUG = "powered_descent"
STUDIES = {slug: load_study(slug, input_model(slug), ROOT) for slug in (SLUG, "random_field", "desensitized")}


# ------------------------------------------------------------------------------------------- universes by their numbers


def table_in(folder, slug, *universes):
    """A file with the table of some universes of a paper, in which nothing is measured."""
    rows = [Row(one, {"claim": Outcome("result", {"": (1.0, 0.0, 1.0)})}) for one in universes]
    path = folder / f"{slug}.h5"
    store.save(path, table_of(SimpleNamespace(study=STUDIES[slug]), rows), paper=slug, reading="all", provenance={})
    return path


@pytest.mark.parametrize("slug", STUDIES)
def test_a_universe_of_a_design_is_the_one_of_its_list(slug):
    choices, designs = STUDIES[slug].choices, STUDIES[slug].designs
    every = design(choices, 32, *designs[1:])
    assert [numbered(choices, one.number, *designs[1:]) for one in every] == every
    with pytest.raises(InputError, match="no design has it"):
        numbered(choices, len([one for one in every if one.number < FIRST]), *designs[1:])


@pytest.mark.parametrize("number", [-1, 999, 100_000, 100_091, 999_999, AGAIN, AGAIN + 100_198])
def test_a_number_that_no_table_and_no_design_has_is_refused(tmp_path, number):
    path = table_in(tmp_path, SLUG, Universe(0, "one_at_a_time", {}))
    with pytest.raises(InputError, match=f"^no table holds universe {number}, and no design has it"):
        found(STUDIES[SLUG], number, [path, tmp_path / "not_there.h5"])


@pytest.mark.parametrize(
    "universe",
    [
        Universe(100_091, "wave", {}, wave=2),
        Universe(AGAIN + 100_198, "wave", {}, seed=1, wave=4),
        Universe(5, "one_at_a_time", {}),  # in a table in which fewer choices are varied by themselves
    ],
)
def test_a_universe_is_that_of_the_table_that_holds_it(tmp_path, universe):
    study = STUDIES["random_field"]
    ranged, other = (next(one for one in study.choices if bool(one.range) == kind) for kind in (True, False))
    value = next(name for name in other.alternatives if name != study.choices.default(other))
    assignment = {ranged.name: ranged.range.at(0.87654321), other.name: value}
    universe = replace(universe, assignment=assignment)
    path = table_in(tmp_path, "random_field", Universe(0, "one_at_a_time", {}), universe)
    assert found(study, universe.number, [tmp_path / "not_there.h5", path]) == (universe, path)


def test_the_build_comes_before_the_committed_run_and_a_design_last(tmp_path):
    study, built = STUDIES[SLUG], Universe(1003, "space_filling", {"noise_unit": "newton"})
    (tmp_path / "committed").mkdir()
    own = table_in(tmp_path, SLUG, built)
    other = table_in(tmp_path / "committed", SLUG, replace(built, assignment={}), Universe(1004, "space_filling", {}))
    assert found(study, 1003, [own, other]) == (built, own)
    assert found(study, 1004, [own, other])[1] == other
    assert found(study, 1005, [own, other]) == (numbered(study.choices, 1005), None)


def test_a_table_of_other_choices_is_refused(tmp_path):
    path = table_in(tmp_path, SLUG, Universe(1003, "space_filling", {}))
    study = STUDIES[SLUG]
    fewer = replace(study.choices, by_name=dict([*study.choices.by_name.items()][1:]))
    with pytest.raises(InputError, match=f"{path} has other choices than this project"):
        found(replace(study, choices=fewer), 1003, [path])


# --------------------------------------------------------------------------------------------------- limits of a size


@pytest.mark.parametrize("slug", ["powered_descent", "random_field", "funnels"])
def test_the_lowest_of_all_limits_on_a_number_counts(slug):
    """A universe of the smoke size flies no more than this size allows; `--trials` never adds to what universes fly."""
    model = input_model(slug)
    small, full = load_study(slug, model, ROOT, "smoke"), load_study(slug, model, ROOT)
    allowed = small.readings["corrected"].trial_counts()
    flown, usual = small.universe({}).trial_counts(), full.universe({}).trial_counts()
    assert flown and all(number <= min(allowed[case], usual[case]) for case, number in flown.items())
    evaluator = Evaluator(catalogue(slug), model, ROOT)
    evaluator.limit_trials(10**9)
    assert evaluator.study.universe({}).inputs.plain() == full.universe({}).inputs.plain()


# ---------------------------------------------------------------------------------------------------------- what moves

ROWS = PublishedClaim(
    paper="toy",
    id="row",
    where="Sec. 1",
    quantity="row",
    kind="deterministic",
    unit="m",
    printed=[1.0, 2.0, 3.0],
    resolution=0.2,
)
CALM = PublishedClaim(
    paper="toy", id="calm", where="Sec. 1", quantity="calm", kind="qualitative", unit="1", printed=True
)
DECLARED = {"row": Declaration(), "calm": Declaration()}


def universe_side(number, row, tests, decides):
    """A universe of a table whose base has the row as it is printed, and a statement that its second test decides."""
    base = {"row": Outcome("result", {f"[{k}]": (float(k), 0.0, float(k)) for k in (1, 2, 3)}, "", "[1]")}
    base["calm"] = Outcome("result", {"test 1": (0.0, 0.0, 1e-6), "test 2": (0.2, 0.0, 0.5)}, "holds", "test 2")
    own = {"row": Outcome("result", {f"[{k}]": (one, 0.0, float(k)) for k, one in enumerate(row, 1)}, "", "[1]")}
    own["calm"] = Outcome("result", tests, "fails", decides)
    rows = [Row(Universe(0, "one_at_a_time", {}), base), Row(Universe(1, "one_at_a_time", {}), own)]
    table = table_of(SimpleNamespace(study=STUDIES[SLUG]), rows)
    judge = Judge(table, STUDIES[SLUG].choices, [ROWS, CALM], DECLARED)
    return Alternative(f"universe {number}", {}, entries_of_universe(judge, number))


def test_a_component_has_its_own_verdict_and_one_that_does_not_move_is_not_listed():
    tests = {"test 1": (0.0, 0.0, 1e-6), "test 2": (0.7, 0.0, 0.5)}
    sides = [universe_side(number, (1.0, 2.0, 9.0), tests, "test 2") for number in (0, 1)]
    assert [one.verdict for (claim, label), one in sides[1].entries.items() if claim == "row" and label] == [
        *("reproduced", "reproduced", "differs"),
    ]
    calm, row, component = sorted(moved_claims(*sides), key=lambda one: one.name)
    assert component.name == ("row", "[3]") and row.name == ("row", "")
    assert {(one.before.verdict, one.after.verdict) for one in (row, component)} == {("reproduced", "differs")}
    assert (calm.name, calm.turned, calm.same_test) == (("calm", ""), True, True)


def statement(verdict, test, value, limit=1e-6):
    """A reading in which a test decides a statement."""
    margin = Margin(measure="share", value=value, limit=limit, unit="1", distance=0.0, scale="values")
    result = Result(value=verdict == "holds", verdict=verdict, margin=margin, test=test)
    given = CALM.model_dump(include=set(Claim.model_fields))
    row = Claim(**given, verdict=verdict, reading="corrected", readings={})
    return Alternative("corrected", {}, entries_of_reading(row, result))


def test_numbers_of_two_tests_have_no_difference_in_universes_and_in_readings():
    """Also of a universe beside a reading, whose limits may be equal by chance."""
    tests = {"test 1": (0.8695, 0.0, 0.4887), "test 2": (0.2, 0.0, 0.5)}
    before, after = (universe_side(number, (1.0, 2.0, 3.0), tests, "test 1") for number in (0, 1))
    readings = [statement("holds", "test 2", 3.2e-7), statement("fails", "test 1", 0.8695, 0.4887)]
    for pair in ([before, after], readings, [readings[0], after], [before, readings[1]]):
        one = moved_claims(*pair)[0]
        assert one.name == ("calm", "")
        assert not one.same_test and math.isnan(one.size) and math.isnan(one.sigmas)
        assert "limit 0.4887" in in_numbers(one)[1]
        assert apart(one) == "another test decides"
    one = moved_claims(before, statement("fails", "test 2", 0.9, 0.5))[0]
    assert one.same_test and one.after.value == 0.9


@pytest.mark.parametrize(("decides", "test"), [(0, "test 1"), (1, "test 2")])
def test_a_reading_says_which_test_of_a_statement_decides(decides, test):
    margins = [
        Margin(measure="share", value=value, limit=1.0, unit="1", distance=0.0, scale="values") for value in (0.5, 0.6)
    ]
    assert judge(CALM, Evaluation(True, margin=margins[decides], margins=margins)).test == test
    assert judge(CALM, Evaluation(True)).test == ""


def test_a_verdict_that_turns_by_less_than_three_errors_is_said_to_be_noise():
    def side(value, verdict):
        return Alternative(verdict, {}, {("calm", ""): Entry(value, 0.1, 1.0, verdict)})

    for after, noise in ((1.3, True), (1.6, False)):
        (one,) = moved_claims(side(0.9, "holds"), side(after, "fails"))
        assert noise == ("turns within noise" in apart(one))


def test_of_a_number_that_is_not_finite_only_the_verdict_moves():
    (one,) = moved_claims(statement("holds", "", 2.0), statement("fails", "", math.inf))
    assert one.turned and one.before.value == 2.0 and math.isnan(one.after.value) and math.isnan(one.size)


def test_a_claim_that_fails_to_give_a_result_is_told_with_its_sentence():
    before = Alternative("a", {}, {("calm", ""): Entry(verdict="holds")})
    after = Alternative("b", {}, {("calm", ""): Entry(verdict="none", said="the largest gain is 4e9")})
    (one,) = moved_claims(before, after)
    assert (one.after.verdict, one.after.said) == ("none", "the largest gain is 4e9")


# ----------------------------------------------------------------------------------------------------------- on a paper


@pytest.fixture(scope="module")
def evaluator():
    made = Evaluator(catalogue(SLUG), input_model(SLUG), ROOT)
    made.limit_trials(100)
    return made


def moved(evaluator, *given):
    return difference(*WhatIf(evaluator, *given).sides()).moved


@pytest.mark.stages
@pytest.mark.xdist_group(SLUG)
def test_what_if_names_what_moves_and_what_was_set(evaluator):
    asked = WhatIf(evaluator, *changes_of(["initial_descent=printed"], evaluator.study.choices))
    assert asked.set == {"initial_descent": ("corrected", "printed")}
    assert asked.trials == evaluator.study.universe({}).trial_counts() and max(asked.trials.values()) == 100
    found = difference(*asked.sides()).moved
    assert {"mc_mean_final_mass", "prior_final_mass"} <= {one.name[0] for one in found if one.counts}
    assert not [one for one in moved(evaluator, {}, {"ensemble.drawn_trials": 7}) if one.counts]


def test_what_if_refuses_what_does_not_exist_or_fit_before_anything_is_computed(evaluator):
    choices = evaluator.study.choices
    for text, message in {
        "initial_descend=printed": "did you mean 'initial_descent'?",
        "initial_descent=up": "no value 'up'",
        "noise_unit": "write NAME=VALUE",
    }.items():
        with pytest.raises(InputError, match=message.replace("?", r"\?")):
            changes_of([text], choices)
    with pytest.raises(InputError, match=r"did you mean 'ensemble.seed'"):
        WhatIf(evaluator, {}, {"ensemble.sed": 7})
    with pytest.raises(InputError, match=r"simulation\.command_interval .* is shorter than simulation\.time_step"):
        WhatIf(evaluator, {}, {"simulation.command_interval": 0.01})
    with pytest.raises(InputError, match="did you mean 'fig07'"):
        figure_entry(evaluator.paper, "fig7")
    with pytest.raises(InputError, match="no reading 'mien'"):
        WhatIf(evaluator, {}, {}, "mien")


@pytest.mark.stages
@pytest.mark.xdist_group(SLUG)
def test_a_figure_is_drawn_of_both(evaluator, tmp_path):
    figures = WhatIf(evaluator, {"noise_unit": "newton"}, {}).drawn("fig07")
    assert list(figures) == ["corrected", "noise_unit = newton"]
    save_side_by_side(figures, tmp_path / "deep" / "fig07.png")
    with Image.open(tmp_path / "deep" / "fig07.png") as image:
        assert image.width > 1.8 * image.height


OWN = """
powered_descent:
  choices:
    noise_unit:
      asks: In which unit?
      because: withheld
      values: {mine: {noise: {noise_coefficient: {value: 0.5, source: "assumed: test"}}}}
  readings:
    mine: {based_on: corrected, choices: {noise_unit: newton}, planet: {gravity: {value: 3.9, source: "assumed: test"}}}
"""


def test_what_if_takes_choices_and_readings_of_a_users_file(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(OWN, encoding="utf-8")
    evaluator = Evaluator(catalogue(SLUG), input_model(SLUG), ROOT)
    evaluator.study = load_studies({SLUG: input_model(SLUG)}, ROOT, {}, [path])[SLUG]
    own = WhatIf(evaluator, {"noise_unit": "mine"}, {})
    assert own.set["noise_unit"][1] == "mine" and own.runs[1].values["noise.noise_coefficient"] == 0.5
    back = WhatIf(evaluator, {"noise_unit": "maximum_thrust"}, {"planet.gravity": 3.8}, "mine")
    assert back.set == {"noise_unit": ("newton", "maximum_thrust"), "planet.gravity": ("3.9", "3.8")}
    before, after = (run.values for run in back.runs)
    assert before["planet.gravity"] == 3.9 and after["planet.gravity"] == 3.8
    units = before["noise.coefficient_unit"], after["noise.coefficient_unit"]
    assert units[0] == "newton" != units[1], "also to what corrected has"
    assert back.names[0] == "mine"
