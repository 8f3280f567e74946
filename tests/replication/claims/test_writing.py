"""Claim functions: what they are given, what their tests say, and what is refused."""

import sys
from types import ModuleType

import numpy as np
import pytest

from marsedl.papers import SLUGS
from marsedl.replication.claims import writing
from marsedl.replication.claims.claim import Doubt
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.thresholds import SMALL
from marsedl.replication.claims.writing import (
    Claims,
    Fails,
    check,
    claim,
    doubtful,
    holds,
    measure,
    measured,
    provided,
    whichever,
)
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.sections import Inputs, Section, given
from marsedl.replication.pipeline import injection
from marsedl.replication.pipeline.injection import Arguments, Largest


class Vehicle(Section):
    """Of the toy paper."""

    mass: float = given("kg", "mass")


class ToyInputs(Inputs):
    """Of the toy paper."""

    vehicle: Vehicle


class Ensemble:
    """Flights."""

    def __init__(self, trials):
        self.trials = trials


class Mean(float):
    """A measure that claims share."""


class Absent(float):
    """A measure of what does not exist."""


CALLS = []


def mean(flights: Largest[Ensemble]) -> Mean:
    CALLS.append(flights)
    return Mean(flights.trials / 2)


def absent(flights: Ensemble) -> Absent:
    raise Fails("no law", flights.trials)


@claim("Because of {spread:.1f}.", errata="E1 E2", choices="unit")
def mean_mass(vehicle: Vehicle, shared: Mean):
    return measured(vehicle.mass, spread=float(shared))


@claim(name="low", side=0)
@claim(name="high", side=1)
def sides(flights: Ensemble, *, side):
    return measured([flights.trials, -flights.trials][side])


@claim()
def of_a_study(study: Ensemble):
    return holds(measure("trials of the study", study.trials) > 0)


@claim()
def with_an_option(shared: Mean, study: Ensemble | None = None):
    return holds(check("there is a study", study is not None), trials=int(shared))


@claim()
def of_what_is_not_there(thing: Absent):
    return holds(measure("thing", thing) > 0)


@claim()
def number_of_what_is_not_there(thing: Absent):
    return measured([thing, thing])


OF_NOTHING = (absent, of_what_is_not_there, number_of_what_is_not_there)
FUNCTIONS = (mean, mean_mass, sides, of_a_study, with_an_option, *OF_NOTHING)
VALUES = {"vehicle.mass": 3.0}


def package(monkeypatch, *functions, name="toy_claims"):
    """A package with one module of claims."""
    folder, module = ModuleType(name), ModuleType(f"{name}.sec1")
    folder.__path__ = []
    for function in functions:
        monkeypatch.setattr(function, "__module__", f"{name}.sec1")
        setattr(module, function.__name__, function)
    for kind in (Mean, Absent):
        monkeypatch.setattr(kind, "__module__", f"{name}.sec1")
    monkeypatch.setitem(sys.modules, name, folder)
    monkeypatch.setitem(sys.modules, f"{name}.sec1", module)
    actual = type("Found", (), {"name": "sec1"})
    monkeypatch.setattr(writing.pkgutil, "iter_modules", lambda path: [actual])
    return name


def printed(name, kind, value, unit="1", **others):
    place = {"paper": "toy", "id": name, "where": "Sec. 1", "quantity": "something"}
    return PublishedClaim(**place, printed=value, unit=unit, kind=kind, **others)


PUBLISHED = {
    "of_what_is_not_there": printed("of_what_is_not_there", "qualitative", True),
    "number_of_what_is_not_there": printed("number_of_what_is_not_there", "monte_carlo", [1.0, 2.0]),
    "stated": printed("stated", "input", 3.0, "kg", input="vehicle.mass"),
}


@pytest.fixture
def evaluations(monkeypatch):
    """Evaluations of the toy paper with some artifacts."""
    claims = Claims(package(monkeypatch, *FUNCTIONS), ToyInputs)

    def of(**artifacts):
        CALLS.clear()
        return claims.evaluate(Arguments(VALUES, lambda name, kind: artifacts.get(name)), PUBLISHED)

    return of


def test_claims_are_given_sections_artifacts_and_shared_measures_once(evaluations):
    flights = Ensemble(8)
    values = evaluations(flights=flights)
    assert values["mean_mass"].value == 3.0 and values["mean_mass"].numbers == {"spread": 4.0}
    assert (values["low"].value, values["high"].value) == (8, -8)
    assert values["stated"].value == 3.0
    assert [flights] == CALLS  # for two claims


def test_the_largest_ensemble_is_taken_where_there_is_one(evaluations):
    large = Ensemble(80)
    values = evaluations(flights=Ensemble(8), flights_large=large)
    assert [large] == CALLS and values["mean_mass"].numbers == {"spread": 40.0}
    assert values["low"].value == 8  # which does not ask for it


