"""Universes of a paper: those that are computed are what its readings and the workflow compute."""

from copy import copy
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.plotting.style import save_side_by_side
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.messages import Place
from marsedl.replication.inputs.readings import load_studies
from marsedl.replication.pipeline.runner import Memory, Run
from marsedl.replication.records.store import content_digest
from marsedl.replication.universes.designs import ONE_AT_A_TIME, Universe, design
from marsedl.replication.universes.judging import Judge
from marsedl.replication.universes.table import CAUSES, Evaluator, chunk_of, gathered, tabulated
from marsedl.replication.universes.tabulating import claims_table, effects_table
from marsedl.replication.universes.what_if import changes_of, drawn, what_if

ROOT = Path(__file__).parents[3]
SLUG = "powered_descent"
RECORDS = ("nominal", "gains", "montecarlo.closed_loop")
CORRECTED = Universe(0, ONE_AT_A_TIME, {})
CLIMBING = Universe(1, ONE_AT_A_TIME, {"initial_descent": "printed"})

pytestmark = [pytest.mark.stages, pytest.mark.xdist_group(SLUG)]


@pytest.fixture(scope="module")
def evaluator():
    made = Evaluator(catalogue(SLUG), input_model(SLUG), ROOT)
    made.limit_trials(100)
    return made


def digests(run):
    return {name: content_digest(run.record(name)) for name in RECORDS}


def test_the_universe_corrected_is_the_reading_and_another_one_is_the_inputs_that_it_sets(evaluator):
    study = evaluator.study
    reading = study.limited(study.readings["corrected"])
    assert digests(evaluator.run(CORRECTED)) == digests(Run.of(evaluator.paper, reading.inputs, Memory()))
    printed = study.readings["printed"].inputs.entry.initial_velocity_angle
    values = reading.inputs.plain() | {"entry.initial_velocity_angle": printed}
    trials = {case: reading.inputs.get(name) for case, name in reading.inputs.CASES.items()}
    by_hand = Run(evaluator.paper, values, Memory(), {case: number for case, number in trials.items() if number})
    assert digests(evaluator.run(CLIMBING)) == digests(by_hand)


def test_a_universe_is_the_same_after_others_and_memory_stays_flat(evaluator):
    first = evaluator.row(CORRECTED).outcomes
    held = []
    for number, unit in enumerate(("newton", "kilonewton", "mars_weight"), start=2):
        evaluator.row(Universe(number, ONE_AT_A_TIME, {"noise_unit": unit}))
        held.append(len(evaluator.memory))
    again = evaluator.row(CORRECTED).outcomes
    assert [one.numbers for one in again.values()] == [one.numbers for one in first.values()]
    assert held[0] == held[1] == held[2]


def test_chunks_give_the_table_of_one_process_and_what_fails_takes_only_its_claims_along(evaluator):
    universes = [CORRECTED, CLIMBING, Universe(2, ONE_AT_A_TIME, {"equation_46": "printed"})]
    whole = tabulated(evaluator, universes)
    parts = gathered([tabulated(evaluator, universes[chunk::2]) for chunk in range(2)])
    assert content_digest(whole) == content_digest(parts)
    causes = {int(number): set(row.tolist()) for number, row in zip(whole.number, whole.cause, strict=True)}
    assert {CAUSES.index("result"), CAUSES.index("refused")} <= causes[2], "the mass iteration burns all of the mass"
    judge = Judge(whole, evaluator.study.choices, list(evaluator.published.values()))
    effects = {(one.choice, one.value): one for one in judge.effects("mc_mean_final_mass")}
    assert effects["initial_descent", "printed"].difference > 5.0, "kg"
    assert not effects["initial_descent", "printed"].towards
    assert set(claims_table(judge)["claim"]) == set(evaluator.asked)
    assert len(effects_table(judge))


