"""Digests of the content of product files, and the differences between two products."""

import csv
import hashlib
import io
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from marsedl.replication.errors import InputError, shown
from marsedl.replication.records.fields import PROVENANCE
from marsedl.replication.records.store import arrays_digest, canonical, opened

HDF5_SUFFIXES = (".h5", ".hdf5")
_NOTHING = object()  # where one of two files has no value


@dataclass(frozen=True)
class Difference:
    """One row of a comparison: where two products differ, and by how much if they differ in numbers."""

    file: str  # path relative to the compared folders, or the first file's path
    field: str  # dataset, attribute, column or key; "" for the file as a whole
    what: str
    absolute: float | None = None  # greatest |a - b|
    relative: float | None = None  # greatest |a - b| / max(|a|, |b|)
    place: str = ""  # where the greatest absolute (else the first) difference is

    def __str__(self) -> str:
        """Return the row for a person, in one line."""
        size = "" if self.absolute is None else f", at most {self.absolute:.3g} (relative {self.relative:.3g})"
        place = f", at {self.place}" if self.place else ""
        return ": ".join(part for part in (self.file, self.field, self.what) if part) + size + place


def digest(path: str | Path) -> str:
    """SHA-256 of a product file, as 64 hexadecimal digits.

    Of HDF5: paths, types, shapes, values and attributes, whatever the compression or byte order, without /provenance
    and without the artifact's line of meaning (a docstring, and editing docstrings rebuilds nothing). What a field's
    dimensions are called counts, by the names of the scales. Of others: bytes.

    Raises InputError if there is no such file, ArtifactError if an HDF5 file is damaged.
    """
    path = _existing_file(path)
    if path.suffix in HDF5_SUFFIXES:
        return arrays_digest(_hdf5_content(path))
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


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
    if not (a.is_dir() and b.is_dir()):
        if a.is_dir() != b.is_dir() and a.exists() and b.exists():
            raise InputError(f"{a} and {b}: one is a folder and the other a file: name two files or two folders")
        return _file_difference(_existing_file(a), _existing_file(b), str(a))
    in_a, in_b = ({path.relative_to(top).as_posix() for path in top.rglob("*") if path.is_file()} for top in (a, b))
    rows = []
    for name in sorted(in_a | in_b):
        if name in in_a & in_b:
            rows += _file_difference(a / name, b / name, name)
        else:
            rows.append(Difference(name, "", f"only in {a if name in in_a else b}"))
    return rows


def format_difference(rows: list[Difference]) -> str:
    """The rows of `difference` as text for a person, one line each."""
    return "\n".join(map(str, rows)) or "no difference"


def _existing_file(path: str | Path) -> Path:
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: the file does not exist: build it first, or correct the name")
    return path


def _file_difference(a: Path, b: Path, name: str) -> list[Difference]:
    if {a.suffix, b.suffix} <= set(HDF5_SUFFIXES):
        return list(_hdf5_differences(a, b, name))
    bytes_a, bytes_b = a.read_bytes(), b.read_bytes()
    if bytes_a == bytes_b:
        return []
    if a.suffix not in _LEAVES or a.suffix != b.suffix:
        return [Difference(name, "", f"bytes differ ({len(bytes_a)} and {len(bytes_b)} bytes)")]
    try:
        leaves_a, leaves_b = (dict(_LEAVES[a.suffix](data.decode("utf-8-sig"))) for data in (bytes_a, bytes_b))
    except (ValueError, csv.Error) as error:
        return [Difference(name, "", f"bytes differ (not readable as {a.suffix[1:]}: {error})")]
    return _leaf_differences(name, leaves_a, leaves_b) or [Difference(name, "", "same content, written differently")]


# ---------------------------------------------------------------------------------------------------------------- HDF5


def _hdf5_content(path: Path) -> dict[str, np.ndarray | None]:
    """Datasets ("/x"), attributes ("/x@unit") and groups ("/g/", None), in canonical order."""
    content: dict[str, np.ndarray | None] = {}

    def add(node: h5py.Group | h5py.Dataset, name: str) -> None:
        if isinstance(node, h5py.Dataset):
            content[name] = np.array(node.shape) if _is_bare_scale(node) else np.asarray(node[()])
        else:
            content[f"{name}/"] = None
            for key in sorted(node.keys() - ({PROVENANCE} if name == "" else set())):
                add(node[key], f"{name}/{key}")
        # Of a scale, REFERENCE_LIST says what DIMENSION_LIST of the fields says, the other way round.
        for key in sorted(node.attrs.keys() - {"REFERENCE_LIST"}):
            value = node.attrs[key]
            if key == "DIMENSION_LIST":
                value = [h5py.h5r.get_name(scale, node.id).decode() for scales in value for scale in scales]
            content[f"{name}@{key}"] = np.asarray(value, dtype=object if isinstance(value, str | bytes) else None)

    with opened(path) as file:
        add(file, "")
    content.pop("@meaning", None)
    return content


def _is_bare_scale(dataset: h5py.Dataset) -> bool:
    """Whether a dataset is a dimension scale without values, which has nothing but its extent."""
    return dataset.attrs.get("CLASS") == b"DIMENSION_SCALE" and dataset.id.get_storage_size() == 0


