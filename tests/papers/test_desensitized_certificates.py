"""Certificates and further perturbations: orders, other formulations of every check, and that each check can fail."""

from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.methods import sensitivity_gains
from marsedl.methods.collocation import SCHEMES, SOLVED, resimulate, simulate
from marsedl.methods.linearization import linearize
from marsedl.models import atmosphere
from marsedl.models.dynamics.velocity_component_entry import velocity_component_entry_rates
from marsedl.papers.desensitized import certificates as module
from marsedl.papers.desensitized import entry_problem, environment, nominal, records
from marsedl.papers.desensitized import further_perturbations as further
from marsedl.papers.desensitized.inputs import MODEL
from marsedl.replication import artifacts
from marsedl.replication.errors import InputError, MarsedlError
from marsedl.replication.inputs import load_study

CONFIG = Path(__file__).parents[2] / "configs" / "desensitized.yaml"
# A coarse mesh, on the branch that reaches all weights without a fold.
SMALL = {
    "intervals": 40,
    "weight_rule": "proportional",
    "weight_factor": 57.3,
    "weight_path": np.array([200.0]),
    "infinite_weights": np.array([573.0, 1500.0]),
    "studied_intervals": np.array([20.0, 40.0]),
    "density_weights": np.array([0.3, 1.0, 3.0, 10.0, 30.0]),
    "branch_tolerance": np.radians(90.0),
    "gain_iterations": 200,
    "substeps": 2,
}
ONE, LAST = 0, 4  # rows of Table 3 without weight and with the largest finite one


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
def best(desensitized):
    return desensitized.nominal("one_reversal", **SMALL)


@pytest.fixture(scope="module")
def rows(desensitized):
    return desensitized.tradeoff("one_reversal", **SMALL)


@pytest.fixture(scope="module")
def certificates(desensitized):
    return desensitized.certificates("one_reversal", **SMALL)


@pytest.fixture(scope="module")
def perturbed(desensitized):
    return desensitized.further_perturbations("one_reversal", **SMALL)


def row_of(rows, number):
    return module.Trajectory(rows.time[number], rows.state[number], rows.bank_acceleration[number])


def saved(tmp_path, artifact):
    path = tmp_path / "artifact.h5"
    artifacts.save(path, artifact, paper="desensitized", reading="mine", provenance={})
    return artifacts.load(path, type(artifact))


# ---- certificates ----------------------------------------------------------------------------------------------------


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
    assert by_mesh["bank_change"][1] == 0.0 < by_mesh["bank_change"].max() < 0.1


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


@pytest.mark.parametrize("scheme", SCHEMES)
def test_sensitivity_is_the_derivative_of_the_discrete_flow(refined, scheme):
    inputs, runs = refined
    solution = runs[scheme][100]
    assert inputs.call(module.flow_deviation, solution) < 1e-8
    other = SCHEMES[SCHEMES.index(scheme) - 1]
    assert inputs.call(module.flow_deviation, replace(solution, scheme=other)) > 1e-6  # not that of another scheme


@pytest.mark.parametrize("profile", ["temperature_pressure_fit", "log_quadratic"])
def test_numpy_has_the_rates_that_the_solver_traces(inputs, best, profile):
    other_inputs = inputs.changed(
        density_profile=profile,
        density_coefficients=np.array([-4e-10, -7e-5, -4.3]),
        density_upper_altitude=135e3,
    )
    states, control = best.state[:-1], best.bank_acceleration
    model = linearize(other_inputs.call(entry_problem.rates), states, control[:, np.newaxis], [0.0, 1.0])
    traced = np.einsum("kij,kj->ki", model.state_matrix, states) + model.control_matrix[:, :, 0] * control[:, None]
    rates = other_inputs.call(module.motion, states, control)
    assert rates == pytest.approx(traced + model.affine, rel=1e-9, abs=1e-9)


