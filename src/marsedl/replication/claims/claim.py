"""One claim from its evaluation to the page: the type of `collect`, of `report/claims.json` and of its JSON Schema."""

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema

from marsedl.replication.claims.names import COUNTED_VERDICTS, LISTED_VERDICTS, REFUTED_VERDICTS
from marsedl.replication.claims.numbers import plain
from marsedl.replication.sizes import FULL

UNEXPLAINED = "Not explained: this verdict is not the one for which the paper's reasons were stated."


def _nested(entry: dict) -> WithJsonSchema:
    """The schema of an entry, a vector of entries, or a matrix."""
    vector = {"type": "array", "items": entry}
    return WithJsonSchema({"anyOf": [entry, vector, {"type": "array", "items": vector}]})


Value = Annotated[Any, _nested({"type": ["number", "boolean", "string", "null"]})]
Sizes = Annotated[Any, BeforeValidator(plain), _nested({"type": ["number", "null"], "minimum": 0})]
Number = Annotated[int | float, WithJsonSchema({"type": "number"})]
Finite = Annotated[  # JSON has no other numbers
    Number | None, BeforeValidator(lambda value: value if value is None or math.isfinite(value) else None)
]
Verdict = Literal[(*COUNTED_VERDICTS, *LISTED_VERDICTS)]


class _Part(BaseModel):
    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        use_attribute_docstrings=True,
        json_schema_serialization_defaults_required=True,
        validate_by_name=True,
        serialize_by_alias=True,
        defer_build=True,
    )


class Tolerance(_Part):
    """The tolerance, stated before the result was known, within which a number is close; relative or absolute."""

    reason: str
    """why this tolerance is the right one"""
    relative: Number | None = None
    """share of the printed value"""
    absolute: Sizes = None
    """size in the claim's unit, a number or one for each component"""


class Margin(_Part):
    """How far the measure that decides is from its limit."""

    measure: str
    """what decides, in words"""
    value: Finite
    """its value"""
    limit: Finite
    """the limit that it is compared with"""
    unit: str
    """unit of both; empty: that of the claim, or none"""
    distance: Finite
    """how far they are apart, in the unit under `in`"""
    scale: Literal["standard errors", "limits", "values"] = Field(alias="in")
    """what the distance counts: standard errors of the value, or shares of the limit or of the value"""
    standard_error: Number = 0.0
    """the standard error of the value; 0 if it is not sampled"""


class Counterexample(_Part):
    """The least change that turns the verdict, of those that are tried."""

    change: Literal["scaled", "shifted", "spread", "replaced", "in_reading"]
    """what is done"""
    of: str
    """the field, input or reading, with the component in brackets"""
    amount: Number | str | None
    """a factor; a shift in standard deviations; or what is put in its place"""
    to: str
    """the verdict after it"""


class Cause(_Part):
    """The value of a choice that by itself makes a claim true, or else brings it nearest to what is printed."""

    choice: str
    """the choice"""
    why: str
    """why the paper leaves it open: not printed, a possible misprint, a setting left open, or an erratum"""
    value: str
    """its value"""
    where: str
    """the universe or the reading that has it"""
    verdict: Verdict
    """the verdict there"""
    number: Finite
    """the number that decides, there; null: none"""
    corrected: Finite
    """the same number in `corrected`, of as many trials; null: none"""
    unit: str = ""
    """the unit of both; empty: none"""


class Standing(_Part):
    """What the universes and readings of the paper say of the claim; it never replaces the verdict."""

    label: Literal["robust", "depends", "never", "undecided", "too_few", "not_computed"]
    """true in all that have a result, in some and false in others, false in all; those that decide it agree and others
    are undetermined; fewer than 20 decide it; none has a result"""
    alone: tuple[str, ...] = ()
    """the choices that decide it by themselves, those that turn it first"""
    together: tuple[str, ...] = ()
    """the choices that decide it only in combination with others"""
    true: int
    """space-filling universes in which it reproduces or holds"""
    undetermined: int
    """in which it is undetermined"""
    deciding: int
    """in which it is true or false"""
    of: int
    """of how many with a result; shares are no probabilities"""
    low: Finite
    """of the Wilson interval of the share in which it is true, at 95 %; null: no universe has a result"""
    high: Finite
    """of the same interval"""
    cause: Cause | None = None
    """of a claim that differs or fails; null: no admissible value of a choice brings it nearer by itself"""
    misprint: Cause | None = None
    """a misprint, or a value that something else printed rules out, which would make it true; null: none does"""


