"""Typed artifacts of the stages, saved as self-explaining HDF5 files and never half written.

An artifact type is a frozen dataclass whose fields are declared with `quantity`; what it shows of itself is a summary:

    @record
    class Nominal:
        \"\"\"Mass profile and mean trajectory.\"\"\"

        time: np.ndarray = quantity("s", ("time",), "time from the start of the flight")
        mean: np.ndarray = quantity(MOTION.unit, ("time", MOTION), "mean position and velocity", label="mean state")
        iterations: int = quantity("1", (), "passes of the mass iteration")

where the components of a dimension are named once:

    MOTION = Axis("motion", downrange="m", altitude="m", downrange_velocity="m/s", vertical_velocity="m/s")

In the file every dimension is a dimension scale, as netCDF has them: `xarray.open_dataset(path)` gives labelled arrays,
`dataset["mean"].sel(motion="altitude")`. A field that lies along a dimension of its own name holds its coordinates.
"""

import dataclasses
import errno
import functools
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, dataclass_transform

import h5py
import numpy as np

from marsedl.replication.errors import ArtifactError, nearest
from marsedl.replication.recipes import FORMAT, recipe_changes, recipe_digest
from marsedl.summaries import value_range

COMPRESS_ABOVE_BYTES = 64 * 2**10

REBUILD = "delete it and run snakemake again: it is rebuilt"
PROVENANCE = "provenance"

_STORED_DTYPES = {"float64": "<f8", "int64": "<i8", "int8": "|i1", "bool": "|b1"}
_DTYPE_OF_ANNOTATION = {"int": "int64", "float": "float64", "bool": "bool", "str": "str"}
_ACCEPTED_KINDS = {"float64": "fiu", "int64": "iu", "int8": "iu", "bool": "b"}
_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_NO_PERMISSION = (errno.EACCES, errno.EPERM, errno.EROFS)
_JSON_MARK = "json:"
_BARE = b"This is a netCDF dimension but not a netCDF variable.%10d"  # what netCDF calls a scale without values
_SEAL = b"marsedl:sha256:"  # behind HDF5's own end of file, followed by the checksum of all bytes before it
_SEAL_BYTES = len(_SEAL) + hashlib.sha256().digest_size


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
    if name not in ("", "str", *_STORED_DTYPES):
        raise TypeError(f"dtype must be one of str, {', '.join(_STORED_DTYPES)}, not {dtype!r}")
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


def save(path: str | Path, artifact: Any, *, paper: str, reading: str, provenance: dict[str, Any]) -> None:
    """Write an artifact: entirely or not at all.

    path: the HDF5 file; missing folders are made
    artifact: an instance of an artifact type
    paper, reading: whose result it is; `load` compares them
    provenance: JSON-able items (digests, seeds, versions, solver) kept in /provenance, outside of all digests

    Equal arguments give files of equal bytes. Raises ArtifactError naming file, type and field for a value that does
    not fit its declaration, and naming the file when it cannot be written; what was there before is then untouched.
    """
    path = Path(path)
    arrays = _checked_values(path, artifact)
    image = _file_image(path, artifact, arrays, paper, reading, provenance)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _replace(path, image)
    except OSError as error:
        raise _writing_error(path, error) from error


def load(path: str | Path, artifact_type: type, *, paper: str | None = None, reading: str | None = None) -> Any:
    """Read an artifact back; its arrays are read-only.

    path: the HDF5 file; artifact_type: the dataclass it must hold, or a direct subclass of which: that has all of its
    fields and more; paper, reading: whose it must be (None: anyone's)

    Raises ArtifactError naming file, field and remedy for a file that is missing, damaged, of another type, paper,
    reading or layout.
    """
    path = Path(path)
    with opened(path) as file:
        subclasses = {kind.__name__: kind for kind in artifact_type.__subclasses__()}
        artifact_type = subclasses.get(file.attrs.get("artifact"), artifact_type)
        _check_identity(path, file, artifact_type, paper, reading)
        arrays = {}
        for name, declared in quantities(artifact_type).items():
            text = declared.dtype == "str"
            arrays[name] = _as_text(np.asarray(file[name].asstr()[()])) if text else np.asarray(file[name][()])
    return _of_arrays(artifact_type, arrays)