def test_motion_takes_density_tables(inputs, best):
    altitude = np.linspace(-5e3, 150e3, 156)
    table = np.column_stack([altitude, np.exp(atmosphere.temperature_pressure_fit(altitude)[0])])
    tabulated = inputs.changed(density_profile="table", density_table=table)
    states, control = best.state[:-1], best.bank_acceleration
    scale = np.abs(inputs.call(module.motion, states, control)).max(axis=0)
    difference = tabulated.call(module.motion, states, control) - inputs.call(module.motion, states, control)
    assert 0.0 < np.abs(difference / scale).max() < 1e-4


@pytest.mark.parametrize("start", [(0.0, 0.0), (0.3, -1.0), (-0.7, 2.0)])
def test_turned_flight_is_a_rotation(start):
    """Any end point of a flight, turned by the rotation that moves the start north."""

    def point(latitude, longitude):
        return np.array(
            [
                np.cos(latitude) * np.cos(longitude),
                np.cos(latitude) * np.sin(longitude),
                np.sin(latitude),
            ]
        )

    def angles(vector):
        return np.array([np.arcsin(vector[2]), np.arctan2(vector[1], vector[0])])

    latitude, longitude = start
    end = latitude + 0.4, longitude + 0.2
    axis = np.array([np.sin(longitude), -np.cos(longitude), 0.0])
    small = 1e-6

    def turned(vector, angle):
        return (
            vector * np.cos(angle)
            + np.cross(axis, vector) * np.sin(angle)
            + axis * (axis @ vector) * (1.0 - np.cos(angle))
        )

    assert angles(turned(point(*start), small)) == pytest.approx([latitude + small, longitude], abs=1e-12)
    change = (angles(turned(point(*end), small)) - angles(turned(point(*end), -small))) / (2.0 * small)
    states = np.zeros((2, 8))
    states[:, 1:3] = start, end
    along = module.Trajectory(np.arange(2.0), states, np.zeros(1))
    assert module.turned_flight(along) == pytest.approx([0.0, *change], abs=1e-9)


def test_identities_hold_on_every_mesh_and_row(certificates):
    c = certificates
    assert (c.mesh_longitude_deviation == 0.0).all() and (c.row_longitude_deviation == 0.0).all()
    assert (c.mesh_status == SOLVED).all()
    assert (c.mesh_crossrange_deviation < 2e-4).all() and (c.row_crossrange_deviation < 2e-5).all()
    # It is the scheme's error, no constant: four times, sixteen times less on the finer mesh.
    ratio = c.mesh_crossrange_deviation[..., 0] / c.mesh_crossrange_deviation[..., 1]
    assert ((ratio[:, :2] > 3.0) & (ratio[:, :2] < 5.0)).all() and ((ratio[:, 2] > 12.0) & (ratio[:, 2] < 20.0)).all()
    assert np.isnan(c.mesh_solver_deviation[0]).all() and (c.mesh_solver_deviation[1] < 1e-7).all()
    assert (c.row_solver_deviation < 1e-7).all() and (c.row_adjoint_deviation < 1e-12).all()
    assert (c.row_frobenius_deviation < 1e-6).all()
    assert (c.flow_deviation < 1e-7).all()


def test_identities_can_fail(inputs, rows):
    along = row_of(rows, LAST)
    sensitivity = inputs.call(module.sensitivities, "midpoint", along)[0]
    other = inputs.call(module.sensitivities, "midpoint", row_of(rows, ONE))[0]
    assert module.column_deviation(rows.column[LAST], other) > 0.01
    assert inputs.call(module.crossrange_deviation, row_of(rows, ONE), other * (1.0 + 1e-3)) > 5e-4
    fed_back = sensitivity.copy()
    fed_back[-1, 0, 2] += 1.0  # a metre of altitude per radian
    assert inputs.call(module.longitude_deviation, fed_back) > 0.0


