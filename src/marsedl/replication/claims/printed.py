"""What a paper prints: its claims, from `data/published/<paper>.yaml`, some of which are inputs of the replication."""

import csv
import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, StrictBool, StringConstraints, field_validator

from marsedl.replication.claims.numbers import flatten, is_number
from marsedl.replication.errors import InputError, nearest, shown
from marsedl.replication.inputs.messages import Keys, Place, checked
from marsedl.replication.inputs.sections import SUFFIXES, Inputs
from marsedl.replication.inputs.yaml_file import Lined, read_yaml

PLAIN_WORDS = 12  # in the short form of a claim, at most
# Factors from printed units to the input's own SI unit, beside those of its suffixes.
_FACTORS = {("percent", "1"): 0.01, ("%", "1"): 0.01, ("r_p", "1"): 1.0, ("rad/s", "1/s"): 1.0}
_NO_UNITS = ("1", "not given")  # of printed values that name none
_NAME = re.compile(r"(\w+\.\w+)(?:\[(\d+)\])?")


def _all(words: str, test: Callable[[Any], object]) -> AfterValidator:
    """Return the check of a value or nested list that it has entries, and that every one passes a test."""

    def check(value: Any) -> Any:
        entries = flatten(value).values()
        if not entries or not all(map(test, entries)):
            raise ValueError(f"must be {words}")
        return value

    return AfterValidator(check)


_Text = Annotated[str, StringConstraints(strict=True, strip_whitespace=True, min_length=1)]
_Plain = Annotated[_Text, _all(f"a text of at most {PLAIN_WORDS} words", lambda text: len(text.split()) <= PLAIN_WORDS)]
_Id = Annotated[str, StringConstraints(strict=True, pattern=r"^[A-Za-z0-9_]+$")]
_Trials = Annotated[int, Field(strict=True, gt=0)]
_Numbers = Annotated[Any, _all("finite numbers", lambda value: is_number(value) and math.isfinite(value))]
_Sizes = Annotated[Any, _all("positive numbers", lambda value: is_number(value) and 0 < value < math.inf)]
_Anything = Annotated[  # an input may be infinite
    Any, _all("numbers, true, false or text", lambda v: isinstance(v, bool | int | float | str) and v == v)
]


class PublishedClaim(Keys):
    """One printed number, vector or statement of a paper."""

    paper: str
    id: _Id
    where: _Text
    quantity: _Text
    kind: Literal["deterministic", "monte_carlo", "qualitative", "input", "undetermined", "context"]
    printed: _Anything  # number, list, nested list, bool or text
    unit: _Text
    resolution: _Sizes | None = None  # size of the last printed digit: a number, or a list shaped like `printed`
    trials: _Trials | None = None  # the paper's number of Monte Carlo trials
    note: str = Field("", strict=True)
    plain: _Plain = ""  # the claim in few words, for readers who do not know the paper
    input: str | list[str] | None = None  # of a stated input that needs no code: "section.name", or a list of them
    headline: int | None = None  # place among the claims that the paper's abstract and conclusions rest on, from 1

    @field_validator("resolution")
    @classmethod
    def _shaped_as_printed(cls, resolution, info):
        printed = flatten(info.data.get("printed", 0))
        if not all(map(is_number, printed.values())):
            raise ValueError("the printed value is not a number, so it has no last digit; leave it out")
        if isinstance(resolution, list) and flatten(resolution).keys() != printed.keys():
            raise ValueError(f"{shown(resolution)} does not have the shape of 'printed'")
        return resolution

    @field_validator("input")
    @classmethod
    def _of_a_stated_input(cls, names, info):
        if info.data.get("kind") != "input":
            raise ValueError("only a claim of kind 'input' names one; leave it out")
        return names


class _Measured(PublishedClaim):
    printed: _Numbers
    resolution: _Sizes


class _MonteCarlo(_Measured):
    trials: _Trials


class _Statement(PublishedClaim):
    printed: StrictBool


_OF_KIND = {"deterministic": _Measured, "monte_carlo": _MonteCarlo, "qualitative": _Statement}


class _File(Keys):
    claims: list[Any]
    headline: tuple[str, ...] = ()