def test_a_claim_without_its_artifact_is_not_evaluated_but_may_do_without_an_option(evaluations):
    values = evaluations(flights=Ensemble(8))
    assert values["of_a_study"] is None
    assert values["with_an_option"].value is False and values["with_an_option"].trials == 4
    values = evaluations(flights=Ensemble(8), study=Ensemble(1))
    assert values["of_a_study"].value is True and values["with_an_option"].value is True
    assert evaluations()["mean_mass"] is None


def test_what_does_not_exist_fails_every_claim_about_it(evaluations):
    values = evaluations(flights=Ensemble(8))
    statement, number = values["of_what_is_not_there"], values["number_of_what_is_not_there"]
    assert statement.value is False and statement.evidence == ("no law",) and statement.trials == 8
    assert np.isnan(number.value).all() and len(number.value) == 2 and number.failed


def test_two_functions_of_one_claim_and_a_claim_with_code_beside_its_input_are_refused(monkeypatch):
    @claim(name="low")
    def another():
        return measured(1.0)

    with pytest.raises(InputError, match="low: two functions"):
        Claims(package(monkeypatch, sides, another), ToyInputs)

    @claim()
    def stated():
        return measured(3.0)

    claims = Claims(package(monkeypatch, stated), ToyInputs)
    with pytest.raises(InputError, match="claim stated has an input in data/published and a function"):
        claims.evaluate(Arguments(VALUES), PUBLISHED)


# --- tests and their evidence -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("test", "passed", "sentence"),
    [
        (measure("mass", 2.0, "kg") < 3, True, "mass: 2 kg (below 3 kg)"),
        (measure("mass", 3.0, "kg") < 3, False, "mass: 3 kg (not below 3 kg)"),
        (measure("mass", 3.0) <= 3, True, "mass: 3 (at most 3)"),
        (measure("mass", 3.0) > 2.5, True, "mass: 3 (above 2.5)"),
        (measure("mass", np.nan) >= 1, False, "mass: nan (not at least 1)"),
        (measure("mass", [1.0, 5.0, 2.0]) < 6, True, "mass: at most 5 (below 6)"),
        (measure("mass", [1.0, 5.0, np.nan]) < 6, False, "mass: at most nan (not below 6)"),
        (measure("mass", [1.0, 5.0, 2.0]) > 0.5, True, "mass: at least 1 (above 0.5)"),
        # The largest is not the nearest to its limit.
        (measure("mass", [1.0, 5.0]) < [1.1, 9.0], True, "mass: nearest to its limit 1 (below 1.1)"),
        (measure("mass", 1.000001) < 1, False, "mass: 1.000001 (not below 1)"),
        (measure("trials", 12_345) < 20_000, True, "trials: 12,345 (below 20,000)"),
        (np.array([3.0, 4.0]) > measure("mass", 2.0), True, "mass: nearest to its limit 2 (below 3)"),
    ],
)
def test_a_test_says_what_it_compared(test, passed, sentence):
    assert (test.passed, test.sentence) == (passed, sentence)


def test_a_statement_needs_all_of_its_tests_and_tells_them_in_order():
    mass = measure("mass", 2.0, "kg")
    statement = holds(mass > 1, mass < 3, "as flown", check("it converges", [True, True]), trials=7, share=0.5)
    assert statement.value is True and statement.trials == 7 and statement.numbers == {"share": 0.5}
    tests = "mass: 2 kg (above 1 kg)", "mass: 2 kg (below 3 kg)"
    assert statement.evidence == (*tests, "as flown", "it converges: yes")
    assert holds(mass > 1, check("it converges", [True, False])).value is False
    assert holds((mass > 3) | (mass > 1)).value is True and holds((mass > 3) | (mass > 4)).value is False


def test_a_sampled_measure_is_decided_three_errors_from_its_limit():
    def evaluated(value, *others):
        return holds(measure("mean", value, "kg", error=0.1) > 1.0, *others, trials=1000)

    assert (evaluated(1.31).value, evaluated(1.31).doubts) == (True, ())
    assert (evaluated(0.69).value, evaluated(0.69).doubts) == (False, ())
    near = evaluated(1.1)
    assert near.value is True
    assert near.doubts == (Doubt(measure="mean", why="within three standard errors of its limit", trials=9000),)
    assert near.margin.distance == pytest.approx(1.0) and near.margin.scale == "standard errors"
    # What fails for certain decides, whatever is in doubt beside it.
    decided = evaluated(1.1, measure("mass", 5.0) < 3)
    assert (decided.value, decided.doubts) == (False, ())
    few = holds(measure("mean", [1.1, 0.9], error=np.nan) > 1.0, trials=1)
    assert (few.doubts[0].why, few.margin) == ("no standard error with so few trials", None)
    # Of an array, one entry that fails for certain is enough.
    assert holds(measure("mean", [0.5, 1.1], error=0.1) > 1.0).doubts == ()