def test_symmetries_hold_and_are_those_of_the_mirror(inputs, rows, certificates):
    c = certificates
    assert (c.row_defect < 1e-9).all() and (c.shifted_defect < 1e-9).all()
    assert c.mirrored_defect == pytest.approx(c.row_defect, rel=1e-6, abs=1e-14)
    assert (c.mirrored_error_deviation < 1e-6).all() and (c.shifted_error_deviation < 1e-6).all()
    along = row_of(rows, LAST)
    half = along._replace(state=along.state * [1, -1, 1, 1, -1, 1, 1, 1])  # the bank as it was
    assert inputs.call(module.defect, "midpoint", half) > 1e-3
    lifted = along._replace(state=along.state + 1e3 * np.eye(8)[0])  # no symmetry
    assert inputs.call(module.defect, "midpoint", lifted) > 1e-4


def test_the_weight_is_the_slope_of_the_curve(inputs, rows, certificates, monkeypatch):
    assert certificates.slope_weight == pytest.approx(57.3 * np.array([0.001, 0.01, 0.1, 1.0]))
    assert np.abs(certificates.slope_deviation).max() < 1e-5
    # What is left is the error of the difference, of second order.
    monkeypatch.setattr(module, "NEIGHBOUR", 10.0 * module.NEIGHBOUR)
    wider = inputs.call(module.slopes, rows, [2])
    assert wider[0] / certificates.slope_deviation[1] == pytest.approx(100.0, rel=0.05)


def test_other_derivatives_find_the_same_solution(certificates):
    exact, unexpanded, approximated = range(3)
    iterations, efforts = certificates.variant_iterations, certificates.variant_effort
    assert (certificates.variant_status[:, :2] == SOLVED).all()
    assert efforts[:, unexpanded] == pytest.approx(efforts[:, exact], rel=1e-8)
    assert efforts[:, approximated] == pytest.approx(efforts[:, exact], rel=1e-6)
    assert (iterations[:, approximated] > 2 * iterations[:, exact]).all()
    assert (certificates.variant_reversals == certificates.variant_reversals[:, :1]).all()


def test_flights_leave_the_linear_errors_with_the_second_power(inputs, best, certificates):
    c, size = certificates, inputs.tabulated_error
    assert c.radius_error == pytest.approx(size * np.array([0.01, -0.01, 0.1, -0.1, 1.0, -1.0]))
    even = np.linalg.norm(c.flown_error[:, ::2] + c.flown_error[:, 1::2], axis=-1) / 2.0
    assert even[:, 1:] / even[:, :-1] == pytest.approx(np.full((2, 2), 100.0), rel=0.2)
    odd = (c.flown_error[:, ::2] - c.flown_error[:, 1::2]) / 2.0
    linear = c.linear_error[:, ::2]
    assert (np.linalg.norm(odd - linear, axis=-1) < 0.02 * np.linalg.norm(linear, axis=-1)).all()
    lengths = np.array([1.0, inputs.planet_radius, inputs.planet_radius])
    problem, controls = inputs.call(entry_problem.problem), best.bank_acceleration[:, np.newaxis]
    ends = [
        simulate(problem, best.state[0] + moved * np.eye(8)[0], controls, best.time, [0.0, 1.0])[-1, :3] * lengths
        for moved in (0.0, size)
    ]
    assert c.flown_error[0, 4] == pytest.approx(ends[1] - ends[0], abs=0.05)


def test_what_does_not_converge_is_stored(inputs, rows, certificates, tmp_path):
    hurried = inputs.changed(solver_iterations=1)
    run = hurried.call(module.refined, module.Case(0.0, module.row_guess(rows, LAST)), "midpoint")
    by_mesh = hurried.call(module.meshes, run, [20, 40])
    assert (by_mesh["status"] != SOLVED).all() and (by_mesh["iterations"] == 1).all()
    assert np.isnan(hurried.call(module.flow_deviation, run[40]))
    assert np.isnan(hurried.call(module.slopes, rows, [LAST])).all()
    unknown = {
        f"mesh_{name}": np.broadcast_to(values, getattr(certificates, f"mesh_{name}").shape)
        for name, values in by_mesh.items()
        if name not in ("error", "flown_error", "miss")
    }
    assert np.isnan(saved(tmp_path, replace(certificates, **unknown)).mesh_effort).all()


