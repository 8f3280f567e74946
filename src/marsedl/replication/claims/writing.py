"""What a paper's claim functions are written with, and how they are run.

A claim is one function in `papers/<slug>/claims/`, named by its id. Its signature says what it measures from: sections
of the inputs, artifacts by the names of their stages or Monte Carlo cases, and measures that claims share. Its
decorator says what is fixed beforehand, what it returns says what was measured and tested:

    @claim(errata="E10")
    def mc_mass_above_prior(nominal: Nominal, closed_loop: Largest[FlightEnsemble]):
        mass = closed_loop.final_state[:, MASS]
        error = mean_standard_error(variance(mass), len(mass))
        return holds(measure("mean minus prior mass", mass.mean() - nominal.mass[-1], "kg") > 3 * error)

docs/verdicts.md says what limits, doubts and counterexamples there are.

- A claim is not evaluated in a reading that lacks an artifact of its signature; a parameter with a default may lack.
- `Largest[...]` takes the case `<name>_large` where the reading has it.
- A measure that claims share is a function of the same folder with the class that it returns as its annotation; a
  parameter of this class asks for it, and it is computed once for a reading.
- `raise Fails("no law")` fails all claims that depend on it.
- A claim is evaluated by itself: `claims.evaluate_one(name, claims.asking(run.given(), published))` computes only the
  stages that it asks for.
- Several claims can be one function under several decorators; their further arguments are its keyword-only parameters.
"""

import contextlib
import inspect
import operator
import pkgutil
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial, partialmethod
from importlib import import_module

import numpy as np

from marsedl.replication.claims.claim import Claim, Counterexample, Doubt, Margin, Tolerance
from marsedl.replication.claims.counterexamples import Perturbation
from marsedl.replication.claims.names import COUNTED_VERDICTS, UNDECIDED
from marsedl.replication.claims.numbers import finite_values, told_apart
from marsedl.replication.claims.printed import PublishedClaim, stated_value
from marsedl.replication.claims.thresholds import SIGMAS, Limit
from marsedl.replication.claims.verdicts import Declaration, Evaluation, collect, judge, settling
from marsedl.replication.errors import InputError, SolverError
from marsedl.replication.inputs.sections import Inputs
from marsedl.replication.pipeline.injection import Arguments, Missing


class Fails(Exception):
    """Raised where what a claim speaks of does not exist: its message is the evidence."""

    def __init__(self, message: str, trials: int | None = None):
        """Take the evidence, and the number of trials that it is seen in."""
        super().__init__(message)
        self.trials = trials


# -------------------------------------------------------------------------------------------------- what claims return


def measured(
    value: object,
    standard_error: object = None,
    trials: int | None = None,
    evidence: str | Iterable[str] = (),
    *,
    by_construction: str = "",
    **numbers: object,
) -> Evaluation:
    """Return what a reading gives for a printed number.

    by_construction: why the number cannot be another one in this reading, if so; numbers: that the reason may quote.
    """
    return Evaluation(value, standard_error, trials, evidence, numbers, by_construction=by_construction)


def holds(*parts: "Test | str", trials: int | None = None, by_construction: str = "", **numbers: object) -> Evaluation:
    """Return what a reading gives for a statement: it is true if all of its tests pass.

    parts: tests, and sentences that only tell, in the order of the evidence; trials: that were flown for it; others as
    of `measured`. Raises InputError if no part is a test.
    """
    tests = [part for part in parts if isinstance(part, Test)]
    if not tests:
        raise InputError("a statement needs a test: compare a measure with its limit")
    value = all(test.passed for test in tests)
    # One test that fails for certain decides, whatever the others are.
    certain = any(not test.passed and not test.doubt for test in tests)
    in_doubt = () if certain else [test for test in tests if test.doubt]
    doubts = [test.doubt.model_copy(update={"trials": settling(test.more, trials)}) for test in in_doubt]
    # Of those passed the nearest to its limit decides, of those failed the furthest from it.
    margins = [test.margin for test in tests if test.margin and test.passed == value]
    margin = (min if value else max)(margins, key=lambda margin: margin.distance, default=None)
    evidence = [part if isinstance(part, str) else part.sentence for part in parts]
    every = tuple(margin for test in tests for margin in test.margins)
    return Evaluation(value, None, trials, evidence, numbers, False, tuple(doubts), margin, every, by_construction)


