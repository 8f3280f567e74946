"""Artifacts come back as they were saved, or not at all.

What is damaged, or not what is asked for, is refused with file and reason.
"""

import errno
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, make_dataclass, replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.errors import ArtifactError
from marsedl.replication.pipeline.runner import record_type
from marsedl.replication.records import fields, store
from marsedl.replication.records.differences import difference, digest
from marsedl.replication.records.fields import Axis, quantities, quantity
from marsedl.replication.records.store import load, provenance, save

PROVENANCE = {
    "inputs": {"nominal": "ab" * 32, "data/table.csv": "cd" * 32},
    "seed": 2**64 - 1,
    "trials": 1000,
    "versions": {"numpy": "2.3.1", "casadi": "3.7.0"},
    "solver": {"name": "Clarabel", "status": "solved", "iterations": 12, "residual": 1e-9, "exact": False},
    "history": [1.0, 0.5, {"deep": None}],
    "nothing": {},
}


@dataclass(frozen=True)
class Everything:
    """One field of each kind.

    And a second paragraph.
    """

    time: np.ndarray = quantity("s", ("time",), "time from the start of the flight")
    mean: np.ndarray = quantity("m, m/s", ("time", 6), "mean state")
    gains: np.ndarray = quantity("1/s", ("time", "control", 6), "feedback gains")
    counts: np.ndarray = quantity("1", ("trial",), "steps of each trial", np.int64)
    outcome: np.ndarray = quantity("1", ("trial",), "how each trial ended", "int8")
    landed: np.ndarray = quantity("1", ("trial",), "whether each trial landed", bool)
    names: np.ndarray = quantity("1", ("name",), "names of the outcomes", str)
    holes: np.ndarray = quantity("m", ("trial",), "miss distance where there is one", allow_nan=True)
    mass: float = quantity("kg", (), "final mass")
    iterations: int = quantity("1", (), "passes of the mass iteration")
    converged: bool = quantity("1", (), "whether the iteration converged")
    status: str = quantity("1", (), "what the solver said")


@dataclass(frozen=True)
class Small:
    """A small artifact."""

    time: np.ndarray = quantity("s", ("time",), "time")
    mass: np.ndarray = quantity("kg", ("time",), "mass")
    label: str = quantity("1", (), "a label")


def everything(times=5, trials=7):
    random = np.random.default_rng(1)
    return Everything(
        time=np.arange(float(times)),
        mean=random.normal(size=(times, 6)),
        gains=random.normal(size=(times, 3, 6)),
        counts=random.integers(-(2**62), 2**62, trials),
        outcome=np.arange(trials, dtype=np.int8) - 3,
        landed=np.arange(trials) % 2 == 0,
        names=np.array(["landed", "crashed", "", "α, µ und ß"]),
        holes=np.where(np.arange(trials) % 3 == 0, np.nan, 1.5),
        mass=1893.25,
        iterations=17,
        converged=True,
        status="Optimal Solution Found ✓",
    )


def small():
    return Small(np.arange(50.0), np.linspace(2, 1, 50), "a")


def put(path, artifact, paper="powered_descent", reading="corrected", made=PROVENANCE):
    save(path, artifact, paper=paper, reading=reading, provenance=made)
    return path


def elsewhere(program) -> int:
    """Run a program with the names of this module in another process; returns its exit status."""
    head = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); from test_store import *"
    return subprocess.run([sys.executable, "-c", f"{head}\n{program}"], check=False).returncode


def leftovers(folder):
    return [path.name for path in folder.iterdir() if path.name.endswith(".partial")]


# --------------------------------------------------------------------------------------------------------------- axes

MOTION = Axis("motion", downrange="m", altitude="m", vertical_velocity="m/s")
LAW = Axis("law", "open", "closed")


@dataclass(frozen=True)
class Named:
    """Fields with named components."""

    time: np.ndarray = quantity("s", ("time",), "time from the start of the flight", label="time")
    mean: np.ndarray = quantity(MOTION.unit, ("time", MOTION), "mean state of all trials")
    final_covariance: np.ndarray = quantity("SI", (LAW, MOTION, MOTION), "sample covariance at the end")


def named(times=4):
    return Named(np.arange(float(times)), np.ones((times, 3)), np.ones((2, 3, 3)))


def test_an_axis_is_its_extent_and_names_its_components():
    assert (MOTION, LAW) == (3, 2)
    assert MOTION.unit == "m, m, m/s"
    assert Axis("observed", bank="rad", change="rad").unit == "rad"
    assert MOTION.index("altitude") == 1
    assert MOTION.label("vertical_velocity") == "vertical velocity"
    assert Axis("state", **MOTION.units, mass="kg").names == (*MOTION.names, "mass")
    with pytest.raises(ArtifactError, match=r"axis 'motion' has no component 'altitud': did you mean 'altitude'\?"):
        MOTION.index("altitud")


