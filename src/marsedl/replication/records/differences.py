"""Digests of the content of product files, and the differences between two products."""

import csv
import hashlib
import io
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from marsedl.replication.errors import InputError
from marsedl.replication.records.store import PROVENANCE, arrays_digest, canonical, opened

HDF5_SUFFIXES = (".h5", ".hdf5")
Leaves = Iterator[tuple[tuple[str, str], Any]]  # field and place of a value, and the value


def digest(path: str | Path) -> str:
    """Return the SHA-256 of a product file, as 64 hexadecimal digits.

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


def difference(a: str | Path, b: str | Path) -> list[str]:
    """Say in lines what differs between two files or folders, and by how much and where; no line if nothing does.

    HDF5 is compared by dataset and attribute (what `digest` counts), JSON by key, CSV by column, all else by bytes; of
    other texts the first line that differs is told.
    Raises InputError if one of them is missing or if one is a folder and the other is not.
    """
    a, b = Path(a), Path(b)
    pairs = {str(a): (a, b)}
    if a.is_dir() and b.is_dir():
        paths = ((path, top) for top in (a, b) for path in top.rglob("*") if path.is_file())
        names = sorted({path.relative_to(top).as_posix() for path, top in paths})
        pairs = {name: (a / name, b / name) for name in names}
    else:
        _existing_file(a), _existing_file(b)
    lines = []
    for name, (one, other) in pairs.items():
        if one.is_file() and other.is_file():
            lines += [f"{name}: {line}" for line in _file_differences(one, other)]
        else:
            lines.append(f"{name}: only in {a if one.is_file() else b}")
    return lines


def _existing_file(path: str | Path) -> Path:
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder: name two files or two folders")
    if not path.is_file():
        raise InputError(f"{path}: the file does not exist: build it first, or correct the name")
    return path


def _file_differences(a: Path, b: Path) -> Iterable[str]:
    if {a.suffix, b.suffix} <= set(HDF5_SUFFIXES):
        return _hdf5_differences(a, b)
    bytes_a, bytes_b = a.read_bytes(), b.read_bytes()
    if bytes_a == bytes_b:
        return []
    if a.suffix != b.suffix or a.suffix not in (".json", ".csv"):
        return [_bytes_differ(bytes_a, bytes_b)]
    try:
        texts = (data.decode("utf-8-sig") for data in (bytes_a, bytes_b))
        sides = [dict(_csv_leaves(text) if a.suffix == ".csv" else _json_leaves(json.loads(text))) for text in texts]
        return list(_leaf_differences(*sides)) or ["same content, written differently"]
    except (ValueError, csv.Error) as error:
        return [f"bytes differ (not readable as {a.suffix[1:]}: {error})"]


def _bytes_differ(a: bytes, b: bytes) -> str:
    """What differs between two files that are not equal: of texts, the first line."""
    said = f"bytes differ ({len(a)} and {len(b)} bytes)"
    try:
        lines = zip_longest(a.decode().splitlines(), b.decode().splitlines(), fillvalue="nothing")
    except UnicodeDecodeError:
        return said
    first = next(((number, *pair) for number, pair in enumerate(lines, start=1) if len({*pair}) == 2), None)
    return f"{said}, first in line {first[0]}: {first[1]:.100} and {first[2]:.100}" if first else said


def _compared(a: Sequence, b: Sequence, numbers: bool) -> tuple[str, int] | None:
    """How many of two rows of values differ and by how much or which, and the index of the worst; None if none does.

    Equal infinities and two NaN do not differ, one NaN differs infinitely.
    """
    a, b = (np.array(row, np.longdouble if numbers else str) for row in (a, b))  # integers with all of their digits
    if numbers:
        same = (a == b) | (np.isnan(a) & np.isnan(b))
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            absolute = np.abs(a - b)
            relative = absolute / np.maximum(np.abs(a), np.abs(b))
        for gaps in (absolute, relative):
            gaps[np.isnan(gaps)] = np.inf
            gaps[same] = 0
        size = f"at most {absolute.max():.3g} (relative {relative.max():.3g})"
        worst, count = int(absolute.argmax()), np.count_nonzero(absolute)
    else:
        worst, count = int(np.argmax(a != b)), np.count_nonzero(a != b)
        size = f"{a[worst]:.100} and {b[worst]:.100}"
    return (f"{count} of {len(a)} values differ, {size}", worst) if count else None


def _hdf5_content(path: Path) -> dict[str, np.ndarray | None]:
    """Datasets ("/x"), attributes ("/x@unit") and groups ("/g/", None), in canonical order."""
    content: dict[str, np.ndarray | None] = {}

    def add(node: h5py.Group | h5py.Dataset, name: str) -> None:
        if isinstance(node, h5py.Dataset):
            # A scale of a dimension that has no values has nothing but its extent.
            bare = node.attrs.get("CLASS") == b"DIMENSION_SCALE" and node.id.get_storage_size() == 0
            text = h5py.check_string_dtype(node.dtype)
            content[name] = np.array(node.shape) if bare else np.asarray((node.asstr() if text else node)[()])
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


def _hdf5_differences(a: Path, b: Path) -> Iterator[str]:
    content_a, content_b = _hdf5_content(a), _hdf5_content(b)
    for field in sorted(content_a.keys() | content_b.keys()):
        if field not in content_a or field not in content_b:
            yield f"{field}: only in {a if field in content_a else b}"
            continue
        one, other = content_a[field], content_b[field]
        if one is None or other is None:
            continue  # groups
        (type_a, data_a), (type_b, data_b) = canonical(one), canonical(other)
        if type_a != type_b:
            yield f"{field}: type {type_a} and {type_b}"
        elif one.shape != other.shape:
            yield f"{field}: shape {one.shape} and {other.shape}"
        elif data_a != data_b:
            numbers = one.dtype.kind in "iuf"
            rows = (array.ravel() if numbers else list(map(repr, array.ravel().tolist())) for array in (one, other))
            what, worst = _compared(*rows, numbers) or ("signs of zeros differ", None)
            place = () if worst is None else np.unravel_index(worst, one.shape)
            yield f"{field}: {what}" + (f", at {list(map(int, place))}" if place else "")


def _json_leaves(value: Any, place: str = "") -> Leaves:
    """The field of a leaf is its place without the indices of lists."""
    inside = []
    if isinstance(value, dict):
        inside = [(f"{place}.{key}" if place else key, item) for key, item in value.items()]
    elif isinstance(value, list):
        inside = [(f"{place}[{index}]", item) for index, item in enumerate(value)]
    for inner, item in inside:
        yield from _json_leaves(item, inner)
    if not inside:
        yield (re.sub(r"\[\d+\]", "[]", place), place), value


def _csv_leaves(text: str) -> Leaves:
    """The field of a cell is its column."""
    for line, row in enumerate(csv.DictReader(io.StringIO(text, newline="")), start=2):
        for column, cell in row.items():
            try:
                value = float(cell)
            except (TypeError, ValueError):
                value = cell
            yield (str(column), f"line {line}"), value


def _leaf_differences(a: dict[tuple[str, str], Any], b: dict[tuple[str, str], Any]) -> Iterator[str]:
    """A line for the numbers of each field that differ, with the greatest difference, and one for all else."""
    rows = defaultdict(list)
    for field, place in a | b:
        found = [side[field, place] for side in (a, b) if (field, place) in side]
        numbers = len(found) == 2 and all(type(value) in (int, float) for value in found)
        texts = (repr(side[field, place]) if (field, place) in side else "nothing" for side in (a, b))
        rows[field, numbers].append((place, *(found if numbers else texts)))
    for (field, numbers), found in rows.items():
        places, *values = zip(*found, strict=True)
        if differing := _compared(*values, numbers):
            what, worst = differing
            yield f"{field}: {what}, at {places[worst]}"
