"""Types of artifacts: arrays with unit, dimensions and a line of meaning per field."""

import dataclasses
import functools
import hashlib
import json
from dataclasses import dataclass
from typing import Any, dataclass_transform

import numpy as np

from marsedl.replication.errors import ArtifactError, nearest
from marsedl.summaries import value_range

PROVENANCE = "provenance"
STORED_DTYPES = {"float64": "<f8", "int64": "<i8", "int8": "|i1", "bool": "|b1"}
_DTYPE_OF_ANNOTATION = {"int": "int64", "float": "float64", "bool": "bool", "str": "str"}


class Axis(int):
    """A dimension of fixed extent whose components have names, and units if they differ or are fixed.

        MOTION = Axis("motion", downrange="m", altitude="m", downrange_velocity="m/s", vertical_velocity="m/s")
        LAW = Axis("law", "open", "closed")

    It is an integer, the number of its components, and serves as an extent in the dims of `quantity`:

        covariance: np.ndarray = quantity("SI", ("time", MOTION, MOTION), "predicted covariance")

    `name` is the dimension's, `names` are those of the components, `units` their units by name ("" where the field
    says them), `unit` all units as `quantity` takes them: `MOTION.unit` is "m, m, m/s, m/s". `MOTION.index("altitude")`
    is the place of a component, `MOTION.label("vertical_velocity")` its name in words. A further axis builds on
    another by `Axis("state", **MOTION.units, mass="kg")`.
    """

    name: str
    units: dict[str, str]

    def __new__(cls, name: str, /, *components: str, **units: str) -> "Axis":
        """Take the name of the dimension and the components: names alone, or names with units.

        Raises TypeError for components of equal names.
        """
        all_units = {**dict.fromkeys(components, ""), **units}
        if len(all_units) != len(components) + len(units):
            raise TypeError(f"axis {name!r} has components of equal names: {', '.join([*components, *units])}")
        axis = super().__new__(cls, len(all_units))
        axis.name, axis.units = name, all_units
        return axis

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, str]]:
        """Return what a copy is made from."""
        return (self.name,), self.units

    def __repr__(self) -> str:
        """Return the name: so the dimension is called in messages and files."""
        return self.name

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components, in their order."""
        return tuple(self.units)

    @property
    def unit(self) -> str:
        """Unit of values along this axis: one for all components, or one of each, separated by commas."""
        units = list(self.units.values())
        return units[0] if len(set(units)) == 1 else ", ".join(units)

    def index(self, component: str) -> int:
        """Place of a component. Raises ArtifactError naming the nearest one if there is none of this name."""
        if component not in self.units:
            raise ArtifactError(f"axis {self.name!r} has no component {component!r}: {nearest(component, self.units)}")
        return self.names.index(component)

    def label(self, component: str) -> str:
        """Name of a component in words. Raises ArtifactError as `index` does."""
        return self.names[self.index(component)].replace("_", " ")


@dataclass(frozen=True)
class Quantity:
    """Declaration of one field: its unit, dimensions, meaning, stored type and short label."""

    unit: str
    dims: tuple[str | int, ...]
    meaning: str
    dtype: str
    allow_nan: bool
    label: str


def quantity(
    unit: str,
    dims: tuple[str | int, ...],
    meaning: str,
    dtype: Any = None,
    *,
    allow_nan: bool = False,
    label: str = "",
) -> Any:
    """Declare a field of an artifact type.

    unit: of the values, "1" for pure numbers; one per component, separated by commas, where they differ
    dims: one entry per axis: a name, whose extent is the same in all fields of the artifact, an `Axis`, or a fixed
        extent; () for a scalar, which is loaded as a plain Python value
    meaning: one line in words
    dtype: float64, int64, int8, bool or str; by default what the annotation (int, float, bool, str) says, else float64
    allow_nan: NaN is a legitimate value of this field (infinities never are)
    label: a few words for the axes of figures and the heads of tables; by default the field's name in words

    Raises TypeError for dims or a dtype of another kind.
    """
    if not isinstance(dims, tuple) or not all(isinstance(extent, str | int) for extent in dims):
        raise TypeError(f"dims must be a tuple of names and fixed extents, not {dims!r}")
    name = "" if dtype is None else "str" if dtype in (str, "str") else np.dtype(dtype).name
    if name not in ("", "str", *STORED_DTYPES):
        raise TypeError(f"dtype must be one of str, {', '.join(STORED_DTYPES)}, not {dtype!r}")
    return dataclasses.field(metadata={"quantity": Quantity(unit, dims, meaning, name, allow_nan, label)})


@dataclass_transform(frozen_default=True, field_specifiers=(quantity,))
def record(artifact_type: type) -> type:
    """Make a class of quantities an artifact type: a frozen dataclass whose `repr` is its `summary`."""
    artifact_type = dataclass(frozen=True, repr=False)(artifact_type)
    artifact_type.__repr__ = summary
    return artifact_type


def summary(artifact: Any) -> str:
    """Return what an artifact holds: the shape, range and unit of every field, the value of a scalar."""
    artifact_type = type(artifact)
    rows = []
    for name, declared in quantities(artifact_type).items():
        array = np.asarray(getattr(artifact, name))
        extents = zip(layout(artifact_type).dims[name], array.shape, strict=False)
        shape = ", ".join(f"{dimension}: {extent}" for dimension, extent in extents)
        rows.append((f"  {name}", f"({shape})" if shape else "", value_range(array), declared.unit))
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    lines = [
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[3]]) for row in rows
    ]
    meaning = (artifact_type.__doc__ or "").strip().partition("\n")[0]
    return "\n".join([f"{artifact_type.__name__}: {meaning}", *lines])


TRIALS = "trials"  # the dimension along which single trials are kept


def trials_of(artifact: Any) -> int:
    """Return how many single trials an artifact keeps; 0 of one that keeps none."""
    if not dataclasses.is_dataclass(artifact):
        return 0
    for name, dims in layout(type(artifact)).dims.items():
        if TRIALS in dims:
            return int(np.shape(getattr(artifact, name))[dims.index(TRIALS)])
    return 0


def first_trials(artifact: Any, number: int) -> Any:
    """Return an artifact with its first trials; what is stored of all together stays."""
    if trials_of(artifact) <= number:
        return artifact
    fields = {
        name: np.take(getattr(artifact, name), range(number), axis=dims.index(TRIALS))
        for name, dims in layout(type(artifact)).dims.items()
        if TRIALS in dims
    }
    return dataclasses.replace(artifact, **fields)


def finite(values: Any) -> Any:
    """Return values as floats with NaN in place of infinities, which artifacts cannot hold."""
    values = np.asarray(values, dtype=float)
    return np.where(np.isfinite(values), values, np.nan)[()]


def quantities(artifact_type: type) -> dict[str, Quantity]:
    """The declared fields of an artifact type by name, with their types resolved.

    Raises ArtifactError if it is no dataclass or if a field is not declared with `quantity`.
    """
    if not dataclasses.is_dataclass(artifact_type):
        raise ArtifactError(f"{artifact_type!r} is not an artifact type: make it a frozen dataclass of quantities")
    declared = {}
    for field in dataclasses.fields(artifact_type):
        described = field.metadata.get("quantity")
        if described is None:
            raise ArtifactError(f"{artifact_type.__name__}.{field.name} has no unit: declare it with quantity(...)")
        if field.name == PROVENANCE:
            raise ArtifactError(f"{artifact_type.__name__}.{field.name}: this name is taken by the file's own group")
        if not described.dtype:
            annotation = field.type if isinstance(field.type, str) else getattr(field.type, "__name__", "")
            described = dataclasses.replace(described, dtype=_DTYPE_OF_ANNOTATION.get(annotation, "float64"))
        if not described.label:
            described = dataclasses.replace(described, label=field.name.replace("_", " "))
        declared[field.name] = described
    return declared


def schema_digest(artifact_type: type) -> str:
    """Short digest of the names, units, dimensions and types of an artifact type's fields."""
    rows = sorted([name, q.unit, [_shape(d) for d in q.dims], q.dtype] for name, q in quantities(artifact_type).items())
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

    @property
    def added(self) -> set[str]:
        """Names of what a file holds of the dimensions beside the fields: components, and their units."""
        units = {f"{name}_unit" for name, axis in self.axes.items() if axis is not None and any(axis.units.values())}
        return (self.axes.keys() - self.fields) | units