# --------------------------------------------------------------------------------------------------------- round trip


@pytest.mark.parametrize("times", [0, 5, 4000])
def test_everything_comes_back(tmp_path, times):
    artifact = everything(times)
    path = put(tmp_path / "new/folders/all.h5", artifact)
    loaded = load(path, Everything, paper="powered_descent", reading="corrected")
    np.testing.assert_equal(vars(loaded), vars(artifact))
    assert loaded.counts.dtype == np.int64
    assert loaded.outcome.dtype == np.int8
    assert loaded.landed.dtype == np.bool_
    scalars = (loaded.mass, loaded.iterations, loaded.converged, loaded.status)
    assert [type(value) for value in scalars] == [float, int, bool, str]
    assert not any(array.flags.writeable for array in vars(loaded).values() if isinstance(array, np.ndarray))
    assert leftovers(path.parent) == []


def test_equal_content_gives_equal_bytes(tmp_path):
    first = put(tmp_path / "a/one.h5", everything(4000)).read_bytes()
    time.sleep(1.1)  # object times in HDF5 count in seconds
    reordered = dict(reversed(PROVENANCE.items()))
    program = f"put(Path({str(tmp_path / 'b/two.h5')!r}), everything(4000))"
    assert elsewhere(f"{program}; put(Path({str(tmp_path / 'b/named.h5')!r}), named())") == 0
    assert (tmp_path / "b/named.h5").read_bytes() == put(tmp_path / "named.h5", named()).read_bytes()
    assert put(tmp_path / "three.h5", everything(4000), made=reordered).read_bytes() == first
    assert (tmp_path / "b/two.h5").read_bytes() == first


def test_provenance_comes_back(tmp_path):
    actual = provenance(put(tmp_path / "a.h5", small()))
    assert actual == PROVENANCE
    assert type(actual["solver"]["exact"]) is bool


def test_xarray_opens_the_file_with_names_of_dimensions_and_components(tmp_path):
    import xarray

    with xarray.open_dataset(put(tmp_path / "a.h5", named())) as dataset:
        assert dataset["mean"].dims == ("time", "motion")
        assert dataset["final_covariance"].dims == ("law", "motion", "motion_2")
        assert dataset["final_covariance"].sel(law="open", motion="altitude", motion_2="altitude") == 1.0
        assert dataset["mean"].sel(motion="altitude", time=2.0) == 1.0
        assert dataset["motion_unit"].sel(motion="vertical_velocity") == "m/s"
        assert set(dataset.coords) == {"time", "motion", "motion_2", "motion_unit", "motion_2_unit", "law"}
        assert (dataset["time"].attrs["units"], dataset["time"].attrs["long_name"]) == ("s", "time")
        assert dataset.attrs["meaning"] == "Fields with named components."


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        ({"mean": ("time",), "time": ("law", "time")}, r"Muddled\.time: a dimension has the name of this field"),
        ({"mean": (MOTION,), "state": (Axis("motion", "x"),)}, "another axis is called 'motion'"),
    ],
)
def test_a_dimension_that_cannot_be_described_is_refused(declared, message):
    rows = [(name, np.ndarray, quantity("m", dims, "a field")) for name, dims in declared.items()]
    with pytest.raises(ArtifactError, match=message):
        fields.layout(make_dataclass("Muddled", rows, frozen=True))


def test_a_name_along_an_axis_has_its_extent(tmp_path):
    @dataclass(frozen=True)
    class Both:
        """An axis and the same dimension by name."""

        mean: np.ndarray = quantity("SI", (MOTION,), "mean")
        lowest: np.ndarray = quantity("SI", ("motion",), "lowest")

    put(tmp_path / "a.h5", Both(np.ones(3), np.ones(3)))
    with pytest.raises(ArtifactError, match=r"\(motion\) have the extents \(3,\)"):
        put(tmp_path / "b.h5", Both(np.ones(3), np.ones(2)))


def test_other_exact_types_are_accepted(tmp_path):
    artifact = replace(small(), time=list(range(50)), mass=np.ones(50, dtype=np.float32))
    assert load(put(tmp_path / "a.h5", artifact), Small).time.dtype == np.float64
    codes = replace(everything(), outcome=np.arange(7))  # int64 values that fit into int8
    assert load(put(tmp_path / "b.h5", codes), Everything).outcome.dtype == np.int8


# ------------------------------------------------------------------------------------------------- refused when saving

