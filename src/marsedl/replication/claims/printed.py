"""What a paper prints: its claims, from `data/published/<paper>.yaml`."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, StrictBool, StringConstraints, field_validator

from marsedl.replication.claims.numbers import flatten, is_number
from marsedl.replication.errors import InputError, nearest, shown
from marsedl.replication.inputs.messages import Keys, Place, checked
from marsedl.replication.inputs.yaml_file import Lined, read_yaml

PLAIN_WORDS = 12  # in the short form of a claim, at most


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
    document = read_yaml(path)
    file = checked(_File, document, Place(str(path), document))
    claims: dict[str, PublishedClaim] = {}
    for number, entry in enumerate(file.claims, start=1):
        claim, place = _printed_claim(path, number, entry)
        if claim.id in claims:
            raise InputError(f"{place / 'id'}: used by two claims; rename one")
        claims[claim.id] = claim
    for place, name in enumerate(file.headline, start=1):
        if name not in claims:
            raise InputError(f"{path}: headline: there is no claim {shown(name)}; {nearest(name, claims)}")
        claims[name] = replace(claims[name], headline=place)
    return list(claims.values())


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


def _all(words: str, test: Callable[[Any], object]) -> AfterValidator:
    """Return the check of a value or nested list that it has entries, and that every one passes a test."""

    def check(value: Any) -> Any:
        entries = flatten(value).values()
        if not entries or not all(map(test, entries)):
            raise ValueError(f"must be {words}")
        return value

    return AfterValidator(check)


def _few(text: str) -> str:
    if len(text.split()) > PLAIN_WORDS:
        raise ValueError(f"must be a text of at most {PLAIN_WORDS} words")
    return text


_Text = Annotated[str, StringConstraints(strict=True, strip_whitespace=True, min_length=1)]
_Id = Annotated[str, StringConstraints(strict=True, pattern=r"^[A-Za-z0-9_]+$")]
_Trials = Annotated[int, Field(strict=True, gt=0)]
_Names = Annotated[
    Any, _all("an input 'section.name', or a list of them", lambda name: re.match(r"\w+\.\w", str(name)))
]
_Numbers = Annotated[Any, _all("finite numbers", lambda value: is_number(value) and math.isfinite(value))]
_Sizes = Annotated[Any, _all("positive numbers", lambda value: is_number(value) and 0 < value < math.inf)]
_Anything = Annotated[  # an input may be infinite
    Any, _all("numbers, true, false or text", lambda v: isinstance(v, bool | int | float | str) and v == v)
]


class _File(Keys):
    claims: list[Any]
    headline: tuple[str, ...] = ()


class _Printed(Keys):
    """A claim as it stands in a file, with the keys of any kind."""

    id: _Id
    where: _Text
    quantity: _Text
    kind: Literal["deterministic", "monte_carlo", "qualitative", "input", "undetermined", "context"]
    printed: _Anything
    unit: _Text
    resolution: _Sizes | None = None
    trials: _Trials | None = None
    note: str = Field("", strict=True)
    plain: Annotated[_Text, AfterValidator(_few)] = ""

    @field_validator("resolution")
    @classmethod
    def _shaped_as_printed(cls, resolution, info):
        printed = flatten(info.data.get("printed", 0))
        if not all(map(is_number, printed.values())):
            raise ValueError("the printed value is not a number, so it has no last digit; leave it out")
        if isinstance(resolution, list) and flatten(resolution).keys() != printed.keys():
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

    printed: StrictBool


class _Input(_Printed):
    """A stated input, with its name or names if it is an input of ours as it stands."""

    input: _Names | None = None


_OF_KIND = {"deterministic": _Measured, "monte_carlo": _MonteCarlo, "qualitative": _Statement, "input": _Input}


def _printed_claim(path: Path, number: int, entry: Any) -> tuple[PublishedClaim, Place]:
    """Return a claim and its place, which is named by its number in the file if it has no id."""
    keys, named = entry if isinstance(entry, dict) else {}, Lined()
    name = str(keys.get("id", number))
    named[name], named.lines = entry, {name: min(getattr(keys, "lines", {}).values(), default=None)}
    place = Place(str(path), {"claims": named}) / "claims" / name
    written = checked(_OF_KIND.get(str(keys.get("kind")), _Printed), entry, place)
    return PublishedClaim(path.stem, **dict(written)), place


def published_of(params) -> dict[str, dict]:
    """Return the printed claims by id, as the argument `published`; nothing if a job of these params shows none."""
    if not params.made["printed"]:
        return {}
    return {"published": {claim.id: claim for claim in load_published(params.published)}}
