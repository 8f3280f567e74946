"""What a paper's claim functions are written with, and how they are run.

A claim is one function in `papers/<slug>/claims/`, named by its id. Its signature says what it measures from: sections
of the inputs, artifacts by the names of their stages or Monte Carlo cases, and measures that claims share. Its
decorator says what is fixed beforehand, what it returns says what was measured and tested:

    @claim(errata="E10")
    def mc_mass_above_prior(nominal: Nominal, closed_loop: Largest[FlightEnsemble]):
        mass = FinalMoments(closed_loop, MASS)
        error = mean_standard_error(mass.variance, mass.count)
        return holds(measure("mean minus prior mass", mass.mean - nominal.mass[-1], "kg") > 3 * error)

- A sampled measure carries its standard error, `measure(name, value, unit, error=...)`: within three of them of its
  limit it is undetermined. A limit of words (`VISIBLE`, `1.0 - MUCH`, see `thresholds`) is varied by a factor of two.
- `counterexample` names the change of a record or input that turns the verdict, see `counterexamples`.
- A claim is not evaluated in a reading that lacks an artifact of its signature; a parameter with a default may lack.
- `Largest[...]` takes the case `<name>_large` where the reading has it.
- A measure that claims share is a function of the same folder with the class that it returns as its annotation; a
  parameter of this class asks for it, and it is computed once for a reading.
- `raise Fails("no law")` fails all claims that depend on it.
- Several claims can be one function under several decorators; their further arguments are its keyword-only parameters.
"""

import inspect
import operator
import pkgutil
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module

import numpy as np

from marsedl.replication.claims.claim import (
    BY_CONSTRUCTION,
    COUNTED_VERDICTS,
    UNDECIDED,
    Claim,
    Counterexample,
    Margin,
)
from marsedl.replication.claims.counterexamples import Perturbation, turning_point
from marsedl.replication.claims.numbers import is_finite
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.stated import stated_value
from marsedl.replication.claims.thresholds import SIGMAS, Limit
from marsedl.replication.claims.verdicts import Close, Declaration, Evaluation, judge, settling
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.sections import Inputs
from marsedl.replication.pipeline.injection import LARGE, Arguments, Missing
from marsedl.replication.pipeline.runner import Run
from marsedl.replication.records.fields import first_trials, trials_of

_DIGITS = 4  # that evidence shows, and more where a value and its limit would look equal


class Fails(Exception):
    """Raised where what a claim speaks of does not exist: its message is the evidence."""

    def __init__(self, message: str, trials: int | None = None):
        """Take the evidence, and the number of trials that it is seen in."""
        super().__init__(message)
        self.trials = trials


# ---------------------------------------------------------------------------------------------------------- decorators


@dataclass(frozen=True)
class _Claim:
    """One claim of a function."""

    id: str
    function: Callable
    declaration: Declaration
    options: Mapping[str, object]
    counterexample: Perturbation | None = None


def claim(
    reason: str = "",
    *,
    errata: str = "",
    withheld: str | tuple[str, ...] = (),
    close: Close | None = None,
    by_construction: str = "",
    counterexample: Perturbation | None = None,
    name: str | None = None,
    **options: object,
) -> Callable:
    """Mark a function as a claim.

    Args:
        reason: why the claim differs or fails, with numbers to fill in, see `Declaration`; line breaks do not count.
        errata: ids of errata, with blanks between them.
        withheld: what the paper does not give, in words.
        close: a tolerance that is stated beforehand.
        by_construction: why the claim cannot fail, in words; it is then listed and not counted.
        counterexample: the change of a record or input that turns the verdict; every counted claim has one.
        name: id of the claim, if it is not the function's name.
        options: values of the function's keyword-only parameters.

    """
    withheld = (withheld,) if isinstance(withheld, str) else withheld
    declaration = Declaration(" ".join(reason.split()), tuple(errata.split()), withheld, close, by_construction)

    def mark(function: Callable) -> Callable:
        marked = _Claim(name or function.__name__, function, declaration, options, counterexample)
        function.claims = [marked, *getattr(function, "claims", [])]
        return function

    return mark


# --------------------------------------------------------------------------------------------------- what is returned


def measured(
    value: object,
    standard_error: object = None,
    trials: int | None = None,
    evidence: str = "",
    *,
    by_construction: str = "",
    **numbers: object,
) -> Evaluation:
    """Return what a reading gives for a printed number; `numbers` may be quoted by the claim's reason.

    by_construction: why the number cannot be another one in this reading, if so.
    """
    return Evaluation(value, standard_error, trials, evidence, numbers, by_construction=by_construction)


