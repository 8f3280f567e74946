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

import errno
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from marsedl.replication.errors import ArtifactError, shown
from marsedl.replication.records.fields import PROVENANCE, STORED_DTYPES, Layout, layout, quantities, schema_digest
from marsedl.replication.records.recipes import FORMAT, recipe_changes, recipe_digest

COMPRESS_ABOVE_BYTES = 64 * 2**10
REBUILD = "delete it and run snakemake again: it is rebuilt"
_ACCEPTED_KINDS = {"float64": "fiu", "int64": "iu", "int8": "iu", "bool": "b"}
_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_NO_PERMISSION = (errno.EACCES, errno.EPERM, errno.EROFS)
_JSON_MARK = "json:"
_BARE = b"This is a netCDF dimension but not a netCDF variable.%10d"  # what netCDF calls a scale without values
_SEAL = b"marsedl:sha256:"  # behind HDF5's own end of file, followed by the checksum of all bytes before it
_SEAL_BYTES = len(_SEAL) + hashlib.sha256().digest_size


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
        artifact_type = subclasses.get(file.attrs["artifact"], artifact_type)
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
    """Return the digest of an artifact's fields: it sees values, shapes and declarations."""
    fields = {name: np.asarray(getattr(artifact, name)) for name in quantities(type(artifact))}
    return arrays_digest({schema_digest(type(artifact)): None, **fields})


def arrays_digest(content: Mapping[str, np.ndarray | None]) -> str:
    """Return the digest of named arrays, in their order: 64 hexadecimal digits. A name alone, with None, counts too."""
    hasher = hashlib.sha256()
    for name, array in content.items():
        if array is None:
            hasher.update(f"{name}\n".encode())
        else:
            dtype, data = canonical(array)
            hasher.update(f"{name} {dtype} {array.shape} {len(data)}\n".encode())
            hasher.update(data)
    return hasher.hexdigest()


def canonical(array: np.ndarray) -> tuple[str, bytes]:
    """Return type and bytes of an array, the same on every machine: little-endian, one NaN, strings as JSON."""
    if array.dtype.kind in "SUTO":
        items = [item.decode() if isinstance(item, bytes) else item for item in array.ravel().tolist()]
        return "str", json.dumps(items).encode()
    array = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    if array.dtype.kind == "f" and np.isnan(array).any():
        array = np.where(np.isnan(array), np.array(np.nan, array.dtype), array)
    return array.dtype.str, array.tobytes()


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
        _check_owner(path, file, paper, reading)
        stored = _read_provenance(file[PROVENANCE])
    if stored.get("recipe") != recipe_digest(recipe):
        changes = "; ".join(recipe_changes(stored, recipe))
        raise _refusal(path, f"comes from another build, of size {shown(stored.get('size'))}: {changes}")


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
    """An artifact's file open for reading, after a check of its seal: HDF5 can crash or hang on a damaged file.

    Raises ArtifactError naming file and remedy if it is missing, is not a file, or is not as it was written.
    """
    path = Path(path)
    if not path.exists():
        raise ArtifactError(f"{path}: the file does not exist: run snakemake to build it")
    if not path.is_file():
        raise ArtifactError(f"{path}: is not a file: move it away and run snakemake again")
    _check_seal(path)
    # Files are replaced, never changed in place, so no lock is needed; some file systems have none.
    with h5py.File(path, "r", locking=False) as file:
        yield file


def _checked_values(path: Path, artifact: Any) -> dict[str, np.ndarray]:
    """The artifact's values as arrays of exactly the declared types, shapes and kinds of numbers."""
    kind = type(artifact)
    extents = {axis.name: (int(axis), "as declared") for axis in layout(kind).axes.values() if axis is not None}
    arrays = {}
    for name, declared in quantities(kind).items():
        try:
            arrays[name] = _as_declared(getattr(artifact, name, None), declared.dtype)
            _check_shape(name, arrays[name].shape, declared.dims, extents)
            _check_finite(arrays[name], declared.allow_nan)
        except (ValueError, TypeError) as error:
            where, remedy = f"{path}: artifact {kind.__name__}, field '{name}'", "fix the stage that computes it"
            raise ArtifactError(f"{where} {_first_line(error)}: {remedy}; nothing was written") from error
    return arrays


def _as_declared(value: Any, dtype: str) -> np.ndarray:
    """The value as an array of the declared type if no number changes by it; raises TypeError or ValueError."""
    if value is None:
        raise ValueError("is missing")
    if isinstance(value, np.ma.MaskedArray):
        raise TypeError("is a masked array, whose mask would be lost")
    array = np.asarray(value)
    if dtype == "str":
        return _as_text(array)
    if array.dtype.kind not in _ACCEPTED_KINDS[dtype]:
        raise TypeError(f"must be of type {dtype}: it is of type {array.dtype}")
    if array.dtype.kind == "f" and array.dtype.itemsize > 8:
        raise TypeError(f"must be of type {dtype}: it is of type {array.dtype}, which would be rounded")
    if dtype in ("int64", "int8") and array.size:
        limits, least, most = np.iinfo(dtype), int(array.min()), int(array.max())
        if least < limits.min or most > limits.max:
            raise ValueError(f"must be of type {dtype}: values from {least} to {most} do not fit")
    return array.astype(STORED_DTYPES[dtype])