def _hdf5_differences(a: Path, b: Path, name: str) -> Iterator[Difference]:
    content_a, content_b = _hdf5_content(a), _hdf5_content(b)
    for field in sorted(content_a.keys() | content_b.keys()):
        if field not in content_a or field not in content_b:
            yield Difference(name, field, f"only in {a if field in content_a else b}")
            continue
        one, other = content_a[field], content_b[field]
        if one is None or other is None:
            continue  # groups
        (type_a, data_a), (type_b, data_b) = canonical(one), canonical(other)
        if type_a != type_b:
            yield Difference(name, field, f"type {type_a} and {type_b}")
        elif one.shape != other.shape:
            yield Difference(name, field, f"shape {one.shape} and {other.shape}")
        elif data_a != data_b:
            yield _array_difference(name, field, one, other)


def _array_difference(name: str, field: str, a: np.ndarray, b: np.ndarray) -> Difference:
    """The row for two arrays of equal type and shape but unequal values."""
    numbers = a.dtype.kind in "iuf"
    if numbers:  # integers need all of their digits
        absolute, relative = _gaps(a.astype(np.longdouble), b.astype(np.longdouble))
    differs = np.asarray(absolute > 0 if numbers else a != b)
    if not differs.any():
        return Difference(name, field, "signs of zeros differ")
    worst = np.unravel_index(np.argmax(absolute if numbers else differs), a.shape)
    place = "[" + ", ".join(str(int(index)) for index in worst) + "]" if worst else ""
    what = f"{np.count_nonzero(differs)} of {a.size} values differ"
    if numbers:
        return Difference(name, field, what, float(absolute.max()), float(relative.max()), place)
    return Difference(name, field, f"{what}, {_shown(a[worst])} and {_shown(b[worst])}", place=place)


def _gaps(a: Any, b: Any) -> tuple[np.ndarray, np.ndarray]:
    """Absolute and relative differences; equal infinities and two NaN do not differ, one NaN differs infinitely."""
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        absolute = np.where(same, 0, np.abs(a - b))
        relative = np.where(same, 0, absolute / np.maximum(np.abs(a), np.abs(b)))
    return np.where(np.isnan(absolute), np.inf, absolute), np.where(np.isnan(relative), np.inf, relative)


def _shown(value: Any) -> str:
    value = value.item() if isinstance(value, np.generic | np.ndarray) else value
    return shown(value.decode("utf-8", "replace") if isinstance(value, bytes) else value)


# -------------------------------------------------------------------------------------------------------- JSON and CSV


def _json_leaves(text: str) -> Iterator[tuple[str, tuple[str, Any]]]:
    """Place and (field, value) of each leaf; the field is the place without the indices of lists."""

    def leaves(value: Any, place: str) -> Iterator[tuple[str, tuple[str, Any]]]:
        if isinstance(value, dict) and value:
            for key, item in value.items():
                yield from leaves(item, f"{place}.{key}" if place else key)
        elif isinstance(value, list) and value:
            for index, item in enumerate(value):
                yield from leaves(item, f"{place}[{index}]")
        else:
            yield place, (re.sub(r"\[\d+\]", "[]", place), value)

    return leaves(json.loads(text), "")


def _csv_leaves(text: str) -> Iterator[tuple[str, tuple[str, Any]]]:
    """Place and (column, value) of each cell; the first row names the columns."""
    header, *rows = list(csv.reader(io.StringIO(text, newline=""))) or [[]]
    for number, cell in enumerate(header, start=1):
        yield f"header {number}", ("header", cell)
    for line, row in enumerate(rows, start=2):
        for number, cell in enumerate(row):
            column = header[number] if number < len(header) else f"column {number + 1}"
            yield f"line {line}, {column}", (column, _number(cell))


def _number(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


_LEAVES = {".json": _json_leaves, ".csv": _csv_leaves}


def _leaf_differences(name: str, a: dict[str, tuple[str, Any]], b: dict[str, tuple[str, Any]]) -> list[Difference]:
    """A row for the numbers of each field that differ, with the greatest difference, and one for all else."""
    numbers, texts = defaultdict(list), defaultdict(list)
    for place in {**a, **b}:
        field = (a.get(place) or b[place])[0]
        one, other = (side.get(place, (field, _NOTHING))[1] for side in (a, b))
        if _NOTHING in (one, other):
            side, value = ("first", one) if other is _NOTHING else ("second", other)
            texts[field].append((f"only in the {side}: {_shown(value)}", place))
        elif type(one) in (int, float) and type(other) in (int, float):
            absolute, relative = map(float, _gaps(np.longdouble(one), np.longdouble(other)))
            if absolute > 0:
                numbers[field].append((absolute, relative, place))
        elif one != other or type(one) is not type(other):
            texts[field].append((f"{_shown(one)} and {_shown(other)}", place))
    rows = []
    for field, found in numbers.items():
        absolute, _, place = max(found, key=lambda item: item[0])
        what = f"{len(found)} number{'s differ' if len(found) > 1 else ' differs'}"
        rows.append(Difference(name, field, what, absolute, max(relative for _, relative, _ in found), place))
    for field, found in texts.items():
        (what, place), more = found[0], f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        rows.append(Difference(name, field, what + more, place=place))
    return rows
