"""Printed claims, their evaluations and the verdicts computed from both.

A paper's printed numbers and statements are facts, kept in `data/published/<paper>.yaml`. A paper's code evaluates
each of them in every reading. `collect` compares the two by fixed rules; nobody types a verdict.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from marsedl.replication.claims.claim import UNEXPLAINED, Claim, Doubt, Margin, Result, Tolerance
from marsedl.replication.claims.counterexamples import Perturbation
from marsedl.replication.claims.names import AGREEING_VERDICTS, BY_CONSTRUCTION, MEASURED, REFUTED_VERDICTS
from marsedl.replication.claims.numbers import finite_values, is_number, plain
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.quotes import with_numbers_of_a_claim
from marsedl.replication.claims.thresholds import SIGMAS, THIN, WIDE
from marsedl.replication.errors import ArtifactError, InputError, nearest
from marsedl.replication.inputs import CORRECTED, PRINTED
from marsedl.replication.inputs.choices import in_words
from marsedl.replication.sizes import FULL

_WORST_FIRST = ("differs", "undetermined", "close", "reproduced")  # verdicts on numbers, of which the first decides
_MORE = [1.5**power for power in range(35)]  # times our trials: what these cannot settle, more do not
_LITERAL = 1e-9  # relative slack with which an input counts as used literally (unit conversions round)


@dataclass(frozen=True)
class Evaluation:
    """What one reading gives for one claim.

    Arrays and numpy numbers are turned into lists and plain numbers. A value that is not finite stays so here (the
    reading failed, visibly): it never reproduces, and it is written to JSON as null.
    """

    value: Any = None  # shaped like the printed value; bool for a statement; None: not evaluated in this reading
    standard_error: Any = None  # shaped like `value`
    trials: int | None = None
    evidence: str | Sequence[str] = ()  # sentences with computed numbers, or one
    numbers: Mapping[str, Any] = field(default_factory=dict)  # named numbers that a reason may quote
    failed: bool = False  # what the claim speaks of does not exist, nor do its named numbers
    doubts: Sequence[Doubt] = ()  # why a statement could as well be judged otherwise
    margin: Margin | None = None  # how far the measure that decides a statement is from its limit
    margins: Sequence[Margin | None] = ()  # those of all tests of a statement, in their order
    by_construction: str = ""  # why it cannot be otherwise in this reading

    def __post_init__(self) -> None:
        """Turn arrays into plain Python."""
        sentences = [self.evidence] if isinstance(self.evidence, str) else self.evidence
        for name in ("value", "standard_error", "trials"):
            object.__setattr__(self, name, plain(getattr(self, name)))
        object.__setattr__(self, "numbers", {name: plain(number) for name, number in self.numbers.items()})
        object.__setattr__(self, "evidence", tuple(filter(None, sentences)))


@dataclass(frozen=True)
class Declaration:
    """What a paper's code states about a claim besides its value.

    `reason` may quote computed numbers, see `quotes`: `{name}` is a named number of the reading that gives the verdict
    (`value`, `standard_error` and `trials` always exist), `{target4.name}` that of the reading `target4`. A
    verdict `differs` or `fails` needs a reason and an erratum or a choice.
    """

    reason: str = ""
    errata: tuple[str, ...] = ()  # ids of errata, such as "E10"
    choices: tuple[str, ...] = ()  # choices of the paper, by name, that may explain a difference
    close: Tolerance | None = None
    by_construction: str = ""  # why the claim cannot fail
    counterexample: Perturbation | None = None  # the change that turns the verdict
    function: Callable | None = None  # that evaluates the claim
    options: Mapping[str, object] = field(default_factory=dict)  # of its keyword-only parameters


def collect(
    published: Sequence[PublishedClaim],
    declarations: Mapping[str, Declaration],
    evaluations_by_reading: Mapping[str, Mapping[str, Evaluation | None]],
    *,
    known_errata: Collection[str] | None = None,
    require_reasons: bool = True,
    left_out: Collection[str] = (),
    size: str = FULL,
) -> list[Claim]:
    """Compare every printed claim of a paper with every reading; returns the claims in the printed order.

    Args:
        published: the printed claims.
        declarations: tolerances and reasons by claim id; a claim without one has neither.
        evaluations_by_reading: for every reading, an evaluation for every claim id (None: not evaluated there; quoted
            literature may be left out). `corrected` gives the verdict that counts, `printed` that on stated inputs.
        known_errata: the paper's errata ids; when given, declarations may name no others.
        require_reasons: refuse an unexplained `differs` or `fails`; else its reason is `UNEXPLAINED`, as it must be for
            builds with changed inputs or of a smaller size.
        left_out: readings that this size does not build; their numbers in reasons are dashes.
        size: the size of the build.

    Raises InputError for what does not fit together, and ArtifactError as `judge`.
    """
    _check_ids(published, declarations, evaluations_by_reading, known_errata)
    readings = dict.fromkeys([CORRECTED, *evaluations_by_reading])
    rows = []
    for claim in published:
        where = f"{claim.paper}: claim {claim.id}"
        declaration = declarations.get(claim.id, Declaration())
        if declaration.close is not None and claim.kind not in MEASURED:
            raise InputError(f"{where}: a {claim.kind} claim takes no tolerance")
        evaluations = {name: evaluations_by_reading[name].get(claim.id) or Evaluation() for name in readings}
        of_paper = evaluations[CORRECTED]
        results = {name: judge(claim, evaluation, declaration, of_paper) for name, evaluation in evaluations.items()}
        first = PRINTED if claim.kind == "input" else CORRECTED
        verdict, margin = results[first].verdict, results[first].margin
        if verdict is None:
            raise InputError(f"{where}: not evaluated in reading {first}, so it has no verdict")
        explained = declaration.reason.strip() and (declaration.errata or declaration.choices)
        unexplained = verdict in REFUTED_VERDICTS and not explained
        if unexplained and require_reasons:
            raise InputError(
                f"{where}: {verdict} in reading {first} (printed {claim.printed!r}, found {evaluations[first].value!r})"
                " without a reason that names an erratum or a choice"
            )
        reason = UNEXPLAINED if unexplained else _reason(claim, declaration, first, evaluations, verdict, left_out)
        row = Claim(
            paper=claim.paper,
            size=size,
            id=claim.id,
            where=claim.where,
            quantity=claim.quantity,
            plain=claim.plain,
            unit=claim.unit,
            kind=claim.kind,
            printed=finite_values(claim.printed, infinity="inf"),
            resolution=claim.resolution,
            trials=claim.trials,
            note=claim.note,
            headline=claim.headline,
            verdict=verdict,
            reading=first,
            reason=reason,
            errata=declaration.errata,
            choices=declaration.choices,
            close=declaration.close,
            by_construction=declaration.by_construction or evaluations[first].by_construction,
            readings=results,
            thin=verdict in ("holds", "reproduced") and bool(margin) and (margin.distance or 0.0) > THIN,
        )
        rows.append(row)
    return rows


def judge(
    claim: PublishedClaim,
    evaluation: Evaluation,
    declaration: Declaration | None = None,
    corrected: Evaluation | None = None,
) -> Result:
    """Return what one reading gives for one claim, with the verdict; None as verdict if it is not evaluated there.

    corrected: the evaluation of `corrected`, whose error tells the paper's own; that of this reading unless given.
    Raises ArtifactError if the evaluation has the wrong shape or type, or lacks a standard error,
    trials or evidence.
    """
    declaration = declaration or Declaration()
    judged = _judged(claim, evaluation, declaration.close, corrected or evaluation)
    confirmed = judged.verdict in (*AGREEING_VERDICTS, "undetermined")
    # A statement may be false by construction; numbers that differ were not bound to agree.
    bound = evaluation.by_construction and not evaluation.failed and (confirmed or claim.kind == "qualitative")
    if bound or (declaration.by_construction and confirmed):
        judged = judged.model_copy(update={"verdict": BY_CONSTRUCTION, "components": None, "doubts": ()})
    measured = {
        "value": finite_values(evaluation.value, infinity="inf" if claim.kind == "input" else None),
        "standard_error": finite_values(evaluation.standard_error),
        "trials": evaluation.trials,
        "numbers": {name: finite_values(number) for name, number in evaluation.numbers.items()},
        "evidence": evaluation.evidence,
    }
    return Result(**{**dict(judged), **measured})


def _judged(claim: PublishedClaim, evaluation: Evaluation, close: Tolerance | None, corrected: Evaluation) -> Result:
    """The verdict by the rule of the claim's kind, with what it rests on and without the evaluated numbers."""
    if claim.kind == "context":
        return Result(verdict="quoted")
    if claim.kind == "undetermined":
        return Result(verdict="undetermined", doubts=(Doubt(why="the paper's own problem does not fix the value"),))
    if evaluation.value is None:
        return Result(verdict=None)

    def refuse(problem: str) -> ArtifactError:
        return ArtifactError(f"{claim.paper}: claim {claim.id}: {problem}")

    printed, values = (np.array(of, dtype=object) for of in (claim.printed, evaluation.value))
    if printed.shape != values.shape:
        raise refuse(f"the value {evaluation.value!r} does not have the shape of the printed {claim.printed!r}")
    if claim.kind == "input":
        used = all(map(_used_literally, values.flat, printed.flat))
        return Result(verdict="as_stated" if used else "not_as_stated")
    if claim.kind == "qualitative":
        if not isinstance(evaluation.value, bool):
            raise refuse(f"a statement is decided by true or false, found {evaluation.value!r}")
        verdict = "holds" if evaluation.value == claim.printed else "fails"
        verdict = "undetermined" if evaluation.doubts else verdict
        tests = (f"test {at}" for at, one in enumerate(evaluation.margins, start=1) if one == evaluation.margin)
        test = next(tests, "") if evaluation.margin else ""
        return Result(verdict=verdict, doubts=evaluation.doubts, margin=evaluation.margin, test=test)
    if not all(map(is_number, values.flat)):
        raise refuse(f"expected numbers, found {evaluation.value!r}")

    bound = close.absolute if close and close.absolute is not None else 0.0
    if np.shape(bound) not in ((), printed.shape):
        raise refuse(f"the tolerance {bound!r} does not have the shape of the printed {claim.printed!r}")
    errors = paper_errors = narrow = np.zeros(printed.shape)
    if claim.kind == "monte_carlo" and all(map(math.isfinite, values.flat)):
        if evaluation.standard_error is None or not evaluation.trials:
            raise refuse("a Monte Carlo value needs its standard error and its number of trials")
        errors = np.array(evaluation.standard_error, dtype=float)
        if errors.shape != values.shape or np.any((errors < 0.0) | np.isinf(errors)):
            raise refuse(f"{evaluation.standard_error!r} is no standard error of {evaluation.value!r}")
        # The paper gives no standard errors: its trials are taken to spread like ours.
        paper_errors = math.sqrt(evaluation.trials / claim.trials) * errors
        is_known = corrected.trials and np.shape(corrected.standard_error) == errors.shape
        theirs, trials = (corrected.standard_error, corrected.trials) if is_known else (errors, evaluation.trials)
        narrow = _narrow(claim, np.array(theirs, dtype=float), trials)
    return _compared(values, *_allowed(claim, close), errors, paper_errors, narrow, evaluation.trials)