def test_certificates_can_be_saved(certificates, tmp_path):
    assert saved(tmp_path, certificates).mesh_effort.shape == (2, 3, 2)


# ---- further perturbations -------------------------------------------------------------------------------------------


def test_directions_are_the_derivatives_of_the_entry_state(inputs):
    directions = inputs.call(further.directions)
    for number, (name, step) in enumerate((("entry_velocity", 1.0), ("entry_flight_path_angle", 1e-4)), start=1):
        both = [
            inputs.changed(entry_azimuth=1.2, **{name: getattr(inputs, name) + s}).call(entry_problem.entry_state)
            for s in (step, -step)
        ]
        expected = (both[0] - both[1]) / (2.0 * step)
        turned = inputs.changed(entry_azimuth=1.2).call(further.directions)
        assert turned[:, number] == pytest.approx(expected, rel=1e-7, abs=1e-7)
    assert (directions[:, records.DENSITY] == 0.0).all()


def test_linear_errors_are_those_of_the_solvers_columns(perturbed, rows):
    """The columns of the transcription, by which the solver desensitizes, and the recursion with its forcing."""
    p = perturbed
    steps = [int(np.flatnonzero(p.path_weight == weight)[0]) for weight in p.design_weight]
    assert p.design_linear_error[:, records.DENSITY] == pytest.approx(p.path_error[steps], rel=1e-7, abs=1e-5)
    assert p.row_linear_error[:, further.RADIUS] == pytest.approx(rows.error, rel=1e-7, abs=1e-5)


def test_flown_errors_approach_the_linear_ones(inputs, best):
    along = further.Trajectory(best.time, best.state, best.bank_acceleration)
    air = inputs.call(environment.surroundings)
    tenth = inputs.changed(
        **{
            name: getattr(inputs, name) / 10.0
            for name in ("density_error", "velocity_error", "path_angle_error", "tabulated_error")
        },
    )
    whole, part = (of.call(further.flown_errors, air, along) for of in (inputs, tenth))
    linear = inputs.call(further.linear_errors, along)
    odd = (part[:, 0] - part[:, 1]) * 5.0
    # The rest is the error of the midpoint rule on this mesh.
    assert (np.linalg.norm(odd - linear, axis=1) < 0.01 * np.linalg.norm(linear, axis=1)).all()
    even = [np.linalg.norm(errors[:4].sum(axis=1), axis=1) for errors in (whole, part)]
    assert even[0] / even[1] == pytest.approx(np.full(4, 100.0), rel=0.15)


def flown_by_adaptive_steps(inputs, along, gain, factor, deviation=0.0):
    """Final error of one flight beside its nominal, with feedback, by another integrator and the closed density."""

    def rates(state, control, density_factor):
        density = density_factor * np.exp(atmosphere.temperature_pressure_fit(state[0])[0])
        return velocity_component_entry_rates(
            state,
            control,
            density,
            (inputs.ballistic_coefficient, inputs.lift_to_drag),
            (inputs.gravitational_parameter, inputs.planet_radius),
        )

    def both(_, states, control):
        trial, beside = states[:8], states[8:]
        bound = inputs.bank_acceleration_bound
        commanded = np.clip(control + gain @ (trial - beside), -bound, bound)
        return [*rates(trial, commanded, factor), *rates(beside, control, 1.0)]

    states = np.concatenate([along.state[0] + deviation * np.eye(8)[0], along.state[0]])
    for control, start, end in zip(along.bank_acceleration, along.time[:-1], along.time[1:], strict=True):
        states = solve_ivp(both, (start, end), states, "DOP853", rtol=1e-9, atol=1e-9, args=(control,)).y[:, -1]
    return (states[:3] - states[8:11]) * [1.0, inputs.planet_radius, inputs.planet_radius]