def holds(*parts: "Test | str", trials: int | None = None, by_construction: str = "", **numbers: object) -> Evaluation:
    """Return what a reading gives for a statement: it is true if all of its tests pass.

    Args:
        parts: tests, and sentences that only tell; the evidence is written from them in this order.
        trials: that were flown for it.
        by_construction: why the statement cannot fail in this reading, if so.
        numbers: that the claim's reason may quote.

    Raises:
        InputError: no part is a test.

    """
    tests = [part for part in parts if not isinstance(part, str)]
    if not tests:
        raise InputError("a statement needs a test: compare a measure with its limit")
    value = all(test.passed for test in tests)
    # One test that fails for certain decides, whatever the others are.
    certain = any(not test.passed and not test.doubt for test in tests)
    doubts = [] if certain else [test.in_words(trials) for test in tests if test.doubt]
    return Evaluation(
        value,
        None,
        trials,
        "; ".join(_sentences(parts)),
        numbers,
        undetermined="; ".join(doubts),
        margin=_deciding(tests, value),
        by_construction=by_construction,
    )


def _sentences(parts: "Iterable[Test | str]") -> list[str]:
    """The sentences of the evidence: one for tests that follow each other and compare one measure with its limits."""
    groups: list[list[Test | str]] = []
    for part in parts:
        before = groups[-1][0] if groups else None
        if isinstance(part, Test) and isinstance(before, Test) and part.extends(before):
            groups[-1].append(part)
        elif isinstance(part, str) or part.sentence:
            groups.append([part])
    return [first if isinstance(first, str) else first.with_relations_of(others) for first, *others in groups]


def _deciding(tests: "Sequence[Test]", value: bool) -> Margin | None:
    """The margin of the test that decides: of those passed the nearest, of those failed the furthest."""
    margins = [test.margin for test in tests if test.margin is not None and test.passed == value]
    if not margins:
        return None
    return (min if value else max)(margins, key=lambda margin: margin.distance)


@dataclass(frozen=True)
class Test:
    """One comparison with a limit, and the words for it."""

    passed: bool
    sentence: str
    measure: "Measure | None" = None
    words: tuple[str, str, str, str] = ("", "", "", "")  # of a measure: before its value, that, after it, the relation
    doubt: str = ""  # why it could as well be the other way
    more: float = 1.0  # so many times the trials would decide
    margin: Margin | None = None  # of the entry that decides

    def __bool__(self):
        """Refuse `a < measure < b`, of which Python would drop a half."""
        raise TypeError("a test has no truth value: pass it to holds(...)")

    def __or__(self, other: "Test") -> "Test":
        """Return the test that passes if either does."""
        sure = [test for test in (self, other) if test.passed and not test.doubt]
        better = next(iter(sure), self if self.passed or not other.passed else other)
        doubt = "" if sure else self.doubt or other.doubt
        return Test(
            self.passed or other.passed,
            f"{self.sentence}, or {other.sentence}",
            doubt=doubt,
            more=max(self.more, other.more),
            margin=better.margin,
        )

    def extends(self, other: "Test") -> bool:
        """Whether it tests the same measure as another one, with the same number where there are several."""
        same = self.measure is other.measure is not None
        return same and (self.measure.value.size == 1 or self.words[1] == other.words[1])

    def with_relations_of(self, others: "Sequence[Test]") -> str:
        """Return the sentence with the relations to further limits, and the digits that tell the value from all."""
        if not others:
            return self.sentence
        before, _, after, _ = self.words
        number = max((test.words[1] for test in (self, *others)), key=len)
        return f"{before}{number}{after} ({' and '.join(test.words[3] for test in (self, *others))})"

    def in_words(self, trials: int | None) -> str:
        """Return why the test is in doubt, and how many trials would settle it if noise is the reason."""
        if self.more <= 1.0 or not trials:
            return self.doubt
        return f"{self.doubt}; {settling(self.more * trials)}"


@dataclass(frozen=True, eq=False)
class Measure:
    """What a statement is judged by: a number, or an array of which all entries have to pass."""

    name: str
    value: np.ndarray
    unit: str
    error: np.ndarray | float = 0.0  # standard error of a sampled value

    __array_ufunc__ = None  # so that arrays leave comparisons to this class

    def __lt__(self, limit):
        """Test that it is below a limit."""
        return _test(self, operator.lt, limit)

    def __le__(self, limit):
        """Test that it is at most a limit."""
        return _test(self, operator.le, limit)

    def __gt__(self, limit):
        """Test that it is above a limit."""
        return _test(self, operator.gt, limit)

    def __ge__(self, limit):
        """Test that it is at least a limit."""
        return _test(self, operator.ge, limit)


