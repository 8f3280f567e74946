"""What the report is told by the artifacts: solvers, provenance, run times, and the plots to look into."""

import json
import math
import typing
from dataclasses import dataclass
from importlib import import_module

import numpy as np
import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.replication import artifacts, assembly
from marsedl.replication.artifacts import quantity
from marsedl.replication.catalogue import Stage
from marsedl.replication.errors import ArtifactError


@dataclass(frozen=True)
class Program:
    """A program and a search."""

    status: np.ndarray = quantity("1", ("stages",), "how the solver ended", "str")
    solver_iterations: np.ndarray = quantity("1", ("stages",), "its iterations", "int64")
    worst_residual: float = quantity("1", (), "its residual")
    search_converged: np.ndarray = quantity("1", ("laws",), "whether", "bool")
    share_converged: float = quantity("1", (), "a number, which says of no solve how it ended")


def saved(path, status, iterations, residual=1e-9, converged=(True, True), made_from=(), **inputs):
    artifact = Program(np.array(status), np.array(iterations), residual, np.array(converged), 0.5)
    provenance = {"inputs": inputs, "code": "abc def", "made_from": dict.fromkeys(made_from, "0" * 64)}
    artifacts.save(path, artifact, paper="p", reading=path.parent.name, provenance=provenance)
    return str(path)


def test_solver_rows_count_how_all_solves_ended_and_name_the_readings_of_the_others(tmp_path):
    paths = {
        "printed": {"gains": saved(tmp_path / "printed" / "gains.h5", ["optimal", "stopped"], [3, 1000])},
        "corrected": {
            "gains": saved(tmp_path / "corrected" / "gains.h5", ["optimal", ""], [7, 0], 2e-6, (True, False)),
        },
    }
    header, search, program = sorted(
        assembly.solver_rows(paths), key=lambda row: (row[0] != "stage", row[1] != "search")
    )
    assert header[0] == "stage"
    assert search == ["gains", "search", "3 converged; 1 not converged (corrected)", "4", "–", "–"]
    said = "2 optimal; 1 stopped (printed); 1 not solved (corrected)"
    assert program == ["gains", "gains", said, "4", "0 to 1,000", "2.0e-06"]


def test_a_paper_without_solvers_has_no_rows(tmp_path):
    assert assembly.solver_rows({}) == []
    assert assembly.provenance_rows({}, {}, "–") == []


def test_provenance_rows_say_what_an_artifact_was_made_from(tmp_path):
    path = saved(tmp_path / "corrected" / "gains.h5", ["optimal"], [3], made_from=["b.h5", "a.h5"], seed=7)
    bare = saved(tmp_path / "corrected" / "nominal.h5", ["optimal"], [3])
    stages = {"nominal": Stage(()), "gains": Stage(()), "montecarlo": Stage((), ("gains", "nominal"))}
    _, gains, nominal = assembly.provenance_rows({"gains": path, "nominal": bare}, stages, "9")
    assert gains == ["gains", "A program and a search.", "a, b", "7", "abc def"]
    assert nominal == ["nominal", "A program and a search.", "inputs alone", "–", "abc def"]


def test_provenance_of_trials_does_not_tell_how_they_were_scattered(tmp_path):
    stages = {"gains": Stage(()), "montecarlo": Stage((), ("gains",))}
    rows = []
    for chunks in (1, 3):
        made_from = [f"case.{k}of{chunks}.h5" for k in range(chunks)]
        path = saved(tmp_path / str(chunks) / "case.h5", ["optimal"], [3], made_from=made_from)
        rows.append(assembly.provenance_rows({"case": path}, stages, "9"))
    assert rows[0] == rows[1]
    assert rows[0][1] == ["case", "A program and a search.", "gains", "9", "–"]


def test_a_damaged_artifact_is_named(tmp_path):
    path = tmp_path / "gains.h5"
    path.write_bytes(b"\x89HDF")
    with pytest.raises(ArtifactError, match=r"gains\.h5"):
        assembly.solver_rows({"corrected": {"gains": str(path)}})


def test_run_times_are_those_of_the_papers_asked_for():
    table = [["paper", "quantity", "value"], ["a", "speed", "1"], ["all", "build", "2"], ["a", "memory", "3"]]
    assert assembly.run_times(table, ["a"]) == [["quantity", "value"], ["speed", "1"], ["memory", "3"]]
    assert assembly.run_times(table, ["b"]) == []
    assert assembly.run_times([], ["a"]) == []


@pytest.mark.parametrize(
    ("values", "axis", "expected"),
    [
        ([0.0, 3.14159265, 10.0], None, [0.0, 3.142, 10.0]),
        ([[1.0, 1000.123456], [2.0, 2000.0]], 0, [[1.0, 1000.12], [2.0, 2000.0]]),
        ([math.nan, 2.0, 4.0], None, [None, 2.0, 4.0]),
        ([0.123456789], None, [0.12346]),
        ([-1e-9, 1.0], None, [0.0, 1.0]),
        ([], None, []),
    ],
)
def test_plots_hold_what_a_screen_shows(values, axis, expected):
    rounded = assembly._rounded(np.array(values), axis)
    assert rounded == expected
    assert "-0.0" not in json.dumps(rounded)