class Doubt(_Part):
    """Why a verdict is undetermined."""

    why: str
    """in words"""
    measure: str = ""
    """the measure that is in doubt; empty: the claim as a whole"""
    trials: int | None = None
    """about how many trials would settle it; null: trials do not, or not known"""


class Result(_Part):
    """What one reading gives for the claim."""

    value: Value = None
    """shaped like the printed value; null: not evaluated in this reading, or not finite; an infinite input is a text"""
    standard_error: Sizes = None
    """of the value, shaped like it; null: no sampling error"""
    trials: Annotated[int, Field(ge=0)] | None = None
    """number of Monte Carlo trials behind the value; null: none"""
    verdict: Verdict | None
    """the reading's own verdict; null: not evaluated in this reading"""
    components: Any = None
    """verdicts on the numbers of a row, shaped like the printed value; null: a single number or a statement"""
    numbers: dict[str, Any] = {}
    """numbers beside the value, by their names: those that the reason and texts may quote"""
    evidence: tuple[str, ...] = ()
    """what was measured and tested, in sentences with numbers"""
    doubts: tuple[Doubt, ...] = ()
    """why the verdict is undetermined"""
    margin: Margin | None = None
    """how far the measure that decides is from its limit; null: nothing was compared with a limit"""
    test: str = ""
    """which of the tests of a statement decides, such as `test 2`; empty: it has no limit, or the claim is a number"""


class Claim(_Part):
    """One printed number or statement, what every reading gives for it, and the verdict."""

    paper: str
    """the paper's name, such as powered_descent"""
    size: str = FULL
    """the size of the build: full, or a smaller one that decides nothing"""
    id: str
    """the claim's name, unique in its paper"""
    where: str = ""
    """where the paper prints it"""
    quantity: str = ""
    """what is printed, in words"""
    plain: str = ""
    """the same in at most 12 words, for readers who do not know the paper; empty: not written"""
    unit: str = "1"
    """unit of the printed value, of those of the readings and of the resolution; 1: none"""
    kind: Literal["deterministic", "monte_carlo", "qualitative", "undetermined", "input", "context"]
    """a number, a number from trials, a statement, not determined by the paper, a stated input, quoted literature"""
    printed: Value
    """what the paper prints; true for a statement"""
    resolution: Sizes = None
    """size of the last printed digit, one or one for each component; null: not a measured number"""
    trials: Annotated[int, Field(gt=0)] | None = None
    """the paper's number of Monte Carlo trials; null: none"""
    note: str = ""
    """a remark on the printed value"""
    headline: int | None = None
    """place among the claims that the paper's abstract and conclusions rest on, from 1; null: not among them"""
    verdict: Verdict
    """the verdict that counts: that of the reading named under `reading`"""
    reading: str
    """the reading that gives the verdict"""
    reason: str = ""
    """why the verdict is what it is, if it needs a reason"""
    errata: tuple[str, ...] = ()
    """ids of the errata in the paper's method note that explain a difference"""
    choices: tuple[str, ...] = ()
    """names of the choices that may explain a difference"""
    close: Tolerance | None = None
    """the tolerance stated beforehand; null: none"""
    by_construction: str = ""
    """why the claim cannot fail; empty: it can"""
    readings: dict[str, Result]
    """what every reading gives, by the reading's name"""
    counterexample: Counterexample | None = None
    """the change that turns the verdict; null: not counted, or not turned"""
    universes: Standing | None = None
    """what the universes say; null: no universe evaluates it, as it is about the method, inputs or literature"""
    thin: bool = False
    """whether the verdict is so far from its limit that it could hardly be another one"""

    @property
    def result(self) -> Result:
        """What the reading gives that gives the verdict."""
        return self.readings[self.reading]

    @property
    def is_statement(self) -> bool:
        """Whether the claim holds or fails; the others are numbers."""
        return self.kind == "qualitative"

    @property
    def is_refuted(self) -> bool:
        """Whether the claim differs or fails."""
        return self.verdict in REFUTED_VERDICTS
