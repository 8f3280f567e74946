"""Every kind of artifact of every paper, damaged in every way: refused with file and reason, and never loaded.

The artifacts are made up, small and of the right types, so that all kinds are here at the cost of none. What a stranger
made carries a valid seal: the checksum must not be all that stands between a file and the science.
"""

import os
import resource  # noqa: F401 (for the programs below)
import signal
import subprocess
import sys
import textwrap
from dataclasses import dataclass, fields, make_dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.replication import artifacts
from marsedl.replication.artifacts import load, quantities, quantity, save
from marsedl.replication.errors import ArtifactError
from marsedl.replication.jobs import record_type

FOREIGN = 32_999  # a number of the range for filters that nobody has registered
REMEDY = "delete it and run snakemake again"


@dataclass(frozen=True)
class Kind:
    """A type of artifact and the paper that it is of."""

    paper: str
    type: type

    def __str__(self):
        return f"{self.paper}-{self.type.__module__.rpartition('.')[2]}-{self.type.__name__}"


def kinds() -> list[Kind]:
    """What the stages of all papers return."""
    by_type = {}
    for slug in SLUGS:
        paper = catalogue(slug)
        for stage in paper.stages.values():
            returned = record_type(stage.entries)
            by_type.setdefault((slug, returned), Kind(slug, returned))
    return list(by_type.values())


KINDS = kinds()
per_kind = pytest.mark.parametrize("kind", KINDS, ids=str)


def made_up(kind: Kind):
    """An artifact with numbers of the right types, four along every named dimension."""
    values = {}
    for name, declared in quantities(kind.type).items():
        shape = tuple(4 if isinstance(extent, str) else extent for extent in declared.dims)
        count = int(np.prod(shape))
        values[name] = {
            "float64": lambda n: np.linspace(1.0, 2.0, n),
            "int64": lambda n: np.arange(n),
            "int8": lambda n: (np.arange(n) % 100).astype("int8"),
            "bool": lambda n: np.arange(n) % 2 == 0,
            "str": lambda n: np.array([f"word {i}" for i in range(n)]),
        }[declared.dtype](count).reshape(shape)
    return kind.type(**values)


def put(path: Path, kind: Kind) -> Path:
    save(path, made_up(kind), paper=kind.paper, reading="corrected", provenance={"code": "abc", "inputs": {"a": 1.0}})
    return path


def refused(path: Path, kind: Kind) -> str:
    """The reason for which a file is not loaded as that kind."""
    with pytest.raises(ArtifactError) as caught:
        load(path, kind.type, paper=kind.paper, reading="corrected")
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert message.endswith(f"{REMEDY}: it is rebuilt")
    assert "\n" not in message
    assert len(message) < 1500
    return message.removeprefix(f"{path}: ")


def sealed(path: Path) -> Path:
    """Give a file the seal that `save` gives, as one may who knows how."""
    path.write_bytes(artifacts.seal(path.read_bytes()))
    return path


def test_there_are_kinds_of_every_paper():
    assert {kind.paper for kind in KINDS} == set(SLUGS)
    assert len(KINDS) >= 40


# -------------------------------------------------------------------------------------------------------- damaged files