@pytest.mark.parametrize(
    ("law", "factor", "deviation"),
    [(further.NO_FEEDBACK, 1.05, 0.0), (further.BOTH_TUNED, 0.95, 0.0), (further.BOTH_TUNED, 1.0, 1000.0)],
)
def test_flights_agree_with_another_integrator(inputs, best, perturbed, law, factor, deviation):
    along = further.Trajectory(best.time, best.state, best.bank_acceleration)
    air = inputs.call(environment.surroundings)
    gain = perturbed.gain[further.LAWS.index(law)]
    deviations = deviation * np.eye(8)[:1]
    error = inputs.changed(substeps=20).call(further.flight_errors, air, along, gain, deviations, np.array([factor]))[0]
    assert error == pytest.approx(flown_by_adaptive_steps(inputs, along, gain, factor, deviation), abs=2e-3)


def test_without_feedback_the_laws_fly_as_the_nominal(perturbed):
    p, one = perturbed, further.LAWS.index(further.NO_FEEDBACK)
    assert (p.gain[one] == 0.0).all()
    assert p.density_error[4:6] == pytest.approx([0.05, -0.05])
    assert p.density_flown_error[one, 4:6] == pytest.approx(p.design_flown_error[0, records.DENSITY], rel=1e-6)
    assert p.radius_flown_error[one, 2:] == pytest.approx(p.design_flown_error[0, further.RADIUS], rel=1e-6)


def test_the_weight_on_density_is_the_slope_of_its_curve(inputs, best, perturbed):
    beside = inputs.changed(density_weights=np.array([2.997, 3.003]))
    points, _, _, extended = beside.call(further.density_path, best)
    (low, near), (high, far) = (
        (further.effort(point.solution), np.linalg.norm(inputs.call(further.final_error, extended, point.solution)))
        for point in points[-2:]
    )
    assert (high - low) / (near - far) * inputs.tabulated_error == pytest.approx(3.0, rel=1e-4)
    p = perturbed
    norm = np.linalg.norm(p.path_error, axis=1) / inputs.tabulated_error
    assert (p.path_branch == 0).all()
    slope = -np.diff(p.path_effort) / np.diff(norm)
    assert (slope > p.path_weight[:-1]).all() and (slope < p.path_weight[1:]).all()
    assert p.design_weight == pytest.approx([0.0, *inputs.density_weights])
    assert p.path_end == "at the largest weight wanted"


def test_desensitizing_against_density_helps_in_flights(perturbed):
    error_norm = np.linalg.norm(perturbed.design_flown_error[:, records.DENSITY], axis=-1)
    assert (error_norm[1:] < error_norm[:-1]).all()


def test_null_gains_null_in_the_linear_model_of_their_own(inputs, best, perturbed):
    """By the recursion with the gain in it, beside the search's own derivative."""
    p, along = perturbed, further.Trajectory(best.time, best.state, best.bank_acceleration)
    null, both = further.LAWS.index(further.NULL), further.LAWS.index(further.BOTH_NULL)
    assert p.converged[null] and p.converged[both]
    open_loop = np.linalg.norm(p.law_linear_error[0], axis=-1)
    assert np.linalg.norm(p.law_linear_error[null, 0]) < 1e-6 * open_loop[0]
    assert (np.linalg.norm(p.law_linear_error[both], axis=-1) < 1e-6 * open_loop).all()
    # The same by differences of the discrete closed loop: x1 - x0 = h f((x0 + x1)/2, u + K dx, density).
    step, small = np.diff(along.time), 1e-9
    moved, gain = along.state[0].copy(), p.gain[null]
    for k, h in enumerate(step):
        start, middle = moved, (along.state[k] + along.state[k + 1]) / 2.0
        moved = start + along.state[k + 1] - along.state[k]
        for _ in range(60):  # a fixed point: h f contracts
            mean = (start + moved) / 2.0
            control = along.bank_acceleration[k] + gain @ (mean - middle)
            density = (1.0 + small) * np.exp(atmosphere.temperature_pressure_fit(mean[0])[0])
            rates = velocity_component_entry_rates(
                mean,
                control,
                density,
                (inputs.ballistic_coefficient, inputs.lift_to_drag),
                (inputs.gravitational_parameter, inputs.planet_radius),
            )
            moved = start + h * np.array(rates)
    lengths = np.array([1.0, inputs.planet_radius, inputs.planet_radius])
    error = (moved - along.state[-1])[:3] * lengths / small * inputs.density_error
    assert np.linalg.norm(error) < 0.01 * open_loop[0]