def artifact_type(paper, name):
    """The type of an artifact by its name, of a stage or of a Monte Carlo case."""
    module, _, function = paper.entry(name if name in paper.stages else "montecarlo").partition(":")
    return typing.get_type_hints(getattr(import_module(module), function))["return"]


@pytest.mark.parametrize("slug", sorted(assembly.CLOSEUP_FIELDS))
def test_the_plots_draw_fields_that_the_artifacts_have(slug):
    assert slug in SLUGS
    for needs in assembly.CLOSEUP_FIELDS[slug].values():
        for name, fields in needs.items():
            assert set(fields) <= set(artifacts.quantities(artifact_type(catalogue(slug), name)))


def drawn(slug, **found):
    (draw,) = assembly.CLOSEUP_FIELDS[slug]
    assert {name: set(fields) for name, fields in assembly.CLOSEUP_FIELDS[slug][draw].items()} == {
        name: set(fields) for name, fields in found.items()
    }
    closeup = draw({name: {k: np.asarray(v) for k, v in fields.items()} for name, fields in found.items()})
    json.dumps(closeup.data, allow_nan=False)
    return closeup


def test_the_scatter_holds_the_trials_and_both_covariances():
    covariance = np.stack([np.eye(5), np.diag([4.0, 3.0, 2.0, 1.0, 0.5])])
    flown = {"final_state": np.arange(15.0).reshape(3, 5), "mean": np.ones((2, 5)), "covariance": covariance}
    design = {"mean": np.zeros((2, 4)), "covariance": covariance[:, :4, :4] * 2}
    data = drawn("powered_descent", gains=design, closed_loop=flown, open_loop=flown).data
    closed, opened = data["cases"]
    assert closed["points"] == [[0.0, 1.0, 2.0, 3.0], [5.0, 6.0, 7.0, 8.0], [10.0, 11.0, 12.0, 13.0]]
    assert [ellipse["covariance"][0][0] for ellipse in closed["ellipses"]] == [8.0, 4.0]
    assert [ellipse["mean"][0] for ellipse in closed["ellipses"]] == [0.0, 1.0]
    assert [ellipse["name"] for ellipse in opened["ellipses"]] == ["of the trials"]


def test_the_slices_of_the_car_are_those_of_their_level_and_shape():
    shape = np.tile(np.diag([2.0, 8.0, 2.0 / math.radians(1.0) ** 2]), (5, 1, 1))
    car = {
        "state": np.zeros((9, 3)) + np.arange(9.0)[:, None] * [1.0, 2.0, math.radians(10.0)],
        "funnel": ["flow", "wind"],
        "level": [[1.0, 4.0], [9.0, 9.0]],
        "shape": shape,
        "slice_step": [0, 4],
        "slice_time": [0.0, 0.4],
    }
    flights = {"kept_history": np.zeros((2, 5, 3))}
    data = drawn("funnels", dubins=car, dubins_calm=flights, dubins_wind=flights).data
    assert data["centre"] == [[0.0, 0.0, 0.0], [8.0, 16.0, 80.0]]
    calm, windy = (np.array(case["half_axes"]) for case in data["cases"])
    np.testing.assert_allclose(calm, [np.diag([1.0, 0.5, 1.0]), np.diag([2.0, 1.0, 2.0])], atol=1e-3)
    np.testing.assert_allclose(windy[0], np.diag([3.0, 1.5, 3.0]), atol=1e-3)
    np.testing.assert_allclose(data["cases"][0]["flights"][1], [[0.0, 0.0, 0.0], [8.0, 16.0, 80.0]])


def test_the_histories_say_how_they_ended():
    rows = {name: [[1.0, 2.0], [3.0, math.nan]] for name in ("percentile", "percentile_error", "predicted", "apoapsis")}
    rows |= {name: [[1.0, 2.0], [3.0, 4.0]] for name in ("nominal_delta_v", "control_change")}
    ending = {"variant": ["one_branch", "both"], "outcome": ["cycling", "converged"], "period": [2, 1]}
    data = drawn("random_field", convergence=rows | ending).data
    assert data["series"] == ["one branch: cycling with period 2", "both: converged"]
    assert data["quantities"][0]["values"] == [[1.0, 2.0], [3.0, None]]
    assert data["quantities"][0]["errors"] == [[1.0, 2.0], [3.0, None]]


def test_a_plot_whose_artifacts_are_not_built_is_left_out():
    assert assembly.closeups("powered_descent", {"gains": "nowhere.h5"}) == []
    assert assembly.closeups("desensitized", {}) == []
