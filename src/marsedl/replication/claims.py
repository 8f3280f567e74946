"""Printed claims, their evaluations and the verdicts computed from both.

A paper's printed numbers and statements are facts, kept in `data/published/<paper>.yaml`. A paper's code evaluates
each of them in every reading. `collect` compares the two by fixed rules; nobody types a verdict.
"""

from __future__ import annotations

import csv
import json
import math
import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_validator

from marsedl.replication.errors import ArtifactError, InputError, nearest, shown
from marsedl.replication.sizes import FULL
from marsedl.replication.strict_yaml import read_yaml
from marsedl.replication.thresholds import SIGMAS, THIN

REFUTED_VERDICTS = ("differs", "fails")  # which need a reason
COUNTED_VERDICTS = ("reproduced", "close", "differs", "holds", "fails", "undetermined")
NUMBER_VERDICTS = ("reproduced", "close", "differs", "undetermined")
STATEMENT_VERDICTS = ("holds", "fails", "undetermined")
STANDING_VERDICTS = ("reproduced", "close", "holds")  # with which a claim stands
BY_CONSTRUCTION = "by_construction"  # what cannot fail
# Inputs, literature and what cannot fail: shown, never counted.
LISTED_VERDICTS = ("as_stated", "not_as_stated", "quoted", BY_CONSTRUCTION)
UNDECIDED = "undetermined"  # the kind of what the paper's own problem does not fix
NUMBERS, STATEMENTS = "numbers", "statements"  # the two kinds of results, which are counted apart
VERDICTS_OF = {NUMBERS: NUMBER_VERDICTS, STATEMENTS: STATEMENT_VERDICTS}
DEFAULT_READING = "corrected"  # the reading whose verdict counts
STATED_READING = "printed"  # the reading that must use every input as the paper states it
NOT_EVALUATED = "–"
UNEXPLAINED = "Not explained: this verdict is not the one for which the paper's reasons were stated."

PLAIN_WORDS = 12  # in the short form of a claim, at most

_MOST_TRIALS = 1e6  # times ours: what more trials cannot settle
_MEASURED = ("deterministic", "monte_carlo")  # kinds that compare numbers with numbers
_LITERAL = 1e-9  # relative slack with which an input counts as used literally (unit conversions round)


# ----------------------------------------------------------------------------------------------- what the paper prints


@dataclass(frozen=True)
class PublishedClaim:
    """One printed number, vector or statement of a paper."""

    paper: str
    id: str
    where: str
    quantity: str
    printed: Any  # number, list, nested list, bool or text
    unit: str
    kind: str
    resolution: Any = None  # size of the last printed digit: a number, a list shaped like `printed`, or None
    trials: int | None = None  # the paper's number of Monte Carlo trials
    note: str = ""
    plain: str = ""  # the claim in at most `PLAIN_WORDS` words, for readers who do not know the paper
    input: Any = None  # of a stated input that needs no code: "section.name", or a list of them
    headline: int | None = None  # place among the claims that the paper's abstract and conclusions rest on, from 1


def load_published(path: str | Path) -> list[PublishedClaim]:
    """Load the printed claims of the paper that gives the file its name.

    Args:
        path: YAML file with the key `claims`, a list of mappings with the fields of `PublishedClaim`, and `headline`,
            the ids of the few claims that the paper's abstract and conclusions rest on, in their order.

    Returns:
        The claims in the order of the file; those of the headline have their places in it, from 1.

    Raises:
        InputError: the file is missing or malformed; the message names the file, the claim's id and the key.

    """
    path = Path(path)
    document = _printed_document(path)
    claims: dict[str, PublishedClaim] = {}
    for number, entry in enumerate(document["claims"], start=1):
        claim = _printed_claim(path, number, entry)
        if claim.id in claims:
            raise InputError(f"{path}:{entry.lines['id']}: claim {claim.id}: key 'id': used by two claims; rename one")
        claims[claim.id] = claim
    for place, name in enumerate(document.get("headline", ()), start=1):
        if name not in claims:
            raise InputError(f"{path}: headline: there is no claim {shown(name)}; {nearest(str(name), claims)}")
        claims[name] = replace(claims[name], headline=place)
    return list(claims.values())


