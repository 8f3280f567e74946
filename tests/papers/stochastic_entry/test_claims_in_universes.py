"""Claims in universes: they cope with flights that are all lost, and with laws that do not exist."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from marsedl.montecarlo.outcomes import CRASHED, ESCAPED, NON_FINITE
from marsedl.papers import catalogue
from marsedl.papers.stochastic_entry.admissible import admissible
from marsedl.papers.stochastic_entry.inputs import Inputs
from marsedl.papers.stochastic_entry.records import CASES
from marsedl.replication.claims.printed import load_published
from marsedl.replication.claims.verdicts import judge
from marsedl.replication.claims.writing import claims_of
from marsedl.replication.errors import InadmissibleError
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.pipeline.injection import Arguments
from marsedl.replication.pipeline.runner import Memory, Run, computed
from marsedl.replication.records.fields import quantities

ROOT = Path(__file__).parents[3]
PAPER, CLAIMS = catalogue("stochastic_entry"), claims_of("stochastic_entry")
PUBLISHED = {one.id: one for one in load_published(ROOT / "data" / "published" / "stochastic_entry.yaml")}
STUDY = load_study("stochastic_entry", Inputs, ROOT)
STUDIES = frozenset(name for name, stage in PAPER.stages.items() if stage.claimed_in)
STUDIED = {"theorem_lqg", "corollary_lqg", "fig9_altitude_range_tradeoff"}  # claims that rest on them
FEW = {"simulation.trials": 64, "simulation.paper_trials": 64}
LAWS = {"apollo": CASES[:2], "stochastic": CASES[2:], "both": CASES}


def verdicts(run, changed):
    """The verdicts of all claims; changed: a function of a record's name and of the record. Any error is the test's."""
    asked = CLAIMS.asking(given_to(run, changed), PUBLISHED)
    found = {name: CLAIMS.evaluate_one(name, asked) for name in CLAIMS.declarations if name not in STUDIED}
    return {name: judge(PUBLISHED[name], one, CLAIMS.declarations[name]).verdict for name, one in found.items()}


def given_to(run, changed):
    """What a function can ask a run for, with changed records."""
    given = run.given()
    return Arguments(run.values, lambda name, kind: changed(name, given.artifact(name, kind)))


def without_numbers(record):
    """A record with NaN wherever its stage may write it."""
    holes = {name: getattr(record, name) for name, one in quantities(type(record)).items() if one.allow_nan}
    return dataclasses.replace(record, **{name: np.full(np.shape(value), np.nan)[()] for name, value in holes.items()})


def ended(record, outcome, kept):
    """An ensemble of which all flights but the first end otherwise than they should, if they are finite at all."""
    changed = (record.outcome != NON_FINITE) & (np.arange(len(record.outcome)) >= kept)
    return dataclasses.replace(record, outcome=np.where(changed, outcome, record.outcome).astype(np.int8))


def not_finite(run, case):
    """Flights under gains that are not finite, as the stage writes them."""
    gains = run.record("gains")
    holes = {name: np.full_like(getattr(gains, name), np.nan) for name in ("stochastic_gain", "table_gain")}
    changed = dataclasses.replace(gains, **holes)
    given = given_to(run, lambda name, of: changed if name == "gains" else of)
    return computed(PAPER.stages["montecarlo"].entries, given, run.flown[f"montecarlo.{case}"])


@pytest.fixture(scope="module")
def runs():
    def run_of(reading):
        return Run.of(PAPER, Inputs.from_plain(reading.inputs.plain() | FEW), Memory(), STUDIES)

    return {name: run_of(STUDY.readings[name]) for name in ("corrected", "printed")}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("reading", ["corrected", "printed"])  # the latter has no stochastic law
@pytest.mark.parametrize("laws", LAWS)
@pytest.mark.parametrize(("outcome", "kept"), [(CRASHED, 0), (ESCAPED, 0), (ESCAPED, 1), (ESCAPED, 2)])
def test_claims_cope_with_flights_that_end_otherwise(runs, reading, laws, outcome, kept):
    found = verdicts(runs[reading], lambda name, of: ended(of, outcome, kept) if name in LAWS[laws] else of)
    assert found["trigger_covariance"] in (
        ("fails",) if kept < 2 or reading == "printed" else ("fails", "undetermined")
    )


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("laws", LAWS)
def test_claims_cope_with_flights_that_are_not_finite(runs, laws):
    lost = {case: not_finite(runs["corrected"], case) for case in LAWS[laws]}
    assert not any(ensemble.count for ensemble in lost.values())
    found = verdicts(runs["corrected"], lambda name, of: lost.get(name, of))
    assert found["headline_range_reduction"] == "differs" and found["halved_velocity_p1"] == "fails"


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_claims_cope_with_a_law_that_does_not_exist(runs):
    run = runs["corrected"]
    lost = {case: not_finite(run, case) for case in LAWS["stochastic"]} | {
        "gains": without_numbers(run.record("gains"))
    }
    found = verdicts(run, lambda name, of: lost.get(name, of))
    assert found["headline_range_reduction"] == "differs" and found["fig8_stochastic_differs"] == "fails"


def test_a_universe_whose_nominal_differs_from_the_text_is_inadmissible(runs):
    nominal = runs["corrected"].record("nominal")
    admissible(nominal)
    for change in ({"reversal_time": nominal.reversal_time[:2]}, {"downrange": nominal.downrange - 6e3}):
        with pytest.raises(InadmissibleError, match=r"the nominal has [23] reversals and ends 1[06]\.\d km uprange"):
            admissible(dataclasses.replace(nominal, **change))
