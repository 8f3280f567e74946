"""Universes of a small paper whose answers are known in closed form."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar, Literal

import numpy as np
import pytest

from marsedl.replication.checks.universes import accept_universes, compare_universes
from marsedl.replication.claims.claim import Claim, Margin, Result
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.rows import read_as, write_as
from marsedl.replication.claims.verdicts import Declaration
from marsedl.replication.errors import InfeasibleError, InputError
from marsedl.replication.inputs.choices import Source, of_written
from marsedl.replication.inputs.messages import Place, checked
from marsedl.replication.inputs.sections import Inputs, Number, Section, given
from marsedl.replication.inputs.written import configuration
from marsedl.replication.pipeline.catalogue import Erratum
from marsedl.replication.records import store
from marsedl.replication.universes.deciding import Decided, decided
from marsedl.replication.universes.designs import AGAIN, Universe, one_at_a_time, redrawn, space_filling
from marsedl.replication.universes.joint import _of_waves, in_sentences, joint
from marsedl.replication.universes.judging import Judge, correlation_ratio, share
from marsedl.replication.universes.table import (
    Outcome,
    Row,
    Universes,
    changed,
    class_of,
    gathered,
    numbers_of,
    table_of,
)
from marsedl.replication.universes.waves import Matching, Wave, emulated, refined


class Toy(Section):
    """Inputs of the small paper."""

    slope: Number = given("1", "slope")
    angle: Number = given("rad", "angle")
    form: Literal["plain", "odd"] = given("1", "form")


class ToyInputs(Inputs):
    """All inputs of the small paper."""

    toy: Toy
    CASES: ClassVar[dict[str, str]] = {}


def sources(**values):
    return {f"toy.{name}": Source(name, value, "1", "Eq. 1", "corrected", value) for name, value in values.items()}


BASE = sources(slope=0.5, angle=0.0, form="plain")
SLOPE = {"input": "toy.slope", "between": [0.0, 1.0], "source": "assumed: any"}


def sets(name, value, source):
    return {"toy": {name: {"value": value, "source": source}}}


ANGLES = {"printed": sets("angle_deg", 180.0, "Eq. 1"), "corrected": sets("angle_deg", 0.0, "Eq. 2")}
FORMS = {"plain": sets("form", "plain", "Eq. 3"), "odd": sets("form", "odd", "assumed: a misprint")}
WRITTEN = {
    "slope": {"asks": "Which slope?", "because": "withheld", "range": SLOPE},
    "angle": {"asks": "Which angle?", "because": "E1", "values": ANGLES},
    "form": {"asks": "Which form?", "because": "misprint", "values": FORMS},
}


def choices_of(written):
    """The choices of what is written, with their values in `corrected` and `printed`."""
    document = {"readings": {}, "choices": written}
    place = Place("toy.yaml", document)
    model = checked(configuration(ToyInputs), document, place)
    found = of_written(model.choices, ToyInputs, {name: place / "choices" / name for name in model.choices})
    return found.placed(BASE | sources(angle=math.radians(180.0)), BASE, place / "choices")


CHOICES = choices_of(WRITTEN)
PRINTED = {"paper": "toy", "where": "Eq. 1", "quantity": "a number", "unit": "1"}
NUMBER = PRINTED | {"kind": "deterministic", "resolution": 0.1}
STATEMENT = PRINTED | {"kind": "qualitative", "printed": True}
PUBLISHED = [
    PublishedClaim(id="line", printed=0.8, headline=1, **NUMBER),  # slope cos(angle): true for slopes from 0.75 to 0.85
    PublishedClaim(id="upwards", headline=2, **STATEMENT),  # angle is zero
    PublishedClaim(id="is_odd", printed=2.0, **NUMBER),  # 1 if plain, 2 if odd
    PublishedClaim(id="constant", printed=1.0, **NUMBER),
    PublishedClaim(id="flat", headline=3, **STATEMENT),  # slope below 0.25: contradicts `line`
]


def outcomes(universe):
    """What the claims give, in closed form."""
    values = {name: one.value for name, one in CHOICES.applied(BASE, universe.assignment).items()}
    slope, angle, form = values["toy.slope"], values["toy.angle"], values["toy.form"]
    line, odd = slope * math.cos(angle), 2.0 if form == "odd" else 1.0

    def statement(room, limit):
        return Outcome("result", {"test 1": (room + limit, 0.0, limit)}, "holds" if room > 0 else "fails", "test 1")

    numbers = {"line": (line, 0.8), "is_odd": (odd, 2.0), "constant": (1.0, 1.0)}
    found = {name: Outcome("result", {"": (value, 0.0, printed)}) for name, (value, printed) in numbers.items()}
    found |= {"upwards": statement(math.cos(angle), 0.0), "flat": statement(0.25 - slope, 0.25)}
    return {one.id: found[one.id] for one in PUBLISHED}


def table(universes, without=()):
    """The table of universes; without: claims that these do not ask for."""
    evaluator = SimpleNamespace(
        study=SimpleNamespace(choices=CHOICES),
        asked=[one.id for one in PUBLISHED],
        published={one.id: one for one in PUBLISHED},
    )
    absent = dict.fromkeys(without, Outcome("not_asked"))
    return table_of(evaluator, [Row(one, outcomes(one) | absent) for one in universes])


DECLARED = {one.id: Declaration() for one in PUBLISHED}


def judge_of(universes, published=PUBLISHED, **more):
    """What judges universes, or a table of them."""
    found = universes if isinstance(universes, Universes) else table(universes)
    return Judge(found, CHOICES, published, DECLARED, **more)


@pytest.fixture(scope="module")
def judge():
    return judge_of([*one_at_a_time(CHOICES), *space_filling(CHOICES, 256)])


def test_what_is_robust_what_depends_and_what_never_holds(judge):
    stands = {one.id: judge.judged(one.id) for one in PUBLISHED}
    expected = dict.fromkeys(stands, "depends") | {"constant": "robust"}
    assert {name: one.label for name, one in stands.items()} == expected
    assert stands["upwards"].alone == ("angle",)
    assert stands["is_odd"].alone == ("form",), "the misprint turns it, though no space-filling universe has it"
    assert sorted((*stands["line"].alone, *stands["line"].together)) == ["angle", "slope"]


def test_a_statement_that_no_universe_asks_for_has_no_number_of_another_claim():
    one = judge_of(table([*one_at_a_time(CHOICES), *space_filling(CHOICES, 16)], without=["upwards"])).judged("upwards")
    assert (one.label, one.component, one.over_results.of) == ("not_computed", "", 0)
    assert math.isnan(one.number) and math.isnan(one.printed) and math.isnan(one.noise)


def test_effects_of_each_value_by_itself(judge):
    effects = {(one.choice, one.value): one for one in judge.effects("line")}
    assert set(effects) == {("slope", 0.0), ("slope", 1.0), ("angle", "printed"), ("form", "odd")}
    assert effects["slope", 1.0].difference == pytest.approx(0.5)
    assert effects["slope", 1.0].size == pytest.approx(0.5 / 0.05), "in half digits"
    assert effects["slope", 1.0].towards and not effects["slope", 0.0].towards
    assert effects["angle", "printed"].difference == pytest.approx(-1.0) and not effects["angle", "printed"].towards
    assert effects["form", "odd"].size == 0.0 and not effects["form", "odd"].counts
    cause = judge.judged("line").cause
    assert cause is None, "1.0 lies beyond the printed 0.8, and differs too"


def test_shares_of_universes_and_the_nearest_value(judge):
    line, upwards = judge.judged("line"), judge.judged("upwards")
    assert upwards.over_all.value == pytest.approx(0.5, abs=0.01)
    assert line.over_all.low <= 0.05 <= line.over_all.high, "a tenth of the slopes with one of two angles"
    assert line.nearest == pytest.approx(0.8, abs=0.01)
    assert line.noise == 0.0


def test_indices_against_the_closed_form(judge):
    indices = {one.choice: one for one in judge.judged("upwards").indices}
    assert indices["angle"].ratio == pytest.approx(1.0, abs=1e-9) or indices["angle"].decides
    assert not indices["slope"].decides
    # Of x in [0, 1] in quarters, 15/16 of the variance lies between the quarters.
    x = (np.arange(4096) + 0.5) / 4096
    assert correlation_ratio(x[np.newaxis], (x * 4).astype(int))[0] == pytest.approx(15 / 16, rel=1e-6)


def claim_row(judge, claim, **more):
    verdict = judge.verdict(claim.id)
    readings = {"corrected": Result(value=judge.judged(claim.id).number, verdict=verdict)}
    own = {name: getattr(claim, name) for name in ("paper", "id", "kind", "printed", "headline")}
    return Claim(**own, verdict=verdict, reading="corrected", readings=readings, **more)


def test_a_page_says_what_an_erratum_changes_and_what_decides(judge, tmp_path):
    verdicts = {one.id: judge.verdict(one.id) for one in PUBLISHED}
    rows = [claim_row(judge, one, errata=("E1",) if one.id == "line" else ()) for one in PUBLISHED]
    rows[0] = rows[0].model_copy(update={"choices": ("slope",)})
    errata = Erratum("E1", "", "", ""), Erratum("E2", "", "", "")
    write_as(Decided, decided(rows, errata, judge, Matching(judge)), tmp_path / "decided.json")
    found = read_as(Decided, tmp_path / "decided.json")
    first, second = found.errata
    assert (first.erratum, first.rank, first.refuted) == ("E1", "headline", ("line",))
    assert (first.headline, first.effect.difference) == ("line", pytest.approx(-1.0))
    assert first.verdicts == ("upwards",) and verdicts["upwards"] == "holds"
    assert second.rank == "not_varied"
    number = found.number
    assert (number.claim, number.value, number.mark) == ("line", 0.5, 0.8)
    assert [one.difference for one in number.effects] == pytest.approx([-1.0, -0.5, 0.5, 0.0])
    slope, form = found.open
    assert (form.choice, form.low, form.high) == ("form", 0.5, 0.5)
    assert (slope.choice, slope.low, slope.high) == ("slope", 0.0, 1.0)
    assert found.standings == {name: judge.standing(name) for name in judge.of}
    assert found.standings["constant"].label == "robust"


def test_the_explorer_has_the_numbers_and_verdicts_of_every_universe(judge):
    rows = [claim_row(judge, one) for one in PUBLISHED]
    found = decided(rows, (), judge, Matching(judge)).explorer
    assert found["numbers"] == judge.table.number.tolist()
    for answer in found["answers"]:
        one = judge.of[answer["claim"]]
        numbers = one.numbers[0][:, one.deciding]
        assert answer["values"] == pytest.approx(numbers.tolist(), rel=1e-3, nan_ok=True)
        verdicts = [found["verdicts"][place][0] for place in answer["verdicts"]]
        assert verdicts == one.verdicts.tolist()
    for knob, choice, assigned in zip(found["knobs"], judge.choices, judge.table.assignment.T, strict=True):
        for place, number in zip(knob["places"], assigned.tolist(), strict=True):
            value, words = knob["values"][place]
            if choice.range and place != knob["ours"]:
                low, high = map(float, words.split(" to "))
                assert low <= number <= high and low < float(value) < high
            elif choice.range:
                assert math.isnan(number) or number == choice.corrected
            else:
                assert value == (list(choice.alternatives)[int(number)] if math.isfinite(number) else choice.corrected)


def test_a_share_of_nothing_has_no_interval():
    assert math.isnan(share(0, 0).value) and math.isnan(share(0, 0).low)
    assert share(3, 3).high == 1.0 and share(0, 3).low == 0.0


def test_waves_find_what_contradicts_and_what_can_be_true_at_once():
    start = [Universe(0, "one_at_a_time", {}), *space_filling(CHOICES, 64)]

    def run(published):
        judge = judge_of(start, published)
        found = Matching(judge).extended(table, 32)
        return Matching(judge.over(found)).waves[-1], found

    last, _ = run(PUBLISHED)
    assert last.volume == 0.0 and last.contradicting == ("flat", "line")
    last, found = run(PUBLISHED[:2])
    assert 0.0 < last.volume < 0.2, "slopes from 0.75 to 0.85 with one of two angles are a twentieth"
    assert last.shares["angle"] == [0.0, 1.0]
    best = found.assignment[found.seed == 1][0]
    assert 0.7 < best[0] < 0.9


@pytest.mark.parametrize(("volume", "said"), [(1.0, "100 %"), (0.998, "99.8 %"), (3e-4, "0.03 %"), (0.0, "no choices")])
def test_what_waves_leave_is_said_in_plain_numbers(volume, said):
    (sentence,) = _of_waves([Wave(1.0, {}, (), 1.0), Wave(volume, {}, (), 1.5)])
    assert f"by the emulators {said}" in sentence


def test_what_is_true_at_once_and_what_never_is(judge):
    found = joint(judge, Matching(judge))
    assert found.never == [("line", "flat")], "a slope of 0.8 and one below a quarter"
    assert (found.best.headlines, found.best.of) == (2, 3)
    assert found.best.again is None and "At most 2 of 3 headlines stand in one universe" in in_sentences(judge)
    assert [(one.of, one.in_corrected) for one in found.halves] == [(2, 2), (3, 0)]
    again = [replace(one, number=AGAIN + one.number, seed=1) for one in space_filling(CHOICES, 4)]
    both = gathered([judge.table, table(again)])
    assert len(judge_of(both).effects("line")) == len(judge.effects("line")), "seeds stay apart"
    assert judge_of(both).second_seed().of == 0, "nothing is sampled"
    noisy = replace(both, error=np.full_like(both.error, 0.01))
    assert judge_of(noisy).second_seed().value == 1.0
    moved = replace(noisy, value=noisy.value + np.where(noisy.of >= AGAIN, 0.1, 0.0))
    assert judge_of(moved).second_seed().value == 0.0


def test_a_build_is_compared_with_the_committed_universes(tmp_path, capsys):
    large, small = table(space_filling(CHOICES, 16)), table(space_filling(CHOICES, 4))
    assert changed(large, small) == {}
    assert changed(large, replace(small, number=small.number + 90, of=small.of + 90)) == {}, "numbers say nothing"
    assert changed(large, replace(small, seed=small.seed + 1)) == dict.fromkeys(range(1000, 1004), "is not among them")
    other = np.where(small.of == 1002, np.spacing(1.0), 0.0)
    assert changed(large, replace(small, value=small.value + other)) == {1002: "has another value of line"}
    assigned = small.assignment + (small.number == 1002)[:, np.newaxis]
    assert changed(large, replace(small, assignment=assigned)) == {1002: "is not among them"}
    finding = np.where((small.of == 1001) & (small.claim == "flat"), "undetermined", small.finding)
    assert changed(large, replace(small, finding=finding)) == {1001: "has another verdict of flattest 1"}
    folder = tmp_path / "report/universes"
    for name, one, world in (
        ("toy", small, "a"),
        ("waves/toy", large, "a"),
        ("waves/old", large, "b"),
        ("old", small, "a"),
    ):
        path = folder / f"{name}.h5"
        store.save(path, one, paper=path.stem, reading="universes", provenance={"world": world})
    root = tmp_path / "root"
    assert accept_universes(root, tmp_path, ["toy", "old", "none"]) == [root / "data/reference/universes/toy.h5"]
    assert f"old: {folder / 'waves/old.h5'} is not stored: it is of other inputs or code" in capsys.readouterr().out
    assert compare_universes(root, tmp_path, ["toy"])
    assert "16 universes compared with 16 committed, 0 differ" in capsys.readouterr().out
    damaged = replace(large, value=large.value + np.where(large.of == 1011, 1e-9, 0.0))
    store.save(root / "data/reference/universes/toy.h5", damaged, paper="toy", reading="x", provenance={"world": "a"})
    assert not compare_universes(root, tmp_path, ["toy"]), "a whole new run finds what no sample has to hold"
    assert "toy: universe 1011: " in capsys.readouterr().out
    (folder / "waves/toy.h5").unlink()
    assert compare_universes(root, tmp_path, ["toy"])
    store.save(root / "data/reference/universes/toy.h5", large, paper="toy", reading="x", provenance={"world": "a"})
    moved = replace(small, value=small.value + other)
    store.save(folder / "toy.h5", moved, paper="toy", reading="x", provenance={"world": "a"})
    assert not compare_universes(root, tmp_path, ["toy"])


def test_a_committed_run_counts_for_rewritten_code_that_computes_the_same_bits(tmp_path, capsys):
    root, built = tmp_path / "root", tmp_path / "report/universes/toy.h5"
    run = root / "data/reference/universes/toy.h5"
    large, small = table(space_filling(CHOICES, 16)), table(space_filling(CHOICES, 4))
    store.save(run, large, paper="toy", reading="x", provenance={"world": "old"})
    other = replace(small, value=small.value + np.where(small.of == 1002, np.spacing(1.0), 0.0))
    store.save(built, other, paper="toy", reading="x", provenance={"world": "new"})
    assert accept_universes(root, tmp_path, ["toy"]) == []
    assert "1 of 4 universes of this build differ from it (universe 1002 has another value" in capsys.readouterr().out
    assert not compare_universes(root, tmp_path, ["toy"])
    store.save(built, small, paper="toy", reading="x", provenance={"world": "new"})
    assert accept_universes(root, tmp_path, ["toy"]) == [run]
    assert "4 universes of this build have the same bits in the committed run of 16" in capsys.readouterr().out
    assert compare_universes(root, tmp_path, ["toy"])
    assert store.content_digest(store.load(run, Universes, paper="toy")) == store.content_digest(large)


def test_points_of_a_range_are_refined_until_one_makes_the_claim_true():
    """The line passes 0.8 between slopes of 0.5 and 1.0: at 0.75, which rounds to 0.8 by the last bit."""
    published = [PUBLISHED[0].model_copy(update={"resolution": 0.02, "printed": 0.8}), *PUBLISHED[1:]]
    start = judge_of(one_at_a_time(CHOICES), published)
    assert start.judged("line").cause is None
    found = start.over(refined(start, table))
    added = {
        int(number): values[0]
        for number, values in zip(found.table.number, found.table.assignment, strict=True)
        if number >= 500
    }
    assert added == {500: 0.75, 501: 0.875, 502: 0.8125, 503: 0.78125}, "halved four times"
    judged = judge_of(refined(start, table), PUBLISHED)
    assert judged.judged("line").cause.is_true and judged.judged("line").cause.value == pytest.approx(0.8, abs=0.02)


def test_an_emulator_is_exact_where_the_answer_is_linear():
    generator = np.random.Generator(np.random.Philox(key=2))
    features = np.column_stack([np.ones(40), generator.normal(size=(40, 3))])
    values = features @ [1.0, 2.0, -3.0, 0.5]
    predicted, error = emulated(features, values, features[:5])
    assert predicted == pytest.approx(values[:5], abs=1e-3) and error < 1e-3


def test_a_headline_whose_number_diverges_somewhere_still_rules_out():
    start = table([Universe(0, "one_at_a_time", {}), *space_filling(CHOICES, 64)])
    volumes = []
    for number in (start.value[start.claim == "line"][3], 1e161):  # its square is infinite
        value = start.value.copy()
        value[np.flatnonzero(start.claim == "line")[3]] = number
        judge = judge_of(replace(start, value=value), PUBLISHED[:1])
        volumes.append(Matching(judge).wave(judge, 0)[0].volume)
    assert 0.0 < volumes[0] < 0.6 and volumes[1] < 0.9, "one universe of 64 does not decide for all"


def test_a_statement_whose_measure_is_infinite_has_no_number_there():
    def numbers(measured):
        margin = Margin(measure="", value=measured, limit=1.0, unit="1", distance=0.0, scale="values")
        return numbers_of(PUBLISHED[1], Result(value=True, verdict="holds", margin=margin))

    assert numbers(2.0) == {"": (2.0, 0.0, 1.0)}


def test_a_fault_of_the_machine_is_no_outcome_of_a_universe():
    assert class_of(InfeasibleError("there is no law", {})).cause == "infeasible"
    assert class_of(ZeroDivisionError("by zero")).cause == "numerical"
    for error in (OSError(28, "No space left on device"), MemoryError()):
        with pytest.raises(type(error)):
            class_of(error)


def test_a_universe_that_is_computed_again_has_the_same_choices():
    first = Universe(1003, "space_filling", {"angle": "printed"})
    again = replace(first, number=1_000_000 + first.number, seed=1)
    for attempt in (1, 2):
        drawn = redrawn(CHOICES, first, ["slope"], attempt).assignment
        assert drawn == redrawn(CHOICES, again, ["slope"], attempt).assignment
        assert set(drawn) == {"slope", "angle"}


def test_the_papers_own_sampling_error_counts_by_our_trials():
    claim = PublishedClaim(**NUMBER | {"kind": "monte_carlo"}, id="line", printed=0.8, headline=1, trials=1000)
    few = table([Universe(0, "one_at_a_time", {}), *space_filling(CHOICES, 2)])
    noisy = replace(few, error=np.full_like(few.error, 0.01), trials=np.full_like(few.trials, 3000))
    judge = judge_of(noisy, [claim])
    deviation = math.hypot(0.01 * math.sqrt(1 + 3000 / 1000), 0.05 / 3)
    missed = Matching(judge).measured(judge)["line"]
    assert missed == pytest.approx((few.value[few.claim == "line"] - 0.8) / deviation), "3,000 of ours"


def test_corrected_comes_first_and_a_longer_design_begins_with_the_shorter_one():
    single = one_at_a_time(CHOICES)
    assert single[0] == Universe(0, "one_at_a_time", {}) and [one.number for one in single] == [0, 1, 2, 3, 4]
    short, long = space_filling(CHOICES, 16), space_filling(CHOICES, 64)
    assert long[:16] == short
    slopes = [one.assignment.get("slope", 0.5) for one in long]
    assert np.mean(slopes) == pytest.approx(0.5, abs=0.02)
    assert all("form" not in one.assignment for one in long), "a misprint is searched apart"


def test_any_chunks_give_the_same_table():
    universes = [*one_at_a_time(CHOICES), *space_filling(CHOICES, 8)]
    whole, parts = table(universes), gathered([table(universes[k::3]) for k in range(3)])
    assert store.content_digest(whole) == store.content_digest(parts)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"angle": {**WRITTEN["angle"], "only_if": {"forms": ["odd"]}}}, "did you mean 'form'?"),
        ({"slope": {**WRITTEN["slope"], "range": {**SLOPE, "input": "toy.slop"}}}, "'toy.slope'?"),
        ({"slope": {"asks": "?", "because": "withheld"}}, "give either 'values' or 'range'"),
        ({"slope": {**WRITTEN["slope"], "because": "a guess"}}, "slope.because"),
        ({"again": WRITTEN["slope"]}, "toy.slope is set by the choice 'slope' too"),
    ],
)
def test_a_choice_that_is_written_wrongly_is_rejected(change, message):
    with pytest.raises(InputError) as error:
        choices_of({**WRITTEN, **change})
    assert message in str(error.value) and str(error.value).startswith("toy.yaml: choices.")


def test_an_assignment_names_known_choices_and_values():
    with pytest.raises(InputError, match="did you mean 'slope'"):
        CHOICES.applied(BASE, {"slop": 0.5})
    with pytest.raises(InputError, match="no value 'printd'; did you mean 'printed'"):
        CHOICES.applied(BASE, {"angle": "printd"})
    with pytest.raises(InputError, match="not a number between 0 and 1"):
        CHOICES.applied(BASE, {"slope": 1.5})
    assert CHOICES.by_name["angle"].printed == "printed" and CHOICES.by_name["angle"].corrected == "corrected"
    assert CHOICES.applied(BASE, {"angle": "printed"})["toy.angle"].value == pytest.approx(math.pi)
