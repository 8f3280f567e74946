"""Closed form of covariance steering; numbers of the descent at the fixed point of its mass iteration."""

import time as clock
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from marsedl.methods.covariance_steering.closed_form import (
    SteeringError,
    SteeringProblem,
    escape_margin,
    predicted_covariance,
    riccati_initial,
    steer,
)
from marsedl.models.dynamics.powered_descent import powered_descent_rates

NOISE_DENSITIES = [0.0, 0.02, 1.0, 50.0, 360.0, 2500.0, 1e5]


def at(grid, values, t):
    return CubicSpline(grid, values)(t)


# --- mass iteration ---------------------------------------------------------------------------------------------------


def test_mass_iteration_converges_to_the_known_mass_with_a_small_factor(new_descent):
    descent = new_descent()
    masses = descent.iterate_mass(7)
    # Printed to the given digits: passes without feedback in the nominal run.
    np.testing.assert_allclose(masses[:4], [1341.67, 1349.739, 1349.435, 1349.445], atol=5.1e-3)
    assert masses[-1] == pytest.approx(1349.4446, abs=1e-4)
    assert descent.masses[0][-1] == pytest.approx(1390.5594, abs=1e-4)
    changes = np.abs(np.diff(masses))[:5]  # later ones are near rounding
    assert (changes[1:] / changes[:-1] < 0.06).all()


@pytest.mark.parametrize("guess", [1000.0, 1250.0])
def test_mass_iteration_forgets_its_start(new_descent, guess):
    descent = new_descent(0.05)
    descent.masses = [np.full(len(grid), guess) for grid in descent.grids]
    assert descent.iterate_mass(7)[-1] == pytest.approx(1349.44459, abs=1e-5)


def test_climbing_start_ends_heavier(new_descent):
    descent = new_descent(0.05)
    final = descent.iterate_mass(7, initial_mean=descent.means[0] * [1, 1, 1, -1])[-1]
    assert final == pytest.approx(1354.90, abs=5e-3)


# --- values of the base case ------------------------------------------------------------------------------------------

LAMBDA_0 = [  # per segment: downrange and altitude axis (rr, rv, vv)
    [(664.2265, 12179.39, 268578.6), (664.2265, 12179.39, 268578.6)],
    [(3469.061, 32782.81, 402207.0), (3935.809, 36678.97, 437730.9)],
]


@pytest.mark.parametrize("segment", [0, 1])
def test_riccati_costate_gramian_and_costs(descent, steerings, segment):
    problem, steering = descent.problem(segment), steerings[segment]
    for axis, expected in enumerate(LAMBDA_0[segment]):
        block = riccati_initial(problem)[np.ix_([axis, axis + 2], [axis, axis + 2])]
        np.testing.assert_allclose(block[np.triu_indices(2)], expected, rtol=4e-7)  # half of the last digit
    costates = [(-1171056.74, -42895.84, -19317849.7, 8079879.81), (334386.98, -387812.74, 2532775.37, 4678442.67)]
    np.testing.assert_allclose(steering.mean_costate, costates[segment], rtol=2e-7)
    moments = [(2.924022e-3, 1.669024e-4, 1.254989e-5), (6.064104e-4, 6.031950e-5, 7.963618e-6)][segment]
    assert problem.gramian[-1][[0, 0, 2], [0, 2, 2]] * [1, -1, 1] == pytest.approx(moments, rel=4e-7)
    assert steering.mean_cost == pytest.approx([2.0822409e9, 5.0111151e8][segment], rel=5e-8)
    altitude_cost = steer(descent.axis(segment, 1)).covariance_cost
    assert altitude_cost == pytest.approx([1.609634e6, 1.065318e6][segment], rel=5e-7)
    assert steering.escape_margin.min() == pytest.approx([0.0253, 0.0032][segment], abs=5e-5)