def measure(name: str, value: object, unit: str = "", *, error: object = 0.0) -> Measure:
    """Return what a statement is judged by.

    Args:
        name: what it is, as the subject of a sentence.
        value: a number or an array.
        unit: of the value and of its limit; none for plain numbers.
        error: standard error of a sampled value, of its shape or one for all.

    Raises:
        InputError: there is no value at all, so that no test could fail.

    """
    value = np.asarray(value)
    if value.size == 0:
        raise InputError(f"{name}: there is nothing to measure")
    return Measure(name, value, unit, np.asarray(error, dtype=float))


def check(sentence: str, passed: object) -> Test:
    """Return the test of what is true or false and no number; of an array, all entries have to be true."""
    passed = np.asarray(passed)
    if passed.size == 0:
        raise InputError(f"{sentence}: there is nothing to test")
    return Test(bool(passed.all()), f"{sentence}: {'yes' if passed.all() else 'no'}")


def provided(sentence: str, passed: object) -> Test:
    """Return the test of a condition that goes without saying: the evidence names it only where it is not met."""
    test = check(sentence, passed)
    return Test(True, "") if test.passed else test


def listed(values: object, form: str = ".3f") -> str:
    """Return a number, or numbers with commas between them, for a sentence; "none" stands for what is not finite."""
    return ", ".join(f"{value:{form}}" if np.isfinite(value) else "none" for value in np.atleast_1d(values))


_WORDS = {operator.lt: "below", operator.le: "at most", operator.gt: "above", operator.ge: "at least"}


def _test(measure: Measure, compare: Callable, limit: object) -> Test:
    upper = compare in (operator.lt, operator.le)
    limit = limit if isinstance(limit, Limit) else Limit(None, np.asarray(limit))
    value, limits, error = np.broadcast_arrays(measure.value, np.asarray(limit.at(1.0)), measure.error)
    passed = compare(value, limits)
    room = (limits - value) if upper else (value - limits)
    room = np.where(np.isnan(room.astype(float)), -np.inf, room)
    # With one limit for all, the entry nearest to it is the largest or the smallest.
    at = np.unravel_index(np.argmin(room), room.shape)
    number, bound = _texts(value[at], limits[at])
    which = ""
    if value.size > 1:
        has_own_limits = np.ptp(limits.astype(float)) > 0
        which = "nearest to its limit " if has_own_limits else ("at most " if upper else "at least ")
    unit = f" {measure.unit}" if measure.unit else ""
    spread = f" ± {error[at]:.2g}" if error[at] > 0 else ""
    relation = f"{'' if passed.all() else 'not '}{_WORDS[compare]} {bound}{unit}"
    doubt, more = _doubt(measure, compare, limit, passed, room, error)
    return Test(
        bool(passed.all()),
        f"{measure.name}: {which}{number}{spread}{unit} ({relation})",
        measure,
        (f"{measure.name}: {which}", number, f"{spread}{unit}", relation),
        doubt,
        more,
        _margin(measure, passed, room, value, limits, error),
    )


def _doubt(measure, compare, limit, passed, room, error) -> tuple[str, float]:
    """Why a test could be the other way, and how many times the trials would decide it; none if it could not."""
    by_noise = np.isfinite(room) & (error > 0) & (np.abs(room) <= SIGMAS * error)
    by_words = np.zeros(room.shape, dtype=bool)
    if limit.soft is not None:
        varied = [np.broadcast_to(compare(measure.value, limit.at(factor)), room.shape) for factor in (0.5, 2.0)]
        by_words = (varied[0] != passed) | (varied[1] != passed)
    without_error = np.isfinite(room) & np.isnan(error)
    if np.any(~passed & ~by_noise & ~by_words & ~without_error):  # one entry fails for certain
        return "", 1.0
    if without_error.any():
        return f"'{measure.name}' has no standard error with so few trials", 1.0
    if by_words.any():
        return f"half or twice the threshold would turn the test of '{measure.name}'", 1.0
    if by_noise.any():
        near = np.maximum(np.abs(room[by_noise]), 1e-3 * error[by_noise])  # nearer is as good as on the limit
        more = float(np.max((SIGMAS * error[by_noise] / near) ** 2))
        return f"'{measure.name}' lies within three standard errors of its limit", more
    return "", 1.0


