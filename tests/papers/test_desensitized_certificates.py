"""Schemes and meshes: orders, an adaptive integration, and that the longitude's column can fail."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from marsedl.methods.collocation import SCHEMES, SOLVED, resimulate, simulate
from marsedl.papers.desensitized import certificates as module
from marsedl.papers.desensitized import entry_problem, nominal
from marsedl.replication.records import store

# A coarse mesh, on the branch that reaches all weights without a fold.
SMALL = {
    "intervals": 40,
    "weight_rule": "proportional",
    "weight_factor": 57.3,
    "weight_path": np.array([200.0]),
    "infinite_weights": np.array([573.0, 1500.0]),
    "studied_intervals": np.array([20.0, 40.0]),
    "branch_tolerance": np.radians(90.0),
    "substeps": 2,
}
LAST = 4  # row of Table 3 with the largest finite weight


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """Flights of a few trials are faster without others to wait for."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)


@pytest.fixture(scope="module")
def inputs(desensitized):
    return desensitized.inputs("one_reversal", **SMALL)


@pytest.fixture(scope="module")
def rows(desensitized):
    return desensitized.tradeoff("one_reversal", **SMALL)


@pytest.fixture(scope="module")
def certificates(desensitized):
    return desensitized.certificates("one_reversal", **SMALL)


@pytest.fixture(scope="module")
def refined(desensitized):
    """The nominal by every scheme on three meshes, fine enough for the orders to show."""
    inputs = desensitized.inputs("corrected", studied_intervals=np.array([50.0, 100.0, 200.0]))
    case = module.Case(0.0, nominal.as_guess(inputs.call(nominal.compute)))
    return inputs, {scheme: inputs.call(module.refined, case, scheme) for scheme in SCHEMES}


@pytest.mark.parametrize(("scheme", "order"), [("midpoint", 2.0), ("trapezoid", 2.0), ("hermite_simpson", 4.0)])
def test_miss_and_sensitivity_converge_with_the_order_of_the_scheme(refined, scheme, order):
    inputs, runs = refined
    numbers = np.array([50, 100, 200])
    by_mesh = inputs.call(module.meshes, runs[scheme], numbers)
    assert (by_mesh["status"] == SOLVED).all()
    assert module.orders(by_mesh["miss"], numbers) == pytest.approx(np.full(2, order), rel=0.05)
    assert module.orders(by_mesh["error"] - by_mesh["flown_error"], numbers) == pytest.approx(
        np.full(2, order), rel=0.05
    )


def test_schemes_agree_on_fine_meshes(refined):
    inputs, runs = refined
    mesh_fields = [inputs.call(module.meshes, runs[scheme], [200]) for scheme in SCHEMES]
    error = np.array([run["error"][0] for run in mesh_fields])
    assert np.linalg.norm(error - error[-1], axis=-1).max() < 1e-4 * np.linalg.norm(error[-1])
    # Controls that are constant on intervals cost more than the best ones: that much the schemes share.
    assert np.ptp([run["effort"][0] for run in mesh_fields]) < 2e-3 * mesh_fields[-1]["effort"][0]


def test_flights_of_the_meshes_agree_with_an_adaptive_integration(refined):
    inputs, runs = refined
    solution = runs["midpoint"][100]
    miss, error = inputs.call(module.flight_errors, entry_problem.of_solution(solution))
    lengths = np.array([1.0, inputs.planet_radius, inputs.planet_radius])
    target = np.array([inputs.final_altitude, inputs.final_latitude, inputs.final_longitude])
    # The flights look the density up in cubics of 1 km, which leave 1.3e-5 m; their steps leave 1e-5 m here.
    assert miss == pytest.approx((resimulate(solution)[-1, :3] - target) * lengths, abs=3e-5)
    start, both = solution.states[0], []
    for sign in (1.0, -1.0):
        moved = start + sign * 5.0 * np.eye(8)[0]
        end = simulate(solution.problem, moved, solution.controls, solution.time, list(solution.given.values()))
        both.append(end[-1, :3] * lengths)
    assert error == pytest.approx((both[0] - both[1]) / 10.0 * inputs.tabulated_error, abs=1e-2)


def test_what_does_not_converge_is_stored(inputs, rows, certificates, tmp_path):
    hurried = inputs.changed(solver_iterations=1)
    run = hurried.call(module.refined, module.Case(0.0, module.row_guess(rows, LAST)), "midpoint")
    by_mesh = hurried.call(module.meshes, run, [20, 40])
    assert (by_mesh["status"] != SOLVED).all() and (by_mesh["iterations"] == 1).all()
    unknown = {
        f"mesh_{name}": np.broadcast_to(values, getattr(certificates, f"mesh_{name}").shape)
        for name, values in by_mesh.items()
        if name not in ("error", "flown_error", "miss")
    }
    artifact = replace(certificates, **unknown)
    store.save(tmp_path / "one.h5", artifact, paper="desensitized", reading="mine", provenance={})
    assert np.isnan(store.load(tmp_path / "one.h5", type(artifact)).mesh_effort).all()


def test_the_longitudes_column_is_exact_everywhere_and_can_fail(inputs, rows, certificates):
    assert (certificates.mesh_status == SOLVED).all()
    assert (certificates.mesh_longitude_deviation == 0.0).all() and (certificates.row_longitude_deviation == 0.0).all()
    along = entry_problem.of_rows(rows)[LAST]
    sensitivity = inputs.call(module.sensitivities, "midpoint", along)
    sensitivity[-1, 0, 2] += 1.0  # a metre of altitude per radian
    assert inputs.call(module.longitude_deviation, sensitivity) > 0.0