def as_loaded(artifact: Any) -> Any:
    """Return an artifact as `load` gives it back after `save`, without a file: in its declared types, read-only.

    Raises ArtifactError as `save` does.
    """
    arrays = _checked_values(Path(type(artifact).__name__), artifact)
    return _of_arrays(type(artifact), {name: np.array(array, order="C") for name, array in arrays.items()})


def content_digest(artifact: Any) -> str:
    """Return the digest of an artifact's values: equal exactly where all bits, shapes and types are."""
    hasher = hashlib.sha256(schema_digest(type(artifact)).encode())
    for name in quantities(type(artifact)):
        array = np.asarray(getattr(artifact, name))
        hasher.update(f"{name} {array.dtype.str} {array.shape}".encode())
        hasher.update(np.ascontiguousarray(array).tobytes())
    return hasher.hexdigest()


def _of_arrays(artifact_type: type, arrays: dict[str, np.ndarray]) -> Any:
    """An artifact of these arrays, which become read-only; scalars become plain Python values."""
    values = {}
    for name, array in arrays.items():
        array.setflags(write=False)
        values[name] = array.item() if array.ndim == 0 else array
    return artifact_type(**values)


def check_recipe(path: str | Path, recipe: Mapping[str, Any], paper: str, reading: str) -> None:
    """Refuse an artifact of another paper or reading, or one that its rule would now make differently.

    recipe: what it would be made from now. Raises ArtifactError as `load` does, and naming what differs: a file that
    was copied here from a build of other inputs, code or libraries is whole, and may be older than what is made of it.
    """
    path = Path(path)
    with opened(path) as file:
        _check_owner(path, file, _short(file.attrs.get("artifact")).strip("'"), paper, reading)
        group = file[PROVENANCE]
        if group.attrs.get("recipe") == recipe_digest(recipe):
            return
        stored = _read_provenance(group)
        changes = "; ".join(recipe_changes(stored, recipe))
        raise _refusal(path, f"comes from another build, of size {_short(stored.get('size'))}: {changes}")


def seal(image: bytes) -> bytes:
    """The bytes of an HDF5 file with the checksum that ends an artifact; HDF5 takes no notice of it."""
    return image + _SEAL + hashlib.sha256(image).digest()


def provenance(path: str | Path) -> dict[str, Any]:
    """The provenance items with which an artifact was saved (tuples as lists). Raises ArtifactError as `load` does."""
    path = Path(path)
    with opened(path) as file:
        return _read_provenance(file[PROVENANCE])


def holds_field(file: h5py.File, name: str) -> bool:
    """Whether a file holds a field of this name, and not only what is known of a dimension."""
    return name in file and "dimensions" in file[name].attrs


@contextmanager
def opened(path: str | Path) -> Iterator[h5py.File]:
    """An artifact's file open for reading; whatever HDF5 says of a damaged one becomes an ArtifactError naming it.

    HDF5 never sees a file without the seal of `save`: damaged files can crash it.
    """
    path = Path(path)
    if not path.exists():
        raise ArtifactError(f"{path}: the file does not exist: run snakemake to build it")
    if not path.is_file():
        raise ArtifactError(f"{path}: is not a file: move it away and run snakemake again")
    _check_seal(path)
    try:
        # Files are replaced, never changed in place, so no lock is needed; some file systems have none.
        file = h5py.File(path, "r", locking=False)
    except Exception as error:
        raise _refusal(path, f"is truncated, damaged or not an HDF5 file ({_first_line(error)})") from error
    with file:
        try:
            yield file
        except ArtifactError:
            raise
        except Exception as error:
            raise _refusal(path, f"is damaged ({_first_line(error)})") from error


# ---------------------------------------------------------------------------------------------------------- checking


