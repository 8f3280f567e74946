"""Printed claims, their evaluations and the verdicts computed from both.

A paper's printed numbers and statements are facts, kept in `data/published/<paper>.yaml`. A paper's code evaluates
each of them in every reading. `collect` compares the two by fixed rules; nobody types a verdict.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from marsedl.replication.claims.claim import (
    BY_CONSTRUCTION,
    MEASURED,
    REFUTED_VERDICTS,
    STANDING_VERDICTS,
    UNEXPLAINED,
    Claim,
    Deviation,
    Margin,
    Other,
    Result,
    Tolerance,
)
from marsedl.replication.claims.numbers import broadcast, finite_values, flatten, is_number, plain
from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.thresholds import SIGMAS
from marsedl.replication.errors import ArtifactError, InputError, nearest
from marsedl.replication.inputs import CORRECTED, PRINTED
from marsedl.replication.sizes import FULL

_MOST_TRIALS = 1e6  # times ours: what more trials cannot settle
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
    evidence: str = ""  # one sentence with computed numbers
    numbers: Mapping[str, Any] = field(default_factory=dict)  # named numbers that a reason may quote
    failed: bool = False  # what the claim speaks of does not exist, nor do its named numbers
    undetermined: str = ""  # why a statement could as well be judged otherwise
    margin: Margin | None = None  # how far the measure that decides a statement is from its limit
    by_construction: str = ""  # why it cannot be otherwise in this reading

    def __post_init__(self) -> None:
        """Turn arrays into plain Python."""
        for name in ("value", "standard_error", "trials"):
            object.__setattr__(self, name, plain(getattr(self, name)))
        object.__setattr__(self, "numbers", {name: plain(number) for name, number in self.numbers.items()})


@dataclass(frozen=True)
class Close:
    """A tolerance stated before the result is known, and why it is the right one: relative or absolute, not both."""

    reason: str
    relative: float | None = None
    absolute: float | Sequence[float] | None = None

    def __post_init__(self) -> None:
        """Refuse a tolerance that is not exactly one positive bound with a reason."""
        if (self.relative is None) == (self.absolute is None):
            raise InputError("Close: give either a relative or an absolute tolerance")
        bounds = flatten(plain(self.absolute if self.relative is None else self.relative)).values()
        if not all(is_number(bound) and math.isfinite(bound) and bound > 0 for bound in bounds):
            raise InputError("Close: a tolerance must be a positive number")
        if not self.reason.strip():
            raise InputError("Close: a tolerance needs its reason")


@dataclass(frozen=True)
class Declaration:
    """What a paper's code states about a claim besides its value.

    `reason` may quote computed numbers: `{name}` is a named number of the reading that gives the verdict (`value`,
    `standard_error`, `trials` and `z` always exist), `{target4[name]}` is that of the reading `target4`; both take a
    format as in `{value[0]:.3f}`. A verdict `differs` or `fails` needs a reason and an erratum or a withheld input.
    """

    reason: str = ""
    errata: tuple[str, ...] = ()  # ids of errata, such as "E10"
    withheld: tuple[str, ...] = ()  # inputs that the paper does not give, in words
    close: Close | None = None
    by_construction: str = ""  # why the claim cannot fail


class Judgement(NamedTuple):
    """A verdict, and what it rests on."""

    verdict: str | None  # None: not evaluated in this reading
    z: Deviation | None = None  # of a Monte Carlo number, how far it is beyond the printed rounding
    components: Any = None  # verdicts on the numbers of a row, shaped like what is printed
    margin: Margin | None = None  # how far what decides is from its limit
    doubt: str = ""  # why it is undetermined


def collect(
    published: Sequence[PublishedClaim],
    declarations: Mapping[str, Declaration],
    evaluations_by_reading: Mapping[str, Mapping[str, Evaluation | None]],
    at_equal_trials: Mapping[str, Mapping[str, Evaluation | None]] | None = None,
    *,
    known_errata: Collection[str] | None = None,
    require_reasons: bool = True,
    left_out: Collection[str] = (),
    size: str = FULL,
) -> list[Claim]:
    """Compare every printed claim with every reading.

    Args:
        published: the printed claims of one paper.
        declarations: tolerances and reasons by claim id; a claim without one has neither.
        evaluations_by_reading: for every reading, an evaluation for every claim id (None: not evaluated in this
            reading). Quoted literature (kind `context`) may be left out. The reading `corrected` gives the verdict that
            counts, `printed` that on stated inputs.
        at_equal_trials: evaluations of the readings that have larger ensembles than others, without these, so that
            readings can be compared.
        known_errata: the paper's errata ids; when given, declarations may name no others.
        require_reasons: refuse an unexplained `differs` or `fails`; else its reason is `UNEXPLAINED`, as it must be for
            builds with changed inputs or of a smaller size.
        left_out: readings that this size does not build; their numbers in reasons read "not built".
        size: the size of the build, which every row names.

    Returns:
        The claims in the order of `published`.

    Raises:
        InputError: ids without evaluator or unknown ids; a `differs` or `fails` without a reason that names an erratum
            or a withheld input; a reason that quotes a number which does not exist.
        ArtifactError: an evaluation with the wrong shape or type, or a Monte Carlo value without standard error.

    """
    _check_ids(published, declarations, evaluations_by_reading, known_errata)
    names = [CORRECTED, *(name for name in evaluations_by_reading if name != CORRECTED)]
    rows = []
    for claim in published:
        declaration = declarations.get(claim.id, Declaration())
        if declaration.close is not None and claim.kind not in MEASURED:
            raise InputError(f"{claim.paper}: claim {claim.id}: a {claim.kind} claim takes no tolerance")
        evaluations = {name: evaluations_by_reading[name].get(claim.id) or Evaluation() for name in names}
        judged = {name: judge(claim, evaluation, declaration) for name, evaluation in evaluations.items()}
        first = PRINTED if claim.kind == "input" else CORRECTED
        verdict = judged[first].verdict
        if verdict is None:
            raise InputError(f"{claim.paper}: claim {claim.id}: not evaluated in reading {first}, so it has no verdict")
        if verdict in REFUTED_VERDICTS and not require_reasons and not explains(declaration):
            reason = UNEXPLAINED
        else:
            reason = _reason(claim, declaration, verdict, first, evaluations, judged, left_out)
        close = declaration.close
        rows.append(
            Claim(
                **{name: getattr(claim, name) for name in _AS_PRINTED},
                size=size,
                printed=finite_values(claim.printed, infinity="inf"),
                verdict=verdict,
                reading=first,
                reason=reason,
                errata=declaration.errata,
                withheld=declaration.withheld,
                close=close and Tolerance(reason=close.reason, relative=close.relative, absolute=plain(close.absolute)),
                by_construction=declaration.by_construction or evaluations[first].by_construction,
                readings={
                    name: Result(
                        **_outcome(claim, evaluation, judged[name]),
                        numbers=finite_values(dict(evaluation.numbers)),
                        evidence=evaluation.evidence,
                        doubt=judged[name].doubt,
                        z=judged[name].z,
                        at_equal_trials=_smaller(
                            claim, declaration, evaluation, (at_equal_trials or {}).get(name, {}).get(claim.id)
                        ),
                    )
                    for name, evaluation in evaluations.items()
                },
            )
        )
    return rows


_AS_PRINTED = ("paper", "id", "where", "quantity", "plain", "unit", "kind", "resolution", "trials", "note", "headline")


def _outcome(claim: PublishedClaim, evaluation: Evaluation, judgement: Judgement) -> dict[str, Any]:
    """A value with its verdict, as fields of a `Result` or `Other`."""
    return {
        "value": finite_values(evaluation.value, infinity="inf" if claim.kind == "input" else None),
        "standard_error": finite_values(evaluation.standard_error),
        "trials": evaluation.trials,
        "verdict": judgement.verdict,
        "components": judgement.components,
        "margin": judgement.margin,
    }


def _smaller(claim, declaration, evaluation, other: Evaluation | None) -> Other | None:
    """Return the result recomputed with fewer trials, or None if that is impossible or no different."""
    if other is None or other.trials is None or other.trials == evaluation.trials:
        return None
    margins = evaluation.margin, other.margin
    if all(margin and margin.sampled for margin in margins) and margins[0].value == margins[1].value:
        return None
    return Other(**_outcome(claim, other, judge(claim, other, declaration)))


def judge(claim: PublishedClaim, evaluation: Evaluation, declaration: Declaration | None = None) -> Judgement:
    """Compute the verdict on one claim in one reading.

    Args:
        claim: what the paper prints.
        evaluation: what the reading gives.
        declaration: the tolerance that is stated beforehand, and why the claim cannot fail, if either is so.

    Returns:
        The verdict with what it rests on.

    Raises:
        ArtifactError: the evaluation has the wrong shape or type, or lacks a standard error, trials or evidence.

    """
    declaration = declaration or Declaration()
    judgement = _judged(claim, evaluation, declaration.close)
    confirmed = judgement.verdict in (*STANDING_VERDICTS, "undetermined")
    # A statement may be false by construction; numbers that differ were not bound to agree.
    bound = evaluation.by_construction and not evaluation.failed and (confirmed or claim.kind == "qualitative")
    if bound or (declaration.by_construction and confirmed):
        return judgement._replace(verdict=BY_CONSTRUCTION, components=None, doubt="")
    return judgement


def _judged(claim: PublishedClaim, evaluation: Evaluation, close: Close | None) -> Judgement:
    if claim.kind == "context":
        return Judgement("quoted")
    if claim.kind == "undetermined":
        return Judgement("undetermined", doubt="the paper's own problem does not fix the value")
    if evaluation.value is None:
        return Judgement(None)

    def refuse(problem: str) -> ArtifactError:
        return ArtifactError(f"{claim.paper}: claim {claim.id}: {problem}")

    printed, values = flatten(claim.printed), flatten(evaluation.value)
    if printed.keys() != values.keys():
        raise refuse(f"the value {evaluation.value!r} does not have the shape of the printed {claim.printed!r}")
    if claim.kind == "input":
        used = all(_used_literally(values[index], printed[index]) for index in printed)
        return Judgement("as_stated" if used else "not_as_stated")
    if claim.kind == "qualitative":
        if not isinstance(evaluation.value, bool):
            raise refuse(f"a statement is decided by true or false, found {evaluation.value!r}")
        if not evaluation.evidence.strip():
            raise refuse("the test of a statement needs a sentence of evidence")
        verdict = "holds" if evaluation.value == claim.printed else "fails"
        verdict = "undetermined" if evaluation.undetermined else verdict
        return Judgement(verdict, margin=evaluation.margin, doubt=evaluation.undetermined)

    if not all(is_number(value) for value in values.values()):
        raise refuse(f"expected numbers, found {evaluation.value!r}")
    bounds = _close_bounds(claim, close, printed, refuse)
    differences = {index: values[index] - printed[index] for index in printed}
    halves = {index: 0.5 * size for index, size in broadcast(claim.resolution, printed).items()}
    errors = paper_errors = dict.fromkeys(printed, 0.0)
    if claim.kind == "monte_carlo" and all(math.isfinite(value) for value in values.values()):
        errors = _standard_errors(claim, evaluation, values, refuse)
        # The paper gives no standard errors: its trials are taken to spread like ours.
        paper_errors = {i: error * math.sqrt(evaluation.trials / claim.trials) for i, error in errors.items()}
    parts = {
        i: _component(differences[i], halves[i], errors[i], paper_errors[i], bounds[i], printed[i]) for i in printed
    }
    verdicts = [part.verdict for part in parts.values()]
    verdict = next(v for v in ("differs", "undetermined", "close", "reproduced") if v in verdicts)
    deciding = [part for part in parts.values() if part.verdict == verdict]
    if any(part.margin is None for part in deciding):
        components = _nested(claim.printed, {index: part.verdict for index, part in parts.items()})
        return Judgement(verdict, None, components, None, "so few trials give no standard error")
    nearest_one = (max if verdict == "differs" else min)(deciding, key=lambda part: part.distance)
    more = max((part.more for part in deciding), default=1.0) if verdict == "undetermined" else 1.0
    doubt = "our sampling error decides" if verdict == "undetermined" else ""
    if more > 1.0:
        doubt += f"; {settling(more * evaluation.trials)}"
    return Judgement(
        verdict,
        _largest_z(parts) if claim.kind == "monte_carlo" else None,
        _nested(claim.printed, {index: part.verdict for index, part in parts.items()}),
        nearest_one.margin,
        doubt,
    )


def settling(trials: float) -> str:
    """Say how many trials would settle a verdict, with two digits."""
    return f"about {float(f'{trials:.2g}'):,.0f} trials would settle it"


class _Component(NamedTuple):
    """The verdict on one number."""

    verdict: str
    z: float
    margin: Margin | None  # None: without a standard error
    distance: float = 0.0  # of the margin, also where it is infinite
    more: float = 1.0  # so many times our trials would decide


def _component(difference, half, error, paper_error, bound, printed) -> _Component:
    """Judge one number by its difference from the printed one.

    half: of the last printed digit; error, paper_error: standard errors of our number and of the paper's; bound: of
    what is close, or nothing.
    """
    if math.isnan(error):
        return _Component("undetermined", 0.0, None)
    combined = math.hypot(error, paper_error)
    size = abs(difference)
    # A number exactly on the rounding edge may be off by its own floating-point noise.
    tolerance = half * (1 + 2e-9) + 1e-15 * abs(printed) + SIGMAS * combined
    if combined and math.isfinite(size):
        z = math.copysign(max(size - half, 0.0) / combined, difference)
    else:
        z = 0.0 if size <= tolerance else math.inf
    distance = abs(size - tolerance) / (combined or half) if math.isfinite(size) else math.inf
    margin = Margin(
        measure="difference from the printed value",
        value=difference,
        limit=tolerance,
        unit="",
        distance=distance,
        scale="standard errors" if combined else "limits",
        standard_error=combined,
    )
    if error and abs(size - tolerance) < error:
        more = 1.0
        while abs(size - half - SIGMAS * math.hypot(error / math.sqrt(more), paper_error)) < error / math.sqrt(more):
            more *= 1.5
            if more > _MOST_TRIALS:
                more = 1.0
                break
        return _Component("undetermined", z, margin, distance, more)
    if size <= tolerance:
        return _Component("reproduced", z, margin, distance)
    verdict = "close" if bound is not None and size <= bound * (1 + 1e-9) else "differs"
    return _Component(verdict, z, margin, distance)


def _close_bounds(claim, close: Close | None, printed, refuse) -> dict:
    """The bound of what is close for every number; nothing without a tolerance."""
    if close is None:
        return dict.fromkeys(printed)
    if close.relative is not None:
        return {index: close.relative * abs(number) for index, number in printed.items()}
    bounds = broadcast(plain(close.absolute), printed)
    if bounds.keys() != printed.keys():
        raise refuse(f"the tolerance {close.absolute!r} does not have the shape of the printed {claim.printed!r}")
    return bounds


def _standard_errors(claim, evaluation, values, refuse) -> dict:
    if evaluation.standard_error is None or evaluation.trials is None:
        raise refuse("a Monte Carlo value needs its standard error and its number of trials")
    errors = flatten(evaluation.standard_error)
    if errors.keys() != values.keys():
        raise refuse("the standard error does not have the shape of the value")
    if not all(is_number(error) and (0 <= error < math.inf or math.isnan(error)) for error in errors.values()):
        raise refuse(f"a standard error must be finite and not negative, found {evaluation.standard_error!r}")
    if not is_number(evaluation.trials) or evaluation.trials < 1:
        raise refuse(f"the number of trials must be positive, found {evaluation.trials!r}")
    return errors


def _largest_z(parts: Mapping) -> Deviation | None:
    worst = max(parts, key=lambda index: abs(parts[index].z))
    if not math.isfinite(parts[worst].z):
        return None
    return Deviation(largest=parts[worst].z, component=tuple(i + 1 for i in worst) or None)


def _nested(like: Any, leaves: Mapping, index: tuple[int, ...] = ()) -> Any:
    """Arrange leaves by their indices in the shape of a nested list; nothing for a single number."""
    if not isinstance(like, list):
        return leaves[index] if index else None
    return [_nested(item, leaves, (*index, i)) for i, item in enumerate(like)]


def _check_ids(published, declarations, evaluations_by_reading, known_errata) -> None:
    paper = published[0].paper if published else "no paper"
    ids = [claim.id for claim in published]
    needed = {claim.id for claim in published if claim.kind != "context"}
    if CORRECTED not in evaluations_by_reading:
        raise InputError(f"{paper}: no evaluations of reading {CORRECTED}")
    if PRINTED not in evaluations_by_reading and any(claim.kind == "input" for claim in published):
        raise InputError(f"{paper}: no evaluations of reading {PRINTED}, which the stated inputs are checked in")
    for reading, evaluations in evaluations_by_reading.items():
        missing = [name for name in ids if name in needed and name not in evaluations]
        if missing:
            raise InputError(f"{paper}: reading {reading}: claims without an evaluator: {', '.join(missing)}")
        _refuse_unknown(f"{paper}: reading {reading}: evaluator of an unknown claim", evaluations, ids)
    _refuse_unknown(f"{paper}: declaration of an unknown claim", declarations, ids)
    if known_errata is not None:
        for name, declaration in declarations.items():
            _refuse_unknown(f"{paper}: claim {name}: unknown erratum", declaration.errata, known_errata)


def _refuse_unknown(problem: str, names: Iterable[str], valid_names: Collection[str]) -> None:
    unknown = [name for name in names if name not in valid_names]
    if unknown:
        raise InputError(f"{problem}: {', '.join(unknown)}; {nearest(unknown[0], valid_names)}")


def explains(declaration) -> bool:
    """Whether a declaration explains a difference: in words, with an erratum or an input that the paper withholds."""
    return bool(declaration.reason.strip() and (declaration.errata or declaration.withheld))


@dataclass(frozen=True)
class _Words:
    """Words in place of every number."""

    words: str

    def __getitem__(self, _):
        return self

    def __format__(self, _):
        return self.words


class _OfFailed(dict):
    """Named numbers of a reading where some do not exist."""

    def __missing__(self, _):
        return _Words("none")


def _reason(claim, declaration, verdict, first, evaluations, judged, left_out) -> str:
    """Write the reason: what it rests on, the declared sentence with its numbers, the tolerance if that decided."""
    where = f"{claim.paper}: claim {claim.id}"
    if verdict in REFUTED_VERDICTS and not explains(declaration):
        value = evaluations[first].value
        raise InputError(
            f"{where}: {verdict} in reading {first} (printed {claim.printed!r}, found {value!r}) without a reason that"
            " names an erratum or an input which the paper withholds"
        )
    quotable = {
        name: (_OfFailed if evaluation.failed else dict)(
            {
                "value": evaluation.value,
                "standard_error": evaluation.standard_error,
                "trials": evaluation.trials,
                "z": judged[name].z and judged[name].z.largest,
                **evaluation.numbers,
            }
        )
        for name, evaluation in evaluations.items()
    }
    quotable |= dict.fromkeys(left_out, _Words("not built"))
    clash = quotable.keys() & quotable[first].keys()
    if clash:
        raise InputError(f"{where}: {sorted(clash)[0]!r} is the name of a reading and of a number")
    try:
        own_numbers = quotable[first]
        text = declaration.reason.format_map(type(own_numbers)({**quotable, **own_numbers}))
    except (LookupError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{where}: the reason quotes a number that does not exist: {error!r}") from error
    # what the sentence names itself is not named twice
    basis = ", ".join(name for name in declaration.errata if not re.search(rf"\b{re.escape(name)}\b", text))
    withheld = ", ".join(name for name in declaration.withheld if name not in text)
    parts = [basis, f"withheld by the paper: {withheld}" if withheld else ""]
    text = ". ".join(part for part in ("; ".join(filter(None, parts)), text) if part)
    if verdict == "close":
        tolerance = declaration.close
        if tolerance.relative:
            bound = f"{100 * tolerance.relative:.3g} % of the printed value"
        else:
            bound = ", ".join(f"{entry:g}" for entry in flatten(plain(tolerance.absolute)).values())
            bound = f"{bound} {claim.unit}".removesuffix(" 1")
        text = f"{text} Within the tolerance stated beforehand ({bound}): {tolerance.reason.rstrip('.')}.".strip()
    return text


def _used_literally(value: Any, printed: Any) -> bool:
    if is_number(value) and is_number(printed):
        # No finite number is an infinite one, though infinity is within any share of itself.
        return value == printed or (math.isfinite(printed) and abs(value - printed) <= _LITERAL * abs(printed))
    return type(value) is type(printed) and value == printed