@per_kind
def test_a_truncated_file_is_refused(tmp_path, kind):
    whole = put(tmp_path / "whole.h5", kind).read_bytes()
    random = np.random.default_rng(KINDS.index(kind))
    path = tmp_path / "cut.h5"
    for length in {0, 1, 8, len(whole) // 2, len(whole) - 1, *random.integers(0, len(whole), 12).tolist()}:
        path.write_bytes(whole[:length])
        refused(path, kind)


@per_kind
def test_flipped_bits_are_refused(tmp_path, kind):
    """Anywhere in the file and its seal; with a seal, HDF5 does not see what was damaged."""
    whole = put(tmp_path / "whole.h5", kind).read_bytes()
    random = np.random.default_rng(KINDS.index(kind))
    path = tmp_path / "flipped.h5"
    sealed_bytes = len(whole) - artifacts._SEAL_BYTES
    for place in [*random.integers(0, sealed_bytes, 25).tolist(), *range(len(whole) - 32, len(whole), 5)]:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(random.integers(8))
        path.write_bytes(damaged)
        assert "its bytes differ from what was written" in refused(path, kind)
    for place in range(sealed_bytes, sealed_bytes + len(artifacts._SEAL), 4):  # of the mark that says it is a seal
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert "its end is cut off" in refused(path, kind)


def test_flipped_bits_in_files_without_a_seal_are_refused_within_bounds(tmp_path):
    """What HDF5 makes of damaged files, in a process that may take neither long nor much memory."""
    program = f"""
        import sys
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        from test_corruption import *
        resource.setrlimit(resource.RLIMIT_AS, (2**32, 2**32))
        folder = Path({str(tmp_path)!r})
        random = np.random.default_rng(8)
        for kind in KINDS:
            whole = put(folder / "whole.h5", kind).read_bytes()[: -artifacts._SEAL_BYTES]
            for _ in range(20):
                damaged = bytearray(whole)
                for _ in range(random.integers(1, 9)):
                    damaged[random.integers(len(damaged))] = random.integers(256)
                (folder / "damaged.h5").write_bytes(damaged)
                signal.alarm(20)
                refused(folder / "damaged.h5", kind)
                signal.alarm(0)
        print("all refused")
    """
    process = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True)
    assert process.returncode == 0, f"{process.returncode}: {process.stderr[-2000:]}"
    assert "all refused" in process.stdout


# ---------------------------------------------------------------------------------------------------------- other files


def test_no_kind_is_taken_for_another_or_for_that_of_another_paper(tmp_path):
    paths = [put(tmp_path / f"{i}.h5", kind) for i, kind in enumerate(KINDS)]
    for path, saved_kind in zip(paths, KINDS, strict=True):
        loaded = load(path, saved_kind.type, paper=saved_kind.paper, reading="corrected")
        for name, value in vars(made_up(saved_kind)).items():
            np.testing.assert_array_equal(getattr(loaded, name), value)
        for kind in KINDS:
            if kind != saved_kind:
                reason = refused(path, kind)
                other_name = kind.type.__name__ != saved_kind.type.__name__
                assert (repr(saved_kind.type.__name__) if other_name else repr(saved_kind.paper)) in reason
        with pytest.raises(ArtifactError, match="of the reading 'corrected', not 'printed'"):
            load(path, saved_kind.type, paper=saved_kind.paper, reading="printed")


def older(kind: Kind, change: str) -> type:
    """The type as it may have been: with a field less, of another unit, dimension or type, or one that is gone."""
    declared = {field.name: field for field in fields(kind.type)}
    name = next(iter(declared))
    stored = quantities(kind.type)[name]

    def renamed(dims):
        """Dimensions that no field is named after, as the field that is changed may be one."""
        return tuple(f"older_{d}" if isinstance(d, str) and change == "dimension" else d for d in dims)

    other = {
        "unit": lambda: quantity(stored.unit + "^2", stored.dims, stored.meaning, stored.dtype),
        "dimension": lambda: quantity(stored.unit, (*renamed(stored.dims), "more"), stored.meaning, stored.dtype),
        "type": lambda: quantity(
            stored.unit, stored.dims, stored.meaning, "int8" if stored.dtype != "int8" else "int64"
        ),
        "missing": lambda: None,
        "gone": lambda: quantity(stored.unit, stored.dims, stored.meaning, stored.dtype),
    }[change]()
    rows = [
        (other_name, field.type, quantity(q.unit, renamed(q.dims), q.meaning, q.dtype, allow_nan=q.allow_nan))
        for (other_name, field), q in zip(declared.items(), quantities(kind.type).values(), strict=True)
        if other_name != name or change == "gone"
    ]
    if other is not None:
        rows.append(("was_here" if change == "gone" else name, np.ndarray, other))
    return make_dataclass(kind.type.__name__, rows, frozen=True)


@per_kind
def test_an_older_schema_is_refused(tmp_path, kind):
    changes = ["unit", "dimension", "type", "missing", "gone"]
    if len(fields(kind.type)) == 1:
        changes.remove("missing")
    for change in changes:
        was = Kind(kind.paper, older(kind, change))
        path = put(tmp_path / f"{change}.h5", was)
        reason = refused(path, kind)
        assert f"artifact {kind.type.__name__} was written by another version" in reason
        first = next(iter(quantities(kind.type)))
        assert (f"it lacks {first}" in reason) == (change == "missing")


# ---------------------------------------------------------------------------------------------------- strangers' files


