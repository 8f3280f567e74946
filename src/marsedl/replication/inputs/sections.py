"""Typed sections of inputs: what a paper's or scenario's functions take, checked before any job is planned.

A section holds the inputs that change together, such as those of a vehicle. Every input has its SI unit and a meaning.
In a file, angles are written with the suffix `_deg`, lengths in kilometres with `_km`; inside, everything is SI and
radians. Lists of numbers become arrays.
"""

import functools
import math
import typing

import numpy as np
from pydantic import AfterValidator, BaseModel, Field, PlainSerializer, Strict, WithJsonSchema, field_validator

# Suffixes under which a quantity of an SI unit may be written, with their factors.
SUFFIXES = {
    "rad": {"_deg": 0.017453292519943295},
    "rad/s": {"_deg_s": 0.017453292519943295},
    "rad/s^2": {"_deg_s2": 0.017453292519943295},
    "m": {"_km": 1000.0},
    "m/s": {"_km_s": 1000.0},
}
SUFFIX_ONLY = ("rad", "rad/s", "rad/s^2")  # an angle without its unit in the name is too easily read as degrees
KNOWN_SUFFIXES = (
    *(suffix for accepted in SUFFIXES.values() for suffix in accepted),
    *("_rad", "_m", "_s", "_ms", "_h", "_kg", "_g", "_lb", "_t", "_N", "_kN", "_percent", "_ft", "_mi", "_m_s", "_K"),
)

# Limits of magnitudes in SI units: a number beyond them is a mistake, and overflows when it is squared.
SMALLEST, LARGEST = 1e-30, 1e30
TEN_TURNS = 20 * math.pi  # rad


# Strict: neither text nor true/false passes for a number.
Number = typing.Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = typing.Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)]
NonNegative = typing.Annotated[float, Strict(), Field(ge=0, allow_inf_nan=False)]
Fraction = typing.Annotated[float, Strict(), Field(gt=0, lt=1)]
Count = typing.Annotated[int, Strict(), Field(gt=0, le=1_000_000_000)]  # of flights
CountOrNone = typing.Annotated[int, Strict(), Field(ge=0, le=1_000_000_000)]
Sign = typing.Literal[-1, 1]
Seed = typing.Annotated[int, Strict(), Field(ge=0, lt=2**63)]


def at_most(most: int, reason: str) -> type:
    """Return the type of a whole number from 1 to `most`; the message beyond it gives the reason."""

    def check(value):
        if value > most:
            raise ValueError(f"should be at most {most}: {reason}")
        return value

    schema = WithJsonSchema({"type": "integer", "exclusiveMinimum": 0, "maximum": most})
    return typing.Annotated[int, Strict(), Field(gt=0), AfterValidator(check), schema]


Few = at_most(10_000, "each costs a computation of its own")
Drawn = at_most(10_000, "a figure shows no more")
Iterations = at_most(1_000_000, "an iteration that has not converged by then never does")
StudyTrials = at_most(10_000_000, "a study keeps all of its trials in memory")


# Follows the type of a list: its numbers become an array, and a list again when written.
ARRAY = (AfterValidator(lambda value: np.array(value, float)), PlainSerializer(np.ndarray.tolist))


def vector(length: int, of: type = Number) -> type:
    """Return the type of a list of `length` numbers."""
    return typing.Annotated[tuple[of, ...], Field(min_length=length, max_length=length), *ARRAY]


def covariance(size: int) -> type:
    """Return the type of a positive definite covariance (size, size), written whole or as its diagonal."""

    def check(value):
        rows = [row for row in value if isinstance(row, tuple)]
        if len(value) != size or len(rows) not in (0, size) or any(len(row) != size for row in rows):
            raise ValueError(f"must be {size} variances, or {size} rows of {size} numbers")
        matrix = np.array(value, float) if rows else np.diag(np.array(value, float))
        asymmetry = np.abs(matrix - matrix.T)
        if np.any(asymmetry > 1e-12 * np.abs(matrix).max()):
            row, column = np.unravel_index(np.argmax(asymmetry), matrix.shape)
            raise ValueError(
                f"is not symmetric: entry ({row + 1}, {column + 1}) is {matrix[row, column]:g}, "
                f"entry ({column + 1}, {row + 1}) is {matrix[column, row]:g}"
            )
        # Scaled to unit diagonal, so that the units of the components do not decide what counts as singular.
        scale = np.sqrt(np.abs(np.diag(matrix)))
        smallest = np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min() if np.all(scale > 0) else 0.0
        if np.any(np.diag(matrix) <= 0) or smallest <= 1e-12:
            raise ValueError(
                f"is not positive definite: its smallest eigenvalue is {np.linalg.eigvalsh(matrix).min():g}; "
                "give variances above zero and correlations between -1 and 1"
            )
        return matrix

    length = {"type": "array", "minItems": size, "maxItems": size}
    variances = {**length, "items": {"type": "number", "exclusiveMinimum": 0}}
    schema = {"anyOf": [variances, {**length, "items": {**length, "items": {"type": "number"}}}]}
    entry = Number | tuple[Number, ...]
    return typing.Annotated[tuple[entry, ...], AfterValidator(check), ARRAY[1], WithJsonSchema(schema)]


