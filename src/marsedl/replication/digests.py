"""Digests of the content of product files, and the differences between two products."""

import csv
import hashlib
import io
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from marsedl.replication.artifacts import PROVENANCE, opened
from marsedl.replication.errors import InputError

HDF5_SUFFIXES = (".h5", ".hdf5")


@dataclass(frozen=True)
class Difference:
    """One row of a comparison: where two products differ, and by how much if they differ in numbers."""

    file: str  # path relative to the compared folders, or the first file's path
    field: str  # dataset, attribute, column or key; "" for the file as a whole
    what: str
    absolute: float | None = None  # greatest |a - b|
    relative: float | None = None  # greatest |a - b| / max(|a|, |b|)
    place: str = ""  # where the greatest absolute (else the first) difference is


def digest(path: str | Path) -> str:
    """SHA-256 of a product file, as 64 hexadecimal digits.

    Of HDF5: paths, types, shapes, values and attributes, whatever the compression or byte order, without /provenance
    and without the artifact's line of meaning (a docstring, and editing docstrings rebuilds nothing). What a field's
    dimensions are called counts, by the names of the scales. Of others: bytes.

    Raises InputError if there is no such file, ArtifactError if an HDF5 file is damaged.
    """
    path = _existing_file(path)
    hasher = hashlib.sha256()
    if path.suffix in HDF5_SUFFIXES:
        for name, array in _hdf5_content(path).items():
            if array is None:
                hasher.update(f"{name}\n".encode())
                continue
            dtype, data = _canonical(array)
            hasher.update(f"{name} {dtype} {array.shape} {len(data)}\n".encode())
            hasher.update(data)
    else:
        with path.open("rb") as stream:
            while block := stream.read(2**20):
                hasher.update(block)
    return hasher.hexdigest()