def load_published(path: str | Path) -> list[PublishedClaim]:
    """Load the printed claims of the paper that gives the file its name, in the order of the file.

    path: YAML file with the key `claims`, mappings with the fields of `PublishedClaim`, and `headline`, the ids of some
    in their order. Raises InputError, which names the file, the claim's id and the key.
    """
    path = Path(path)
    document = read_yaml(path)
    file = checked(_File, document, Place(str(path), document))
    claims: dict[str, PublishedClaim] = {}
    faults = []
    for number, entry in enumerate(file.claims, start=1):
        keys, named = entry if isinstance(entry, dict) else {}, Lined()
        name = str(keys.get("id", number))
        named[name], named.lines = entry, {name: min(getattr(keys, "lines", {}).values(), default=None)}
        place = Place(str(path), {"claims": named}) / "claims" / name
        model = _OF_KIND.get(str(keys.get("kind")), PublishedClaim)
        try:
            claim = checked(model, {"paper": path.stem, **entry} if keys else entry, place)
            if claim.id in claims:
                raise InputError(f"{place / 'id'}: used by two claims; rename one")
            claims[claim.id] = claim
        except InputError as error:
            faults.append(str(error))
    if faults:
        raise InputError("\n".join(faults))
    for position, name in enumerate(file.headline, start=1):
        if name not in claims:
            raise InputError(f"{path}: headline: there is no claim {shown(name)}; {nearest(name, claims)}")
        claims[name] = claims[name].model_copy(update={"headline": position})
    return list(claims.values())


def stated_value(claim: PublishedClaim, values: Mapping[str, object], model: type[Inputs]) -> Any:
    """Return what a reading uses for a stated input, in the unit in which it is printed.

    values: all inputs of the reading as plain values by "section.name". Raises InputError, which names the claim, if
    there is no such input or entry, or if its unit is not the printed one.
    """
    names = claim.input if isinstance(claim.input, list) else [claim.input]
    units = [unit.strip() for unit in claim.unit.split(",")]
    try:
        if len(units) not in (1, len(names)):
            raise ValueError(f"{len(units)} units for {len(names)} inputs; give one, or one for each")
        units *= len(names) // len(units)
        numbers = [_in_unit(name, unit, values, model) for name, unit in zip(names, units, strict=True)]
    except ValueError as error:
        raise InputError(f"data/published/{claim.paper}.yaml: claim {claim.id}: key 'input': {error}") from None
    return numbers if isinstance(claim.input, list) else numbers[0]


def _in_unit(name: str, unit: str, values: Mapping[str, object], model: type[Inputs]) -> object:
    match = _NAME.fullmatch(name)
    if not match or match[1] not in values:
        raise ValueError(f"there is no input '{name}'; {nearest(name, model.names())}")
    value, si = values[match[1]], model.unit(match[1])
    if match[2] is not None:
        if not isinstance(value, list) or int(match[2]) >= len(value):
            raise ValueError(f"the input '{match[1]}' has no entry {match[2]}; count from 0")
        value = value[int(match[2])]
    # A printed value without a unit is that of an input whose unit has no other spelling.
    if unit == si or (unit in _NO_UNITS and si not in (*SUFFIXES, "1/s")):
        return value
    suffix = "_" + unit.replace("/", "_").replace("^", "")  # km/s is _km_s
    factor = SUFFIXES.get(si, {}).get(suffix) or _FACTORS.get((unit, si))
    if factor is None:
        raise ValueError(
            f"it is printed in '{unit}', but the input '{name}' is in '{si}'; correct the unit or the name, or write a"
            " function for the claim"
        )
    return (np.asarray(value) / factor).tolist()


def load_measured(path: str | Path, paper: str) -> dict[str, float]:
    """Read what the benchmarks of a paper measured, by what they are of; raises InputError naming the file."""
    try:
        rows = list(csv.reader(Path(path).read_text(encoding="utf-8").splitlines()))[1:]
        return {quantity: float(value) for of, quantity, value, *_ in rows if of == paper}
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as benchmarks ({error!r}); restore it, or run 'make bench'") from None


def published_by_id(path: str | Path) -> dict[str, PublishedClaim]:
    """Return the printed claims of a file by their ids."""
    return {claim.id: claim for claim in load_published(path)}