def _checked_values(path: Path, artifact: Any) -> dict[str, np.ndarray]:
    """The artifact's values as arrays of exactly the declared types."""
    artifact_type = type(artifact)
    remedy = "fix the stage that computes it; nothing was written"
    arrays = {}
    for name, declared in quantities(artifact_type).items():
        where = f"{path}: artifact {artifact_type.__name__}, field '{name}'"
        value = getattr(artifact, name, None)
        if value is None:
            raise ArtifactError(f"{where} is missing: {remedy}")
        if isinstance(value, np.ma.MaskedArray):
            raise ArtifactError(f"{where} is a masked array, whose mask would be lost: {remedy}")
        try:
            arrays[name] = _as_declared(np.asarray(value), declared.dtype)
        except (ValueError, TypeError) as error:
            raise ArtifactError(f"{where} must be of type {declared.dtype}: {_first_line(error)}: {remedy}") from error
    _check_shapes(path, artifact_type, {name: array.shape for name, array in arrays.items()}, remedy)
    _check_values(path, artifact_type, arrays, remedy)
    return arrays


def _as_declared(array: np.ndarray, dtype: str) -> np.ndarray:
    """The array in the declared type if no value changes by it; raises TypeError or ValueError."""
    if dtype == "str":
        return _as_text(array)
    if array.dtype.kind not in _ACCEPTED_KINDS[dtype]:
        raise TypeError(f"it is of type {array.dtype}")
    if array.dtype.kind == "f" and array.dtype.itemsize > 8:
        raise TypeError(f"it is of type {array.dtype}, which would be rounded")
    if array.dtype.kind in "iu" and dtype in ("int64", "int8") and array.size:
        limits = np.iinfo(dtype)
        if int(array.min()) < limits.min or int(array.max()) > limits.max:
            raise ValueError(f"values from {array.min()} to {array.max()} do not fit")
    return array.astype(_STORED_DTYPES[dtype])


def _as_text(array: np.ndarray) -> np.ndarray:
    """An array of strings as numpy's own fixed-width strings; raises TypeError or ValueError."""
    items = array.ravel().tolist()
    # An empty list of strings has numpy's default type, float64.
    if (array.dtype.kind not in "UOT" and array.size) or not all(isinstance(item, str) for item in items):
        raise TypeError(f"it is of type {array.dtype}")
    if any("\0" in item for item in items):
        raise ValueError("it contains the character NUL, which HDF5 strings cannot hold")
    for item in items:
        item.encode()  # lone surrogates fail here, with their position
    return np.array(items, dtype=str).reshape(array.shape)


def _check_shapes(path: Path, artifact_type: type, shapes: Mapping[str, tuple], remedy: str) -> None:
    """Raise ArtifactError for the first field whose shape does not fit the declaration."""
    axes = {axis.name: axis for axis in layout(artifact_type).axes.values() if axis is not None}
    extents: dict[str, tuple[int, str]] = {name: (int(axis), "as declared") for name, axis in axes.items()}
    for name, declared in quantities(artifact_type).items():
        shape = shapes[name]
        where = f"{path}: artifact {artifact_type.__name__}, field '{name}'"
        if len(shape) != len(declared.dims):
            raise ArtifactError(f"{where} has shape {shape} but its dimensions are {_spelled(declared.dims)}: {remedy}")
        for dimension, extent in zip(declared.dims, shape, strict=True):
            if isinstance(dimension, int):
                expected, origin = int(dimension), "as declared"
            else:
                expected, origin = extents.setdefault(dimension, (extent, f"as in field '{name}'"))
            if extent != expected:
                raise ArtifactError(
                    f"{where} has shape {shape} but its dimensions are {_spelled(declared.dims)}, "
                    f"where {dimension} is {expected} {origin}: {remedy}"
                )


def _check_values(path: Path, artifact_type: type, arrays: Mapping[str, np.ndarray], remedy: str) -> None:
    """Raise ArtifactError for the first array with a number that is not finite and may not be so."""
    for name, declared in quantities(artifact_type).items():
        array = arrays[name]
        if array.dtype.kind == "f":
            invalid = np.isinf(array) if declared.allow_nan else ~np.isfinite(array)
            if invalid.any():
                first = tuple(int(index) for index in np.argwhere(invalid)[0])
                raise ArtifactError(
                    f"{path}: artifact {artifact_type.__name__}, field '{name}' is not finite: "
                    f"{np.count_nonzero(invalid)} of {array.size} values, the first {array[first]} at index {first}: "
                    f"{remedy}"
                )


def _spelled(dims: tuple[str | int, ...]) -> str:
    return f"({', '.join(str(dimension) for dimension in dims)})" if dims else "scalar"


# ----------------------------------------------------------------------------------------------------------- writing