@functools.cache
def layout(artifact_type: type) -> Layout:
    """Return the names of the dimensions of an artifact type.

    Raises ArtifactError if a dimension has the name of a field that does not lie along it, or if two axes have the
    same name and other components.
    """
    declared = quantities(artifact_type)
    dims: dict[str, tuple[str, ...]] = {}
    axes: dict[str, Axis | None] = {}
    for field, described in declared.items():
        names: list[str] = []
        bases = [f"fixed_{d}" if type(d) is int else str(d) for d in described.dims]
        for number, dimension in enumerate(described.dims):
            axis = dimension if isinstance(dimension, Axis) else None
            times = bases[: number + 1].count(bases[number])
            name = bases[number] if times == 1 else f"{bases[number]}_{times}"
            axis_before = axes.get(name)
            if axis is not None and axis_before is not None and _shape(axis_before) != _shape(axis):
                raise ArtifactError(
                    f"{artifact_type.__name__}.{field}: another axis is called '{name}' too: rename one"
                )
            axes[name] = axis_before if axis is None else axis
            names.append(name)
        dims[field] = tuple(names)
    coordinate_fields = frozenset(name for name in axes if name in declared)
    result = Layout(dims, axes, coordinate_fields)
    for name in sorted(coordinate_fields | (result.added & declared.keys())):
        if dims[name] != (name,) or axes.get(name) is not None:
            raise ArtifactError(
                f"{artifact_type.__name__}: a dimension is described by '{name}', which is a field of another kind: "
                "rename the dimension"
            )
    return result
