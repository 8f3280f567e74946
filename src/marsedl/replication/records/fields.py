"""Types of artifacts: frozen dataclasses of arrays with unit, dimensions and a line of meaning per field.

    MOTION = Axis("motion", downrange="m", altitude="m", downrange_velocity="m/s", vertical_velocity="m/s")

    @record
    class Nominal:
        \"\"\"Mass profile and mean trajectory.\"\"\"

        time: np.ndarray = quantity("s", ("time",), "time from the start of the flight")
        mean: np.ndarray = quantity(MOTION.unit, ("time", MOTION), "mean position and velocity", label="mean state")
        iterations: int = quantity("1", (), "passes of the mass iteration")

A field that lies along a dimension of its own name holds its coordinates.
"""

import dataclasses
import hashlib
import json
from dataclasses import dataclass
from functools import cache
from typing import Any, dataclass_transform

import numpy as np

from marsedl.replication.errors import ArtifactError, nearest
from marsedl.summaries import summary

_DTYPE_OF_ANNOTATION = {"int": "int64", "float": "float64", "bool": "bool", "str": "str"}
TRIALS = "trials"  # the dimension along which single trials are kept


class Axis(int):
    """A dimension of fixed extent whose components have names, and units if they differ or are fixed.

    It is an integer, the number of its components, and serves as an extent in the dims of `quantity`. `name` is the
    dimension's, `units` are those of the components by name ("" where the field says them). A further axis builds on
    another by `Axis("state", **MOTION.units, mass="kg")`; `Axis("law", "open", "closed")` has no units.
    """

    name: str
    units: dict[str, str]

    def __new__(cls, name: str, /, *components: str, **units: str) -> "Axis":
        """Take the name of the dimension and the components: names alone, or names with units."""
        units = {**dict.fromkeys(components, ""), **units}
        axis = super().__new__(cls, len(units))
        axis.name, axis.units = name, units
        return axis

    def __repr__(self) -> str:
        """Return the name, by which messages and files call the dimension."""
        return self.name

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components, in their order."""
        return tuple(self.units)

    @property
    def unit(self) -> str:
        """Unit of values along this axis, as `quantity` takes it: one for all components, or "m, m, m/s, m/s"."""
        units = list(self.units.values())
        return units[0] if len(set(units)) == 1 else ", ".join(units)

    def index(self, component: str) -> int:
        """Return the place of a component; raises ArtifactError naming the nearest one if there is none."""
        if component not in self.units:
            raise ArtifactError(f"axis {self.name!r} has no component {component!r}: {nearest(component, self.units)}")
        return self.names.index(component)

    def label(self, component: str) -> str:
        """Return the name of a component in words; raises ArtifactError as `index` does."""
        return self.names[self.index(component)].replace("_", " ")


@dataclass(frozen=True)
class Quantity:
    """Declaration of one field, see `quantity`."""

    unit: str
    dims: tuple[str | int, ...]
    meaning: str
    dtype: str
    allow_nan: bool
    label: str


def quantity(
    unit: str, dims: tuple[str | int, ...], meaning: str, dtype: Any = "", *, allow_nan: bool = False, label: str = ""
) -> Any:
    """Declare a field of an artifact type.

    unit: of the values, "1" for pure numbers; one per component, separated by commas, where they differ
    dims: one entry per axis: a name, whose extent is the same in all fields of the artifact, an `Axis`, or a fixed
        extent; () for a scalar, which is loaded as a plain Python value
    meaning: one line in words
    dtype: float64, int64, int8, bool or str; by default what the annotation (int, float, bool, str) says, else float64
    allow_nan: NaN is a legitimate value of this field (infinities never are)
    label: a few words for the axes of figures and the heads of tables; by default the field's name in words
    """
    dtype = "str" if dtype in (str, "str") else dtype and np.dtype(dtype).name
    return dataclasses.field(metadata={"quantity": Quantity(unit, dims, meaning, dtype, allow_nan, label)})


@dataclass_transform(frozen_default=True, field_specifiers=(quantity,))
def record(artifact_type: type) -> type:
    """Make a class of quantities an artifact type: a frozen dataclass whose `repr` is its `summary`."""
    artifact_type = dataclass(frozen=True, repr=False)(artifact_type)
    artifact_type.__repr__ = summary
    return artifact_type


def finite(values: Any) -> Any:
    """Return values as floats with NaN in place of infinities, which artifacts cannot hold."""
    values = np.asarray(values, dtype=float)
    return np.where(np.isfinite(values), values, np.nan)[()]


@cache
def quantities(artifact_type: type) -> dict[str, Quantity]:
    """Return the declared fields of an artifact type by name, with their types and labels.

    `inherited`, a dictionary of an artifact type, declares fields anew that it has from another one.

    Raises ArtifactError if it is no dataclass or if a field is not declared with `quantity`.
    """
    if not dataclasses.is_dataclass(artifact_type):
        raise ArtifactError(f"{artifact_type!r} is not an artifact type: make it a frozen dataclass of quantities")
    declared, inherited = {}, getattr(artifact_type, "inherited", {})
    for field in dataclasses.fields(artifact_type):
        if "quantity" not in field.metadata:
            raise ArtifactError(f"{artifact_type.__name__}.{field.name} has no unit: declare it with quantity(...)")
        described = inherited.get(field.name, field.metadata["quantity"])
        annotation = field.type if isinstance(field.type, str) else getattr(field.type, "__name__", "")
        declared[field.name] = dataclasses.replace(
            described,
            dtype=described.dtype or _DTYPE_OF_ANNOTATION.get(annotation, "float64"),
            label=described.label or field.name.replace("_", " "),
        )
    return declared


def schema_digest(artifact_type: type) -> str:
    """Return a short digest of the names, units, dimensions and types of an artifact type's fields."""
    declared = quantities(artifact_type)
    rows = sorted([name, field.unit, list(map(_shape, field.dims)), field.dtype] for name, field in declared.items())
    return hashlib.sha256(json.dumps(rows).encode()).hexdigest()[:16]