def _margin(measure, passed, room, value, limits, error) -> Margin | None:
    """How far the entry that decides is from its limit, in standard errors or in shares of the limit."""
    limits, value = limits.astype(float), value.astype(float)
    scale = np.where(error > 0, error, np.where(limits != 0, np.abs(limits), np.abs(value)))
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.abs(room) / scale
    distance = np.where(np.isfinite(distance + error) & (passed == passed.all()), distance, np.nan)
    if np.isnan(distance).all():
        return None
    at = np.unravel_index(np.nanargmin(distance) if passed.all() else np.nanargmax(distance), distance.shape)
    return Margin(
        measure=measure.name,
        value=float(value[at]),
        limit=float(limits[at]),
        unit=measure.unit,
        distance=float(distance[at]),
        scale="standard errors" if error[at] > 0 else "limits" if limits[at] else "values",
        standard_error=float(error[at]),
    )


def _texts(value: object, limit: object) -> tuple[str, str]:
    """A number and its limit, with as many digits as it takes to tell them apart."""
    if np.issubdtype(np.asarray(value).dtype, np.integer):
        return f"{value:,}", f"{limit:,}" if float(limit).is_integer() else f"{limit:.{_DIGITS}g}"
    for digits in range(_DIGITS, 18):
        texts = f"{value:.{digits}g}", f"{limit:.{digits}g}"
        if texts[0] != texts[1] or value == limit:
            break
    return texts


# -------------------------------------------------------------------------------------------------- a paper's claims