def _narrow(claim: PublishedClaim, errors: np.ndarray, trials: int) -> np.ndarray:
    """The largest standard errors that decide: the paper's own, or a tenth of what is printed.

    errors, trials: those of `corrected`, by which the paper's own are known.
    """
    of_paper = np.nan_to_num(np.sqrt(trials / claim.trials) * errors)
    return np.maximum(of_paper, WIDE * np.abs(np.array(claim.printed, dtype=float)))


def verdicts_in_universes(
    claim: PublishedClaim,
    close: Tolerance | None,
    values: np.ndarray,
    errors: np.ndarray,
    trials: np.ndarray,
    base: int,
) -> np.ndarray:
    """Return the verdicts on a claim's numbers in many universes, by the rule of `judge` (universe, component).

    Args:
        claim: what is printed.
        close: the tolerance stated beforehand.
        values: numbers (universe, component), NaN where there is none, in the order of the printed ones.
        errors: their standard errors, NaN where so few trials give none.
        trials: their numbers (universe,).
        base: the place of `corrected` among the universes.

    """
    sampled = (claim.kind == "monte_carlo") & np.isfinite(values).all(axis=1)[:, np.newaxis]
    errors, papers, narrow = np.where(sampled, errors, 0.0), np.zeros(values.shape), np.zeros(values.shape)
    if claim.kind == "monte_carlo":
        papers = np.sqrt(trials / claim.trials)[:, np.newaxis] * errors
        printed = claim.model_copy(update={"printed": np.ravel(claim.printed)})
        narrow = np.broadcast_to(_narrow(printed, errors[base], trials[base]), values.shape)
    parts = [np.broadcast_to(of, np.shape(claim.printed)).astype(float).ravel() for of in _allowed(claim, close)]
    return _verdicts(values, *(np.broadcast_to(part, values.shape) for part in parts), errors, papers, narrow)