def given(unit: str, meaning: str, **constraints):
    """Declare an input: its SI unit ("1" for none) and what it is; constraints go to `pydantic.Field`."""
    return Field(json_schema_extra={"unit": unit}, description=meaning, **constraints)


class Section(BaseModel, extra="forbid", frozen=True, defer_build=True):
    """Base of every section: no unknown keys, no changes after validation, no silent conversions."""

    @field_validator("*")
    @classmethod
    def _plausible(cls, value, info):
        numbers = np.asarray(value)
        if numbers.dtype.kind != "f":
            return value
        smallest = SMALLEST if numbers.ndim < 2 else 0.0  # a tiny number in a matrix may be the rounding of zero
        sizes = np.abs(numbers)
        for number in numbers[(sizes > LARGEST) | (sizes < smallest) & (sizes > 0)].flat:
            limits = f"between {SMALLEST:g} and {LARGEST:g}"
            raise ValueError(f"{number:g} is neither 0 nor {limits}: check the number and its unit")
        if cls.unit(info.field_name) == "rad" and sizes.max(initial=0.0) > TEN_TURNS:
            raise ValueError("is more than ten turns, 3600 deg: check the angle and its unit")
        return value

    @classmethod
    def unit(cls, name: str) -> str:
        """Return the SI unit of an input."""
        return cls.model_fields[name].json_schema_extra["unit"]

    @classmethod
    @functools.cache
    def keys(cls) -> dict[str, tuple[str, float, str]]:
        """Return what every key that a file may use sets: the input, the factor to SI, and the unit of the value."""
        accepted = {}
        for name in cls.model_fields:
            unit = cls.unit(name)
            if unit not in SUFFIX_ONLY:
                accepted[name] = name, 1.0, unit
            for suffix, factor in SUFFIXES.get(unit, {}).items():
                accepted[name + suffix] = name, factor, suffix[1:].replace("_", "/")
        return accepted

    @classmethod
    def from_plain(cls, values: typing.Mapping[str, object]) -> typing.Self:
        """Return the section with some of its inputs, from plain values that were validated before.

        Reading any other input is an error, see `replication/pipeline/declarations.py`.
        """
        return cls.model_construct(
            **{name: np.array(v, float) if isinstance(v, list | tuple) else v for name, v in values.items()}
        )

    def __getattr__(self, name):
        """Name the input that was read although the stage does not have it."""
        if name in type(self).model_fields:
            raise AttributeError(
                f"the input '{name}' was not given: of a section, a stage is given what its code reads as "
                f"'{type(self).__name__.lower()}.{name}', of a parameter annotated as {type(self).__name__} or Inputs"
            )
        return super().__getattr__(name)


class Inputs(BaseModel, extra="forbid", frozen=True, defer_build=True):
    """Base of all inputs of a paper or scenario: its sections, each a class of its own."""

    # Monte Carlo ensembles, with the input "section.name" that holds their number of trials.
    CASES: typing.ClassVar[dict[str, str]] = {}
    # Functions that raise ValueError for inputs that do not fit together; they take sections by their names.
    CHECKS: typing.ClassVar[tuple[typing.Callable, ...]] = ()

    @classmethod
    def sections(cls) -> dict[str, type[Section]]:
        """Return the classes of the sections by their names."""
        return {name: field.annotation for name, field in cls.model_fields.items()}

    @classmethod
    def names(cls) -> list[str]:
        """Return "section.name" of every input."""
        return [f"{section}.{name}" for section, of in cls.sections().items() for name in of.model_fields]

    @classmethod
    def unit(cls, name: str) -> str:
        """Return the SI unit of an input "section.name"."""
        section, name = name.split(".")
        return cls.sections()[section].unit(name)

    @classmethod
    def meaning(cls, name: str) -> str:
        """Return what an input "section.name" is."""
        section, name = name.split(".")
        return cls.sections()[section].model_fields[name].description

    @classmethod
    def from_plain(cls, values: typing.Mapping[str, object]) -> typing.Self:
        """Return the inputs from plain values by "section.name", all or some, that were validated before."""
        plain = by_section(values)
        return cls.model_construct(**{name: of.from_plain(plain.get(name, {})) for name, of in cls.sections().items()})

    def get(self, name: str) -> typing.Any:
        """Return an input by "section.name"."""
        return functools.reduce(getattr, name.split("."), self)

    def plain(self) -> dict[str, object]:
        """Return all inputs by "section.name", as numbers, strings and nested lists."""
        dumped = self.model_dump(mode="json")
        return {f"{section}.{name}": value for section, values in dumped.items() for name, value in values.items()}


def by_section(values: typing.Mapping[str, object]) -> dict[str, dict[str, object]]:
    """Return values by "section.name" as a mapping for each section."""
    sections: dict[str, dict[str, object]] = {}
    for key, value in values.items():
        section, _, name = key.partition(".")
        sections.setdefault(section, {})[name] = value
    return sections