def test_riccati_for_the_smaller_downrange_target(descent):
    lambda_0 = riccati_initial(descent.problem(1, final_covariance=np.diag([4, 0.25, 0.25, 0.25])))
    assert lambda_0[[0, 0, 2], [0, 2, 2]] == pytest.approx((3561.735, 33550.02, 409027.4), rel=4e-7)


NOMINAL = [  # segment, time in it, mean state, mass, thrust as a fraction of the maximum
    (0, 0, (250, 500, 46.985, -17.101), 1500, 0.7755),
    (0, 5, (387.13, 414.06, 9.831, -17.069), 1470.03, 0.5976),
    (0, 10, (369.02, 331.28, -14.907, -15.860), 1447.53, 0.4380),
    (0, 15, (260.52, 257.21, -26.183, -13.599), 1430.80, 0.3455),
    (0, 20, (130.88, 196.93, -23.254, -10.349), 1415.34, 0.3860),
    (0, 25, (52.77, 155.51, -5.434, -6.018), 1395.43, 0.5385),
    (0, 26, (50, 150, 0, -5), 1390.56, 0.5768),
    (1, 0, (50, 150, 0, -5), 1390.56, 0.2125),
    (1, 4, (58.66, 121.90, 3.875, -8.490), 1382.46, 0.2549),
    (1, 9, (82.22, 78.32, 4.817, -8.031), 1369.71, 0.3319),
    (1, 14, (99.35, 50.99, 1.268, -1.931), 1353.24, 0.4242),
    (1, 15, (100, 50, 0, 0), 1349.44, 0.4440),
]


@pytest.mark.parametrize(("segment", "t", "mean", "mass", "fraction"), NOMINAL)
def test_nominal_motion(descent, steerings, segment, t, mean, mass, fraction):
    steering, grid = steerings[segment], descent.grids[segment]
    np.testing.assert_allclose(at(grid, steering.mean, t), mean, atol=5.1e-3)  # digits of positions
    assert at(grid, descent.masses[segment], t) == pytest.approx(mass, abs=5.1e-3)
    thrust = np.linalg.norm(at(grid, steering.feedforward, t)) / descent.maximum_thrust
    assert thrust == pytest.approx(fraction, abs=5.1e-5)


GAINS = [  # segment, time in it, (position, velocity) gain of the downrange axis, of the altitude axis
    (0, 0, (8.12, 179.1), (8.12, 179.1)),
    (0, 13, (25.41, 291.9), (25.41, 291.9)),
    (0, 26, (-11.68, 87.5), (-11.68, 87.5)),
    (1, 0, (23.58, 289.2), (26.38, 314.8)),
    (1, 7, (50.76, 379.8), (80.74, 548.1)),
    (1, 15, (-7.34, 261.7), (-15.10, 301.5)),
]


@pytest.mark.parametrize(("segment", "t", "downrange", "altitude"), GAINS)
def test_gains(descent, steerings, segment, t, downrange, altitude):
    gain = at(descent.grids[segment], steerings[segment].gain, t)
    np.testing.assert_allclose(gain[[0, 1], [0, 1]], [downrange[0], altitude[0]], atol=5.1e-3)
    np.testing.assert_allclose(gain[[0, 1], [2, 3]], [downrange[1], altitude[1]], atol=5.1e-2)


def test_gain_extremes_and_sign_changes(descent, steerings):
    def largest(segment, row, column):
        values = steerings[segment].gain[:, row, column]
        return values.max(), descent.grids[segment][values.argmax()]

    def sign_change(segment, row):
        values = steerings[segment].gain[:, row, row]
        return descent.grids[segment][1:][np.diff(np.sign(values)) != 0]

    assert largest(0, 0, 0) == pytest.approx((39.8, 19.0), abs=0.05)
    assert largest(0, 0, 2) == pytest.approx((307.3, 15.8), abs=0.05)
    assert largest(1, 1, 1) == pytest.approx((416.1, 39.1 - 26), abs=0.05)
    assert largest(1, 1, 3) == pytest.approx((981.4, 38.2 - 26), abs=0.05)
    for segment, row, expected in ((0, 0, 24.98), (0, 1, 24.98), (1, 0, 14.69), (1, 1, 14.96)):
        assert sign_change(segment, row) == pytest.approx([expected], abs=0.011)  # a cell