def _printed_document(path: Path) -> dict:
    document = read_yaml(path)
    if not isinstance(document, dict) or not {"claims"} <= set(document) <= {"claims", "headline"}:
        raise InputError(f"{path}: expected the key 'claims', and 'headline' beside it or not")
    for key, value in document.items():
        if not isinstance(value, list):
            raise InputError(f"{path}: key '{key}': must be a list, not {shown(value)}")
    return document


def load_measured(path: str | Path, paper: str) -> dict[str, float]:
    """Read what the benchmarks of a paper measured, by what they are of; raises InputError naming the file."""
    try:
        with Path(path).open(newline="", encoding="utf-8") as stream:
            table = csv.DictReader(stream)
            if not {"paper", "quantity", "value"} <= set(table.fieldnames or ()):
                raise ValueError("its columns are not paper, quantity, value")
            rows = [row for row in table if row["paper"] == paper]
        return {row["quantity"]: float(row["value"]) for row in rows}
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as benchmarks ({error!r}); restore it, or run 'make bench'") from None


def _must_be(words: str, test: Callable[[Any], object]) -> BeforeValidator:
    """Return the check that a value as it is written passes a test; words: what must pass it."""

    def check(value):
        if not test(value):
            raise ValueError(f"must be {words}, not {shown(value)}")
        return value

    return BeforeValidator(check)


def _every(test: Callable[[Any], object]) -> Callable[[Any], bool]:
    """Return the test of a number or nested list that is not empty and of which every entry passes a test."""
    return lambda value: bool(entries := _flatten(value).values()) and all(map(test, entries))


def _known_kind(kind: Any) -> str:
    if kind not in list(_OF_KIND):
        raise ValueError(f"there is no kind {shown(kind)}; {nearest(kind, _OF_KIND)}")
    return kind


def _is_short(text: Any) -> bool:
    return isinstance(text, str) and 0 < len(text.split()) <= PLAIN_WORDS


_EXPONENTS = "(YAML reads 1e-6 as text: write 1.0e-6)"
_Text = Annotated[str, _must_be("text", lambda value: isinstance(value, str) and value.strip())]
_Name = Annotated[
    str,
    _must_be("letters, digits and _", lambda value: isinstance(value, str) and re.fullmatch(r"[A-Za-z0-9_]+", value)),
]
_Names = Annotated[
    Any,
    _must_be(
        "an input 'section.name', or a list of them", _every(lambda v: isinstance(v, str) and re.match(r"\w+\.\w", v))
    ),
]
_Truth = Annotated[bool, _must_be("true or false", lambda value: isinstance(value, bool))]
_Trials = Annotated[int, _must_be("a whole number above 0", lambda value: type(value) is int and value > 0)]
_Anything = Annotated[
    Any,  # an input may be infinite
    _must_be("numbers, true, false or text", _every(lambda v: isinstance(v, bool | int | float | str) and v == v)),
]
_Numbers = Annotated[
    Any, _must_be(f"finite numbers {_EXPONENTS}", _every(lambda value: _is_number(value) and math.isfinite(value)))
]
_Sizes = Annotated[
    Any, _must_be(f"positive numbers {_EXPONENTS}", _every(lambda value: _is_number(value) and 0 < value < math.inf))
]


class _Printed(BaseModel):
    """A claim as it stands in a file, with the keys of any kind."""

    model_config = ConfigDict(extra="forbid", defer_build=True)

    id: _Name
    where: _Text
    quantity: _Text
    kind: Annotated[str, BeforeValidator(_known_kind)]
    printed: _Anything
    unit: _Text
    resolution: _Sizes | None = None
    trials: _Trials | None = None
    note: str = Field("", strict=True)
    plain: Annotated[str, _must_be(f"a text of at most {PLAIN_WORDS} words", _is_short)] = ""

    @field_validator("resolution")
    @classmethod
    def _shaped_as_printed(cls, resolution, info):
        printed = _flatten(info.data.get("printed", 0))
        if not all(map(_is_number, printed.values())):
            raise ValueError("the printed value is not a number, so it has no last digit; leave it out")
        if isinstance(resolution, list) and _flatten(resolution).keys() != printed.keys():
            raise ValueError(f"{shown(resolution)} does not have the shape of 'printed'")
        return resolution