@dataclass(frozen=True)
class Test:
    """One comparison with a limit, and the words for it."""

    passed: bool
    sentence: str
    doubt: Doubt | None = None  # why it could as well be the other way
    more: float = 1.0  # so many times the trials would decide
    margin: Margin | None = None  # of the entry that decides
    margins: tuple[Margin | None, ...] = ()  # of all comparisons that it joins, in their order

    def __bool__(self):
        """Refuse `a < measure < b`, of which Python would drop a half."""
        raise TypeError("a test has no truth value: pass it to holds(...)")

    def __or__(self, other: "Test") -> "Test":
        """Return the test that passes if either does."""
        sure = [test for test in (self, other) if test.passed and not test.doubt]
        better = next(iter(sure), self if self.passed or not other.passed else other)
        sentence = f"{self.sentence}, or {other.sentence}"
        unsure = Test(True, "") if sure else self if self.doubt else other
        margins = self.margins + other.margins
        return Test(self.passed or other.passed, sentence, unsure.doubt, unsure.more, better.margin, margins)


class Measure:
    """What a statement is judged by: a number, or an array of which all entries have to pass."""

    __array_ufunc__ = None  # so that arrays leave comparisons to this class

    def __init__(self, name: str, value: object, unit: str = "", *, error: object = 0.0):
        """Take what is measured; raises InputError if there is no value at all, so that no test could fail.

        name: what it is, as the subject of a sentence; unit: of the value and of its limit; error: standard error of a
        sampled value, of its shape or one for all.
        """
        self.name, self.value, self.unit, self.error = name, np.asarray(value), unit, np.asarray(error, dtype=float)
        if self.value.size == 0:
            raise InputError(f"{name}: there is nothing to measure")

    def _test(self, compare: Callable, relation: str, limit: object) -> Test:
        limit = limit if isinstance(limit, Limit) else Limit(None, np.asarray(limit))
        varied = (limit.at(factor) for factor in (1.0, 0.5, 2.0))
        arrays = np.broadcast_arrays(self.value, *varied, self.error)
        value, limits, half, twice, error = map(np.ravel, arrays)
        passed, upper = compare(value, limits), compare in (operator.lt, operator.le)
        room = ((limits - value) if upper else (value - limits)).astype(float)
        room = np.where(np.isnan(room), -np.inf, room)
        # With one limit for all, the entry nearest to it is the largest or the smallest.
        at, which = np.argmin(room), ""
        if value.size > 1:
            has_own_limits = np.ptp(limits.astype(float)) > 0
            which = "nearest to its limit " if has_own_limits else ("at most " if upper else "at least ")
        number, bound = told_apart(value[at], limits[at])
        unit = f" {self.unit}" if self.unit else ""
        spread = f" ± {error[at]:.2g}" if error[at] > 0 else ""
        negation = "" if passed.all() else "not "
        why, more = _doubt(passed, (compare(value, half) != passed) | (compare(value, twice) != passed), room, error)
        margin = _margin(self, passed, room, value.astype(float), limits.astype(float), error)
        return Test(
            bool(passed.all()),
            f"{self.name}: {which}{number}{spread}{unit} ({negation}{relation} {bound}{unit})",
            Doubt(why=why, measure=self.name) if why else None,
            more,
            margin,
            (margin,),
        )

    __lt__ = partialmethod(_test, operator.lt, "below")
    __le__ = partialmethod(_test, operator.le, "at most")
    __gt__ = partialmethod(_test, operator.gt, "above")
    __ge__ = partialmethod(_test, operator.ge, "at least")


measure = Measure


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


def doubtful(why: str) -> Test:
    """Return the test that passes and leaves its statement undetermined, unless another one fails for certain."""
    return Test(True, "", Doubt(why=why))


def whichever(*tests: Test) -> Test:
    """Return the test of a word that can mean several things: it is in doubt if these disagree."""
    passed, sentence = all(test.passed for test in tests), "; ".join(test.sentence for test in tests)
    unsure = next((test for test in tests if test.doubt), tests[0])
    if not passed and any(test.passed for test in tests):
        unsure = doubtful("the paper does not say which of these is meant")
    margin = next((test.margin for test in tests if test.passed == passed), None)
    return Test(passed, sentence, unsure.doubt, unsure.more, margin, sum((test.margins for test in tests), ()))


