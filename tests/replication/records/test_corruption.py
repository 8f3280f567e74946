"""Artifacts that are damaged, or that are not what is asked for, are refused with file and reason, and never loaded."""

from dataclasses import dataclass, make_dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.errors import ArtifactError
from marsedl.replication.pipeline.runner import record_type
from marsedl.replication.records import store
from marsedl.replication.records.differences import difference, digest
from marsedl.replication.records.fields import quantities, quantity
from marsedl.replication.records.store import load, provenance, save


@dataclass(frozen=True)
class Path2:
    """A mass over time."""

    time: np.ndarray = quantity("s", ("time",), "time")
    mass: np.ndarray = quantity("kg", ("time",), "mass")
    label: str = quantity("1", (), "a label")


def put(path: Path, artifact, paper="powered_descent") -> Path:
    save(path, artifact, paper=paper, reading="corrected", provenance={"code": "abc", "inputs": {"a": 1.0}})
    return path


def refused(path: Path, kind=Path2, paper="powered_descent", reading="corrected") -> str:
    """The reason for which a file is not loaded as that kind."""
    with pytest.raises(ArtifactError) as caught:
        load(path, kind, paper=paper, reading=reading)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert message.endswith(": delete it and run snakemake again: it is rebuilt")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


@pytest.fixture
def path(tmp_path):
    return put(tmp_path / "a.h5", Path2(np.arange(50.0), np.linspace(2, 1, 50), "a"))


def test_a_truncated_file_is_refused(path):
    whole = path.read_bytes()
    for length in [*range(0, len(whole), len(whole) // 20), *range(len(whole) - 50, len(whole), 5)]:
        path.write_bytes(whole[:length])
        assert "is truncated or damaged" in refused(path)


def test_flipped_bits_are_refused(path):
    whole, random = path.read_bytes(), np.random.default_rng(1)
    for place in [*random.integers(0, len(whole), 30).tolist(), len(whole) - 1]:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(random.integers(8))
        path.write_bytes(damaged)
        refused(path)


def test_hdf5_never_sees_a_damaged_file(path, monkeypatch):
    """It can crash on one."""
    path.write_bytes(path.read_bytes()[:-1])
    monkeypatch.setattr(h5py, "File", None)
    for read in (digest, provenance, lambda path: difference(path, path)):
        with pytest.raises(ArtifactError, match=r"a\.h5: is truncated or damaged"):
            read(path)


def test_a_file_that_another_tool_has_edited_is_refused(path):
    with h5py.File(path, "r+") as file:
        file["provenance"].attrs["seed"] = 1
    assert "was edited with other tools after it was written" in refused(path)


@pytest.mark.parametrize("content", [b"", b"time,mass\n1,2\n"])
def test_another_file_is_refused(path, content):
    path.write_bytes(content)
    refused(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(ArtifactError, match=r"none\.h5: the file does not exist: run snakemake to build it"):
        load(tmp_path / "none.h5", Path2)
    with pytest.raises(ArtifactError, match="the file does not exist"):
        load(tmp_path, Path2)


def test_another_format_of_the_file_is_refused(path):
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = 0
    path.write_bytes(store.seal(path.read_bytes()))
    assert "was written by another version, whose fields differ from today's" in refused(path)


@pytest.mark.parametrize(
    "mass",
    [
        ("mass", quantity("g", ("time",), "mass")),
        ("mass", quantity("kg", (50,), "mass")),
        ("mass", quantity("kg", ("time",), "mass", np.int64)),
        ("weight", quantity("kg", ("time",), "mass")),
    ],
)
def test_other_fields_than_todays_are_refused(path, mass):
    time, label = (quantity("s", ("time",), "time"), quantity("1", (), "a label", "str"))
    today = make_dataclass("Path2", [("time", np.ndarray, time), (mass[0], np.ndarray, mass[1]), ("label", str, label)])
    assert "was written by another version" in refused(path, today)
    assert ("it lacks weight" in refused(path, today)) == (mass[0] == "weight")


def made_up(kind):
    """An artifact with numbers of the right types, four along every named dimension."""
    of_type = {
        "float64": lambda n: np.linspace(1.0, 2.0, n),
        "int64": np.arange,
        "int8": lambda n: (np.arange(n) % 100).astype("int8"),
        "bool": lambda n: np.arange(n) % 2 == 0,
        "str": lambda n: np.array([f"word {i}" for i in range(n)]),
    }
    values = {}
    for name, declared in quantities(kind).items():
        shape = tuple(4 if isinstance(extent, str) else extent for extent in declared.dims)
        values[name] = of_type[declared.dtype](int(np.prod(shape))).reshape(shape)
    return kind(**values)


def test_every_kind_of_every_paper_comes_back_and_is_taken_for_no_other(tmp_path):
    kinds = {(slug, record_type(s.entries)): None for slug in SLUGS for s in catalogue(slug).stages.values()}
    assert len(kinds) >= 40
    before = Path2
    for number, (slug, kind) in enumerate(kinds):
        path = put(tmp_path / f"{number}.h5", made_up(kind), slug)
        loaded = load(path, kind, paper=slug, reading="corrected")
        for name, value in vars(made_up(kind)).items():
            np.testing.assert_array_equal(getattr(loaded, name), value)
        if before.__name__ != kind.__name__:
            assert f"is of the artifact {kind.__name__!r}, not {before.__name__!r}" in refused(path, before, slug)
        assert f"is of the paper {slug!r}, not 'another'" in refused(path, kind, "another")
        assert "is of the reading 'corrected', not 'printed'" in refused(path, kind, slug, "printed")
        before = kind
