"""Universes of a small paper whose answers are known in closed form."""

import math
from types import SimpleNamespace
from typing import ClassVar, Literal

import numpy as np
import pytest

from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.choices import of_written
from marsedl.replication.inputs.messages import Place, checked
from marsedl.replication.inputs.sections import Inputs, Number, Section, given
from marsedl.replication.inputs.sources import Source
from marsedl.replication.inputs.written import configuration
from marsedl.replication.universes.designs import Universe, one_at_a_time, space_filling
from marsedl.replication.universes.judging import Judge, cause_of, correlation_ratio, wilson
from marsedl.replication.universes.table import Outcome, Row, gathered, table_of
from marsedl.replication.universes.waves import Matching, emulated


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
WRITTEN = {
    "slope": {
        "asks": "Which slope?",
        "because": "withheld",
        "range": {"input": "toy.slope", "between": [0.0, 1.0], "source": "assumed: any"},
    },
    "angle": {
        "asks": "Which angle?",
        "because": "E1",
        "values": {
            "printed": {"toy": {"angle_deg": {"value": 180.0, "source": "Eq. 1"}}},
            "corrected": {"toy": {"angle_deg": {"value": 0.0, "source": "Eq. 2"}}},
        },
    },
    "form": {
        "asks": "Which form?",
        "because": "misprint",
        "values": {
            "plain": {"toy": {"form": {"value": "plain", "source": "Eq. 3"}}},
            "odd": {"toy": {"form": {"value": "odd", "source": "assumed: a misprint"}}},
        },
    },
}


def choices_of(written):
    """The choices of what is written, with their values in `corrected` and `printed`."""
    document = {"readings": {}, "choices": written}
    place = Place("toy.yaml", document)
    model = checked(configuration(ToyInputs), document, place)
    found = of_written(model.choices, ToyInputs, place / "choices")
    return found.placed(BASE | sources(angle=math.radians(180.0)), BASE)


CHOICES = choices_of(WRITTEN)
NUMBER = {
    "paper": "toy",
    "where": "Eq. 1",
    "quantity": "a number",
    "unit": "1",
    "kind": "deterministic",
    "resolution": 0.1,
}
STATEMENT = {
    "paper": "toy",
    "where": "Eq. 1",
    "quantity": "a number",
    "unit": "1",
    "kind": "qualitative",
    "printed": True,
}
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

    def number(value, printed):
        verdict = "reproduced" if abs(value - printed) <= 0.05 else "differs"
        return Outcome("result", verdict, {(): (value, 0.0, printed)})

    def statement(room, limit):
        return Outcome("result", "holds" if room > 0 else "fails", {(): (room + limit, 0.0, limit)})

    return {
        "line": number(line, 0.8),
        "upwards": statement(math.cos(angle), 0.0),
        "is_odd": number(odd, 2.0),
        "constant": number(1.0, 1.0),
        "flat": statement(0.25 - slope, 0.25),
    }


def table(universes):
    evaluator = SimpleNamespace(
        study=SimpleNamespace(choices=CHOICES),
        asked=[one.id for one in PUBLISHED],
        published={one.id: one for one in PUBLISHED},
    )
    return table_of(evaluator, [Row(one, outcomes(one)) for one in universes])


@pytest.fixture(scope="module")
def judge():
    return Judge(table([*one_at_a_time(CHOICES), *space_filling(CHOICES, 256, first=100)]), CHOICES, PUBLISHED)


def test_what_is_robust_what_depends_and_what_never_holds(judge):
    stands = {one.id: judge.judged(one.id) for one in PUBLISHED}
    assert {name: one.stands for name, one in stands.items()} == {
        "line": "depends",
        "upwards": "depends",
        "is_odd": "depends",
        "constant": "robust",
        "flat": "depends",
    }
    assert stands["upwards"].on == ("angle",)
    assert stands["is_odd"].on == ("form",), "the misprint turns it, though no space-filling universe has it"
    assert stands["line"].on == ("slope", "angle") or stands["line"].on == ("angle", "slope")


def test_effects_of_each_value_by_itself(judge):
    effects = {(one.choice, one.value): one for one in judge.effects("line")}
    assert set(effects) == {("slope", 0.0), ("slope", 1.0), ("angle", "printed"), ("form", "odd")}
    assert effects["slope", 1.0].difference == pytest.approx(0.5)
    assert effects["slope", 1.0].size == pytest.approx(0.5 / 0.05), "in half digits"
    assert effects["slope", 1.0].towards and not effects["slope", 0.0].towards
    assert effects["angle", "printed"].difference == pytest.approx(-1.0) and not effects["angle", "printed"].towards
    assert effects["form", "odd"].size == 0.0 and not effects["form", "odd"].counts
    cause = cause_of(judge.judged("line"))
    assert (cause.choice, cause.value) == ("slope", 1.0), "the largest change is away from what is printed"