def _as_text(array: np.ndarray) -> np.ndarray:
    """An array of strings as numpy's own fixed-width strings; raises TypeError or ValueError."""
    items = array.ravel().tolist()
    # An empty list of strings has numpy's default type, float64.
    if (array.dtype.kind not in "UOT" and array.size) or not all(isinstance(item, str) for item in items):
        raise TypeError(f"must be of type str: it is of type {array.dtype}")
    try:
        "".join(items).encode()
    except UnicodeEncodeError as error:  # a lone surrogate
        raise ValueError(f"must be of type str: {error}") from None
    if any("\0" in item for item in items):
        raise ValueError("must be of type str: it contains the character NUL, which HDF5 strings cannot hold")
    return np.array(items, dtype=str).reshape(array.shape)


def _check_shape(name: str, shape: tuple, dims: tuple[str | int, ...], extents: dict[str, tuple[int, str]]) -> None:
    """Raise ValueError if a field's shape does not fit; extents: of the dimensions met so far, with their origins."""
    mismatch = f"has shape {shape} but its dimensions are {_spelled(dims)}"
    if len(shape) != len(dims):
        raise ValueError(mismatch)
    for dimension, extent in zip(dims, shape, strict=True):
        if isinstance(dimension, int):
            expected, origin = int(dimension), "as declared"
        else:
            expected, origin = extents.setdefault(dimension, (extent, f"as in field '{name}'"))
        if extent != expected:
            raise ValueError(f"{mismatch}, where {dimension} is {expected} {origin}")


def _check_finite(array: np.ndarray, allow_nan: bool) -> None:
    """Raise ValueError for the first number that is not finite and may not be so."""
    if array.dtype.kind == "f":
        invalid = np.isinf(array) if allow_nan else ~np.isfinite(array)
        if invalid.any():
            first = tuple(int(index) for index in np.argwhere(invalid)[0])
            count = f"{np.count_nonzero(invalid)} of {array.size} values"
            raise ValueError(f"is not finite: {count}, the first {array[first]} at index {first}")


def _spelled(dims: tuple[str | int, ...]) -> str:
    return f"({', '.join(str(dimension) for dimension in dims)})" if dims else "scalar"


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
    for key, value in sorted(items.items()):
        value = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        if isinstance(value, dict):
            _write_provenance(path, group.create_group(key), value)
            continue
        plain = isinstance(value, str | float | bool) or (isinstance(value, int) and -(2**63) <= value < 2**63)
        try:
            group.attrs[key] = value if plain else _JSON_MARK + json.dumps(value, sort_keys=True)
        except (TypeError, ValueError) as error:
            raise ArtifactError(
                f"{path}: {group.name}/{key}: {_first_line(error)}: provenance holds only what JSON can hold"
            ) from error


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


def _check_seal(path: Path) -> None:
    """Raise ArtifactError if the file has no seal, or if its bytes are not those that were sealed.

    A file that was truncated, or edited with other tools, has no seal.
    """
    hasher = hashlib.sha256()
    try:
        with path.open("rb") as stream:
            remaining = path.stat().st_size - _SEAL_BYTES
            while remaining > 0 and (block := stream.read(min(remaining, 2**20))):
                hasher.update(block)
                remaining -= len(block)
            seal = stream.read(_SEAL_BYTES)
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be read ({error.strerror}): remove the cause and run again") from error
    if not seal.startswith(_SEAL):
        raise _refusal(path, "is truncated or damaged, or was edited with other tools after it was written")
    if seal != _SEAL + hasher.digest():
        raise _refusal(path, "is damaged: its bytes differ from what was written")


def _check_identity(path: Path, file: h5py.File, artifact_type: type, paper: str | None, reading: str | None) -> None:
    """Raise ArtifactError unless the file says that it is this artifact of this paper and reading in this layout."""
    name, stored = artifact_type.__name__, file.attrs
    if stored["artifact"] != name:
        raise _refusal(path, f"holds the artifact {stored['artifact']!r}, not {name!r}")
    _check_owner(path, file, paper, reading)
    if stored["format"] != FORMAT or stored["schema"] != schema_digest(artifact_type):
        missing = sorted(name for name in quantities(artifact_type) if not holds_field(file, name))
        hint = f" (it lacks {', '.join(missing)})" if missing else ""
        raise _refusal(path, f"artifact {name} was written by another version, whose fields differ from today's{hint}")


def _check_owner(path: Path, file: h5py.File, paper: str | None, reading: str | None) -> None:
    for key, expected in (("paper", paper), ("reading", reading)):
        if expected is not None and file.attrs[key] != expected:
            kind = file.attrs["artifact"]
            raise _refusal(path, f"artifact {kind} is of the {key} {file.attrs[key]!r}, not {expected!r}")


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


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).partition("\n")[0]
