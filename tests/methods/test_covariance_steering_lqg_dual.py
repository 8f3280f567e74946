from fractions import Fraction
from math import erf

import numpy as np
import pytest

from linear_systems import of_one_control
from marsedl.methods.covariance_steering.chance import chance_factor
from marsedl.methods.covariance_steering.lqg_dual import (
    ChanceConstrainedProblem,
    InfeasibleProblem,
    lqg_gains,
    lqg_gains_as_printed,
    noise_floor,
    solve,
    variances,
)
from marsedl.methods.lincov import compose, discretize, propagate
from marsedl.methods.linear_system import LinearSystem
from marsedl.methods.linearization import linearize
from marsedl.papers.stochastic_entry.beyond.cone_program import solve_cone_program
from marsedl.papers.stochastic_entry.beyond.weight_search import solve_over_weights

STATE_SCALE = np.array([1e3, 100, 0.01, 1e3, 5e-3])
ALTITUDE, FLIGHT_PATH_ANGLE, RANGE = np.eye(5)[[0, 2, 3]]


def entry_rates(radius, velocity, flight_path_angle, downrange, density, cosine, drag=3.7e-3, lift=8.9e-4, scale=9.5e3):
    """Planar entry of a capsule at Mars; the density follows an exponential, and its deviations die out."""
    gravity = 4.2828e13 / radius**2
    climb, mean = velocity * np.sin(flight_path_angle), 0.0165 * np.exp(-(radius - 3.397e6) / scale)
    return (
        climb,
        -drag * density * velocity**2 - gravity * np.sin(flight_path_angle),
        lift * density * velocity * cosine - (gravity / velocity - velocity / radius) * np.cos(flight_path_angle),
        velocity * np.cos(flight_path_angle),
        -density * climb / scale + 2 * (density - mean) * climb / scale,
    )


@pytest.fixture(scope="module")
def flight():
    """160 intervals of 1 s from 60 km to 600 m/s, of 4 sub-steps each; the last 32 are beyond control."""
    step, states = 0.125, [np.array([3.397e6 + 60e3, 5700.0, -0.24, 0.0, 0.0165 * np.exp(-60 / 9.5)])]
    for _ in range(1280):
        middle = states[-1] + step / 2 * np.array(entry_rates(*states[-1], 0.5))
        states.append(states[-1] + step * np.array(entry_rates(*middle, 0.5)))
    points = np.array(states[1::2])
    model = linearize(entry_rates, points, np.full((640, 1), 0.5))
    noise = np.zeros((640, 5, 5))
    sink_rate = np.maximum(-points[:, 1] * np.sin(points[:, 2]), 0)
    noise[:, 4, 4] = (0.02 * points[:, 4]) ** 2 * 4 / 9.5e3 * sink_rate
    system = discretize(
        model.state_matrix.reshape(160, 4, 5, 5),
        model.control_matrix.reshape(160, 4, 5, 1),
        noise.reshape(160, 4, 5, 5),
        np.ones(160),
    )
    system.control[128:] = 0
    return system


@pytest.fixture(scope="module")
def pose(flight):
    """`pose(every, **changes)`: the problem on intervals of `every` s; range in metres, two final limits."""

    def problem(every=4, **changes):
        starts = np.arange(0, 160, every)
        limits = np.minimum.reduceat(np.where(np.arange(160) < 60, 0.5, np.linspace(0.5, 0.3, 160)), starts)
        fields = {
            "system": compose(flight, starts),
            "initial_covariance": np.diag([0, 2.0, np.radians(0.03), 400.0, 2e-6]) ** 2,
            "objective": RANGE,
            "control_weight": np.full(len(starts), 0.1 * every),
            "final_directions": np.array([ALTITUDE, FLIGHT_PATH_ANGLE]),
            "final_limits": np.array([100.0, np.radians(0.3)]),
            "control_limits": limits,
            "state_scale": STATE_SCALE,
        }
        return ChanceConstrainedProblem(**(fields | changes))

    return problem


@pytest.fixture(scope="module")
def solved(pose):
    """The problem on 40 intervals of 4 s, and its solution."""
    problem = pose()
    return problem, solve(problem)


def cost_of(problem, gain):
    """Cost and the ratios of all standard deviations to their limits, from the definition."""
    covariance, control_variance = variances(problem, gain)
    final = np.einsum("mi,ij,mj->m", problem.final_directions, covariance[-1], problem.final_directions)
    cost = problem.objective @ covariance[-1] @ problem.objective + problem.control_weight @ control_variance
    return cost, np.sqrt(
        np.concatenate([final / problem.final_limits**2, control_variance / problem.control_limits**2])
    )


def multiplier_weights(problem, solution):
    """Weights of the LQG problem of Eq. 88."""
    weight = np.outer(problem.objective, problem.objective) + sum(
        xi * np.outer(d, d) for xi, d in zip(solution.final_multipliers, problem.final_directions, strict=True)
    )
    return weight, problem.control_weight + solution.control_multipliers