def stranger(path: Path, kind: Kind, edit) -> Path:
    """The kind's file with an array of numbers replaced by something else, and with a seal."""
    put(path, kind)
    numbers = {name: len(declared.dims) for name, declared in quantities(kind.type).items() if declared.dtype != "str"}
    name = max(numbers, key=lambda name: min(numbers[name], 1))
    with h5py.File(path, "r+") as file:
        attributes = dict(file[name].attrs)
        shape, dtype = file[name].shape, file[name].dtype
        del file[name]
        edit(file, name, shape, dtype)
        if isinstance(file.get(name, getlink=True), h5py.HardLink):
            file[name].attrs.update(attributes)
    return sealed(path)


def soft_link(file, name, shape, dtype):
    file[name] = h5py.SoftLink("/provenance")


def endless_link(file, name, shape, dtype):
    file[name] = h5py.SoftLink(f"/{name}")


def external_link(file, name, shape, dtype):
    file[name] = h5py.ExternalLink("/dev/zero", "/")


def external_values(file, name, shape, dtype):
    file.create_dataset(name, shape or (1,), dtype, external=[("/dev/zero", 0, h5py.h5f.UNLIMITED)])


def virtual_values(file, name, shape, dtype):
    layout = h5py.VirtualLayout(shape or (1,), dtype)
    layout[...] = h5py.VirtualSource("/dev/zero", "x", shape or (1,))
    file.create_virtual_dataset(name, layout)


def huge(file, name, shape, dtype):
    file.create_dataset(
        name, (2**55,) + (1,) * (max(len(shape), 1) - 1), dtype, chunks=(1024,) + (1,) * (max(len(shape), 1) - 1)
    )


def huge_chunk(file, name, shape, dtype):
    chunks = (2**27,) + (1,) * (max(len(shape), 1) - 1)
    file.create_dataset(name, chunks, dtype, chunks=chunks, compression="gzip")


def unallocated(file, name, shape, dtype):
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    creation.set_alloc_time(h5py.h5d.ALLOC_TIME_LATE)
    space = h5py.h5s.create_simple((2**33,))
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.py_create(dtype), space, creation)


def many_dimensions(file, name, shape, dtype):
    file.create_dataset(name, data=np.ones((1,) * 32, dtype))


def object_references(file, name, shape, dtype):
    file.create_dataset(name, data=np.full(shape or (1,), file.ref, dtype=object), dtype=h5py.ref_dtype)


def region_references(file, name, shape, dtype):
    file.create_dataset(name, shape or (1,), dtype=h5py.regionref_dtype)


def compound(file, name, shape, dtype):
    file.create_dataset(name, shape, dtype=np.dtype([("a", "f8"), ("b", "S16")]))


def array_type(file, name, shape, dtype):
    file.create_dataset(name, shape, dtype=np.dtype(("f8", (1000,))))


def variable_length(file, name, shape, dtype):
    file.create_dataset(name, shape or (1,), dtype=h5py.vlen_dtype(np.float64))


def opaque(file, name, shape, dtype):
    file.create_dataset(name, shape, dtype=h5py.opaque_dtype(np.dtype("V16")))


def enumeration(file, name, shape, dtype):
    kind = h5py.enum_dtype({"a": 0, "b": 1}, basetype="i8")
    file.create_dataset(name, data=np.zeros(shape, "i8"), dtype=kind)


def pickled(file, name, shape, dtype):
    file.create_dataset(name, data=np.void(b"cos\nsystem\n(S'touch executed'\ntR."))


def named_type(file, name, shape, dtype):
    file[name] = dtype


def group(file, name, shape, dtype):
    file.create_group(name)[name] = file["/"]


def unknown_filter(file, name, shape, dtype):
    """A chunk that says it went through a filter that is not installed."""
    shape = shape or (1,)
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    creation.set_chunk(shape)
    creation.set_filter(FOREIGN, h5py.h5z.FLAG_OPTIONAL, (1, 2, 3))
    space = h5py.h5s.create_simple(shape)
    dataset = h5py.h5d.create(file.id, name.encode(), h5py.h5t.py_create(dtype), space, creation)
    dataset.write_direct_chunk((0,) * len(shape), bytes(int(np.prod(shape)) * dtype.itemsize), filter_mask=0)