def listed(values: object, form: str = ".3f") -> str:
    """Return a number, or numbers with commas between them, for a sentence; "none" stands for what is not finite."""
    return ", ".join(f"{value:{form}}" if np.isfinite(value) else "none" for value in np.atleast_1d(values))


def _doubt(passed, by_words, room, error) -> tuple[str, float]:
    """Why a test could be the other way, and how many times the trials would decide it; none if it could not."""
    by_noise = np.isfinite(room) & (error > 0) & (np.abs(room) <= SIGMAS * error)
    without_error = np.isfinite(room) & np.isnan(error)
    if np.any(~passed & ~by_noise & ~by_words & ~without_error) or not np.any(by_noise | by_words | without_error):
        return "", 1.0  # one entry fails for certain, or all pass
    if without_error.any():
        return "no standard error with so few trials", 1.0
    if by_words.any():
        return "half or twice the threshold would turn the verdict", 1.0
    near = np.maximum(np.abs(room[by_noise]), 1e-3 * error[by_noise])  # nearer is as good as on the limit
    return "within three standard errors of its limit", float(np.max((SIGMAS * error[by_noise] / near) ** 2))


def _margin(measure, passed, room, value, limits, error) -> Margin | None:
    """How far the entry that decides is from its limit, in standard errors or in shares of the limit."""
    scale = np.where(error > 0, error, np.where(limits != 0, np.abs(limits), np.abs(value)))
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.abs(room) / scale
    candidates = np.flatnonzero(np.isfinite(distance + error) & (passed == passed.all()))
    if not candidates.size:
        return None
    # Of several that are as far in these units, as all are from a limit of zero, the numbers themselves decide.
    by_distance = np.lexsort((np.abs(room)[candidates], distance[candidates]))
    at = candidates[by_distance[0 if passed.all() else -1]]
    return Margin(
        measure=measure.name,
        value=float(value[at]),
        limit=float(limits[at]),
        unit=measure.unit,
        distance=float(distance[at]),
        scale="standard errors" if error[at] > 0 else "limits" if limits[at] else "values",
        standard_error=float(error[at]),
    )


# ----------------------------------------------------------------------------------------------------- a paper's claims


def claim(
    reason: str = "",
    *,
    errata: str = "",
    choices: str = "",
    close: Tolerance | None = None,
    by_construction: str = "",
    counterexample: Perturbation | None = None,
    name: str | None = None,
    **options: object,
) -> Callable:
    """Mark a function as a claim.

    reason, close, by_construction: see `Declaration`; errata, choices: names with blanks between them, such as
    "E1 E4"; counterexample: the change of a record or input that turns the verdict; name: id of the claim, if it is not
    the function's name; options: values of the function's keyword-only parameters.
    """

    def mark(function: Callable) -> Callable:
        text, named = " ".join(reason.split()), [tuple(names.split()) for names in (errata, choices)]
        declared = Declaration(text, *named, close, by_construction, counterexample, function, options)
        function.claims = [(name or function.__name__, declared), *getattr(function, "claims", [])]
        return function

    return mark