def digest_tree(folder: str | Path, patterns: Iterable[str]) -> dict[str, str]:
    """Digests of all files in `folder` that match one of the glob patterns ("**/*.h5"), by sorted relative path."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: the folder does not exist: name one that holds products")
    paths = {path for pattern in patterns for path in folder.glob(pattern) if path.is_file()}
    return {name: digest(path) for name, path in sorted((path.relative_to(folder).as_posix(), path) for path in paths)}


def difference(a: str | Path, b: str | Path) -> list[Difference]:
    """What differs between two files of one kind, or between two folders; an empty list if nothing does.

    HDF5 is compared by dataset and attribute (what `digest` counts), JSON by key, CSV by column, all else by bytes.
    Raises InputError if one of them is missing or if one is a folder and the other is not.
    """
    a, b = Path(a), Path(b)
    if a.is_dir() and b.is_dir():
        return _folder_difference(a, b)
    if a.is_dir() != b.is_dir() and a.exists() and b.exists():
        raise InputError(f"{a} and {b}: one is a folder and the other a file: name two files or two folders")
    return _file_difference(_existing_file(a), _existing_file(b), str(a))


def format_difference(rows: list[Difference]) -> str:
    """The rows of `difference` as text for a person, one line each."""
    if not rows:
        return "no difference"
    lines = []
    for row in rows:
        line = f"{row.file}: {row.field}: {row.what}" if row.field else f"{row.file}: {row.what}"
        if row.absolute is not None:
            line += f", at most {row.absolute:.3g} (relative {row.relative:.3g})"
        lines.append(f"{line}, at {row.place}" if row.place else line)
    return "\n".join(lines)


def _canonical(array: np.ndarray) -> tuple[str, bytes]:
    """Type name and bytes of an array, the same on every machine: little-endian, C order, one NaN, strings as JSON.

    Raises TypeError for object references and other types that mean nothing outside of their file.
    """
    if array.dtype.kind in "SUTO":
        items = [_text(item) for item in array.ravel().tolist()]
        if not all(isinstance(item, str) for item in items):
            raise TypeError(f"values of type {array.dtype} cannot be compared")
        return "str", json.dumps(items).encode()
    if array.dtype.hasobject:
        raise TypeError(f"values of type {array.dtype} cannot be compared")
    dtype = array.dtype.newbyteorder("<")
    array = np.ascontiguousarray(array, dtype=dtype)
    if dtype.kind == "f" and np.isnan(array).any():
        array = np.where(np.isnan(array), np.array(np.nan, dtype), array)
    return str(dtype.descr if dtype.fields else dtype.str), array.tobytes()


def _text(item: Any) -> Any:
    return item.decode("utf-8") if isinstance(item, bytes) else item


def _existing_file(path: str | Path) -> Path:
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: the file does not exist: build it first, or correct the name")
    return path


def _hdf5_content(path: Path) -> dict[str, np.ndarray | None]:
    """Datasets ("/x"), attributes ("/x@unit") and groups ("/g/", None), in canonical order."""
    content: dict[str, np.ndarray | None] = {}

    def add_attributes(node: h5py.Group | h5py.Dataset, name: str) -> None:
        for key in sorted(node.attrs):
            if key == "REFERENCE_LIST":  # of a scale: what DIMENSION_LIST of the fields says, the other way round
                continue
            value = node.attrs[key]
            if key == "DIMENSION_LIST":
                value = [_text(h5py.h5r.get_name(scale, node.id)) for scales in value for scale in scales]
            if isinstance(value, h5py.Empty):
                value = ""
            content[f"{name}@{key}"] = np.asarray(value, dtype=object if isinstance(value, str | bytes) else None)

    def add(node: h5py.Group | h5py.Dataset, name: str) -> None:
        if isinstance(node, h5py.Dataset):
            content[name] = np.array(node.shape) if _is_bare_scale(node) else np.asarray(node[()])
        else:
            content[f"{name}/"] = None
            for key in sorted(node):
                if (name, key) != ("", PROVENANCE):
                    add(node[key], f"{name}/{key}")
        add_attributes(node, name)

    with opened(path) as file:
        add(file, "")
        content.pop("@meaning", None)
        for array in content.values():
            if array is not None and array.dtype.hasobject:
                _canonical(array)  # refuses object references while the file's name is at hand
    return content


def _is_bare_scale(dataset: h5py.Dataset) -> bool:
    """Whether a dataset is a dimension scale without values, which has nothing but its extent."""
    return dataset.attrs.get("CLASS") == b"DIMENSION_SCALE" and dataset.id.get_storage_size() == 0


def _folder_difference(a: Path, b: Path) -> list[Difference]:
    in_a, in_b = ({path.relative_to(top).as_posix() for path in top.rglob("*") if path.is_file()} for top in (a, b))
    rows = []
    for name in sorted(in_a | in_b):
        if name not in in_b:
            rows.append(Difference(name, "", f"only in {a}"))
        elif name not in in_a:
            rows.append(Difference(name, "", f"only in {b}"))
        else:
            rows += _file_difference(a / name, b / name, name)
    return rows


def _file_difference(a: Path, b: Path, name: str) -> list[Difference]:
    if {a.suffix, b.suffix} <= set(HDF5_SUFFIXES):
        return _hdf5_difference(a, b, name)
    bytes_a, bytes_b = a.read_bytes(), b.read_bytes()
    if bytes_a == bytes_b:
        return []
    read_leaves = {".json": _json_leaves, ".csv": _csv_leaves}.get(a.suffix)
    if read_leaves and a.suffix == b.suffix:
        try:
            rows = _leaf_difference(name, read_leaves(bytes_a), read_leaves(bytes_b))
        except (ValueError, csv.Error) as error:
            return [Difference(name, "", f"bytes differ (not readable as {a.suffix[1:]}: {error})")]
        return rows or [Difference(name, "", "same content, written differently")]
    return [Difference(name, "", f"bytes differ ({len(bytes_a)} and {len(bytes_b)} bytes)")]


def _hdf5_difference(a: Path, b: Path, name: str) -> list[Difference]:
    content_a, content_b = _hdf5_content(a), _hdf5_content(b)
    rows = []
    for field in sorted(content_a.keys() | content_b.keys()):
        if field not in content_b or field not in content_a:
            rows.append(Difference(name, field, f"only in {a if field in content_a else b}"))
            continue
        array_a, array_b = content_a[field], content_b[field]
        if array_a is None or array_b is None:
            continue  # groups
        (dtype_a, data_a), (dtype_b, data_b) = _canonical(array_a), _canonical(array_b)
        if dtype_a != dtype_b:
            rows.append(Difference(name, field, f"type {dtype_a} and {dtype_b}"))
        elif array_a.shape != array_b.shape:
            rows.append(Difference(name, field, f"shape {array_a.shape} and {array_b.shape}"))
        elif data_a != data_b:
            rows.append(_array_difference(name, field, array_a, array_b))
    return rows


def _array_difference(name: str, field: str, a: np.ndarray, b: np.ndarray) -> Difference:
    """The row for two arrays of equal type and shape but unequal values."""
    if a.dtype.kind in "iuf":
        wide_a, wide_b = a.astype(np.longdouble), b.astype(np.longdouble)
        absolute, relative = _gaps(wide_a, wide_b)
        differs = absolute > 0
        if not differs.any():
            return Difference(name, field, "signs of zeros differ")
        worst = np.unravel_index(np.argmax(absolute), a.shape)
        what = f"{np.count_nonzero(differs)} of {a.size} values differ"
        return Difference(name, field, what, float(absolute.max()), float(relative.max()), _index(worst))
    differs = np.atleast_1d(a != b)
    if not differs.any():
        return Difference(name, field, "bytes differ")
    first = tuple(np.argwhere(differs)[0])[: a.ndim]
    what = f"{np.count_nonzero(differs)} of {a.size} values differ, {_shortened(a[first])} and {_shortened(b[first])}"
    return Difference(name, field, what, place=_index(first))


def _gaps(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Absolute and relative differences; equal infinities and two NaN do not differ, one NaN differs infinitely."""
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        absolute = np.where(same, 0, np.abs(a - b))
        relative = np.where(same, 0, absolute / np.maximum(np.abs(a), np.abs(b)))
    return np.where(np.isnan(absolute), np.inf, absolute), np.where(np.isnan(relative), np.inf, relative)