def worst(verdicts: np.ndarray) -> np.ndarray:
    """Return the verdict on rows of numbers from the verdicts on each number (..., number)."""
    return np.select([(verdicts == one).any(axis=-1) for one in _WORST_FIRST], _WORST_FIRST, "")


def _allowed(claim: PublishedClaim, close: Tolerance | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is printed, half of its last digits, and the bounds of what is close, 0 if nothing is."""
    printed = np.array(claim.printed, dtype=object)
    bound = close.absolute if close and close.absolute is not None else 0.0
    bounds = close.relative * np.abs(printed) if close and close.relative else bound
    return printed, 0.5 * np.asarray(claim.resolution), np.asarray(bounds)


def settling(more: float, trials: int | None) -> int | None:
    """Return so many times our trials, which would settle a verdict, to two digits; None if trials do not."""
    return int(float(f"{more * trials:.2g}")) if trials and more > 1.0 else None


def _verdicts(values, printed, half, bounds, errors, paper_errors, narrow) -> np.ndarray:
    """The verdict on each of some numbers; arguments as of `_compared`, all of one shape."""
    size, limits, combined = _against_limits(values, printed, half, errors, paper_errors)
    near, is_close = size <= limits, size <= (bounds * (1 + 1e-9)).astype(float)
    by_width = (errors > narrow) & (near | is_close)  # a wide error lets nothing reproduce
    by_zero = near & _is_zero_as_good(printed, limits, combined)[..., np.newaxis]
    unsure = np.isnan(errors) | (np.abs(size - limits) < errors) | by_width | by_zero
    return np.select([unsure, near, is_close], ["undetermined", "reproduced", "close"], "differs")


def _is_zero_as_good(printed, limits, combined) -> np.ndarray:
    """Whether zeros would reproduce a whole row as well, (...): then what is printed is noise; of (..., number)."""
    size = np.abs(printed).astype(float)
    return ((size <= limits) & (combined > 0.0)).all(axis=-1) & (size > 0.0).any(axis=-1)


def _against_limits(values, printed, half, errors, paper_errors) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sizes of differences from what is printed, what rounding and sampling allow, and the combined errors."""
    with np.errstate(invalid="ignore"):  # of an error that is none
        combined = np.frompyfunc(math.hypot, 2, 1)(errors, paper_errors).astype(float)
    size = np.abs(values - printed).astype(float)
    # A number exactly on the rounding edge may be off by its own floating-point noise.
    return size, half * (1 + 2e-9) + 1e-15 * np.abs(printed).astype(float) + SIGMAS * combined, combined


def _compared(values, printed, half, bounds, errors, paper_errors, narrow, trials) -> Result:
    """Judge numbers, of which the worst gives the verdict.

    half: of the last printed digits; bounds: of what is close, 0 if nothing is; errors, paper_errors: standard errors,
    ours and the paper's; narrow: the largest of ours that decide; trials: ours.
    """
    shape, arrays = printed.shape, np.broadcast_arrays(values, printed, half, bounds, errors, paper_errors, narrow)
    values, printed, half, bounds, errors, paper_errors, narrow = map(np.ravel, arrays)
    verdicts = _verdicts(values, printed, half, bounds, errors, paper_errors, narrow)
    size, limits, combined = _against_limits(values, printed, half, errors, paper_errors)
    differences, room = values - printed, np.abs(size - limits)
    verdict = next(one for one in _WORST_FIRST if one in verdicts)
    components = verdicts.reshape(shape).tolist() if shape else None
    deciding = np.flatnonzero(verdicts == verdict)
    if np.isnan(errors[deciding]).any():
        doubt = Doubt(why="so few trials give no standard error")
        return Result(verdict=verdict, components=components, doubts=(doubt,))
    doubts = ()
    if verdict == "undetermined":
        of = (array[deciding] for array in (size - half, errors, paper_errors, narrow))
        doubt = Doubt(why="our sampling error decides", trials=settling(max(map(_more, *of)), trials))
        if _is_zero_as_good(printed, limits, combined):
            doubt = Doubt(why="zero would reproduce it as well")
        doubts = (doubt,)
    sampled = combined > 0.0
    distance = room / np.where(sampled, combined, half)
    at = deciding[(np.argmax if verdict == "differs" else np.argmin)(distance[deciding])]
    margin = Margin(
        measure="difference from the printed value",
        value=differences[at],
        limit=limits[at],
        unit="",
        distance=distance[at],
        scale="standard errors" if sampled[at] else "limits",
        standard_error=combined[at],
    )
    return Result(verdict=verdict, components=components, doubts=doubts, margin=margin)


def _more(beyond: float, error: float, paper_error: float, narrow: float) -> float:
    """So many times our trials would decide about a number that lies so far beyond its printed digits.

    narrow: the error that is narrow enough, where it is above the paper's own.
    """

    def decide(more: float) -> bool:
        less = error / math.sqrt(more)
        room = beyond - SIGMAS * math.hypot(less, paper_error)
        return abs(room) >= less and (room > 0.0 or less <= narrow)

    return next(filter(decide, _MORE), 1.0)


def _used_literally(value: Any, printed: Any) -> bool:
    if is_number(value) and is_number(printed):
        # No finite number is an infinite one, though infinity is within any share of itself.
        return value == printed or (math.isfinite(printed) and abs(value - printed) <= _LITERAL * abs(printed))
    return type(value) is type(printed) and value == printed


def _check_ids(published, declarations, evaluations_by_reading, known_errata) -> None:
    """Every claim has an evaluator, and every evaluator and erratum exists."""
    ids, evaluated = [claim.id for claim in published], set().union(*evaluations_by_reading.values())
    for claim in published:
        if claim.id not in evaluated and claim.kind != "context":
            raise InputError(f"{claim.paper}: claim {claim.id}: no function evaluates it")
    named = [("claim", name, ids) for name in evaluated]
    if known_errata is not None:
        named += [("erratum", name, known_errata) for declared in declarations.values() for name in declared.errata]
    for what, name, valid in named:
        if name not in valid:
            raise InputError(f"{published[0].paper}: there is no {what} '{name}'; {nearest(name, valid)}")


def _reason(claim, declaration, first, evaluations, verdict, left_out) -> str:
    """Write the reason: what it rests on, the declared sentence with its numbers, the tolerance if that decided."""
    numbers: dict[str, dict | None] = dict.fromkeys(left_out)
    for name, evaluation in evaluations.items():
        always = {"value": evaluation.value, "standard_error": evaluation.standard_error, "trials": evaluation.trials}
        numbers[name] = None if evaluation.failed else always | evaluation.numbers
    try:
        text = with_numbers_of_a_claim(declaration.reason, numbers, first)
    except (ValueError, TypeError) as error:
        where = f"{claim.paper}: claim {claim.id}"
        raise InputError(f"{where}: the reason quotes a number that does not exist: {error}") from None
    # What the sentence names itself is not named twice.
    basis = ", ".join(name for name in declaration.errata if not re.search(rf"\b{re.escape(name)}\b", text))
    text = ". ".join(filter(None, [basis, text]))
    if not text and declaration.choices:
        text = f"Depends on {', '.join(map(in_words, declaration.choices))}."
    if verdict != "close":
        return text
    tolerance = declaration.close
    if tolerance.relative:
        bound = f"{100 * tolerance.relative:.3g} % of the printed value"
    else:
        bound = ", ".join(f"{entry:g}" for entry in np.ravel(tolerance.absolute))
        bound = f"{bound} {claim.unit}".removesuffix(" 1")
    return f"{text} Within the tolerance stated beforehand ({bound}): {tolerance.reason.rstrip('.')}.".strip()
