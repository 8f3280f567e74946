"""What moved between two readings or universes of a paper."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from marsedl.papers import input_model
from marsedl.replication.checks import compare
from marsedl.replication.checks.compare import (
    apart,
    difference,
    in_numbers,
    named,
    of_other_build,
    side_of,
)
from marsedl.replication.claims.moved import Entry, Moved
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.readings import load_study
from marsedl.replication.universes.what_if import Alternative, moved_claims

ROOT = Path(__file__).parents[3]


def side(name: str, mean, peak: float, verdicts: tuple[str, str, str | None], own=(), **inputs: str) -> Alternative:
    """A reading with two means of standard error 0.3 and 0.4, and a peak; own: verdicts on the means."""
    first, second = own or 2 * [verdicts[0]]
    entries = {
        ("mean", ""): Entry(verdict=verdicts[0]),
        ("mean", "[1]"): Entry(mean[0], 0.3, 1.0, first, "m", 0.05),
        ("mean", "[2]"): Entry(mean[1], 0.4, 2.0, second, "m", 0.05),
        ("peak", ""): Entry(peak, 0.0, 5.0, verdicts[1], "m", 0.05),
    }
    return Alternative(name, inputs, entries | ({("calm", ""): Entry(verdict=verdicts[2])} if verdicts[2] else {}))


BEFORE = side("corrected", (1.0, 2.0), 5.0, ("reproduced", "reproduced", "holds"), mass="1", area="2")
AFTER = side("mine", (1.3, 4.0), 5.0, ("differs", "reproduced", None), ("reproduced", "differs"), mass="3", area="2")


@pytest.fixture(scope="module")
def study():
    """The readings of a paper."""
    return load_study("powered_descent", input_model("powered_descent"), ROOT, "full", {})


@pytest.fixture
def other_build(tmp_path, study, monkeypatch):
    """A function that gives a reading of a build whose only artifact, of `corrected`, was made with some inputs."""
    monkeypatch.setattr(compare, "side_of", lambda *_: BEFORE)
    path = tmp_path / "data/cache/powered_descent/corrected/gains.h5"

    def made_with(name, inputs, size):
        path.parent.mkdir(parents=True)
        path.touch()
        monkeypatch.setattr(compare.store, "provenance", lambda path: {"inputs": inputs, "size": size})
        return of_other_build(name, study, tmp_path)

    return made_with


def test_a_verdict_is_beside_the_claim_and_a_component_beside_a_component():
    claim, two, one = moved_claims(BEFORE, AFTER)
    assert (claim.name, claim.before.verdict, claim.after.verdict) == (("mean", ""), "reproduced", "differs")
    assert (two.name, two.before.verdict, two.after.verdict) == (("mean", "[2]"), "reproduced", "differs")
    assert two.sigmas == pytest.approx(2.0 / math.hypot(0.4, 0.4)), "a claim that only one evaluates has not moved"
    assert (one.name, one.turned, one.after.verdict) == (("mean", "[1]"), False, "reproduced")


def test_numbers_come_by_what_noise_and_rounding_explain_whether_they_have_sampling_errors_or_not():
    after = side("mine", (1.9, 2.4), 5.2, ("reproduced", "reproduced", "holds"))
    moved = moved_claims(BEFORE, after)
    assert [one.name for one in moved] == [("peak", ""), ("mean", "[1]"), ("mean", "[2]")], (
        "4 halves of a digit; 0.7 and 0.2 of noise"
    )
    assert [one.sigmas for one in moved] == pytest.approx([math.nan, 0.9 / 0.3 / 2**0.5, 1.0 / 2**0.5], nan_ok=True)
    assert moved[0].counts, "a deterministic number moves if it moves by more than half a printed digit"
    assert [apart(one) for one in moved] == ["no sampling error", "2.1 standard errors", "0.7 standard errors"]


def test_a_claim_that_only_one_evaluates_is_named_and_has_not_moved():
    entries = {("mean", ""): BEFORE.entries["mean", ""], ("later", ""): Entry(verdict="holds")}
    assert moved_claims(BEFORE, replace(BEFORE, entries=entries)) == []
    assert difference(BEFORE, replace(BEFORE, entries=entries)).alone == ["calm", "later", "peak"]


def test_numbers_are_shown_with_digits_that_tell_them_apart():
    one = Moved("mean", Entry(1.23456, unit="m"), Entry(1.23461, unit="m"), 0.0)
    assert in_numbers(one) == ("1.23456 m", "1.23461 m")
    assert in_numbers(one._replace(before=Entry(unit="m"))) == ("no number", "1.235 m")
    assert in_numbers(one._replace(before=Entry(), after=Entry())) == ("", ""), "verdicts alone"


def test_inputs_of_another_build_are_those_that_its_artifacts_were_made_with(tmp_path, study, other_build):
    with pytest.raises(InputError, match="has no artifacts"):
        of_other_build("corrected", study, tmp_path)
    same = study.readings["corrected"].inputs.get("entry.initial_speed")
    other = other_build("corrected", {"noise.noise_coefficient": 0.5, "entry.initial_speed": same}, "smoke")
    assert [*difference(BEFORE, other).inputs] == ["noise.noise_coefficient", "size"]


def test_what_a_point_of_another_build_changes_is_not_taken_from_artifacts_of_corrected(study, other_build):
    same = study.readings["corrected"].inputs.plain()["mission.final_covariance"]
    point = other_build("target4", {"mission.final_covariance": same, "entry.initial_speed": 1.0}, "full")
    assert {*difference(BEFORE, point).inputs} == {"entry.initial_speed", "size"}


def test_inputs_that_differ_are_named_with_both_values():
    assert difference(BEFORE, AFTER).inputs == {"mass": ("1", "3")}
    assert difference(BEFORE, BEFORE).inputs == {}


def test_what_is_not_built_or_not_known_is_refused(tmp_path, study):
    for name, message in {"universe:x": "write universe:NUMBER", "printd": "did you mean 'printed'"}.items():
        with pytest.raises(InputError, match=message):
            named(name, study)
    assert named("there/a:universe:3", study) == (Path("there/a"), 3) and named("printed", study) == (None, "printed")
    for of, message in {
        3: "run 'snakemake report/universes/powered_descent.h5'",
        "printed": "run 'snakemake report/claims/powered_descent.json'",
    }.items():
        with pytest.raises(InputError, match=message):
            side_of(of, study, tmp_path)
    (tmp_path / "report/claims").mkdir(parents=True)
    (tmp_path / "report/claims/powered_descent.json").write_text("[]", encoding="utf-8")
    with pytest.raises(InputError, match="the claims of printed are not built"):
        side_of("printed", study, tmp_path)


@pytest.mark.workflow
def test_a_page_says_what_moved_and_which_figures_are_not_drawn(copied):
    process = copied.marsedl("compare", "powered_descent", "printed", "--size", "smoke")
    assert process.returncode == 0, process.stderr
    assert process.stdout.startswith("inputs that differ, corrected -> printed:\n")
    text = next(copied.folder.glob("build/compare/*.html")).read_text(encoding="utf-8")
    assert "Inputs that differ" in text and "fig07" in text, "figures of printed are not drawn by all, and it says so"
    universes = copied.marsedl("compare", "powered_descent", "universe:1", "universe:0", "--size", "smoke", "--json")
    assert universes.returncode == 0 and '"inputs"' in universes.stdout
