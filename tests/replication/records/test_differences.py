"""Digests see content and nothing else; differences say what, how much and where."""

import json
from contextlib import contextmanager
from dataclasses import dataclass, replace

import h5py
import numpy as np
import pytest

from marsedl.replication.errors import InputError
from marsedl.replication.records.differences import difference, digest, digest_tree
from marsedl.replication.records.fields import quantity
from marsedl.replication.records.store import save, seal


@dataclass(frozen=True)
class Nominal:
    """A trajectory."""

    time: np.ndarray = quantity("s", ("time",), "time")
    mean: np.ndarray = quantity("m", ("time", 2), "mean")
    outcome: np.ndarray = quantity("1", ("time",), "outcome", np.int8)
    gap: np.ndarray = quantity("m", ("time",), "gap", allow_nan=True)
    names: np.ndarray = quantity("1", ("name",), "names", str)
    good: bool = quantity("1", (), "good")


def nominal(n=6):
    return Nominal(
        time=np.arange(float(n)),
        mean=np.linspace(1, 2, 2 * n).reshape(n, 2),
        outcome=np.zeros(n, np.int8),
        gap=np.where(np.arange(n) % 2, np.nan, 1.0),
        names=np.array(["a", "bb"]),
        good=True,
    )


def put(path, artifact, provenance=None, reading="corrected"):
    save(path, artifact, paper="funnels", reading=reading, provenance=provenance or {"seed": 1})
    return path


@contextmanager
def hdf5(path, mode, **options):
    """An HDF5 file open for writing, which then gets the seal of an artifact."""
    with h5py.File(path, mode, **options) as file:
        yield file
    path.write_bytes(seal(path.read_bytes()))


def with_value(array, index, value):
    array = np.array(array)
    array[index] = value
    return array


def test_digest_does_not_see_provenance_or_the_name(tmp_path):
    a = put(tmp_path / "a.h5", nominal())
    b = put(tmp_path / "b.h5", nominal(), provenance={"seed": 2, "solver": {"name": "x"}})
    assert a.read_bytes() != b.read_bytes()
    assert digest(a) == digest(b)
    assert len(digest(a)) == 64
    assert difference(a, b) == []


def test_digest_does_not_see_storage(tmp_path):
    values = np.random.default_rng(1).normal(size=(300, 4))
    digests = set()
    for number, (dtype, options) in enumerate(
        [
            ("<f8", {}),
            (">f8", {}),
            ("<f8", {"chunks": (7, 2)}),
            ("<f8", {"chunks": True, "compression": "gzip", "shuffle": True, "fletcher32": True}),
            ("<f8", {"maxshape": (None, 4)}),
            ("<f8", {"track_times": True}),
        ]
    ):
        with hdf5(tmp_path / f"{number}.h5", "w", libver="latest" if number % 2 else "earliest") as file:
            file.create_dataset("group/x", data=values.astype(dtype), **options)
            file["names"] = ["a", "b"] if number % 2 else np.array([b"a", b"b"])
            for key in ("p", "q") if number % 2 else ("q", "p"):
                file.attrs[key] = key
        digests.add(digest(tmp_path / f"{number}.h5"))
    assert len(digests) == 1


EDITS = {
    "one value by one bit": lambda file: file["time"].__setitem__(3, np.nextafter(3.0, 4)),
    "sign of zero": lambda file: file["time"].__setitem__(0, -0.0),
    "attribute": lambda file: file["time"].attrs.__setitem__("unit", "h"),
    "attribute of the root": lambda file: file.attrs.__setitem__("reading", "printed"),
    "type": lambda file: retyped(file, "f4"),
    "shape": lambda file: retyped(file, "f8", (2, 3)),
    "dataset removed": lambda file: file.pop("mean"),
    "dataset in a group": lambda file: file.move("mean", "more/mean"),
    "text": lambda file: file["names"].__setitem__(0, b"c"),
    "scale of a dimension": lambda file: file["mean"].dims[0].detach_scale(file["time"]),
    "bool": lambda file: file["good"].__setitem__((), False),
}


def retyped(file, dtype, shape=(6,)):
    attributes = dict(file["time"].attrs)
    del file["time"]
    file["time"] = np.arange(6).astype(dtype).reshape(shape)
    file["time"].attrs.update(attributes)


@pytest.mark.parametrize("case", EDITS)
def test_digest_and_difference_see_every_edit(tmp_path, case):
    a = put(tmp_path / "a.h5", nominal())
    b = put(tmp_path / "b.h5", nominal())
    assert digest(a) == digest(b)
    with hdf5(b, "r+") as file:
        EDITS[case](file)
    assert digest(a) != digest(b)
    assert difference(a, b) != []
    assert difference(b, a) != []


def test_what_is_no_content_and_what_tells_two_files_apart(tmp_path):
    """One NaN is as good as another, a docstring is no content; values belong to fields, integers have all digits."""

    def digest_of(meaning="", **fields):
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.h5"
        with hdf5(path, "w") as file:
            file.attrs["meaning"] = meaning
            for name, value in fields.items():
                file[name] = value
        return digest(path)

    assert digest_of(x=[1.0, np.nan]) == digest_of("Another wording.", x=[1.0, np.copysign(np.nan, -1.0)])
    assert digest_of(x=[1.0], y=[2.0, 3.0]) != digest_of(x=[1.0, 2.0], y=[3.0])
    assert digest_of(x=np.int64(2**62)) != digest_of(x=np.int64(2**62 + 1))
    (tmp_path / "a.png").write_bytes(b"abc")
    assert digest(tmp_path / "a.png").startswith("ba7816bf8f01cfea"), "of other files that of their bytes"
    assert list(digest_tree(tmp_path, ["[01].h5", "*.png"])) == ["0.h5", "1.h5", "a.png"]