def broken_filter(file, name, shape, dtype):
    """Chunks that are not what deflate wrote."""
    dataset = file.create_dataset(name, shape or (1,), dtype, chunks=shape or (1,), compression="gzip")
    dataset.id.write_direct_chunk((0,) * len(shape or (1,)), b"\x78\x9c" + b"\xff" * 64, filter_mask=0)


def wrong_checksum(file, name, shape, dtype):
    dataset = file.create_dataset(name, shape or (1,), dtype, chunks=shape or (1,), fletcher32=True)
    dataset.id.write_direct_chunk((0,) * len(shape or (1,)), bytes(dataset.nbytes) + b"\x01" * 4, filter_mask=0)


STRANGE = {
    soft_link: "is a link to somewhere else",
    endless_link: "is a link to somewhere else",
    external_link: "is a link to somewhere else",
    external_values: "takes its values from another file",
    virtual_values: "takes its values from another file",
    huge: "bytes of values but the file stores",
    huge_chunk: "bytes of values but the file stores",
    unallocated: "bytes of values but the file stores",
    many_dimensions: "has shape (1, 1",
    object_references: "is of type object",
    region_references: "is of type object",
    compound: "is of type [",
    array_type: "is of type (",
    variable_length: "is of type object",
    opaque: "is of type |V",
    enumeration: " is of type ",
    pickled: "is of type |V",
    named_type: "is unexpectedly a datatype",
    group: "is unexpectedly a group",
    unknown_filter: f"went through the filter {FOREIGN}",
    broken_filter: "cannot be read (",
    wrong_checksum: "cannot be read (",
}


@per_kind
def test_the_file_of_a_stranger_is_refused(tmp_path, kind):
    scalars = not any(declared.dims for declared in quantities(kind.type).values())
    for edit, reason in STRANGE.items():
        path = stranger(tmp_path / f"{edit.__name__}.h5", kind, edit)
        if scalars and edit in (broken_filter, wrong_checksum):  # filters are of arrays
            reason = "has shape (1,)"
        assert reason in refused(path, kind), edit.__name__
        path.unlink()
    assert not list(tmp_path.iterdir()), "nothing was executed or written"


def test_strange_files_are_refused_within_bounded_time_and_memory(tmp_path):
    """All of them for one kind, in a process that may neither use much memory nor take long."""
    program = f"""
        import sys
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        from test_corruption import *
        folder, kind = Path({str(tmp_path)!r}), KINDS[0]
        paths = [stranger(folder / f"{{edit.__name__}}.h5", kind, edit) for edit in STRANGE]
        used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
        for path in paths:
            refused(path, kind)
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - used)
    """
    process = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True)
    assert process.returncode == 0, f"{process.returncode}: {process.stderr[-2000:]}"
    assert int(process.stdout) < 50_000, "kilobytes"


@pytest.mark.parametrize(
    ("attribute", "value"),
    [
        ("artifact", "x" * 10_000),
        ("artifact", np.zeros(5000)),
        ("artifact", np.array(["Nominal", "Gains"], dtype=h5py.string_dtype())),
        ("paper", "a\nb"),
        ("paper", h5py.Empty("f8")),
        ("reading", np.zeros(3, dtype=[("a", "f8")])),
        ("format", "1"),
        ("format", np.inf),
        ("schema", b"\xff\xfe"),
    ],
)
def test_strange_words_about_itself_are_refused(tmp_path, attribute, value):
    kind = KINDS[0]
    path = put(tmp_path / "a.h5", kind)
    with h5py.File(path, "r+") as file:
        file.attrs[attribute] = value
    refused(sealed(path), kind)


def test_a_missing_reason_is_none_for_a_file_that_may_not_be_opened(tmp_path):
    """A pipe that nobody writes to would be waited for without end; a folder, a dangling link and a device are said."""
    kind = KINDS[0]
    pipe, folder, link, device = (tmp_path / name for name in ("pipe.h5", "folder.h5", "link.h5", "device.h5"))
    os.mkfifo(pipe)
    folder.mkdir()
    link.symlink_to(tmp_path / "nowhere.h5")
    device.symlink_to("/dev/zero")
    signal.alarm(20)
    for path, reason in (
        (pipe, "is not a file"),
        (folder, "is not a file"),
        (device, "is not a file"),
        (link, "does not exist"),
    ):
        with pytest.raises(ArtifactError, match=rf"{path.name}: .*{reason}"):
            load(path, kind.type)
    signal.alarm(0)