def test_chance_factor_inverts_the_error_function():
    assert chance_factor(0.9973) == pytest.approx(3.0, abs=3e-5)
    for level in (0.5, 0.9, 0.999):
        assert erf(chance_factor(level) / np.sqrt(2)) == pytest.approx(level, rel=1e-14)
    with pytest.raises(ValueError, match="strictly between 0 and 1"):
        chance_factor([0.5, 1.0])


def test_riccati_of_one_scalar_step_in_closed_form():
    a, b, q, weight = 1.3, 0.7, 2.0, 0.4
    system = of_one_control(np.full((1, 1, 1), a), np.full((1, 1), b), np.ones((1, 1, 1)))
    gain, value = lqg_gains(system, [[q]], [weight])
    assert gain[0, 0] == pytest.approx(-a * b * q / (b * b * q + weight), rel=1e-15)
    assert value[0, 0, 0] == pytest.approx(a * a * q * weight / (b * b * q + weight), rel=1e-15)
    assert value[1, 0, 0] == q


def test_joseph_form_equals_the_printed_recursion_in_exact_arithmetic():
    # Small integers, so that floats represent the system exactly.
    rng = np.random.default_rng(3)
    transition, control = rng.integers(-3, 4, size=(4, 3, 3)), rng.integers(-2, 3, size=(4, 3))
    root, weight = rng.integers(-2, 3, size=(3, 3)), rng.integers(1, 5, size=4)

    def exact(array):
        return np.vectorize(Fraction, otypes=[object])(array.astype(int).astype(object))

    printed = joseph = exact(root @ root.T)
    gain, value = lqg_gains(of_one_control(transition, control, np.zeros((4, 3, 3))), root @ root.T, weight)
    for k in range(3, -1, -1):
        a, b, r = exact(transition[k]), exact(control[k]), Fraction(int(weight[k]))
        feedback = -(b @ joseph @ a) / (b @ joseph @ b + r)
        closed_loop = a + np.outer(b, feedback)
        printed = a.T @ printed @ a - np.outer(feedback, feedback) * (r + b @ printed @ b)
        joseph = closed_loop.T @ joseph @ closed_loop + r * np.outer(feedback, feedback)
        assert (printed == joseph).all()
        assert gain[k] == pytest.approx(feedback.astype(float), rel=1e-12)
        assert value[k] == pytest.approx(joseph.astype(float), rel=1e-12)


def test_printed_gain_has_no_inverse_and_overflows(pose):
    system = pose().system
    weight = 1e12 * np.outer(RANGE, RANGE)
    gain, _ = lqg_gains_as_printed(system, weight, np.full(40, 1e-2))
    last = np.flatnonzero(system.control.any(axis=(1, 2)))[-1]
    tail = np.linalg.multi_dot(system.transition[last + 1 :][::-1])
    after = tail.T @ weight @ tail
    b = system.control[last, :, 0]
    expected = -(b @ after @ b + 1e-2) * (b @ after @ system.transition[last])
    assert gain[last] == pytest.approx(expected, rel=1e-10)
    assert np.abs(expected).max() > 1e25
    assert not np.isfinite(gain[:last]).all()
    assert np.isfinite(lqg_gains(system, weight, np.full(40, 1e-2))[0]).all()


def test_solution_meets_the_optimality_conditions(solved):
    _, solution = solved
    assert solution.status == "optimal"
    assert abs(solution.gap) < 1e-7 and abs(solution.gap_above_floor) < 1e-7
    assert solution.complementarity < 1e-7
    assert (solution.final_multipliers >= 0).all() and (solution.control_multipliers >= 0).all()
    assert max(solution.final_ratio.max(), solution.control_ratio.max()) <= 1 + 1e-7
    priced = solution.control_multipliers > 0
    assert solution.control_ratio[priced] == pytest.approx(1, abs=1e-4)
    # The case has both kinds of limits, or it would test nothing.
    assert 5 < priced.sum() < priced.size - 8 and (solution.final_multipliers > 0).all()


def test_any_multipliers_bound_the_cost_from_below(solved):
    problem, solution = solved
    rng = np.random.default_rng(11)
    for size in (0.01, 0.3, 2.0):
        factors = [np.exp(size * rng.normal(size=xi.shape)) for xi in solution[3:5]]
        final, control = solution.final_multipliers * factors[0], solution.control_multipliers * factors[1]
        perturbed = solution._replace(final_multipliers=final, control_multipliers=control)
        _, value = lqg_gains(problem.system, *multiplier_weights(problem, perturbed))
        bound = np.sum(value[0] * problem.initial_covariance) + np.sum(value[1:] * problem.system.noise)
        assert bound - final @ problem.final_limits**2 - control @ problem.control_limits**2 < solution.cost


@pytest.mark.parametrize("objective", [RANGE, np.array([0.0, 60.0, 0.0, 1.0, 0.0])], ids=["range", "range and speed"])
def test_semidefinite_program_finds_the_same_optimum(pose, objective):
    problem = pose(10, objective=objective)
    solution = solve(problem)
    program = solve_cone_program(problem, solution)
    assert program.status in ("optimal", "optimal_inaccurate")
    assert program.cost == pytest.approx(solution.cost, rel=1e-6)
    assert program.iterations > 5