def _index(index: Iterable[Any]) -> str:
    return "[" + ", ".join(str(int(i)) for i in index) + "]" if index else ""


def _json_leaves(data: bytes) -> dict[str, tuple[str, Any]]:
    """Place -> (group, value) of each leaf; the group is the place without the indices of lists."""
    leaves: dict[str, tuple[str, Any]] = {}

    def add(value: Any, place: str) -> None:
        if isinstance(value, dict) and value:
            for key, item in value.items():
                add(item, f"{place}.{key}" if place else key)
        elif isinstance(value, list) and value:
            for index, item in enumerate(value):
                add(item, f"{place}[{index}]")
        else:
            leaves[place] = (re.sub(r"\[\d+\]", "[]", place), value)

    add(json.loads(data), "")
    return leaves


def _csv_leaves(data: bytes) -> dict[str, tuple[str, Any]]:
    """Place -> (column, value) of each cell; the first row names the columns."""
    rows = list(csv.reader(io.StringIO(data.decode("utf-8-sig"), newline="")))
    header = rows[0] if rows else []
    leaves: dict[str, tuple[str, Any]] = {f"header {i + 1}": ("header", cell) for i, cell in enumerate(header)}
    for number, row in enumerate(rows[1:], start=2):
        for i, cell in enumerate(row):
            column = header[i] if i < len(header) and header.count(header[i]) == 1 else f"column {i + 1}"
            leaves[f"line {number}, {column}"] = (column, _number(cell))
    return leaves


def _number(cell: str) -> Any:
    try:
        return float(cell)
    except ValueError:
        return cell


def _leaf_difference(name: str, a: dict[str, tuple[str, Any]], b: dict[str, tuple[str, Any]]) -> list[Difference]:
    """One row per group for numbers and one for all else."""
    numbers: dict[str, list[tuple[float, float, str]]] = {}
    text_differences: dict[str, list[tuple[str, str]]] = {}
    for place in [*a, *(place for place in b if place not in a)]:
        if place not in a or place not in b:
            group, value = a[place] if place in a else b[place]
            side = "first" if place in a else "second"
            text_differences.setdefault(group, []).append((f"only in the {side}: {_shortened(value)}", place))
            continue
        (group, value_a), (_, value_b) = a[place], b[place]
        if _is_number(value_a) and _is_number(value_b):
            absolute, relative = (float(gap) for gap in _gaps(np.float64(value_a), np.float64(value_b)))
            if absolute > 0:
                numbers.setdefault(group, []).append((absolute, relative, place))
        elif value_a != value_b or type(value_a) is not type(value_b):
            text_differences.setdefault(group, []).append((f"{_shortened(value_a)} and {_shortened(value_b)}", place))
    rows = []
    for group, differences in numbers.items():
        absolute, _, place = max(differences, key=lambda item: item[0])
        what = f"{len(differences)} number{'s' * (len(differences) > 1)} differ{'s' * (len(differences) == 1)}"
        rows.append(Difference(name, group, what, absolute, max(item[1] for item in differences), place))
    for group, texts in text_differences.items():
        more = f" (and {len(texts) - 1} more)" if len(texts) > 1 else ""
        rows.append(Difference(name, group, texts[0][0] + more, place=texts[0][1]))
    return rows


def _is_number(value: Any) -> bool:
    return isinstance(value, float) or (isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**53)


def _shortened(value: Any) -> str:
    value = value.item() if isinstance(value, np.generic | np.ndarray) else value
    text = repr(value.decode("utf-8", "replace") if isinstance(value, bytes) else value)
    return text if len(text) <= 60 else text[:57] + "..."