VARIANCES = [  # segment, axis, variance of the downrange target, times in the segment, position variances
    (0, 0, 5, (0, 5, 10, 13, 20, 26), (40, 101.505, 145.914, 133.572, 47.930, 10)),
    (0, 1, 5, (0, 5, 10, 13, 20, 26), (40, 101.505, 145.914, 133.572, 47.930, 10)),
    (1, 0, 5, (0, 4, 7, 10, 15), (10, 14.824, 14.868, 10.519, 5)),
    (1, 0, 4, (0, 4, 7, 10, 15), (10, 14.6455, 14.333, 9.661, 4)),
    (1, 1, 5, (0, 4, 7, 10, 15), (10, 13.911, 12.167, 6.285, 0.25)),
]


@pytest.mark.parametrize(("segment", "axis", "target", "times", "expected"), VARIANCES)
def test_position_variances(descent, segment, axis, target, times, expected):
    changes = {"final_covariance": np.diag([target, 0.25, 0.25, 0.25])} if segment else {}
    variance = steer(descent.problem(segment, **changes)).covariance[:, axis, axis]
    np.testing.assert_allclose(at(descent.grids[segment], variance, times), expected, atol=5.1e-4)


# --- what any solution must satisfy -----------------------------------------------------------------------------------


@pytest.mark.parametrize("segment", [0, 1])
@pytest.mark.parametrize("noise_density", NOISE_DENSITIES)
def test_both_ends_are_met_at_any_noise_density(descent, segment, noise_density):
    problem = descent.problem(segment, noise_density=noise_density)
    steering = steer(problem)
    scale = np.sqrt(np.diag(problem.final_covariance))
    miss = (steering.covariance[-1] - problem.final_covariance) / np.outer(scale, scale)
    assert np.abs(miss).max() < 1e-8  # cancellation at the largest density; 1e-11 elsewhere
    np.testing.assert_allclose(steering.covariance[0], problem.initial_covariance, rtol=1e-13)
    np.testing.assert_allclose(steering.mean[[0, -1]], [problem.initial_mean, problem.final_mean], atol=1e-8)
    assert np.linalg.eigvalsh(steering.covariance).min() > 0
    assert steering.escape_margin.min() > 0


def test_riccati_is_indefinite_at_low_noise_but_steering_still_exists(descent):
    signs = [np.sign(np.linalg.eigvalsh(riccati_initial(descent.axis(0, 0, noise_density=g)))) for g in (360.0, 0.02)]
    assert signs[0].tolist() == [1, 1]
    assert signs[1].tolist() == [-1, 1]


@pytest.mark.parametrize("segment", [0, 1])
def test_the_other_root_meets_the_ends_but_escapes(descent, segment):
    problem = descent.problem(segment)
    other = riccati_initial(problem, root=+1)
    end = predicted_covariance(problem, other, problem.noise_density, problem.initial_covariance)[-1]
    np.testing.assert_allclose(end, problem.final_covariance, rtol=0, atol=1e-9)
    margin = escape_margin(problem, other)
    assert margin[0] == 1
    assert margin.min() < 0
    with pytest.raises(SteeringError, match="escapes before t ="):
        steer(problem, root=+1)


def test_root_must_be_a_sign(descent):
    with pytest.raises(SteeringError, match="root"):
        steer(descent.problem(0), root=0)