class _Measured(_Printed):
    """Numbers, of which the last digit has a size."""

    printed: _Numbers
    resolution: _Sizes


class _MonteCarlo(_Measured):
    """Numbers from a number of trials."""

    trials: _Trials


class _Statement(_Printed):
    """A statement that holds or fails."""

    printed: _Truth


class _Input(_Printed):
    """A stated input, with its name or names if it is an input of ours as it stands."""

    input: _Names | None = None


_OF_KIND = {
    "deterministic": _Measured,
    "monte_carlo": _MonteCarlo,
    "qualitative": _Statement,
    "input": _Input,
    **dict.fromkeys(("undetermined", "context"), _Printed),
}


def _printed_claim(path: Path, number: int, entry: Any) -> PublishedClaim:
    if not isinstance(entry, dict) or not entry:
        raise InputError(f"{path}: claim number {number}: must be keys with values, not {shown(entry)}")
    kind = entry.get("kind")
    model = _OF_KIND[kind] if kind in list(_OF_KIND) else _Printed
    try:
        written = model.model_validate(entry)
    except ValidationError as error:
        # First an unknown key: what is missing may be what stands there.
        first = min(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
        key = first["loc"][0]
        problem = {
            "extra_forbidden": f"unknown key; {nearest(key, model.model_fields)}",
            "missing": f"is missing; a claim{f' of kind {kind}' if key != 'kind' else ''} needs it",
        }.get(first["type"], first["msg"].removeprefix("Value error, "))
        line = entry.lines.get(key, min(entry.lines.values()))
        name = entry.get("id") or f"number {number}"
        raise InputError(f"{path}:{line}: claim {name}: key {shown(key)}: {problem}") from None
    return PublishedClaim(path.stem, **dict(written))


# ----------------------------------------------------------------------------------------- what the paper's code gives


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
    margin: Mapping[str, Any] | None = None  # how far the measure that decides a statement is from its limit
    by_construction: str = ""  # why it cannot be otherwise in this reading

    def __post_init__(self) -> None:
        """Turn arrays into plain Python."""
        for name in ("value", "standard_error", "trials"):
            object.__setattr__(self, name, _plain(getattr(self, name)))
        object.__setattr__(self, "numbers", {name: _plain(number) for name, number in self.numbers.items()})


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
        bounds = _flatten(_plain(self.absolute if self.relative is None else self.relative)).values()
        if not all(_is_number(bound) and math.isfinite(bound) and bound > 0 for bound in bounds):
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


# ------------------------------------------------------------------------------------------------------------ verdicts


class Judgement(NamedTuple):
    """A verdict, and what it rests on."""

    verdict: str | None  # None: not evaluated in this reading
    # Of a Monte Carlo number the distance beyond the printed rounding in combined standard errors, of the component
    # that is worst: {"largest": z, "component": [i]}, counted from 1 (None for a scalar).
    z: dict | None = None
    components: Any = None  # verdicts on the numbers of a row, shaped like what is printed
    margin: Mapping[str, Any] | None = None  # how far what decides is from its limit
    doubt: str = ""  # why it is undetermined


def collect(
    published: Sequence[PublishedClaim],
    declarations: Mapping[str, Declaration],
    evaluations_by_reading: Mapping[str, Mapping[str, Evaluation | None]],
    at_equal_trials: Mapping[str, Mapping[str, Evaluation | None]] | None = None,
    *,
    default_reading: str = DEFAULT_READING,
    known_errata: Collection[str] | None = None,
    require_reasons: bool = True,
    left_out: Collection[str] = (),
    size: str = FULL,
) -> list[dict[str, Any]]:
    """Compare every printed claim with every reading.

    Args:
        published: the printed claims of one paper.
        declarations: tolerances and reasons by claim id; a claim without one has neither.
        evaluations_by_reading: for every reading, an evaluation for every claim id (None: not evaluated in this
            reading). Quoted literature (kind `context`) may be left out.
        at_equal_trials: evaluations of the readings that have larger ensembles than others, without these, so that
            readings can be compared.
        default_reading: the reading whose verdict is shown first. Stated inputs are checked in the reading `printed`.
        known_errata: the paper's errata ids; when given, declarations may name no others.
        require_reasons: refuse an unexplained `differs` or `fails`; else its reason is `UNEXPLAINED`, as it must be for
            builds with changed inputs or of a smaller size.
        left_out: readings that this size does not build; their numbers in reasons read "not built".
        size: the size of the build, which every row names.

    Returns:
        One plain dictionary per claim, in the order of `published`, ready for `write_claims`.

    Raises:
        InputError: ids without evaluator or unknown ids; a `differs` or `fails` without a reason that names an erratum
            or a withheld input; a reason that quotes a number which does not exist.
        ArtifactError: an evaluation with the wrong shape or type, or a Monte Carlo value without standard error.

    """
    _check_ids(published, declarations, evaluations_by_reading, default_reading, known_errata)
    names = [default_reading, *(name for name in evaluations_by_reading if name != default_reading)]
    rows = []
    for claim in published:
        declaration = declarations.get(claim.id, Declaration())
        if declaration.close is not None and claim.kind not in _MEASURED:
            raise InputError(f"{claim.paper}: claim {claim.id}: a {claim.kind} claim takes no tolerance")
        evaluations = {name: evaluations_by_reading[name].get(claim.id) or Evaluation() for name in names}
        judged = {name: judge(claim, evaluation, declaration) for name, evaluation in evaluations.items()}
        first = STATED_READING if claim.kind == "input" else default_reading
        verdict = judged[first].verdict
        if verdict is None:
            raise InputError(f"{claim.paper}: claim {claim.id}: not evaluated in reading {first}, so it has no verdict")
        if verdict in REFUTED_VERDICTS and not require_reasons and not explains(declaration):
            reason = UNEXPLAINED
        else:
            reason = _reason(claim, declaration, verdict, first, evaluations, judged, left_out)
        close = declaration.close
        rows.append(
            {
                "paper": claim.paper,
                "size": size,
                "id": claim.id,
                "where": claim.where,
                "quantity": claim.quantity,
                "plain": claim.plain,
                "unit": claim.unit,
                "kind": claim.kind,
                "printed": _finite(claim.printed, infinity="inf"),
                "resolution": claim.resolution,
                "trials": claim.trials,
                "note": claim.note,
                "headline": claim.headline,
                "verdict": verdict,
                "reading": first,
                "reason": reason,
                "errata": list(declaration.errata),
                "withheld": list(declaration.withheld),
                "close": close and {**vars(close), "absolute": _plain(close.absolute)},
                "by_construction": declaration.by_construction or evaluations[first].by_construction,
                "readings": {
                    name: {
                        **_result(claim, evaluation, judged[name]),
                        "numbers": _finite(dict(evaluation.numbers)),
                        "evidence": evaluation.evidence,
                        "doubt": judged[name].doubt,
                        "margin": _finite(judged[name].margin),
                        "z": _finite(judged[name].z),
                        "at_equal_trials": _smaller(
                            claim, declaration, evaluation, (at_equal_trials or {}).get(name, {}).get(claim.id)
                        ),
                    }
                    for name, evaluation in evaluations.items()
                },
            }
        )
    return rows


def _result(claim: PublishedClaim, evaluation: Evaluation, judgement: Judgement) -> dict[str, Any]:
    """Return a value with its verdict."""
    return {
        "value": _finite(evaluation.value, infinity="inf" if claim.kind == "input" else None),
        "standard_error": _finite(evaluation.standard_error),
        "trials": evaluation.trials,
        "verdict": judgement.verdict,
        "components": judgement.components,
    }


def _smaller(claim, declaration, evaluation, other: Evaluation | None) -> dict[str, Any] | None:
    """Return the result recomputed with fewer trials, or None if that is impossible or no different."""
    if other is None or other.trials is None or other.trials == evaluation.trials:
        return None
    judgement = judge(claim, other, declaration)
    if _sampled(evaluation.margin) and _sampled(other.margin) and other.margin["value"] == evaluation.margin["value"]:
        return None
    return {**_result(claim, other, judgement), "margin": _finite(judgement.margin)}


def _sampled(margin: Mapping[str, Any] | None) -> bool:
    return margin is not None and margin["in"] == "standard errors"


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

    printed, values = _flatten(claim.printed), _flatten(evaluation.value)
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

    if not all(_is_number(value) for value in values.values()):
        raise refuse(f"expected numbers, found {evaluation.value!r}")
    bounds = _close_bounds(claim, close, printed, refuse)
    differences = {index: values[index] - printed[index] for index in printed}
    halves = {index: 0.5 * size for index, size in _broadcast(claim.resolution, printed).items()}
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
    nearest_one = (max if verdict == "differs" else min)(deciding, key=lambda part: part.margin["distance"])
    more = max((part.more for part in deciding), default=1.0) if verdict == "undetermined" else 1.0
    doubt = "our sampling error decides" if verdict == "undetermined" else ""
    if more > 1.0:
        doubt += f"; about {float(f'{more * evaluation.trials:.2g}'):,.0f} trials would settle it"
    return Judgement(
        verdict,
        _largest_z(parts) if claim.kind == "monte_carlo" else None,
        _nested(claim.printed, {index: part.verdict for index, part in parts.items()}),
        nearest_one.margin,
        doubt,
    )


class _Component(NamedTuple):
    """The verdict on one number."""

    verdict: str
    z: float
    margin: dict[str, Any] | None  # None: without a standard error
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
    scale = combined or half
    margin = {
        "measure": "difference from the printed value",
        "value": difference,
        "limit": tolerance,
        "unit": "",
        "distance": abs(size - tolerance) / scale if math.isfinite(size) else math.inf,
        "in": "standard errors" if combined else "limits",
        "standard_error": combined,
    }
    if error and abs(size - tolerance) < error:
        more = 1.0
        while abs(size - half - SIGMAS * math.hypot(error / math.sqrt(more), paper_error)) < error / math.sqrt(more):
            more *= 1.5
            if more > _MOST_TRIALS:
                more = 1.0
                break
        return _Component("undetermined", z, margin, more)
    if size <= tolerance:
        return _Component("reproduced", z, margin)
    return _Component("close" if bound is not None and size <= bound * (1 + 1e-9) else "differs", z, margin)


def _close_bounds(claim, close: Close | None, printed, refuse) -> dict:
    """The bound of what is close for every number; nothing without a tolerance."""
    if close is None:
        return dict.fromkeys(printed)
    if close.relative is not None:
        return {index: close.relative * abs(number) for index, number in printed.items()}
    bounds = _broadcast(_plain(close.absolute), printed)
    if bounds.keys() != printed.keys():
        raise refuse(f"the tolerance {close.absolute!r} does not have the shape of the printed {claim.printed!r}")
    return bounds


def _standard_errors(claim, evaluation, values, refuse) -> dict:
    if evaluation.standard_error is None or evaluation.trials is None:
        raise refuse("a Monte Carlo value needs its standard error and its number of trials")
    errors = _flatten(evaluation.standard_error)
    if errors.keys() != values.keys():
        raise refuse("the standard error does not have the shape of the value")
    if not all(_is_number(error) and (0 <= error < math.inf or math.isnan(error)) for error in errors.values()):
        raise refuse(f"a standard error must be finite and not negative, found {evaluation.standard_error!r}")
    if not _is_number(evaluation.trials) or evaluation.trials < 1:
        raise refuse(f"the number of trials must be positive, found {evaluation.trials!r}")
    return errors


def _largest_z(parts: Mapping) -> dict | None:
    worst = max(parts, key=lambda index: abs(parts[index].z))
    if not math.isfinite(parts[worst].z):
        return None
    return {"largest": parts[worst].z, "component": [i + 1 for i in worst] if worst else None}


def _nested(like: Any, leaves: Mapping, index: tuple[int, ...] = ()) -> Any:
    """Arrange leaves by their indices in the shape of a nested list; nothing for a single number."""
    if not isinstance(like, list):
        return leaves[index] if index else None
    return [_nested(item, leaves, (*index, i)) for i, item in enumerate(like)]


def _check_ids(published, declarations, evaluations_by_reading, default_reading, known_errata) -> None:
    paper = published[0].paper if published else "no paper"
    ids = [claim.id for claim in published]
    needed = {claim.id for claim in published if claim.kind != "context"}
    if default_reading not in evaluations_by_reading:
        raise InputError(f"{paper}: no evaluations of reading {default_reading}")
    if STATED_READING not in evaluations_by_reading and any(claim.kind == "input" for claim in published):
        raise InputError(f"{paper}: no evaluations of reading {STATED_READING}, which the stated inputs are checked in")
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
                "z": judged[name].z and judged[name].z["largest"],
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
            bound = ", ".join(f"{entry:g}" for entry in _flatten(_plain(tolerance.absolute)).values())
            bound = f"{bound} {claim.unit}".removesuffix(" 1")
        text = f"{text} Within the tolerance stated beforehand ({bound}): {tolerance.reason.rstrip('.')}.".strip()
    return text


# ---------------------------------------------------------------------------------------------------- files and tables


def write_claims(rows: Iterable[Mapping[str, Any]], path: str | Path) -> None:
    """Write claims as JSON, papers in alphabetical order, the claims of a paper in the order given.

    Args:
        rows: dictionaries from `collect`, of one or more papers.
        path: the JSON file; replaced as a whole or not at all.

    Raises:
        ArtifactError: a number is not finite, or two rows have the same paper and id.

    """
    rows = sorted(rows, key=lambda row: row["paper"])
    names = [(row["paper"], row["id"]) for row in rows]
    if len(set(names)) != len(names):
        raise ArtifactError(f"{path}: a claim is written twice")
    write_json(rows, path)


def write_json(value: Any, path: str | Path) -> None:
    """Write plain values as JSON; raises ArtifactError for a number that is not finite."""
    try:
        text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
    except ValueError as error:
        raise ArtifactError(f"{path}: a number is not finite: {error}") from error
    write_text(path, text + "\n")


def read_claims(path: str | Path) -> list[dict[str, Any]]:
    """Read what `write_claims` wrote.

    Raises:
        ArtifactError: the file is missing, damaged, or no list of claims.

    """

    def refuse(problem: str) -> ArtifactError:
        return ArtifactError(f"{path}: {problem}; delete the file and run 'snakemake claims'")

    try:
        rows = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be read ({error.strerror}); run 'snakemake claims'") from None
    except (ValueError, RecursionError) as error:
        raise refuse(f"is not JSON ({error})") from None
    if not isinstance(rows, list):
        raise refuse("is not a list of claims")
    return rows


def read_counterexamples(path: str | Path) -> dict[str, dict[str, Any] | None]:
    """Read the counterexamples of a paper's counted claims; raises ArtifactError if they cannot be read."""
    try:
        return dict(json.loads(Path(path).read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        raise ArtifactError(f"{path}: cannot be read ({error}); delete it and run 'snakemake claims'") from None


def with_counterexamples(
    rows: Iterable[Mapping[str, Any]], counterexamples: Mapping[str, Mapping[str, Any] | None]
) -> list[dict[str, Any]]:
    """Return rows of claims, each with its counterexample, and whether its verdict is thin."""
    return [{**row, "counterexample": counterexamples.get(row["id"]), "thin": is_thin(row)} for row in rows]


def is_thin(row: Mapping[str, Any]) -> bool:
    """Whether a counted verdict is so far from its limit that it could hardly be another one."""
    margin = row["readings"].get(row["reading"], {}).get("margin")
    confirmed = row["verdict"] in ("holds", "reproduced")
    return bool(confirmed and margin and margin["distance"] is not None and margin["distance"] > THIN)


def write_text(path: str | Path, text: str) -> None:
    """Write UTF-8 text under a temporary name and rename it, so that a good file is never left half replaced."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_text(text, encoding="utf-8", newline="\n")
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def reading_names(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the readings of the rows, in order of first appearance."""
    return list(dict.fromkeys(name for row in rows for name in row["readings"]))


def claims_markdown(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return claims as a table for readers: what is printed, every reading's value and verdict, the reason.

    rows: dictionaries from `collect` or `read_claims`. For analysts there is `tables.claims_table`.
    """
    readings = reading_names(rows)
    # not "printed", which is the name of a reading
    header = ["paper", "id", "where", "quantity", "unit", "kind", "in the paper"]
    for name in readings:
        header += [name, f"{name} verdict"]
    header += ["verdict", "reason"]
    table = []
    for row in rows:
        cells = [row[key] for key in header[:6]]
        cells.append("; ".join(format_lines(row["printed"], resolution=row["resolution"])))
        for name in readings:
            result = row["readings"].get(name)
            cells.append("; ".join(format_result(row, name)))
            cells.append(_verdict_cell(result))
        table.append([*cells, row["verdict"], row["reason"]])
    lines = [header, ["---"] * len(header), *table]
    return "".join(f"| {' | '.join(map(_markdown_cell, line))} |\n" for line in lines)


def _verdict_cell(result: Mapping[str, Any] | None) -> str:
    """The verdict of a reading, and the one from as many trials as other readings have if that is another one."""
    verdict = (result and result["verdict"]) or NOT_EVALUATED
    other = result and result.get("at_equal_trials")
    if not other or other["verdict"] == verdict:
        return verdict
    return f"{verdict} ({other['verdict']} with {other['trials']:,} trials)"


def unexplained(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the ids of claims that differ or fail without an erratum or a withheld input."""
    return [row["id"] for row in rows if row["reason"] == UNEXPLAINED]


def kind_of_result(row: Mapping[str, Any]) -> str:
    """Return whether a claim is counted among the numbers or the statements."""
    return STATEMENTS if row["kind"] == "qualitative" else NUMBERS


def summary(rows: Iterable[Mapping[str, Any]], reading: str | None = None) -> dict[str, dict[str, int]]:
    """Count verdicts.

    Args:
        rows: dictionaries from `collect` or `read_claims`.
        reading: count the verdicts of this reading; by default the verdict that is shown first.

    Returns:
        `{"counted": {verdict: count}, "numbers": ..., "statements": ..., "listed": ...}`: all results, printed numbers
        and statements apart, and what is listed and never counted. Claims that the reading does not evaluate are in
        none.

    """
    rows = list(rows)
    verdicts = [row["verdict"] if reading is None else row["readings"].get(reading, {}).get("verdict") for row in rows]
    kinds = [kind_of_result(row) for row in rows]

    def count(names: Iterable[str], kind: str | None = None) -> dict[str, int]:
        chosen = [verdict for verdict, kind_of_row in zip(verdicts, kinds, strict=True) if kind in (None, kind_of_row)]
        return {verdict: chosen.count(verdict) for verdict in names}

    return {
        "counted": count(COUNTED_VERDICTS),
        **{kind: count(names, kind) for kind, names in VERDICTS_OF.items()},
        "listed": count(LISTED_VERDICTS),
    }


# ----------------------------------------------------------------------------------------------------- numbers as text


def format_number(value: Any, standard_error: float | None = None, resolution: float | None = None) -> str:
    """Write one number for a reader.

    Args:
        value: a number, bool, text or None.
        standard_error: if positive, it is shown with two digits and sets the digits of the value.
        resolution: the size of the last digit to show, if there is no standard error; without it six digits are shown.

    Returns:
        For example `1349.384 ± 0.047`, `4.85e-4`, `true`, or a dash for None.

    """
    if value is None:
        return NOT_EVALUATED
    if isinstance(value, bool):
        return "true" if value else "false"
    if not _is_number(value):
        return str(value)
    if not math.isfinite(value):
        return str(value)
    has_error = standard_error is not None and math.isfinite(standard_error) and standard_error > 0
    if not has_error and resolution is None:
        return f"{value:.6g}"
    last_digit = _decade(standard_error) - 1 if has_error else _decade(resolution)
    size = max(abs(value), standard_error) if has_error else abs(value)
    exponent = _decade(size) if size else 0
    if size and not -4 < exponent < 7:
        # powers of ten: as many digits as needed to reach the last one
        decimals, scale = max(exponent - last_digit, 0), 10.0**exponent
        number = f"{value / scale:.{decimals}f}"
        if has_error:
            return f"({number} ± {standard_error / scale:.{decimals}f})e{exponent}"
        return f"{number}e{exponent}"
    decimals = max(-last_digit, 0)
    number = f"{value:.{decimals}f}"
    return f"{number} ± {standard_error:.{decimals}f}" if has_error else number


def format_lines(value: Any, standard_error: Any = None, resolution: Any = None) -> list[str]:
    """Write a number, vector or matrix as one line per number or matrix row; arguments as in `format_number`."""
    if not isinstance(value, list):
        return [format_number(value, standard_error, resolution)]

    def part(other: Any, index: int) -> Any:
        return other[index] if isinstance(other, list) else other

    inner = [format_lines(item, part(standard_error, i), part(resolution, i)) for i, item in enumerate(value)]
    return [", ".join(lines) for lines in inner]


def format_result(row: Mapping[str, Any], reading: str) -> list[str]:
    """Write what a reading gives for a claim; without a standard error, with two digits more than the paper prints."""
    result = row["readings"].get(reading)
    if result is None or result["value"] is None:
        return ["not finite"] if result and result["verdict"] == "differs" else [NOT_EVALUATED]
    finer = row["resolution"]
    if row["kind"] == "input":
        # What another value of an input is must be seen, however few digits the paper prints.
        finer = finer if result["verdict"] == "as_stated" else None
    elif finer is not None:
        finer = [0.01 * size for size in finer] if isinstance(finer, list) else 0.01 * finer
    return format_lines(result["value"], result["standard_error"], finer)


def _decade(size: float) -> int:
    return math.floor(math.log10(size) + 1e-9)  # 0.001 has decade -3 although its logarithm is rounded


def _markdown_cell(text: str) -> str:
    escaped = str(text).replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;").replace(">", "&gt;")
    return " ".join(escaped.split())


# -------------------------------------------------------------------------------------------------------- plain values


def _plain(value: Any) -> Any:
    """Turn arrays, numpy numbers and tuples into lists and Python numbers."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def _finite(value: Any, infinity: str | None = None) -> Any:
    """Replace numbers that JSON cannot hold: by None, or by a text where an infinite number is meant."""
    if isinstance(value, list):
        return [_finite(item, infinity) for item in value]
    if isinstance(value, dict):
        return {key: _finite(item, infinity) for key, item in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return None if infinity is None or math.isnan(value) else f"{'-' * (value < 0)}{infinity}"
    return value


def _flatten(value: Any, index: tuple[int, ...] = ()) -> dict[tuple[int, ...], Any]:
    """Return the numbers of a nested list by their indices; two values have one shape if the indices are the same."""
    if not isinstance(value, list):
        return {index: value}
    return {place: leaf for i, item in enumerate(value) for place, leaf in _flatten(item, (*index, i)).items()}


def _broadcast(value: Any, like: Mapping[tuple[int, ...], Any]) -> dict[tuple[int, ...], Any]:
    return _flatten(value) if isinstance(value, list) else dict.fromkeys(like, value)


def is_finite(value: Any) -> bool:
    """Whether a plain value is there, and has no number in it that is not finite."""
    return value is not None and all(not _is_number(part) or math.isfinite(part) for part in _flatten(value).values())


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _used_literally(value: Any, printed: Any) -> bool:
    if _is_number(value) and _is_number(printed):
        # No finite number is an infinite one, though infinity is within any share of itself.
        return value == printed or (math.isfinite(printed) and abs(value - printed) <= _LITERAL * abs(printed))
    return type(value) is type(printed) and value == printed
