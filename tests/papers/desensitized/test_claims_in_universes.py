"""Claims in universes: they cope with lost flights and missing rows; a universe is the reading of the same inputs."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from marsedl.papers import catalogue
from marsedl.papers.desensitized.inputs import Inputs
from marsedl.papers.desensitized.records import Gains, Linearization, Responses, Tradeoff
from marsedl.replication.claims.printed import load_published
from marsedl.replication.claims.verdicts import judge
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.errors import InfeasibleError, MarsedlError
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.pipeline.injection import Arguments, Missing
from marsedl.replication.pipeline.runner import Memory, Run
from marsedl.replication.records.fields import quantities
from marsedl.replication.records.store import content_digest
from marsedl.replication.universes.designs import ONE_AT_A_TIME, Universe, one_at_a_time, space_filling
from marsedl.replication.universes.table import EVALUATED, Evaluator, class_of

ROOT = Path(__file__).parents[3]
PAPER, CLAIMS = catalogue("desensitized"), claims_of("desensitized")
PUBLISHED = {one.id: one for one in load_published(ROOT / "data" / "published" / "desensitized.yaml")}
STUDY = load_study("desensitized", Inputs, ROOT)
STUDIES = frozenset(name for name, stage in PAPER.stages.items() if stage.claimed_in)
SMALL = {
    "solver.intervals": 60,
    "design.weight_path": [0.03, 0.5, 6.0, 60.0, 600.0],
    "design.infinite_weights": [3e3, 1e4],
    "design.all_columns_regularization": [0.1],
    "simulation.sweep_points": 9,
    "ensemble.trials": 10,
    "ensemble.drawn_trials": 2,
}
HEADLINES = {
    "radius_reducible_by_reshaping",
    "dr_needs_feedback",
    "cr_needs_feedback",
    "feedback_radius_greatly_reduced",
    "more_fuel_when_desensitized",
}


def run_of(values):
    return Run(PAPER, values, Memory(), {"entry_errors": values["ensemble.trials"]}, without=STUDIES)


@pytest.fixture(scope="module")
def run():
    """`corrected` on a coarse mesh with few weights."""
    return run_of(STUDY.readings["corrected"].inputs.plain() | SMALL)


def outcomes(run, change):
    """The verdict of every claim on changed records, or the MarsedlError that it raises; any other error is raised."""
    given = run.given()
    changed = Arguments(given.values, lambda name, kind: change(given.artifact(name, kind)))
    asked, found = CLAIMS.asking(changed, PUBLISHED), {}
    for name in CLAIMS.declarations:
        if PUBLISHED[name].kind not in EVALUATED:
            continue
        try:
            found[name] = judge(PUBLISHED[name], CLAIMS.evaluate_one(name, asked), CLAIMS.declarations[name]).verdict
        except Missing:
            found[name] = None
        except MarsedlError as error:
            found[name] = error
    return found


def lost(record):
    """Flights of which none comes to its end, also not the unperturbed ones: NaN wherever the stage may write it."""
    if not isinstance(record, Responses):
        return record
    holes = {name: getattr(record, name) for name, one in quantities(Responses).items() if one.allow_nan}
    return dataclasses.replace(record, **{name: np.full(np.shape(value), np.nan) for name, value in holes.items()})


def unconverged(record):
    """Gains of which no search ended, with flights that are lost under them."""
    if isinstance(record, Gains):
        return dataclasses.replace(record, converged=np.zeros_like(record.converged))
    return lost(record)


def without(*weights, effort=0.1):
    """Tables of which some printed weights have no row, as no solution has their control energy."""

    def change(record):
        if not isinstance(record, Tradeoff | Linearization):
            return record
        kept = ~np.isin(record.printed_weight, weights)
        by_row = [name for name, one in quantities(type(record)).items() if one.dims[:1] == ("rows",)]
        rows = {name: getattr(record, name)[kept] for name in by_row}
        if isinstance(record, Tradeoff):
            rows |= {"missing_weight": np.array(weights), "missing_effort": np.full(len(weights), effort)}
        return dataclasses.replace(record, **rows)

    return change


@pytest.mark.filterwarnings("default::RuntimeWarning")  # of numbers that are NaN; a job may warn, but not end
@pytest.mark.parametrize(
    "change",
    [lost, unconverged, without(0.001), without(0.001, 0.01, 0.1, 1.0), without(0.001, 1.0, effort=9.0)],
    ids=["lost", "unconverged", "one row less", "no row with a finite weight", "two rows less"],
)
def test_no_claim_crashes(run, change):
    found = outcomes(run, change)
    assert set(found) >= HEADLINES
    assert not any(error for error in found.values() if isinstance(error, Exception) and change in (lost, unconverged))


def test_a_row_that_no_solution_has_has_no_value(run):
    """Before, another branch was judged as the row, or its claims failed."""
    complete, found = outcomes(run, lambda record: record), outcomes(run, without(0.001))
    missing = {name for name, one in found.items() if isinstance(one, Exception)}
    assert missing == {"tab03_c0p001", "fuel_increases_except_first_step"}
    assert all("c1 = 0.001 lies below the least" in str(found[name]) for name in missing)
    assert {class_of(found[name]).cause for name in missing} == {"infeasible"}
    assert {name: found[name] for name in HEADLINES} == {name: complete[name] for name in HEADLINES}
    elsewhere = outcomes(run, without(0.001, effort=1.0))["tab03_c0p001"]
    assert class_of(elsewhere).cause == "refused" and not isinstance(elsewhere, InfeasibleError)


def test_every_choice_is_at_a_value_in_corrected_and_printed():
    assert all(one.corrected is not None and one.printed is not None for one in STUDY.choices)
    printed, corrected = (STUDY.readings[name].sources for name in ("printed", "corrected"))
    turned = STUDY.choices.applied(corrected, {one.name: one.printed for one in STUDY.choices})
    assert {name for name in printed if turned[name].value != printed[name].value} == {"ensemble.trials"}
    for universe in [*one_at_a_time(STUDY.choices), *space_filling(STUDY.choices, 16)]:
        STUDY.universe(universe.assignment)


@pytest.mark.stages
def test_the_universe_corrected_is_the_reading_and_remains_so():
    evaluator = Evaluator(PAPER, Inputs, ROOT)
    small = {name: value for name, value in SMALL.items() if name != "design.weight_path"}
    names = ("nominal", "tradeoff", "linearization", "gains", "responses")

    def digests(assignment):
        run = evaluator.run(Universe(0, ONE_AT_A_TIME, assignment, inputs=small))
        found = {name: content_digest(run.record(name)) for name in names}
        evaluator.memory.let_go()
        return found

    limited = STUDY.limited(STUDY.readings["corrected"])
    reading = run_of(limited.inputs.plain() | small)
    first, other = digests({}), digests({"planet_radius": 3390.0, "branch": "one_reversal"})
    assert first == {name: content_digest(reading.record(name)) for name in names}
    assert all(other[name] != first[name] for name in names)
    assert digests({}) == first