class Claims:
    """The claim functions of a paper and the measures that they share."""

    def __init__(self, package: str, model: type[Inputs]):
        """Take the package with the paper's claims, and the paper's inputs.

        Raises:
            InputError: two functions have claims of one id, or return one class of measure.

        """
        self._model = model
        self.claims: dict[str, _Claim] = {}
        self._providers: dict[type, Callable] = {}
        folder = import_module(package)
        modules = [import_module(f"{package}.{module.name}") for module in pkgutil.iter_modules(folder.__path__)]
        for module in modules:
            members = [f for f in vars(module).values() if getattr(f, "__module__", "") == module.__name__]
            for function in filter(inspect.isfunction, members):
                for marked in getattr(function, "claims", ()):
                    self._add(self.claims, marked.id, marked)
                kind = typing.get_type_hints(function).get("return")
                if isinstance(kind, type) and kind.__module__.startswith(package):
                    self._add(self._providers, kind, function)

    @property
    def declarations(self) -> dict[str, Declaration]:
        """What is stated about each claim besides its value, by id."""
        return {name: marked.declaration for name, marked in self.claims.items()}

    def evaluate(
        self, given: Arguments, published: Mapping[str, PublishedClaim], **further_arguments: object
    ) -> dict[str, Evaluation | None]:
        """Evaluate all claims in one reading.

        Args:
            given: all inputs of the reading, and its artifacts.
            published: the paper's printed claims by id; what fails takes the shape of what is printed.
            further_arguments: used by functions that have parameters of these names.

        Returns:
            Evaluations by claim id; None for a claim that lacks an artifact.

        """
        of_claims = self._given(given, published, further_arguments)
        stated = {name: printed for name, printed in published.items() if printed.input is not None}
        if twice := stated.keys() & self.claims.keys():
            raise InputError(f"claim {min(twice)} has an input in data/published and a function too; drop one of them")
        return {
            **{name: stated_value(printed, given.values, self._model) for name, printed in stated.items()},
            **{name: _evaluation(marked, of_claims, published.get(name)) for name, marked in self.claims.items()},
        }

    def of_readings(
        self, readings: Mapping[str, Arguments], published: Mapping[str, PublishedClaim], **further_arguments: object
    ) -> tuple[dict[str, dict], dict[str, dict]]:
        """Evaluate all claims in several readings.

        Args:
            readings: the argument `given` of `evaluate` by reading.
            published, further_arguments: as in `evaluate`.

        Returns:
            The evaluations by reading; and once more those of the readings that have more trials of a case than another
            reading, from as many as that has, so that readings can be compared. What is stored of all trials alone
            (moments over time, say) stays that of all.

        """
        trials: dict[str, dict[str, int]] = {}  # by case and reading

        def note(case: str, kind: type, reading: str, artifact: Callable) -> object:
            record = artifact(case, kind)
            if record is not None and not case.endswith(LARGE) and (number := trials_of(record)):
                trials.setdefault(case, {})[reading] = number
            larger.update({reading} if case.endswith(LARGE) and record is not None else ())
            return record

        def fewer(case: str, kind: type, artifact: Callable) -> object:
            record = None if case.endswith(LARGE) else artifact(case, kind)
            return first_trials(record, min(trials[case].values())) if case in trials else record

        larger: set[str] = set()
        evaluations = {
            name: self.evaluate(
                Arguments(of.values, partial(note, reading=name, artifact=of.artifact)), published, **further_arguments
            )
            for name, of in readings.items()
        }
        larger |= {name for of in trials.values() for name, number in of.items() if number > min(of.values())}
        smaller = {
            name: self.evaluate(
                Arguments(of.values, partial(fewer, artifact=of.artifact)), published, **further_arguments
            )
            for name, of in readings.items()
            if name in larger
        }
        return evaluations, smaller

    def evaluate_one(
        self, name: str, given: Arguments, published: Mapping[str, PublishedClaim], **further_arguments: object
    ) -> Evaluation | None:
        """Evaluate one claim that is a function; arguments as in `evaluate`."""
        return _evaluation(self.claims[name], self._given(given, published, further_arguments), published.get(name))

    def turned(
        self,
        rows: Iterable[Claim],
        given: Arguments,
        published: Mapping[str, PublishedClaim],
        **further_arguments: object,
    ) -> dict[str, Counterexample | None]:
        """Turn every counted claim by its counterexample.

        Args:
            rows: the claims with the verdicts of all readings.
            given: all inputs of the reading whose verdicts count, and its artifacts.
            published, further_arguments: as in `evaluate`.

        Returns:
            What was changed, by how much, and the verdict after it, by claim; None for one that was not turned. See
            `counterexamples.turning_point`. A claim that another reading turns is left out where that is not built.

        """

        turned = {}
        for row in rows:
            marked = self.claims.get(row.id)
            change = marked and marked.counterexample
            if row.verdict not in COUNTED_VERDICTS or row.kind == UNDECIDED:
                continue
            if not change:
                turned[row.id] = None
            elif change.change != "in_reading":
                turned[row.id] = self._turned(marked, given, published, further_arguments)
            elif change.target in row.readings:
                verdict = row.readings[change.target].verdict
                same = verdict in (None, BY_CONSTRUCTION, row.verdict)
                elsewhere = {"change": "in_reading", "of": change.target, "amount": None, "to": verdict}
                turned[row.id] = None if same else Counterexample(**elsewhere)
        return turned

    def _turned(self, marked: _Claim, given: Arguments, published, further_arguments) -> Counterexample | None:
        def judged(values, artifact, further_arguments):
            evaluation = self.evaluate_one(marked.id, Arguments(values, artifact), published, **further_arguments)
            if evaluation is None or evaluation.failed or not is_finite(evaluation.value):
                raise ValueError(f"{marked.id}: nothing to judge")
            judgement = judge(published[marked.id], evaluation, marked.declaration)
            return judgement.verdict, judgement.components

        try:
            return turning_point(marked.counterexample, judged, given.values, given.artifact, further_arguments)
        except ValueError:
            return None  # the claim fails as a whole in this reading

    def _given(self, given: Arguments, published, further_arguments) -> Arguments:
        """What claims can ask for: also what they share, which is computed once."""
        return Arguments(given.values, given.artifact, {**further_arguments, "published": published}, self._providers)

    @staticmethod
    def _add(table: dict, key: object, value: object) -> None:
        if key in table:
            raise InputError(f"{getattr(key, '__name__', key)}: two functions of claims give it; rename one")
        table[key] = value


def _evaluation(marked: _Claim, given: Arguments, printed: PublishedClaim | None) -> Evaluation | None:
    try:
        return given.call(marked.function, **marked.options)
    except Missing:
        return None
    except Fails as failure:
        value = printed.printed if printed else None
        failed = (not value) if isinstance(value, bool) else np.full(np.shape(value), np.nan)
        errors = None if isinstance(value, bool) or failure.trials is None else failed
        return Evaluation(failed, errors, failure.trials, str(failure), failed=True)


@cache
def claims_of(slug: str) -> Claims:
    """Return the claims of a paper."""
    model = import_module(f"marsedl.papers.{slug}.inputs").MODEL
    return Claims(f"marsedl.papers.{slug}.claims", model)


def evaluate(run: Run, published: Mapping[str, PublishedClaim], **further_arguments) -> dict[str, Evaluation | None]:
    """Return the evaluation of each claim of a run's paper.

    published: the printed claims by id; further_arguments: what claims ask for beside artifacts.
    """
    return claims_of(run.paper.slug).evaluate(run.given(), published, **further_arguments)
