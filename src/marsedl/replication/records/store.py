"""Typed artifacts of the stages, saved as self-explaining HDF5 files and never half written.

In the file every dimension is a dimension scale, as netCDF has them: `xarray.open_dataset(path)` gives labelled arrays,
`dataset["mean"].sel(motion="altitude")`.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from marsedl.replication.errors import ArtifactError
from marsedl.replication.files import write_bytes
from marsedl.replication.records.fields import Layout, Quantity, layout, quantities, schema_digest
from marsedl.replication.records.recipes import FORMAT

PROVENANCE = "provenance"  # the group of a file that holds it
COMPRESS_ABOVE_BYTES = 64 * 2**10
REBUILD = "delete it and run snakemake again: it is rebuilt"
_STORED = {"float64": "<f8", "int64": "<i8", "int8": "|i1", "bool": "|b1"}
_ACCEPTED_KINDS = {"float64": "fiu", "int64": "iu", "int8": "iu", "bool": "b"}
_JSON_MARK = "json:"
_BARE = b"This is a netCDF dimension but not a netCDF variable.%10d"  # what netCDF calls a scale without values
_SEAL = b"marsedl:sha256:"  # behind HDF5's own end of file, followed by the checksum of all bytes before it
_SEAL_BYTES = len(_SEAL) + hashlib.sha256().digest_size


def save(path: str | Path, artifact: Any, *, paper: str, reading: str, provenance: dict[str, Any]) -> None:
    """Write an artifact: entirely or not at all. Equal arguments give files of equal bytes.

    paper, reading: whose result it is; `load` compares them
    provenance: JSON-able items (digests, seeds, versions, solver) kept in /provenance, outside of all digests

    Raises ArtifactError naming file, type and field for a value that does not fit its declaration, and OSError naming
    the file when it cannot be written; an earlier file is then unchanged.
    """
    kind, arrays = type(artifact), _checked_values(path, artifact)
    # HDF5 builds the file in memory, because on a full disk HDF5 itself can crash the process. The oldest file format
    # is readable everywhere and stores no object times if asked. Where a dataset lies depends on when the one before it
    # is closed: when `dataset` becomes the next one.
    with h5py.File.in_memory(libver=("earliest", "v110"), track_order=False) as file:
        meaning = (kind.__doc__ or "").strip().partition("\n")[0]
        file.attrs.update({"artifact": kind.__name__, "paper": paper, "reading": reading, "meaning": meaning})
        file.attrs.update({"schema": schema_digest(kind), "format": FORMAT})
        for name, declared in sorted(quantities(kind).items()):
            array, options = arrays[name], {"track_times": False}
            if declared.dtype == "str" and array.nbytes <= COMPRESS_ABOVE_BYTES:
                array = array.astype(h5py.string_dtype())
            elif declared.dtype == "str":  # of fixed length, as HDF5 compresses no others
                array = np.char.encode(array, "utf-8")
                array = array.astype(h5py.string_dtype("utf-8", array.dtype.itemsize))
            if array.dtype.kind != "O" and array.nbytes > COMPRESS_ABOVE_BYTES:
                options |= {"chunks": True, "shuffle": True, "compression": "gzip", "compression_opts": 4}
            dataset = file.create_dataset(name, data=array, **options)
            words = {"units": declared.unit, "long_name": declared.label, "meaning": declared.meaning}
            dataset.attrs.update({**words, "dimensions": _spelled(declared.dims)})
        _write_scales(file, layout(kind))
        _write_provenance(file.create_group(PROVENANCE), provenance)
        file.flush()
        image = file.id.get_file_image()
    write_bytes(path, seal(image))


def load(path: str | Path, artifact_type: type, *, paper: str | None = None, reading: str | None = None) -> Any:
    """Read an artifact of a type back; its arrays are read-only.

    paper, reading: whose it must be (None: anyone's)

    Raises ArtifactError naming file, field and remedy for a file that is missing, damaged, of another type, paper,
    reading or layout.
    """
    with opened(path) as file:
        declared = quantities(artifact_type)
        expected = {"artifact": artifact_type.__name__, "paper": paper, "reading": reading}
        for key, value in expected.items():
            if value is not None and file.attrs[key] != value:
                raise _refusal(path, f"is of the {key} {file.attrs[key]!r}, not {value!r}")
        if file.attrs["format"] != FORMAT or file.attrs["schema"] != schema_digest(artifact_type):
            missing = ", ".join(name for name in sorted(declared) if not holds_field(file, name))
            hint = f" (it lacks {missing})" if missing else ""
            raise _refusal(path, f"was written by another version, whose fields differ from today's{hint}")
        texts = {name for name in declared if declared[name].dtype == "str"}
        arrays = {name: np.asarray((file[name].asstr() if name in texts else file[name])[()]) for name in declared}
    return _of_arrays(artifact_type, arrays | {name: _as_declared(arrays[name], "str") for name in texts})


def as_loaded(artifact: Any) -> Any:
    """Return an artifact as `load` gives it back after `save`, without a file; raises ArtifactError as `save` does."""
    return _of_arrays(type(artifact), _checked_values(type(artifact).__name__, artifact))


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


def provenance(path: str | Path) -> dict[str, Any]:
    """Return the provenance items with which an artifact was saved (tuples as lists); raises as `load` does."""
    with opened(path) as file:
        return _read_provenance(file[PROVENANCE])


def holds_field(file: h5py.File, name: str) -> bool:
    """Return whether a file holds a field of this name, and not only what is known of a dimension."""
    return name in file and "dimensions" in file[name].attrs


def seal(image: bytes) -> bytes:
    """Return the bytes of an HDF5 file with the checksum that ends an artifact; HDF5 takes no notice of it."""
    return image + _SEAL + hashlib.sha256(image).digest()


@contextmanager
def opened(path: str | Path) -> Iterator[h5py.File]:
    """Open an artifact's file for reading, after a check of its seal: HDF5 can crash or hang on a damaged file.

    Raises ArtifactError naming file and remedy if it is missing or not as it was written.
    """
    path, hasher = Path(path), hashlib.sha256()
    if not path.is_file():
        raise ArtifactError(f"{path}: the file does not exist: run snakemake to build it")
    with path.open("rb") as stream:
        end = max(path.stat().st_size - _SEAL_BYTES, 0)
        while block := stream.read(min(end - stream.tell(), 2**20)):
            hasher.update(block)
        if stream.read() != _SEAL + hasher.digest():
            raise _refusal(path, "is truncated or damaged, or was edited with other tools after it was written")
    # Files are replaced, never changed in place, so no lock is needed; some file systems have none.
    with h5py.File(path, "r", locking=False) as file:
        yield file


def _checked_values(path: str | Path, artifact: Any) -> dict[str, np.ndarray]:
    """The artifact's values as arrays of exactly the declared types, shapes and kinds of numbers."""
    kind = type(artifact)
    extents = {axis.name: int(axis) for axis in layout(kind).axes.values() if axis is not None}
    arrays = {}
    for name, declared in quantities(kind).items():
        try:
            arrays[name] = _as_declared(getattr(artifact, name), declared.dtype)
            _check_fit(arrays[name], declared, extents)
        except (ValueError, TypeError) as error:
            where = f"{path}: artifact {kind.__name__}, field '{name}'"
            raise ArtifactError(f"{where} {error}: fix the stage that computes it; nothing was written") from error
    return arrays


def _as_declared(value: Any, dtype: str) -> np.ndarray:
    """The value as an array of the declared type if no number changes by it; raises TypeError or ValueError."""
    array = np.asarray(value)
    if dtype == "str":
        items = array.ravel().tolist()
        if all(isinstance(item, str) for item in items):
            return np.array(items, dtype=str).reshape(array.shape)
    elif array.dtype.kind in _ACCEPTED_KINDS[dtype]:
        stored = array.astype(_STORED[dtype], order="C")
        if np.array_equal(stored, array, equal_nan=True):
            return stored
        raise ValueError(f"must be of type {dtype}: values of type {array.dtype} do not fit")
    raise TypeError(f"must be of type {dtype}: it is of type {array.dtype}")


def _check_fit(array: np.ndarray, declared: Quantity, extents: dict[str, int]) -> None:
    """Raise ValueError if a field's shape or a number does not fit; extents: of the dimensions met so far."""
    dims = declared.dims
    met = zip(dims, array.shape, strict=False)
    expected = tuple(int(dim) if isinstance(dim, int) else extents.setdefault(dim, extent) for dim, extent in met)
    if array.ndim != len(dims) or array.shape != expected:
        raise ValueError(f"has shape {array.shape}, but its dimensions {_spelled(dims)} have the extents {expected}")
    if array.dtype.kind == "f" and (invalid := np.isinf(array) if declared.allow_nan else ~np.isfinite(array)).any():
        first = tuple(int(index) for index in np.argwhere(invalid)[0])
        count = f"{np.count_nonzero(invalid)} of {array.size} values"
        raise ValueError(f"is not finite: {count}, the first {array[first]} at index {first}")


def _spelled(dims: tuple[str | int, ...]) -> str:
    return f"({', '.join(str(dimension) for dimension in dims)})" if dims else "scalar"


def _of_arrays(artifact_type: type, arrays: dict[str, np.ndarray]) -> Any:
    """An artifact of these arrays, which become read-only; scalars become plain Python values."""
    for array in arrays.values():
        array.setflags(write=False)
    return artifact_type(**{name: array if array.ndim else array.item() for name, array in arrays.items()})


def _write_scales(file: h5py.File, dimensions: Layout) -> None:
    """Make a dimension scale of every dimension and attach the fields to it.

    Names and units of components are text of variable length, which xarray wants; the file's attribute `coordinates`
    names the units. Dimensions without either are scales without values, as netCDF writes them: they take no room.
    """

    def described(name: str, meaning: str, values: list[str]) -> h5py.Dataset:
        dataset = file.create_dataset(name, data=values, dtype=h5py.string_dtype(), track_times=False)
        dataset.attrs["meaning"] = meaning
        return dataset

    with_units = []
    for name, axis in sorted(dimensions.axes.items()):
        if axis is not None:
            scale = described(name, f"names of the components of the dimension {name}", list(axis.names))
            scale.make_scale(name)
            if any(axis.units.values()):
                with_units.append(f"{name}_unit")
                meaning = f"units of the components of the dimension {name}"
                described(with_units[-1], meaning, list(axis.units.values())).dims[0].attach_scale(scale)
        elif name in dimensions.fields:
            file[name].make_scale(name)
        else:
            field = next(field for field, dims in dimensions.dims.items() if name in dims)
            extent = file[field].shape[dimensions.dims[field].index(name)]
            scale = file.create_dataset(name, (extent,), ">f4", track_times=False)  # as netCDF writes it
            scale.make_scale((_BARE % extent).decode())
    for field, dims in sorted(dimensions.dims.items()):
        for number, name in enumerate(dims):
            if name != field:
                file[field].dims[number].attach_scale(file[name])
    if with_units:
        file.attrs["coordinates"] = " ".join(with_units)


def _write_provenance(group: h5py.Group, items: dict[str, Any]) -> None:
    """Scalars and strings as attributes, dicts as subgroups, all else as a JSON string behind a mark."""
    for key, value in sorted(items.items()):
        if isinstance(value, dict):
            _write_provenance(group.create_group(key), value)
        elif isinstance(value, str | float | bool) or (isinstance(value, int) and value.bit_length() < 64):
            group.attrs[key] = value
        else:
            group.attrs[key] = _JSON_MARK + json.dumps(value, sort_keys=True)


def _read_provenance(group: h5py.Group) -> dict[str, Any]:
    items: dict[str, Any] = {name: _read_provenance(group[name]) for name in group}
    for key, value in group.attrs.items():
        if isinstance(value, str) and value.startswith(_JSON_MARK):
            items[key] = json.loads(value.removeprefix(_JSON_MARK))
        else:
            items[key] = value.item() if isinstance(value, np.generic) else value
    return items


def _refusal(path: str | Path, what: str) -> ArtifactError:
    return ArtifactError(f"{path}: {what}: {REBUILD}")