def test_tuned_gains_do_not_depend_on_their_start(inputs, best, perturbed, monkeypatch):
    along = further.Trajectory(best.time, best.state, best.bank_acceleration)
    air = inputs.call(environment.surroundings)
    number = further.LAWS.index(further.BOTH_TUNED)
    assert perturbed.converged[number]
    error_norm = np.linalg.norm(perturbed.density_flown_error, axis=-1)[:, 2:6]
    assert (error_norm[number] < 0.5 * error_norm[0]).all()
    original, other = sensitivity_gains.tune, np.array([0.1, -2.0, 0.5, 0.1, 1.0, -0.5])
    monkeypatch.setattr(
        sensitivity_gains,
        "tune",
        lambda errors, start, **options: original(errors, start + other, **options),
    )
    again = inputs.call(further.tuned, air, along, [inputs.tabulated_error])
    assert again.scaled_gain == pytest.approx(perturbed.scaled_gain[number], rel=1e-3, abs=1e-3)


def test_a_path_that_ends_is_kept(inputs, best, monkeypatch):
    original = further.follow

    def ends(solver, design, transcribed, first, weights):
        if weights[0] > 1.0:
            raise MarsedlError("no further")
        return original(solver, design, transcribed, first, weights)

    monkeypatch.setattr(further, "follow", ends)
    points, designs, path_end, _ = inputs.call(further.density_path, best)
    assert [point.solution.given["weight"] for point in designs] == [0.0, 0.3, 1.0]
    assert points[-1] is designs[-1] and path_end == "no solution was found between the weights 1 and 3"


def test_flights_that_come_to_the_ground_are_no_errors(inputs, best):
    along = further.Trajectory(best.time, best.state, best.bank_acceleration)
    air = inputs.call(environment.surroundings)
    deviations = np.zeros((2, 8))
    deviations[1, 3] = -1500.0  # straight down
    errors = inputs.call(further.flight_errors, air, along, np.zeros(8), deviations, np.ones(2))
    assert (errors[0] == 0.0).all() and np.isnan(errors[1]).all()
    vacuum = inputs.changed(density_error=0.5)
    assert np.isnan(
        vacuum.call(
            further.under_law,
            air,
            along,
            further.Law(np.zeros(6), True, ""),
            further.FlownErrors(np.array([-1.0]), np.empty(0)),
        )["density_flown_error"]
    ).all()
    steep = inputs.changed(tabulated_error=1e6)
    law = steep.call(further.tuned, air, along, [1e6])
    assert not law.converged and "nothing to start from" in law.ended


def test_density_errors_leave_some_air():
    studies = {"density_error": {"value": 0.6, "source": "assumed: test"}}
    overlay = {"readings": {"mine": {"based_on": "corrected", "studies": studies}}}
    with pytest.raises(InputError, match=r"density_error.*0\.5"):
        load_study("desensitized", MODEL, CONFIG, overlay=overlay, overlay_name="mine.yaml")


def test_further_perturbations_can_be_saved(perturbed, tmp_path):
    loaded = saved(tmp_path, perturbed)
    assert loaded.row_flown_error.shape == (7, 6, 2, 3)
    assert loaded.law.tolist() == list(further.LAWS)