def test_the_unit_of_control_does_not_matter(descent):
    base = descent.problem(1)
    expected = steer(base)
    for unit in (1000.0, 18000.0):
        scaled = replace(
            base,
            control_matrix=base.control_matrix * unit,
            gramian=base.gramian * unit**2,
            noise_density=base.noise_density / unit,
        )
        steering = steer(scaled)
        np.testing.assert_allclose(steering.gain * unit, expected.gain, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(steering.feedforward * unit, expected.feedforward, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(steering.mean, expected.mean, atol=1e-10)
        np.testing.assert_allclose(steering.covariance, expected.covariance, atol=1e-10)


def test_the_mean_does_not_depend_on_noise_or_covariances(descent, steerings):
    other = steer(descent.problem(0, noise_density=1.0, initial_covariance=np.eye(4), final_covariance=2 * np.eye(4)))
    assert (other.mean == steerings[0].mean).all()
    assert (other.feedforward == steerings[0].feedforward).all()
    assert (other.mean_costate == steerings[0].mean_costate).all()


def test_axes_do_not_couple_and_the_gain_jumps(steerings):
    for steering in steerings:
        # Rounding of the eigenvectors, which are not unique where both axes are equal; the gains are 7 to 981.
        np.testing.assert_allclose(steering.gain[:, [0, 0, 1, 1], [1, 3, 0, 2]], 0, atol=1e-9)
    np.testing.assert_allclose(steerings[0].gain[:, 0, [0, 2]], steerings[0].gain[:, 1, [1, 3]], rtol=0, atol=1e-9)
    jump = steerings[1].gain[0] - steerings[0].gain[-1]
    assert (jump[[0, 1, 0, 1], [0, 1, 2, 3]] > [30, 30, 200, 200]).all()


def test_one_axis_alone_gives_the_same_design(descent, steerings):
    axis = steer(descent.axis(1, 1))
    np.testing.assert_allclose(axis.gain[:, 0], steerings[1].gain[:, 1, [1, 3]], rtol=1e-9, atol=1e-9)


def test_costs_are_the_integrals_that_they_stand_for(steerings):
    for steering in steerings:
        feedback = np.einsum("kij,kjl,kil->k", steering.gain, steering.covariance, steering.gain)
        effort = np.einsum("ki,ki->k", steering.feedforward, steering.feedforward)
        for density, cost in ((feedback, steering.covariance_cost), (effort, steering.mean_cost)):
            assert CubicSpline(steering.time, density).integrate(0, steering.time[-1]) == pytest.approx(cost, rel=1e-10)


def test_larger_start_covariance_gives_larger_end_covariance(descent):
    problem = descent.problem(1)
    lambda_0, target = riccati_initial(problem), problem.final_covariance
    random = np.random.default_rng(4)
    for _ in range(20):
        extra = np.diag([3.0, 3, 0.5, 0.5]) @ random.standard_normal((4, 4))
        start = problem.initial_covariance + extra @ extra.T
        end = predicted_covariance(problem, lambda_0, problem.noise_density, start)[-1]
        assert np.linalg.eigvalsh(end - target).min() > 0


def test_a_quieter_plant_ends_below_the_target(descent):
    problem = descent.problem(1)
    quiet = predicted_covariance(problem, riccati_initial(problem), 0.0, problem.initial_covariance)[-1]
    assert np.linalg.eigvalsh(problem.final_covariance - quiet).min() > 0


def test_nonlinear_flight_without_noise_follows_the_mean_and_ends_with_the_prior_mass(descent, steerings):
    mass = descent.wet_mass
    for segment, steering in enumerate(steerings):
        grid = descent.grids[segment]
        mean, thrust, gain = (CubicSpline(grid, x) for x in (steering.mean, steering.feedforward, steering.gain))

        def rates(t, y, mean=mean, thrust=thrust, gain=gain):
            u = thrust(t) - gain(t) @ (y[:4] - mean(t))
            return powered_descent_rates(y, u, (0.0, 0.0), descent.gravity, descent.mass_flow_constant)

        start = [*descent.means[segment], mass]
        end = solve_ivp(rates, (0, grid[-1]), start, method="DOP853", rtol=1e-10, atol=1e-9).y[:, -1]
        np.testing.assert_allclose(end[:4], descent.means[segment + 1], atol=1e-6)
        mass = end[4]
    assert mass == pytest.approx(1349.4446, abs=1e-4)


# --- quadrature -------------------------------------------------------------------------------------------------------


def linear_mass_gramian(t, mass, flow):
    """int_0^t s^k / (mass - flow s)^2 ds for k = 0, 1, 2."""
    mass_at = mass - flow * t
    zero = t / (mass * mass_at)
    one = (flow * t / mass_at + np.log(mass_at / mass)) / flow**2
    two = (mass * (mass / mass_at - 1) + flow * t + 2 * mass * np.log(mass_at / mass)) / flow**3
    return np.array([[two, -one], [-one, zero]])


def test_gramian_converges_with_order_four():
    mass, flow, duration = 1500.0, 60.0, 20.0
    exact = linear_mass_gramian(duration, mass, flow)
    errors = []
    for cells in (20, 40, 80):
        time = np.linspace(0, duration, cells + 1)
        control_matrix = np.array([[0.0], [1.0]]) / (mass - flow * time)[:, None, None]
        problem = SteeringProblem.from_linear_model(
            time,
            (np.eye(2, k=1), control_matrix, np.array([0, -3.71])),
            initial_mean=np.zeros(2),
            final_mean=np.zeros(2),
            initial_covariance=np.eye(2),
            final_covariance=np.eye(2),
            noise_density=1.0,
        )
        errors.append(np.abs(problem.gramian[-1] / exact - 1).max())
    assert (np.log2(np.array(errors[:-1]) / errors[1:]) > 3.7).all()
    np.testing.assert_allclose(  # constant A and c: exact
        problem.affine_response, np.outer(time**2, [-3.71 / 2, 0]) + np.outer(time, [0, -3.71]), atol=1e-10
    )


def test_varying_state_matrix_converges_with_order_four():
    # A(t) = exp(St) A0 exp(-St) has Phi(t,0) = exp(St) exp((A0 - S)t); neither commutes with the other.
    spin, a_0 = np.array([[0.0, 1], [-1, 0]]), np.array([[-0.3, 0.5], [0.1, 0.2]])
    affine_0, duration = np.array([1.0, -2.0]), 2.0

    def final(cells):
        time = np.linspace(0, duration, cells + 1)
        turn = expm(spin * time[:, None, None])
        problem = SteeringProblem.from_linear_model(
            time,
            (turn @ a_0 @ np.linalg.inv(turn), turn @ np.array([[0.0], [1.0]]), turn @ affine_0),
            initial_mean=np.zeros(2),
            final_mean=np.zeros(2),
            initial_covariance=np.eye(2),
            final_covariance=np.eye(2),
            noise_density=1.0,
        )
        return problem.transition[-1], problem.affine_response[-1]

    turn, step = expm(spin * duration), expm((a_0 - spin) * duration)
    exact = turn @ step, turn @ np.linalg.solve(a_0 - spin, (step - np.eye(2)) @ affine_0)
    errors = np.array([[np.abs(x - y).max() for x, y in zip(final(n), exact, strict=True)] for n in (40, 80, 160)])
    assert (np.log2(errors[:-1] / errors[1:]) > 3.7).all()
    assert errors[-1].max() < 1e-8


def test_ten_millisecond_cells_suffice(descent):
    fine = CubicSpline(descent.grids[1], descent.masses[1])
    problem = descent.problem(1)
    time = np.linspace(0, 15, 15001)
    control_matrix = np.eye(4, 2, k=-2) / fine(time)[:, None, None]
    finer = SteeringProblem.from_linear_model(
        time,
        (descent.state_matrix, control_matrix, descent.affine),
        initial_mean=problem.initial_mean,
        final_mean=problem.final_mean,
        initial_covariance=problem.initial_covariance,
        final_covariance=problem.final_covariance,
        noise_density=problem.noise_density,
        transition=np.eye(4) + descent.state_matrix * time[:, None, None],
    )
    end = predicted_covariance(finer, riccati_initial(problem), problem.noise_density, problem.initial_covariance)[-1]
    np.testing.assert_allclose(np.diag(end), descent.variances[2], rtol=1e-8)


def test_steering_is_fast(descent):
    problem = descent.problem(0)
    elapsed = []
    for _ in range(5):
        start = clock.process_time()
        steer(problem)
        elapsed.append(clock.process_time() - start)
    assert min(elapsed) < 0.05  # measured: 7 ms


# --- bad input --------------------------------------------------------------------------------------------------------

BAD = {
    "time": lambda p: p.time[::-1],
    "transition": lambda p: p.transition[:, :3],
    "gramian": lambda p: np.where(np.arange(4) == 1, np.nan, p.gramian),
    "affine_response": lambda p: p.affine_response + 1,
    "control_matrix": lambda p: p.control_matrix[0],
    "initial_mean": lambda p: p.initial_mean[:3],
    "final_mean": lambda p: p.final_mean * np.inf,
    "initial_covariance": lambda p: np.diag([1.0, 1, 1, -1]),
    "final_covariance": lambda p: np.triu(np.ones((4, 4))) + np.eye(4),
    "noise_density": lambda p: -1.0,
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # 0 * inf in the bad values themselves
@pytest.mark.parametrize("field", BAD)
def test_bad_fields_are_named(descent, field):
    problem = descent.problem(1)
    with pytest.raises(SteeringError, match=field):
        replace(problem, **{field: BAD[field](problem)})


def test_uncontrollable_model_is_refused(descent):
    problem = descent.problem(1)
    with pytest.raises(SteeringError, match="not controllable"):
        replace(problem, gramian=problem.gramian * [1, 0, 1, 0])


def test_constant_matrices_may_be_given_once():
    """An approach with gravity: A, B and c once, and at every node."""
    time = np.linspace(0.0, 10.0, 41)
    once = [[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [0.0, -3.71]
    ends = {"initial_mean": [100.0, 0.0], "final_mean": [0.0, 0.0], "noise_density": 0.3}
    ends |= {"initial_covariance": np.diag([25.0, 4.0]), "final_covariance": np.diag([1.0, 0.25])}
    models = once, tuple(np.tile(matrix, (41, *[1] * np.ndim(matrix))) for matrix in once)
    short, long = (steer(SteeringProblem.from_linear_model(time, model, **ends)) for model in models)
    for name in short._fields:
        np.testing.assert_allclose(getattr(short, name), getattr(long, name), rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": np.array([0.0, 1.0])}, "time"),
        ({"state_matrix": np.eye(3)}, "state_matrix"),
        ({"control_matrix": np.ones((4, 2, 1))}, "control_matrix"),
        ({"control_matrix": np.ones(2)}, "control_matrix"),
        ({"control_matrix": np.full((5, 2, 1), np.nan)}, "control_matrix"),
        ({"affine": np.ones((4, 2))}, "affine"),
        ({"transition": np.ones((5, 2, 3))}, "transition"),
    ],
)
def test_bad_models_are_refused(changes, message):
    model = {
        "time": np.linspace(0, 1, 5),
        "state_matrix": np.eye(2),
        "control_matrix": np.ones((5, 2, 1)),
        "affine": np.zeros(2),
    }
    ends = {name: np.zeros(2) for name in ("initial_mean", "final_mean")}
    ends |= {name: np.eye(2) for name in ("initial_covariance", "final_covariance")}
    arguments = model | ends | {"noise_density": 1.0} | changes
    arguments["model"] = tuple(arguments.pop(name) for name in ("state_matrix", "control_matrix", "affine"))
    with pytest.raises(SteeringError, match=message):
        SteeringProblem.from_linear_model(**arguments)