def _shape(dimension: str | int) -> str | int | list:
    """What a schema holds of a dimension."""
    return [dimension.name, *dimension.units.items()] if isinstance(dimension, Axis) else dimension


@dataclass(frozen=True)
class Layout:
    """How the dimensions of an artifact type's fields are called, and what is known of their components."""

    dims: dict[str, tuple[str, ...]]  # by field; a dimension that a field has twice has another name there: motion_2
    axes: dict[str, Axis | None]  # by dimension; None: its components have no names
    fields: frozenset[str]  # that hold the coordinates of a dimension, which has their name


@cache
def layout(artifact_type: type) -> Layout:
    """Return the names of the dimensions of an artifact type.

    Raises ArtifactError if a dimension has the name of a field that does not lie along it, or if two axes have the
    same name and other components.
    """
    declared = quantities(artifact_type)
    dims: dict[str, tuple[str, ...]] = {}
    axes: dict[str, Axis | None] = {}
    for field, described in declared.items():
        bases = [f"fixed_{d}" if type(d) is int else str(d) for d in described.dims]
        times = [bases[: place + 1].count(base) for place, base in enumerate(bases)]
        dims[field] = tuple(base if n == 1 else f"{base}_{n}" for base, n in zip(bases, times, strict=True))
        for name, dimension in zip(dims[field], described.dims, strict=True):
            axis = dimension if isinstance(dimension, Axis) else axes.get(name)
            if axis is not None and _shape(axes.get(name) or axis) != _shape(axis):
                where = f"{artifact_type.__name__}.{field}"
                raise ArtifactError(f"{where}: another axis is called '{name}' too: rename one")
            axes[name] = axis
    coordinates = frozenset(axes.keys() & declared.keys())
    for name in coordinates:
        if dims[name] != (name,) or axes[name] is not None:
            problem = "a dimension has the name of this field, which does not lie along it: rename one"
            raise ArtifactError(f"{artifact_type.__name__}.{name}: {problem}")
    return Layout(dims, axes, coordinates)