def _file_image(
    path: Path, artifact: Any, arrays: dict[str, np.ndarray], paper: str, reading: str, provenance: dict[str, Any]
) -> bytes:
    """The bytes of the HDF5 file.

    HDF5 builds it in memory, because on a full disk HDF5 itself can crash the process.
    """
    artifact_type = type(artifact)
    declared = quantities(artifact_type)
    # The oldest file format is readable everywhere and stores no object times if asked.
    with h5py.File(
        _partial_path(path), "w", driver="core", backing_store=False, libver=("earliest", "v110"), track_order=False
    ) as file:
        file.attrs["artifact"] = artifact_type.__name__
        file.attrs["paper"] = paper
        file.attrs["reading"] = reading
        file.attrs["meaning"] = (artifact_type.__doc__ or "").strip().partition("\n")[0]
        file.attrs["schema"] = schema_digest(artifact_type)
        file.attrs["format"] = FORMAT
        for name in sorted(arrays):
            array = arrays[name]
            options: dict[str, Any] = {"track_times": False}
            if array.dtype.kind == "U":
                array = array.astype(h5py.string_dtype())
            elif array.nbytes > COMPRESS_ABOVE_BYTES and array.ndim:
                options.update(chunks=True, shuffle=True, compression="gzip", compression_opts=4)
            dataset = file.create_dataset(name, data=array, **options)
            dataset.attrs["units"] = declared[name].unit
            dataset.attrs["long_name"] = declared[name].label
            dataset.attrs["meaning"] = declared[name].meaning
            dataset.attrs["dimensions"] = _spelled(declared[name].dims)
        _write_scales(file, layout(artifact_type))
        _write_provenance(path, file.create_group(PROVENANCE), provenance)
        file.flush()
        image = file.id.get_file_image()
    return seal(image)


def _write_scales(file: h5py.File, dimensions: Layout) -> None:
    """Make a dimension scale of every dimension and attach the fields to them.

    What is known of the components are their names and units, text of variable length, which xarray wants. The others
    are scales without values, as netCDF writes them: they take no room. The file's attribute `coordinates` says which
    datasets describe others.
    """
    extents = {
        name: extent
        for field, names in dimensions.dims.items()
        for name, extent in zip(names, file[field].shape, strict=True)
    }
    described = []
    for name, axis in sorted(dimensions.axes.items()):
        if axis is not None:
            scale = file.create_dataset(name, data=list(axis.units), dtype=h5py.string_dtype(), track_times=False)
            scale.attrs["meaning"] = f"names of the components of the dimension {name}"
            scale.make_scale(name)
            if any(axis.units.values()):
                described.append(f"{name}_unit")
                units = list(axis.units.values())
                unit = file.create_dataset(described[-1], data=units, dtype=h5py.string_dtype(), track_times=False)
                unit.attrs["meaning"] = f"units of the components of the dimension {name}"
                unit.dims[0].attach_scale(scale)
        elif name in dimensions.fields:
            file[name].make_scale(name)
        else:
            # The type is the one that netCDF uses for it.
            scale = file.create_dataset(name, (extents[name],), ">f4", track_times=False)
            scale.make_scale((_BARE % extents[name]).decode())
    for field in sorted(dimensions.dims):
        for number, name in enumerate(dimensions.dims[field]):
            if name != field:
                file[field].dims[number].attach_scale(file[name])
    if described:
        file.attrs["coordinates"] = " ".join(described)


def _write_provenance(path: Path, group: h5py.Group, items: dict[str, Any]) -> None:
    """Scalars and strings as attributes, dicts as subgroups, all else as a JSON string behind a mark."""
    for key in sorted(items, key=str):
        where = f"{path}: {group.name}/{key}"
        value = items[key]
        if not isinstance(key, str) or not key or "\0" in key:
            raise ArtifactError(f"{where}: a provenance item needs a name that is a string")
        if isinstance(value, np.ndarray | np.generic):
            value = value.tolist()
        if isinstance(value, dict) and "/" not in key and key not in (".", ".."):
            _write_provenance(path, group.create_group(key), value)
            continue
        plain = isinstance(value, float | bool) or (isinstance(value, int) and -(2**63) <= value < 2**63)
        if isinstance(value, str):
            plain = not value.startswith(_JSON_MARK) and "\0" not in value
        try:
            group.attrs[key] = value if plain else _JSON_MARK + json.dumps(value, sort_keys=True)
        except (TypeError, ValueError) as error:
            raise ArtifactError(f"{where}: {_first_line(error)}: provenance holds only what JSON can hold") from error