class Claims:
    """The claim functions of a paper and the measures that they share."""

    def __init__(self, package: str, model: type[Inputs]):
        """Take the package with the paper's claims, and its inputs; raises InputError if two claims have one id."""
        self._model = model
        self.declarations: dict[str, Declaration] = {}
        self._providers: dict[type, Callable] = {}
        folder = import_module(package)
        for module in [import_module(f"{package}.{found.name}") for found in pkgutil.iter_modules(folder.__path__)]:
            for function in filter(inspect.isfunction, vars(module).values()):
                if function.__module__ != module.__name__:
                    continue
                for name, declared in getattr(function, "claims", ()):
                    if self.declarations.setdefault(name, declared) is not declared:
                        raise InputError(f"{name}: two functions are claims of this id; rename one")
                kind = typing.get_type_hints(function).get("return")
                shared = isinstance(kind, type) and kind.__module__.startswith(package)
                if shared and self._providers.setdefault(kind, function) is not function:
                    raise InputError(f"{kind.__name__}: two functions of claims return it; rename one")

    def asking(self, given: Arguments, published: Mapping[str, PublishedClaim], **further: object) -> Arguments:
        """Return what the claims of a reading can ask for: also what they share, which is computed once.

        given: all inputs of the reading, and its artifacts; published: the paper's printed claims by id, of which one
        that fails takes the shape; further: used by functions that have parameters of these names.
        """
        return Arguments(given.values, given.artifact, {**further, "published": published}, self._providers)

    def evaluate_one(self, name: str, asked: Arguments) -> Evaluation:
        """Evaluate one claim from what it asks for, see `asking`.

        Raises Missing if it lacks an artifact, and what the stages raise that give it.
        """
        printed, marked = asked.further["published"].get(name), self.declarations.get(name)
        if printed and printed.input is not None:
            if marked:
                raise InputError(f"claim {name} has an input in data/published and a function too; drop one of them")
            return Evaluation(stated_value(printed, asked.values, self._model))
        try:
            return asked.call(marked.function, **marked.options)
        except Fails as failure:
            value = printed.printed if printed else None
            failed = (not value) if isinstance(value, bool) else np.full(np.shape(value), np.nan)
            errors = None if isinstance(value, bool) or failure.trials is None else failed
            return Evaluation(failed, errors, failure.trials, str(failure), failed=True)

    def evaluate(
        self, given: Arguments, published: Mapping[str, PublishedClaim], **further: object
    ) -> dict[str, Evaluation | None]:
        """Return the evaluations of all claims in one reading by id, arguments as of `asking`.

        None is that of a claim that lacks an artifact, or needs a stage whose solver fails.
        """
        asked = self.asking(given, published, **further)
        stated = [name for name, printed in published.items() if printed.input is not None]
        evaluations = dict.fromkeys([*stated, *self.declarations])
        for name in evaluations:
            with contextlib.suppress(Missing, SolverError):
                evaluations[name] = self.evaluate_one(name, asked)
        return evaluations


def judged(
    claims: Claims,
    readings: Mapping[str, Arguments],
    published: Mapping[str, PublishedClaim],
    named: Mapping[str, Mapping[str, Evaluation]],
    measured: Mapping[str, float] | None,
    **rules: object,
) -> list[Claim]:
    """Evaluate and judge all claims of a paper.

    readings: what claims can ask for, by reading. named: what named readings give. measured: by benchmarks, for a paper
    that needs them. rules: see `collect`.
    """
    evaluations = {name: claims.evaluate(given, published, measured=measured) for name, given in readings.items()}
    return collect([*published.values()], claims.declarations, evaluations | named, **rules)


def turned(
    claims: Claims, rows: Iterable[Claim], given: Arguments, published: Mapping[str, PublishedClaim], **further: object
) -> dict[str, Counterexample | None]:
    """Turn every counted claim by its counterexample; arguments as of `Claims.evaluate`, in the reading that counts.

    Returns what was changed, by how much, and the verdict after it, by claim; None for one that was not turned. A claim
    that another reading turns is left out where that is not built.
    """
    asked, found = claims.asking(given, published, **further), {}
    for row in rows:
        if row.verdict not in COUNTED_VERDICTS or row.kind == UNDECIDED:
            continue
        change = claims.declarations[row.id].counterexample
        if change is None:
            found[row.id] = None
        elif change.change != "in_reading":
            found[row.id] = change.turning_point(partial(_verdict, claims, row.id), asked)
        elif change.target in row.readings:
            found[row.id] = change.elsewhere(row)
    return found


def _verdict(claims: Claims, name: str, asked: Arguments) -> tuple:
    """The verdict on a claim and on its components; raises ValueError if there is nothing to judge."""
    evaluation = claims.evaluate_one(name, asked)
    if evaluation.failed or evaluation.value is None or finite_values(evaluation.value) != evaluation.value:
        raise ValueError(f"{name}: nothing to judge")
    result = judge(asked.further["published"][name], evaluation, claims.declarations[name])
    return result.verdict, result.components


@cache
def claims_of(slug: str) -> Claims:
    """Return the claims of a paper."""
    model = import_module(f"marsedl.papers.{slug}.inputs").Inputs
    return Claims(f"marsedl.papers.{slug}.claims", model)