def test_shares_of_universes_and_the_nearest_value(judge):
    line, upwards = judge.judged("line"), judge.judged("upwards")
    assert upwards.over_all.value == pytest.approx(0.5, abs=0.01)
    assert line.over_all.low <= 0.05 <= line.over_all.high, "a tenth of the slopes with one of two angles"
    assert upwards.given_deciding["angle"]["corrected"].value == 1.0
    assert upwards.given_deciding["angle"]["printed"].value == 0.0
    assert line.nearest.number == pytest.approx(0.8, abs=0.01) and line.nearest.assignment["angle"] == "corrected"
    assert line.noise == 0.0 and line.causes == {"result": 261}


def test_indices_against_the_closed_form(judge):
    indices = {one.choice: one for one in judge.judged("upwards").indices}
    assert indices["angle"].ratio == pytest.approx(1.0, abs=1e-9) or indices["angle"].decides
    assert not indices["slope"].decides
    # Of x in [0, 1] in quarters, 15/16 of the variance lies between the quarters.
    x = (np.arange(4096) + 0.5) / 4096
    assert correlation_ratio(x[np.newaxis], (x * 4).astype(int))[0] == pytest.approx(15 / 16, rel=1e-6)


def test_the_interval_of_a_share_covers_it():
    generator = np.random.Generator(np.random.Philox(key=1))
    for share in (0.02, 0.3, 0.9):
        hits = [wilson(int(generator.binomial(64, share)), 64) for _ in range(2000)]
        assert np.mean([one.low <= share <= one.high for one in hits]) > 0.93
    assert math.isnan(wilson(0, 0).value)


def test_waves_find_what_contradicts_and_what_can_be_true_at_once():
    start = table(space_filling(CHOICES, 64))

    def run(published):
        matching = Matching(CHOICES, published)
        return matching.run(start, table, gathered, 32, 4)

    waves, _ = run(PUBLISHED)
    assert waves[-1].volume == 0.0 and waves[-1].contradicting == ("flat", "line")
    waves, found = run(PUBLISHED[:2])
    assert 0.0 < waves[-1].volume < 0.2, "slopes from 0.75 to 0.85 with one of two angles are a twentieth"
    assert waves[-1].nearest < 3.0 and waves[-1].shares["angle"] == [0.0, 1.0]
    best = found.assignment[found.number == waves[-1].its][0]
    assert 0.7 < best[0] < 0.9


def test_an_emulator_is_exact_where_the_answer_is_linear():
    generator = np.random.Generator(np.random.Philox(key=2))
    features = np.column_stack([np.ones(40), generator.normal(size=(40, 3))])
    values = features @ [1.0, 2.0, -3.0, 0.5]
    predicted, error = emulated(features, values, features[:5])
    assert predicted == pytest.approx(values[:5], abs=1e-3) and error < 1e-3


def test_a_longer_design_begins_with_the_shorter_one():
    short, long = space_filling(CHOICES, 16), space_filling(CHOICES, 64)
    assert long[:16] == short
    slopes = [one.assignment.get("slope", 0.5) for one in long]
    assert np.mean(slopes) == pytest.approx(0.5, abs=0.02)
    assert all("form" not in one.assignment for one in long), "a misprint is searched apart"


def test_any_chunks_give_the_same_table():
    universes = [*one_at_a_time(CHOICES), *space_filling(CHOICES, 8, first=50)]
    whole, parts = table(universes), gathered([table(universes[k::3]) for k in range(3)])
    for name in ("number", "assignment", "value", "verdict", "sentence"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"angle": {**WRITTEN["angle"], "only_if": {"forms": ["odd"]}}}, "did you mean 'form'?"),
        ({"slope": {**WRITTEN["slope"], "range": {**WRITTEN["slope"]["range"], "input": "toy.slop"}}}, "'toy.slope'?"),
        ({"slope": {"asks": "?", "because": "withheld"}}, "give either 'values' or 'range'"),
        ({"slope": {**WRITTEN["slope"], "because": "a guess"}}, "slope.because"),
        (
            {"again": {**WRITTEN["slope"]}},
            "toy.slope is set by the choice 'slope' too",
        ),
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


def test_a_universe_is_numbered_and_corrected_comes_first():
    universes = one_at_a_time(CHOICES)
    assert universes[0] == Universe(0, "one_at_a_time", {}) and [one.number for one in universes] == [0, 1, 2, 3, 4]