def test_what_if_names_what_moves_and_refuses_what_does_not_exist(evaluator):
    choices = evaluator.study.choices
    moved = what_if(evaluator, *changes_of(["initial_descent=printed"], choices))
    assert {"mc_mean_final_mass", "prior_final_mass"} <= {one.claim for one in moved}
    assert all(one.counts for one in moved)
    assert what_if(evaluator, {}, {"ensemble.drawn_trials": 7}) == []
    for text, message in {
        "initial_descend=printed": "did you mean 'initial_descent'?",
        "initial_descent=up": "no value 'up'",
        "noise_unit": "write NAME=VALUE",
    }.items():
        with pytest.raises(InputError, match=message.replace("?", r"\?")):
            changes_of([text], choices)
    with pytest.raises(InputError, match=r"did you mean 'ensemble.seed'"):
        what_if(evaluator, {}, {"ensemble.sed": 7})
    with pytest.raises(InputError, match=r"simulation\.command_interval .* is shorter than simulation\.time_step"):
        what_if(evaluator, {}, {"simulation.command_interval": 0.01})


def test_a_figure_is_drawn_of_both(evaluator, tmp_path):
    figures = drawn(evaluator, "fig07", {"noise_unit": "newton"}, {})
    assert list(figures) == ["corrected", "noise_unit = newton"]
    save_side_by_side(figures, tmp_path / "deep" / "fig07.png")
    with Image.open(tmp_path / "deep" / "fig07.png") as image:
        assert image.width > 1.8 * image.height
    with pytest.raises(InputError, match="did you mean 'fig07'"):
        drawn(evaluator, "fig7", {}, {})


def test_every_paper_has_its_readings_at_values_of_them():
    for slug in SLUGS:
        choices = Evaluator(catalogue(slug), input_model(slug), ROOT).study.choices
        assert choices and all(one.corrected is not None for one in choices)
        assert all(one.printed is not None for one in choices if one.erratum and not one.only_if)
        errata = {erratum.id for erratum in catalogue(slug).errata}
        assert {one.erratum for one in choices if one.erratum} <= errata
        universes = design(choices, 8)
        assert len({one.number for one in universes}) == len(universes)


def test_named_readings_are_evaluated_beside_their_universes_in_any_number_of_chunks(evaluator):
    study = evaluator.study
    assert study.assignment_of("target4") == {"downrange_target_variance": "four"}
    small = copy(evaluator)
    small.study = replace(study, points=("printed_eq46", "plus_sign"))
    few = ({"ensemble": {"large_trials": 1.0, "trials": 50.0}}, Place("size"))
    limited = replace(study, limits=(few,)).limited(study.readings["plus_sign"])
    small.study = replace(small.study, readings={**study.readings, "plus_sign": limited})
    universes = [CORRECTED, CLIMBING, Universe(2, ONE_AT_A_TIME, {"noise_unit": "newton"})]
    table, points = zip(*(chunk_of(small, universes, chunk, 2, "") for chunk in range(2)), strict=True)
    assert [list(found) for found in points] == [["printed_eq46"], ["plus_sign"]]
    assert repr(points[1]["plus_sign"]) == repr(small.point("plus_sign")), "NaN equals no NaN"
    assert content_digest(gathered(table)) == content_digest(tabulated(evaluator, universes))


def test_every_erratum_that_changes_an_input_is_kept_by_itself():
    """In a full build for three papers; for the others, whose universes are dear, with `--config universes=...`."""
    for slug in SLUGS:
        for config, allowed in (({}, {"desensitized": {"E7", "E16"}}), ({"universes": 8}, {})):
            study = load_studies({slug: input_model(slug)}, ROOT, config)[slug]
            moved = {name for one in design(study.choices, *study.designs) for name in one.assignment}
            kept = {one.erratum for one in study.choices if one.name in moved}
            assert {one.erratum for one in study.choices if one.erratum} - kept <= allowed.get(slug, set()), slug