BAD_VALUES = {
    "missing": ("time", None, "must be of type float64: it is of type object"),
    "number of dimensions": ("time", np.zeros((5, 1)), r"has shape \(5, 1\), but its dimensions \(time\)"),
    "scalar for an array": ("time", 1.0, r"shape \(\)"),
    "fixed extent": ("mean", np.zeros((5, 5)), r"\(5, 5\), but its dimensions \(time, 6\) have the extents \(5, 6\)"),
    "extent of another field": ("mean", np.zeros((4, 6)), r"\(4, 6\), but .* have the extents \(5, 6\)"),
    "inf": ("mean", np.full((5, 6), np.inf), "not finite"),
    "inf where nan is allowed": ("holes", np.full(7, np.inf), "not finite"),
    "bool for numbers": ("time", np.zeros(5, bool), "must be of type float64"),
    "long double": ("time", np.full(5, np.longdouble(1) / 3), "do not fit"),
    "bool for int": ("iterations", True, "must be of type int64"),
    "too large for int8": ("outcome", np.full(7, 128), "do not fit"),
    "int for bool": ("landed", np.zeros(7, int), "must be of type bool"),
    "objects for text": ("names", np.array(["a", None], object), "must be of type str"),
}


@pytest.mark.parametrize("case", BAD_VALUES)
def test_a_bad_value_is_refused_before_anything_is_touched(tmp_path, case):
    field, value, message = BAD_VALUES[case]
    path = put(tmp_path / "all.h5", everything())
    before = path.read_bytes()
    with pytest.raises(ArtifactError, match=rf"(?s)all\.h5.*Everything.*'{field}'.*{message}"):
        put(path, replace(everything(), **{field: value}))
    assert path.read_bytes() == before
    assert leftovers(tmp_path) == []


def test_declarations_are_checked(tmp_path):
    @dataclass(frozen=True)
    class Undeclared:
        """A field without a unit."""

        time: float = 1.0

    with pytest.raises(ArtifactError, match=r"Undeclared\.time"):
        put(tmp_path / "a.h5", Undeclared())
    with pytest.raises(ArtifactError, match="is not an artifact type"):
        put(tmp_path / "a.h5", {"time": 1.0})


# ----------------------------------------------------------------------------------------------------------- atomicity


def test_a_failed_write_names_the_file_and_leaves_the_old_one(tmp_path, monkeypatch):
    path = put(tmp_path / "a.h5", small())
    before = path.read_bytes()

    def fail(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    for target, name in ((os, "fsync"), (Path, "replace")):
        monkeypatch.setattr(target, name, fail)
        with pytest.raises(OSError, match="No space left on device") as caught:
            put(path, replace(small(), label="new"))
        assert caught.value.filename == str(path)
        monkeypatch.undo()
        assert list(tmp_path.iterdir()) == [path] and path.read_bytes() == before


def test_a_kill_in_mid_write_does_no_harm(tmp_path):
    path = put(tmp_path / "a.h5", small())
    before = path.read_bytes()
    killed = "os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)"
    assert elsewhere(f"{killed}; put(Path({str(path)!r}), replace(small(), label='new'))") == -signal.SIGKILL
    assert path.read_bytes() == before
    assert len(leftovers(tmp_path)) == 1
    put(path, replace(small(), label="new"))
    assert load(path, Small).label == "new"
    assert leftovers(tmp_path) == []


# ------------------------------------------------------------------------------------------------- refused when loading


def refused(path: Path, kind=Small, paper="powered_descent", reading="corrected") -> str:
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
    return put(tmp_path / "a.h5", small())


def test_a_truncated_file_is_refused(path):
    whole = path.read_bytes()
    for length in [*range(0, len(whole), len(whole) // 20), *range(len(whole) - 50, len(whole), 5)]:
        path.write_bytes(whole[:length])
        assert "is truncated or damaged, or was edited with other tools after it was written" in refused(path)


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


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(ArtifactError, match=r"none\.h5: the file does not exist: run snakemake to build it"):
        load(tmp_path / "none.h5", Small)
    with pytest.raises(ArtifactError, match="the file does not exist"):
        load(tmp_path, Small)


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
    today = make_dataclass("Small", [("time", np.ndarray, time), (mass[0], np.ndarray, mass[1]), ("label", str, label)])
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
    before = Small
    for number, (slug, kind) in enumerate(kinds):
        path = put(tmp_path / f"{number}.h5", made_up(kind), slug)
        np.testing.assert_equal(vars(load(path, kind, paper=slug, reading="corrected")), vars(made_up(kind)))
        if before.__name__ != kind.__name__:
            assert f"is of the artifact {kind.__name__!r}, not {before.__name__!r}" in refused(path, before, slug)
        assert f"is of the paper {slug!r}, not 'another'" in refused(path, kind, "another")
        assert "is of the reading 'corrected', not 'printed'" in refused(path, kind, slug, "printed")
        before = kind