def _partial_path(path: Path) -> Path:
    return path.with_name(f".{path.name}.partial")


def _replace(path: Path, image: bytes) -> None:
    """Write a partial file beside `path`, flush it to disk, and only then rename it."""
    partial = _partial_path(path)
    try:
        with partial.open("wb") as stream:
            stream.write(image)
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def _writing_error(path: Path, error: OSError) -> ArtifactError:
    if error.errno in _NO_SPACE:
        reason = f"cannot be written, there is no space left ({error.strerror}): free space and run again"
    elif error.errno in _NO_PERMISSION:
        reason = f"cannot be written ({error.strerror}): change the permissions of its folder and run again"
    else:
        reason = f"cannot be written ({_first_line(error)}): remove the cause and run again"
    return ArtifactError(f"{path}: {reason}; the earlier file is unchanged")


# ----------------------------------------------------------------------------------------------------------- reading


def _check_seal(path: Path) -> None:
    """Raise ArtifactError if the file has no seal, or if its bytes are not those that were sealed.

    HDF5 can crash or hang on damaged files, so this comes before HDF5 sees the file. A file that was truncated, or
    edited with other tools, has no seal.
    """
    hasher = hashlib.sha256()
    try:
        with path.open("rb") as stream:
            remaining = path.stat().st_size - _SEAL_BYTES
            while remaining > 0 and (block := stream.read(min(remaining, 2**20))):
                hasher.update(block)
                remaining -= len(block)
            seal = stream.read(_SEAL_BYTES)
    except PermissionError as error:
        raise ArtifactError(f"{path}: cannot be read: change its permissions") from error
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be read ({error.strerror}): remove the cause and run again") from error
    if not seal.startswith(_SEAL):
        raise _refusal(path, "is truncated or damaged, or was edited with other tools after it was written")
    if seal != _SEAL + hasher.digest():
        raise _refusal(path, "is damaged: its bytes differ from what was written")


def _check_identity(path: Path, file: h5py.File, artifact_type: type, paper: str | None, reading: str | None) -> None:
    """Raise ArtifactError unless the file says that it is this artifact of this paper and reading in this layout."""
    name = artifact_type.__name__
    identity = {key: file.attrs.get(key) for key in ("artifact", "format", "schema")}
    if identity["artifact"] != name:
        raise _refusal(path, f"holds the artifact {_short(identity['artifact'])}, not {name!r}")
    _check_owner(path, file, name, paper, reading)
    if identity["format"] != FORMAT or identity["schema"] != schema_digest(artifact_type):
        missing = sorted(name for name in quantities(artifact_type) if not holds_field(file, name))
        hint = f" (it lacks {', '.join(missing)})" if missing else ""
        raise _refusal(path, f"artifact {name} was written by another version, whose fields differ from today's{hint}")


def _check_owner(path: Path, file: h5py.File, name: str, paper: str | None, reading: str | None) -> None:
    for key, expected in (("paper", paper), ("reading", reading)):
        owner = file.attrs.get(key)
        if expected is not None and owner != expected:
            raise _refusal(path, f"artifact {name} is of the {key} {_short(owner)}, not {expected!r}")


def _read_provenance(group: h5py.Group) -> dict[str, Any]:
    items: dict[str, Any] = {}
    for key, value in group.attrs.items():
        if isinstance(value, str) and value.startswith(_JSON_MARK):
            items[key] = json.loads(value.removeprefix(_JSON_MARK))
        else:
            items[key] = value.item() if isinstance(value, np.generic) else value
    for name in group:
        items[name] = _read_provenance(group[name])
    return items


def _refusal(path: Path, what: str) -> ArtifactError:
    return ArtifactError(f"{path}: {what}: {REBUILD}")


def _short(value: object) -> str:
    """A short text, in one line, of a value that a file holds."""
    text = repr(value).replace("\n", " ")
    return text if len(text) <= 80 else text[:77] + "..."


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).partition("\n")[0]