@pytest.mark.parametrize(
    ("value", "passed", "doubt"), [(0.04, True, False), (0.06, True, True), (0.15, False, True), (0.3, False, False)]
)
def test_a_word_does_not_decide_within_a_factor_of_two(value, passed, doubt):
    for test in (
        measure("deviation", value) < SMALL,
        measure("deviation", 100 * value, "%") <= 100 * SMALL,
        measure("what is left", [1.0 - value, 2.0]) > 1.0 - SMALL,
        measure("excess", 3.0 + value) < 3.0 + SMALL,
    ):
        assert (test.passed, bool(test.doubt)) == (passed, doubt), test.sentence


def test_of_entries_with_a_limit_of_zero_the_furthest_fails_and_the_nearest_holds():
    """Shares of a limit of zero tell none from the other."""
    assert holds(measure("excess", [4e-5, 10.7, 0.3]) <= 0).margin.value == 10.7
    assert holds(measure("change", [-124.0, -3.0, -50.0]) < 0).margin.value == -3.0


def test_the_margin_is_that_of_the_test_that_decides():
    statement = holds(measure("mass", 2.0, "kg") > 1, measure("time", 9.0, "s") < 10, check("it converges", True))
    assert statement.margin.model_dump() == {
        "measure": "time", "value": 9.0, "limit": 10.0, "unit": "s", "distance": pytest.approx(0.1), "in": "limits",
        "standard_error": 0.0,
    }  # fmt: skip
    failed = holds(measure("mass", 2.0, "kg") > 3, measure("time", 50.0, "s") < 10)
    assert failed.margin.measure == "time", "both would have to turn"
    either = (measure("mass", 2.0, "kg") > 3) | (measure("time", 9.0, "s") < 10)
    assert holds(either).margin.measure == "time"


def test_what_goes_without_saying_is_told_only_where_it_is_not_met():
    mass = measure("mass", 2.0)
    assert holds(mass > 1, provided("it converges", True)).evidence == ("mass: 2 (above 1)",)
    statement = holds(mass > 1, provided("it converges", False))
    assert statement.value is False and statement.evidence[-1] == "it converges: no"


@pytest.mark.parametrize(
    ("speed", "turn", "passed", "doubt"),
    [(5.0, 5.0, True, ""), (1.0, 1.0, False, ""), (5.0, 1.0, False, "the paper does not say which of these is meant")],
)
def test_a_word_with_several_meanings_decides_only_where_they_agree(speed, turn, passed, doubt):
    statement = holds(whichever(measure("speed", speed) > 3, measure("turn", turn) > 3))
    assert (statement.value, "".join(one.why for one in statement.doubts)) == (passed, doubt)
    assert statement.margin.measure == ("turn" if doubt else "speed")


def test_trials_settle_only_what_noise_leaves_in_doubt():
    near, far = measure("mean", 1.1, error=0.1) > 1.0, measure("mass", 2.0) > 3.0
    word = measure("share", 0.06) < SMALL
    assert holds(whichever(near, far), trials=1000).doubts[0].trials is None
    assert holds(word | near, trials=1000).doubts == (Doubt(why=word.doubt.why, measure="share"),)
    assert holds(near | far, trials=1000).doubts[0].trials == 9000


def test_what_is_doubtful_is_undetermined_unless_another_test_fails_for_certain():
    assert [one.why for one in holds(measure("mass", 5.0) > 3, doubtful("than what?")).doubts] == ["than what?"]
    assert holds(measure("mass", 1.0) > 3, doubtful("than what?")).doubts == ()


def test_what_could_not_fail_is_refused():
    with pytest.raises(TypeError, match="no truth value"):
        _ = 1 < measure("mass", 2.0) < 3
    with pytest.raises(InputError, match="needs a test"):
        holds("it does")
    with pytest.raises(InputError, match="nothing to measure"):
        measure("mass", [])
    with pytest.raises(InputError, match="nothing to test"):
        check("it converges", [])


@pytest.mark.parametrize("slug", SLUGS)
def test_a_shared_measure_has_one_name_in_a_paper_so_that_it_is_computed_once(slug):
    claims = writing.claims_of(slug)
    functions = {marked.function for marked in claims.declarations.values()} | set(claims._providers.values())
    names = {(kind, name) for function in functions for name, kind, _ in injection._parameters(function)}
    named = {kind: sorted(name for other, name in names if other is kind) for kind in claims._providers}
    assert {kind.__name__: several for kind, several in named.items() if len(several) > 1} == {}