def test_solution_does_not_depend_on_units(solved):
    problem, solution = solved
    unit = np.array([1e3, 0.3, 1e-2, 1e6, 1e-5])
    other = solve(
        problem._replace(
            system=problem.system._replace(
                transition=problem.system.transition / unit[:, None] * unit,
                control=problem.system.control / unit[:, None],
                noise=problem.system.noise / np.outer(unit, unit),
            ),
            initial_covariance=problem.initial_covariance / np.outer(unit, unit),
            objective=problem.objective * unit,
            final_directions=problem.final_directions * unit,
            state_scale=problem.state_scale / unit,
        )
    )
    assert other.iterations == solution.iterations
    assert other.cost == pytest.approx(solution.cost, rel=1e-10)
    assert np.allclose(other.gain / unit, solution.gain, rtol=1e-8, atol=0)


def test_without_binding_limits_the_solution_is_lqg(pose):
    problem = pose(4, final_directions=np.empty((0, 5)), final_limits=np.empty(0), control_limits=np.full(40, 1e3))
    solution = solve(problem)
    gain, _ = lqg_gains(problem.system, np.outer(RANGE, RANGE), problem.control_weight)
    assert solution.status == "optimal" and not solution.control_multipliers.any()
    assert np.array_equal(solution.gain, gain)


def test_noise_floor_is_the_effect_of_the_last_noise_alone(pose, solved):
    problem, solution = solved
    uncontrolled = 1 + np.flatnonzero(problem.system.control.any(axis=(1, 2)))[-1]
    tail = LinearSystem(*(field[uncontrolled:] for field in problem.system))
    alone = propagate(tail, np.zeros((len(tail.control), 1, 5)), np.zeros((5, 5))).covariance[-1]
    assert noise_floor(problem.system, RANGE) == pytest.approx(RANGE @ alone @ RANGE, rel=1e-12)
    assert solution.noise_floor == noise_floor(problem.system, RANGE)
    assert solution.gap_above_floor * (solution.cost - solution.noise_floor) == pytest.approx(
        solution.cost - solution.dual_value, rel=1e-9
    )
    assert noise_floor(LinearSystem(*(field[:uncontrolled] for field in problem.system)), RANGE) == 0


def test_an_impossible_limit_is_named_with_the_least_attainable_deviation(pose):
    with pytest.raises(InfeasibleProblem, match=r"final limit 0 \(direction.*the limit 1;") as caught:
        solve(pose(4, final_limits=np.array([1.0, np.radians(0.3)])))
    least = float(str(caught.value).split("allow is ")[1].split(",")[0])
    alone = pose(
        4,
        objective=ALTITUDE,
        final_directions=np.empty((0, 5)),
        final_limits=np.empty(0),
        control_weight=np.full(40, 1e-9),
    )
    assert least == pytest.approx(np.sqrt(solve(alone).cost), rel=1e-4)
    # Just above this deviation there is a solution, just below there is none.
    assert solve(pose(4, final_limits=np.array([1.001 * least, 1.0]))).status == "optimal"
    with pytest.raises(InfeasibleProblem, match="final limit 0"):
        solve(pose(4, final_limits=np.array([0.999 * least, 1.0])))


def test_limits_that_exclude_each_other_are_recognized(pose):
    directions = np.array([ALTITUDE, RANGE])
    limits = np.array(
        [
            np.sqrt(solve(pose(4, objective=d, final_directions=np.empty((0, 5)), final_limits=np.empty(0))).cost)
            for d in directions
        ]
    )
    with pytest.raises(InfeasibleProblem, match="one by one but not together"):
        solve(pose(4, final_directions=directions, final_limits=1.05 * limits))


def test_search_over_weights_reaches_the_optimum_from_a_good_start(pose):
    problem = pose(20)
    solution, search = solve(problem), solve_over_weights(problem)
    cost, ratios = cost_of(problem, search.gain)
    assert search.cost == pytest.approx(cost, rel=1e-12)
    assert search.worst_ratio == pytest.approx(ratios.max(), rel=1e-12)
    assert search.worst_ratio < 1 + 1e-3
    assert search.cost == pytest.approx(solution.cost, rel=3e-3)
    exact = solve_over_weights(problem, multiplier_weights(problem, solution))
    assert exact.success and exact.cost == pytest.approx(solution.cost, rel=1e-6)
    assert exact.evaluations < search.evaluations


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"control_limits": np.zeros(40)}, "control_limits must be positive; entry 0"),
        ({"control_weight": np.ones(39)}, r"control_weight must have shape \(40,\)"),
        ({"objective": np.zeros(5)}, "variance is zero without any control"),
    ],
)
def test_bad_problems_are_refused(pose, changes, message):
    with pytest.raises(ValueError, match=message):
        solve(pose(4, **changes))
