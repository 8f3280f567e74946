"""What the report is told by the artifacts: solvers, provenance, and the plots to look into."""

from dataclasses import dataclass

import numpy as np
import pytest

from marsedl.replication.errors import ArtifactError
from marsedl.replication.pipeline.catalogue import Solve
from marsedl.replication.records import store
from marsedl.replication.records.fields import quantity
from marsedl.replication.report import assembly


@dataclass(frozen=True)
class Program:
    """A program and a search."""

    status: np.ndarray = quantity("1", ("stages",), "how the solver ended", "str")
    solver_iterations: np.ndarray = quantity("1", ("stages",), "its iterations", "int64")
    worst_residual: float = quantity("1", (), "its residual")
    search_converged: np.ndarray = quantity("1", ("laws",), "whether", "bool")
    share_converged: float = quantity("1", (), "a number, which says of no solve how it ended")


def saved(path, status, iterations, residual=1e-9, converged=(True, True), needs=(), **inputs):
    artifact = Program(np.array(status), np.array(iterations), residual, np.array(converged), 0.5)
    provenance = {"inputs": inputs, "code": "abc def", "needs": dict(needs)}
    store.save(path, artifact, paper="p", reading=path.parent.name, provenance=provenance)
    return str(path)


def test_how_all_solves_ended_is_counted_with_the_readings_of_each(tmp_path):
    paths = {
        "printed": {"gains": saved(tmp_path / "printed" / "gains.h5", ["optimal", "stopped"], [3, 1000])},
        "corrected": {
            "gains": saved(tmp_path / "corrected" / "gains.h5", ["optimal", ""], [7, 0], 2e-6, (True, False)),
        },
    }
    search = assembly.solved(Solve("gains", "search_converged", what="search"), paths)
    assert search == ["gains", "search", "3 converged; 1 not converged (corrected)", "4", "–", "–"]
    program = assembly.solved(Solve("gains", "status", "solver_iterations", "worst_residual"), paths)
    ended = "2 optimal; 1 stopped (printed); 1 not solved (corrected)"
    assert program == ["gains", "gains", ended, "4", "0 to 1,000", "2.0e-06"]
    assert assembly.solved(Solve("path", "status"), paths) == []


def test_provenance_rows_say_what_an_artifact_was_made_from(tmp_path):
    needs = {"b.h5": "0" * 16, "a.h5": "1" * 16}
    path = saved(tmp_path / "corrected" / "gains.h5", ["optimal"], [3], needs=needs, **{"ensemble.seed": 7})
    bare = saved(tmp_path / "corrected" / "nominal.h5", ["optimal"], [3])
    gains, nominal = assembly.provenance({"gains": path, "nominal": bare})
    assert gains == ["gains", "A program and a search.", "a, b", "7", "abc def"]
    assert nominal == ["nominal", "A program and a search.", "inputs alone", "–", "abc def"]


def test_a_damaged_artifact_is_named(tmp_path):
    path = tmp_path / "gains.h5"
    path.write_bytes(b"\x89HDF")
    with pytest.raises(ArtifactError, match=r"gains\.h5"):
        assembly.solved(Solve("gains", "status"), {"corrected": {"gains": str(path)}})