def test_missing_files(tmp_path):
    with pytest.raises(InputError, match=r"none\.png: the file does not exist"):
        digest(tmp_path / "none.png")
    with pytest.raises(InputError, match="the folder does not exist"):
        digest_tree(tmp_path / "none", ["*"])


# ---------------------------------------------------------------------------------------------------------- difference


def test_difference_of_artifacts_says_how_much_and_where(tmp_path):
    base = nominal()
    other = replace(
        base,
        mean=with_value(with_value(base.mean, (4, 1), base.mean[4, 1] + 0.5), (0, 0), 0.75),
        outcome=with_value(base.outcome, 2, 5),
        gap=with_value(base.gap, 1, 2.0),
        names=np.array(["a", "cc"]),
        good=False,
    )
    a, b = put(tmp_path / "a.h5", base), put(tmp_path / "b.h5", other, reading="printed")
    assert difference(a, b) == [
        f"{a}: /gap: 1 of 6 values differ, at most inf (relative inf), at [1]",
        f"{a}: /good: 1 of 1 values differ, True and False",
        # The relative one is that of the first value, 1.0 and 0.75.
        f"{a}: /mean: 2 of 12 values differ, at most 0.5 (relative 0.25), at [4, 1]",
        f"{a}: /names: 1 of 2 values differ, 'bb' and 'cc', at [1]",
        f"{a}: /outcome: 1 of 6 values differ, at most 5 (relative 1), at [2]",
        f"{a}: @reading: 1 of 1 values differ, 'corrected' and 'printed'",
    ]


def test_difference_of_shapes_types_and_missing_fields(tmp_path):
    a, b = tmp_path / "a.h5", tmp_path / "b.h5"
    with hdf5(a, "w") as file:
        file["x"], file["y"], file["z"], file["zero"] = np.zeros(3), np.zeros(3), 1.0, 0.0
    with hdf5(b, "w") as file:
        file["x"], file["y"], file["w"], file["zero"] = np.zeros(4), np.zeros(3, "f4"), 1.0, -0.0
    assert difference(a, b) == [
        f"{a}: /w: only in {b}",
        f"{a}: /x: shape (3,) and (4,)",
        f"{a}: /y: type <f8 and <f4",
        f"{a}: /z: only in {a}",
        f"{a}: /zero: signs of zeros differ",
    ]


def test_difference_of_json(tmp_path):
    a = [{"id": "x", "value": 1.0, "verdict": "reproduced"}, {"id": "y", "value": 2.0, "verdict": "close"}]
    b = [{"id": "x", "value": 1.5, "verdict": "reproduced"}, {"id": "y", "value": 4.0, "verdict": "differs"}, 3]
    paths = [tmp_path / f"{name}.json" for name in "abcd"]
    for path, text in zip(paths, (json.dumps(a), json.dumps(b), json.dumps(a, indent=1), "{"), strict=True):
        path.write_text(text)
    assert difference(*paths[:2]) == [
        f"{paths[0]}: [].value: 2 of 2 values differ, at most 2 (relative 0.5), at [1].value",
        f"{paths[0]}: [].verdict: 1 of 2 values differ, 'close' and 'differs', at [1].verdict",
        f"{paths[0]}: []: 1 of 1 values differ, nothing and 3, at [2]",
    ]
    assert difference(paths[0], paths[2]) == [f"{paths[0]}: same content, written differently"]
    assert "not readable as json" in difference(paths[0], paths[3])[0]


def test_difference_of_csv(tmp_path):
    a, b = tmp_path / "a.csv", tmp_path / "b.csv"
    a.write_text("case,mass,note\nA,1.0,x\nB,2.0,y\n")
    b.write_text("case,mass,note\nA,1.125,x\nB,2.5,z\nC,,\n")
    assert difference(a, b) == [
        f"{a}: case: 1 of 3 values differ, nothing and 'C', at line 4",
        f"{a}: mass: 2 of 2 values differ, at most 0.5 (relative 0.2), at line 3",
        f"{a}: note: 2 of 3 values differ, 'y' and 'z', at line 3",
        f"{a}: mass: 1 of 1 values differ, nothing and '', at line 4",
    ]


def test_difference_of_folders(tmp_path):
    a, b = tmp_path / "a", tmp_path / "b"
    for side in (a, b):
        put(side / "deep/same.h5", nominal())
        (side / "fig.png").write_bytes(side.name.encode())
        (side / f"only_{side.name}.txt").write_text("")
    assert difference(a, b) == [
        "fig.png: bytes differ (1 and 1 bytes), first in line 1: a and b",
        f"only_a.txt: only in {a}",
        f"only_b.txt: only in {b}",
    ]
    assert difference(a, a) == []
    with pytest.raises(InputError, match="a: is a folder: name two files or two folders"):
        difference(a, b / "fig.png")


def test_texts_differ_by_their_first_line(tmp_path):
    for name in "ab":
        (tmp_path / f"{name}.md").write_text(f"same\n{name}\n")
    assert difference(tmp_path / "a.md", tmp_path / "b.md")[0].endswith("(7 and 7 bytes), first in line 2: a and b")
