from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm

from linear_systems import of_one_control
from marsedl.methods import conic
from marsedl.methods.covariance_steering import block_program, lqg_dual
from marsedl.methods.covariance_steering.block_program import (
    BlockSystem,
    HalfPlane,
    IllConditionedError,
    InfeasibleProgram,
    Percentile,
    SteeringProgram,
    TrustRegion,
    causal_root,
    closed_loop,
    margins,
    solve,
    stacked,
)
from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.methods.covariance_steering.history_feedback import history_program
from marsedl.methods.covariance_steering.steering_program import present_gains

THREE_SIGMA = (1 - 0.9973) / 2


def feedback(law):
    """K of the stacked system."""
    intervals, nodes, m, n = law.gain.shape
    return law.gain.transpose(0, 2, 1, 3).reshape(intervals * m, nodes * n)


def random_system(seed, intervals=4, n=3, m=2, initial=True):
    """A system with correlated disturbances of full rank."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(intervals * n, intervals * n)) / np.sqrt(intervals * n)
    initial_root = 0.5 * rng.normal(size=(n, n))
    return BlockSystem(
        np.eye(n) + 0.4 * rng.normal(size=(intervals, n, n)),
        rng.normal(size=(intervals, n, m)),
        0.3 * rng.normal(size=(intervals, n)),
        rng.normal(size=n),
        initial * initial_root @ initial_root.T,
        0.1 * root @ root.T + 0.01 * np.eye(intervals * n),
    )


@pytest.fixture(scope="module")
def rich():
    """Every kind of cost and constraint at once, two controls, correlated disturbances; most constraints are active."""
    rng, system = np.random.default_rng(3), random_system(7)
    intervals, n, m = system.control.shape

    def weights(size, rank):
        root = rng.normal(size=(intervals, size, rank))
        return root @ root.swapaxes(1, 2)

    return SteeringProgram(
        system,
        state_weight=0.3 * weights(n, 1),
        control_weight=0.3 * weights(m, m),
        mean_control_weight=0.1 * weights(m, m),
        desired_state=rng.normal(size=(intervals + 1, n)),
        state_constraints=(
            HalfPlane(2, [1.0, -0.5, 0.2], 1.0, 0.02, "wall"),
            HalfPlane(2, [-2.0, 1.0, -0.4], 4.0, 0.05),
            HalfPlane(4, [0.0, 1.0, 1.0], 1.5, 0.01),
        ),
        control_constraints=(
            HalfPlane(1, [1.0, 0.0], 0.7, 0.01),
            HalfPlane(1, [-3.0, 0.0], 3.0, 0.01),
            HalfPlane(3, [0.6, 0.8], 0.5, 0.1),
        ),
        final_mean=np.array([0.5, 0.2, -0.1]),
        final_covariance=np.diag([0.3, 0.4, 0.5]),
        percentiles=(Percentile([1.0, 2.0, -0.5], 0.3, 0.05), Percentile([-1.0, 0.3, 0.4], 1.75, 0.1)),
        percentile_weight=0.7,
        control_reference=np.full((intervals, m), 0.1),
        control_trust=1.3,
        state_trust=(TrustRegion(3, [1.0, 0.0, 1.0], 0.4, 0.6),),
    )


def field_disturbances():
    """Cov(W) of the double integrator on the field of Eq. 59 along r = 0.1 + 0.1 t, by Gauss-Legendre quadrature."""
    points, weights = np.polynomial.legendre.leggauss(12)
    points, weights = (points + 1) / 2, weights / 2
    positions = 0.1 + 0.1 * (np.arange(5)[:, None] + points).ravel()
    distance = np.subtract.outer(positions, positions)
    field = 2e-6 * np.exp(-2 * np.sin(np.pi * distance / 0.35) ** 2 / 0.8**2 - distance**2 / 2)
    effect = np.kron(np.eye(5), np.array([(1 - points) * weights, weights]))
    return effect @ field @ effect.T


def double_integrator(nodes=range(6), **changes):
    """The first example of the paper; state constraints at the given nodes."""
    initial = np.diag([0.05 / 3, 0.01 / 3]) ** 2
    system = BlockSystem(
        np.tile([[1.0, 1.0], [0.0, 1.0]], (5, 1, 1)),
        np.tile([[0.5], [1.0]], (5, 1, 1)),
        np.zeros((5, 2)),
        np.array([0.1, 0.1]),
        initial,
        field_disturbances(),
    )
    lines = (([0.212766, 8.51064], 1.0), ([0.30303, -12.1212], -1.0))
    fields = {
        "state_constraints": tuple(HalfPlane(k, a, alpha, THREE_SIGMA) for k in nodes for a, alpha in lines),
        "final_mean": np.array([0.6, 0.1]),
        "final_covariance": initial,
    }
    return SteeringProgram(system, np.zeros((5, 2, 2)), np.ones((5, 1, 1)), np.ones((5, 1, 1)), **(fields | changes))


def drag_passage(intervals=14, noise=1e-4, **changes):
    """Like aerocapture: no initial deviation, drag correlated in time, lift that acts through the path angle."""
    step, middle = 1 / intervals, (np.arange(intervals) + 0.5) / intervals
    pressure = np.exp(-(((middle - 0.45) / 0.18) ** 2))
    transition, control = np.tile(np.eye(3), (intervals, 1, 1)), np.zeros((intervals, 3, 1))
    transition[:, 0, 1:], transition[:, 1, 0] = [0.5 * step, 8 * step], 0.4 * pressure * step
    transition[:, 2, :2] = [0.05 * step, 1.5 * step]
    control[:, 0, 0], control[:, 2, 0] = 12 * pressure * step**2, 3 * pressure * step + 1e-3 * step
    effect = np.zeros((intervals, 3, intervals))
    effect[np.arange(intervals), :, np.arange(intervals)] = 4 * pressure[:, None] * step * np.array([step / 2, 1, 0])
    effect = effect.reshape(3 * intervals, intervals)
    drag = effect @ np.exp(-np.abs(np.subtract.outer(middle, middle)) / 0.3) @ effect.T
    system = BlockSystem(
        transition,
        control,
        np.zeros((intervals, 3)),
        np.zeros(3),
        np.zeros((3, 3)),
        drag + noise * np.eye(3 * intervals),
    )
    gradient = np.array([-0.11, 0.3, 0.0])
    fields = {
        "control_weight": np.full((intervals, 1, 1), 0.28 / intervals),
        "mean_control_weight": np.zeros((intervals, 1, 1)),
        "control_constraints": tuple(
            HalfPlane(k, [sign], 1.0, THREE_SIGMA) for k in range(intervals) for sign in (1.0, -1.0)
        ),
        "percentiles": (Percentile([0.02, 0.10, 0.03], 0.279, 0.01),),
        "percentile_weight": 1.0,
        "control_reference": np.zeros((intervals, 1)),
        "control_trust": 0.1,
        "state_trust": (TrustRegion(intervals, [0.1, 0.3, 0.2], 0.0, 0.1),),
    }
    return SteeringProgram(system, np.tile(np.outer(gradient, gradient), (intervals, 1, 1)), **(fields | changes))


def test_stacked_system_reproduces_the_recursion():
    system, rng = random_system(1), np.random.default_rng(2)
    controls, disturbances = rng.normal(size=(4, 2)), rng.normal(size=(4, 3))
    states = [rng.normal(size=3)]
    for k in range(4):
        states.append(
            system.transition[k] @ states[k] + system.control[k] @ controls[k] + system.affine[k] + disturbances[k]
        )
    whole = stacked(system)
    actual = whole.transition @ states[0] + whole.control @ controls.ravel() + whole.affine
    actual += whole.disturbance @ disturbances.ravel()
    assert actual == pytest.approx(np.ravel(states), rel=1e-13)
    # Not A_1 c_1, as Eq. 29 prints the third block.
    assert whole.affine[6:9] == pytest.approx(system.transition[1] @ system.affine[0] + system.affine[1], rel=1e-14)


@pytest.mark.parametrize("initial", [True, False])
def test_causal_root_is_a_block_causal_factor_with_a_left_inverse(initial):
    system = random_system(5, initial=initial)
    root = causal_root(system)
    covariance = np.zeros((15, 15))
    covariance[:3, :3], covariance[3:, 3:] = system.initial_covariance, system.disturbance_covariance
    assert root.factor @ root.factor.T == pytest.approx(covariance, abs=1e-14)
    assert root.whitening @ root.factor == pytest.approx(np.eye(len(root.block)), abs=1e-11)
    assert np.bincount(root.block, minlength=5).tolist() == [3 * initial, 3, 3, 3, 3]
    block = np.arange(15)[:, None] // 3
    assert not root.factor[block < root.block].any()
    assert not root.whitening[(block > root.block).T].any()
    assert root.condition == pytest.approx(np.linalg.cond(system.disturbance_covariance), rel=1e-9)


@pytest.mark.parametrize("unit", [1.0, 1e-6])
def test_causal_root_gives_no_innovation_to_what_the_past_determines(unit):
    # The force of the second interval is the mean of its neighbours; a single force per interval moves two states.
    rng = np.random.default_rng(4)
    forces = rng.normal(size=(4, 4))
    forces[2] = 0.7 * forces[0] - 1.3 * forces[1]
    effect = np.kron(np.eye(4), np.array([[0.5], [1.0]]) * np.array([[1.0], [unit]]))
    covariance = effect @ forces @ forces.T @ effect.T
    system = BlockSystem(
        np.tile(np.eye(2), (4, 1, 1)), np.ones((4, 2, 1)), np.zeros((4, 2)), np.zeros(2), np.zeros((2, 2)), covariance
    )
    root = causal_root(system)
    assert root.block.tolist() == [1, 2, 4]
    scale = np.tile([1.0, unit], 4)
    assert (root.factor @ root.factor.T)[2:, 2:] / np.outer(scale, scale) == pytest.approx(
        covariance / np.outer(scale, scale), abs=1e-13
    )


def test_closed_loop_covariance_matches_the_response_to_every_single_deviation():
    system, rng = random_system(8), np.random.default_rng(9)
    gain = rng.normal(size=(4, 5, 2, 3)) * (np.arange(5) <= np.arange(4)[:, None])[:, :, None, None]
    other = np.diag(rng.uniform(0.1, 1, 12))
    for covariance in (None, other):
        blocks = np.zeros((15, 15))
        blocks[:3, :3] = system.initial_covariance
        blocks[3:, 3:] = system.disturbance_covariance if covariance is None else covariance
        states, controls = np.zeros((5, 3, 15)), np.zeros((4, 2, 15))
        for column, deviation in enumerate(np.eye(15)):
            states[0, :, column] = deviation[:3]
            for k in range(4):
                controls[k, :, column] = sum(gain[k, l] @ states[l, :, column] for l in range(k + 1))
                states[k + 1, :, column] = (
                    system.transition[k] @ states[k, :, column]
                    + system.control[k] @ controls[k, :, column]
                    + deviation[3 * (k + 1) : 3 * (k + 2)]
                )
        actual = closed_loop(system, gain, covariance)
        for response, result in ((states, actual.covariance), (controls, actual.control_covariance)):
            expected = response @ blocks @ response.swapaxes(1, 2)
            assert result == pytest.approx(expected, rel=1e-11, abs=1e-11 * np.abs(expected).max())


def test_gains_are_causal_and_reproduce_the_statistics_of_the_design(rich):
    law, whole = solve(rich), stacked(rich.system)
    gain, identity = feedback(law), np.eye(15)
    history = gain @ np.linalg.inv(identity - whole.control @ gain)  # Eq. 35
    assert (identity + whole.control @ history) @ (identity - whole.control @ gain) == pytest.approx(
        identity, abs=1e-11
    )
    assert all(not law.gain[k, k + 1 :].any() for k in range(4))
    assert law.largest_gain == np.abs(law.gain).max()
    statistics = closed_loop(rich.system, law.gain)
    assert statistics.covariance == pytest.approx(law.covariance, abs=1e-12)
    assert statistics.control_covariance == pytest.approx(law.control_covariance, abs=1e-12)
    assert law.mean[0] == pytest.approx(rich.system.initial_mean, rel=1e-15)


@pytest.mark.parametrize("form", ["innovations", "history"])
@pytest.mark.parametrize("solver", ["CLARABEL", "SCS"])
def test_forms_and_solvers_agree_on_every_kind_of_cost_and_constraint(rich, form, solver):
    reference, law = solve(rich), solve(rich, form=form, solver=solver)
    assert (law.status, law.solver) == ("optimal", solver)
    assert law.objective == pytest.approx(reference.objective, rel=1e-7)
    assert law.control == pytest.approx(reference.control, abs=2e-4)
    assert law.gain == pytest.approx(reference.gain, abs=1e-4 * reference.largest_gain)
    all_margins = margins(rich, law)
    assert max(margin.excess for margin in all_margins) < 1e-6
    # The comparison says little about a constraint that is not active.
    active = {margin.name for margin in all_margins if margin.excess > -1e-6}
    assert {"state constraint wall at step 2", "control constraint 0 at step 1", "final covariance"} <= active


def test_objective_is_that_of_the_printed_program(rich):
    law = solve(rich)
    problem, *_ = history_program(rich, 1.0)
    problem.solve(solver="CLARABEL", direct_solve_method="qdldl")
    assert law.objective == pytest.approx(problem.value, rel=1e-7)
    assert law.objective == law.quadratic_cost + 0.7 * law.percentile
    branches = [
        item.offset
        + item.gradient @ law.mean[-1]
        + norm.isf(item.probability) * np.sqrt(item.gradient @ law.covariance[-1] @ item.gradient)
        for item in rich.percentiles
    ]
    assert law.percentile == pytest.approx(max(branches), rel=1e-14)


@pytest.mark.parametrize("noise", [1e-4, 1e-6])
def test_forms_agree_without_initial_deviation(noise):
    program = drag_passage(noise=noise)
    first, second = solve(program), solve(program, form="history")
    assert first.innovations == second.innovations == 42
    assert second.objective == pytest.approx(first.objective, rel=1e-7)
    # The gains from x_0 multiply zero.
    assert second.gain[:, 1:] == pytest.approx(first.gain[:, 1:], abs=1e-4 * first.largest_gain)
    assert solve(program, solver="SCS").objective == pytest.approx(first.objective, rel=1e-7)
    for law in (first, second):
        assert np.all(np.abs(law.control[:, 0]) + 3 * np.sqrt(law.control_covariance[:, 0, 0]) <= 1 + 1e-5)
        assert np.abs(law.control).max() <= 0.1 + 1e-6


def test_forms_agree_where_a_control_costs_nothing():
    program = drag_passage(control_weight=np.zeros((14, 1, 1)))
    first, second = solve(program), solve(program, form="history")
    assert second.objective == pytest.approx(first.objective, rel=1e-7)


@pytest.mark.parametrize("solver", ["CLARABEL", "SCS"])
def test_double_integrator_of_the_paper(solver):
    law = solve(double_integrator(), solver=solver)
    assert law.objective == pytest.approx(6.7213e-6, rel=1e-5)
    assert law.quadratic_cost == law.objective
    assert law.control == pytest.approx(np.zeros((5, 1)), abs=1e-9)
    deviation = np.sqrt(np.diagonal(law.covariance, axis1=1, axis2=2))
    assert np.sqrt(law.control_covariance.ravel()) == pytest.approx(
        [9.392e-4, 1.1400e-3, 1.1951e-3, 1.2425e-3, 1.2520e-3], rel=1e-4
    )
    assert deviation[:, 0] == pytest.approx([0.016667, 0.016724, 0.016785, 0.016768, 0.016698, 0.016666], rel=1e-4)
    assert deviation[-1, 1] == pytest.approx(7.217e-4, rel=2e-4)
    excess = {margin.name: margin.excess for margin in margins(double_integrator(), law)}
    assert excess["final covariance"] == pytest.approx(0, abs=1e-7)


def test_independent_disturbances_lead_to_the_riccati_recursion():
    system = random_system(21, intervals=6)
    blocks = system.disturbance_covariance.reshape(6, 3, 6, 3)[np.arange(6), :, np.arange(6)] + 0.01 * np.eye(3)
    independent = np.zeros((6, 3, 6, 3))
    independent[np.arange(6), :, np.arange(6)] = blocks
    system = system._replace(disturbance_covariance=independent.reshape(18, 18))
    rng = np.random.default_rng(22)
    root = rng.normal(size=(6, 3, 3))
    state_weight, control_weight = root @ root.swapaxes(1, 2), np.tile(np.diag([0.5, 2.0]), (6, 1, 1))
    law = solve(SteeringProgram(system, state_weight, control_weight, control_weight))

    value, cost = np.zeros((3, 3)), 0.0
    for k in range(5, -1, -1):
        transition, control = system.transition[k], system.control[k]
        cost += np.trace(value @ blocks[k])
        inner = control_weight[k] + control.T @ value @ control
        gain = -np.linalg.solve(inner, control.T @ value @ transition)
        assert law.gain[k, k] == pytest.approx(gain, abs=1e-6)
        assert law.gain[k, :k] == pytest.approx(np.zeros((k, 2, 3)), abs=1e-6)
        value = state_weight[k] + transition.T @ value @ (transition + control @ gain)
    assert law.objective == pytest.approx(cost + np.trace(value @ system.initial_covariance), rel=1e-7)


def test_control_limits_agree_with_the_certified_dual_of_stochastic_entry():
    # The cost of the dual is of the final state, which is the state before an additional interval without control.
    intervals, limits = 30, np.full(30, 0.25)
    program = drag_passage(intervals)
    system, target = program.system, np.array([0.3, 1.0, 0.4])
    noise = np.array([np.diag([1e-4, 0.02 * (1 + np.sin(k)), 2e-4]) for k in range(intervals)])
    problem = lqg_dual.ChanceConstrainedProblem(
        of_one_control(system.transition, system.control[:, :, 0], noise),
        np.diag([0.1, 0.05, 0.02]),
        target,
        np.full(intervals, 1e-3),
        np.empty((0, 3)),
        np.empty(0),
        limits,
        np.ones(3),
    )
    certified = lqg_dual.solve(problem)
    covariance = np.zeros((31, 3, 31, 3))
    covariance[np.arange(30), :, np.arange(30)] = noise
    longer = BlockSystem(
        np.concatenate([system.transition, np.eye(3)[None]]),
        np.concatenate([system.control, np.zeros((1, 3, 1))]),
        np.zeros((31, 3)),
        np.zeros(3),
        problem.initial_covariance,
        covariance.reshape(93, 93),
    )
    state_weight = np.zeros((31, 3, 3))
    state_weight[30] = np.outer(target, target)
    half_planes = tuple(
        HalfPlane(k, [sign], limits[k] * upper_quantile(0.1), 0.1) for k in range(intervals) for sign in (1.0, -1.0)
    )
    law = solve(
        SteeringProgram(
            longer, state_weight, np.full((31, 1, 1), 1e-3), np.ones((31, 1, 1)), control_constraints=half_planes
        )
    )
    assert certified.status == "optimal"
    assert np.count_nonzero(certified.control_ratio > 0.999) > 5
    assert law.objective == pytest.approx(certified.cost, rel=1e-7)
    assert np.sqrt(law.control_covariance[:30, 0, 0]) == pytest.approx(limits * certified.control_ratio, abs=1e-4)


def test_percentile_and_chance_constraint_of_one_step_match_a_direct_search():
    # x_1 = x_0 + u + w with u = v + K (x_0 - xbar_0), an absolute value as cost, and one half plane.
    system = BlockSystem(
        np.ones((1, 1, 1)), np.ones((1, 1, 1)), np.array([[0.2]]), np.array([0.5]), np.array([[0.3]]), np.array([[0.1]])
    )
    items = (Percentile([1.0], -0.3, 0.05), Percentile([-2.0], 0.6, 0.05))
    wall = HalfPlane(1, [-1.0], 0.1, 0.1)
    ones = np.ones((1, 1, 1))
    program = SteeringProgram(
        system, 0 * ones, 0.4 * ones, 0.2 * ones, state_constraints=(wall,), percentiles=items, percentile_weight=1.5
    )

    def cost(unknown):
        v, gain = unknown
        deviation = np.sqrt((1 + gain) ** 2 * 0.3 + 0.1)
        percentile = max(
            i.offset + i.gradient[0] * (0.7 + v) + 1.644854 * abs(i.gradient[0]) * deviation for i in items
        )
        violation = max(0.0, -(0.7 + v) + 1.281552 * deviation - 0.1)
        return 0.4 * gain**2 * 0.3 + 0.2 * v**2 + 1.5 * percentile + 1e3 * violation

    best = min(
        (
            minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-13})
            for start in ([0.0, -0.5], [-0.5, -0.9], [0.3, 0.0])
        ),
        key=lambda result: result.fun,
    )
    law = solve(program)
    assert law.objective == pytest.approx(best.fun, rel=1e-5)
    assert [law.control[0, 0], law.gain[0, 0, 0, 0]] == pytest.approx(best.x, abs=1e-3)


def test_without_deviations_the_program_is_deterministic(rich):
    system = rich.system._replace(initial_covariance=np.zeros((3, 3)), disturbance_covariance=np.zeros((12, 12)))
    program = replace(
        rich,
        system=system,
        state_constraints=(),
        control_constraints=(),
        percentile_weight=0.0,
        control_trust=None,
        state_trust=(),
    )
    law = solve(program)
    assert law.innovations == 0
    assert not law.gain.any() and not law.covariance.any() and not law.control_covariance.any()
    # Least squares with the final mean as equality, by its optimality conditions.
    whole = stacked(system)
    start = whole.transition @ system.initial_mean + whole.affine
    hessian, gradient = np.zeros((8, 8)), np.zeros(8)
    for k in range(4):
        rows, columns = slice(3 * k, 3 * k + 3), slice(2 * k, 2 * k + 2)
        hessian[columns, columns] += rich.mean_control_weight[k]
        weighted = whole.control[rows].T @ rich.state_weight[k]
        hessian += weighted @ whole.control[rows]
        gradient += weighted @ (start[rows] - rich.desired_state[k])
    final = whole.control[12:]
    conditions = np.block([[hessian, final.T], [final, np.zeros((3, 3))]])
    expected = np.linalg.solve(conditions, np.concatenate([-gradient, rich.final_mean - start[12:]]))[:8]
    assert law.control.ravel() == pytest.approx(expected, abs=1e-6)
    # The constraints then are those of a linear program.
    assert (
        max(margin.excess for margin in margins(replace(rich, system=system), solve(replace(rich, system=system))))
        < 1e-6
    )


def test_predictable_disturbances_are_refused(monkeypatch):
    with pytest.raises(IllConditionedError, match=r"condition number 1\.9e\+12.*add independent noise"):
        solve(drag_passage(noise=1e-13))
    law = solve(drag_passage(noise=1e-13), accept_ill_conditioned=True)
    assert law.condition > 1e12
    # The gains on a known initial state multiply zero.
    assert law.largest_gain == np.abs(law.gain[:, 1:]).max()
    # What the past determines exactly has no innovation, and does no harm.
    assert solve(drag_passage(noise=0.0)).innovations == 14
    with pytest.raises(IllConditionedError, match=r"largest gain is .* more than 1e\+00.*add independent noise"):
        monkeypatch.setattr(block_program, "_LARGEST_GAIN", 1.0)
        solve(drag_passage())
    assert solve(drag_passage(), accept_ill_conditioned=True).largest_gain > 1.0


def test_unreachable_final_covariance_is_named_with_the_least_that_can_be_reached():
    # x_{k+1} = x_k + u_k + w_k: feedback can take back everything but what the past says nothing about.
    covariance = 0.5 ** np.abs(np.subtract.outer(np.arange(4), np.arange(4))) + 0.2 * np.eye(4)
    ones = np.ones((4, 1, 1))
    system = BlockSystem(ones, ones, np.zeros((4, 1)), np.zeros(1), np.array([[0.7]]), covariance)
    least = 1 / np.linalg.inv(covariance)[-1, -1]
    program = SteeringProgram(system, ones, ones, ones, final_covariance=np.array([[least / 1.84]]))
    with pytest.raises(
        InfeasibleProgram,
        match=r"final covariance: the least reachable largest eigenvalue .* is 1\.84, must be <= 1",
    ) as error:
        solve(program)
    assert error.value.margins[-1].value == pytest.approx(1.84, rel=1e-4)
    np.testing.assert_allclose(error.value.law.covariance[-1], least, rtol=1e-4)
    with pytest.raises(InfeasibleProgram, match=r"is 1\.84, must"):
        solve(program, form="history")
    assert solve(replace(program, final_covariance=np.array([[least * 1.001]]))).status == "optimal"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"state_constraints": (HalfPlane(0, [1.0, 0.0], 0.1, 0.01, "start"),)},
            # 0.1 + 2.326348 sigma
            r"state constraint start at step 0: the least reachable value .* is 0\.138772, must be <= 0\.1",
        ),
        (
            {"control_constraints": tuple(HalfPlane(k, [s], 1e-4, THREE_SIGMA) for k in range(5) for s in (1.0, -1.0))},
            r"control constraint \d at step \d: .*, must be <= 0\.0001",
        ),
    ],
)
def test_unreachable_constraints_are_named(changes, message):
    with pytest.raises(InfeasibleProgram, match=message):
        solve(double_integrator((), **changes))


@pytest.mark.parametrize("form", ["innovations", "history"])
def test_a_component_of_the_final_mean_may_be_free(form):
    free = solve(double_integrator((), final_mean=np.array([0.6, np.nan])), form=form)
    assert free.mean[-1, 0] == pytest.approx(0.6, abs=1e-7)
    costs = [
        solve(double_integrator((), final_mean=free.mean[-1] + [0.0, moved])).objective for moved in (0.0, 0.01, -0.01)
    ]
    assert costs[0] == pytest.approx(free.objective, rel=1e-6)
    assert min(costs[1:]) > costs[0] * (1.0 + 1e-4)


def test_solver_that_does_not_converge_is_an_error():
    with pytest.raises(RuntimeError, match="CLARABEL ended with the status 'optimal_inaccurate'"):
        solve(double_integrator(), tolerance=1e-17)
    law = solve(double_integrator(), tolerance=1e-17, accept_inaccurate=True)
    assert law.status == "optimal_inaccurate"
    assert law.objective == pytest.approx(6.72126e-6, rel=1e-5)
    assert law.accepted_by == "leave"
    free = drag_passage(control_trust=None, control_constraints=(), state_trust=())
    with pytest.raises(RuntimeError, match=r"'unbounded' \(DualInfeasible\) after \d+ iterations, .*; limit the mean"):
        solve(free)


def test_a_law_tells_the_status_the_attempt_and_the_rule_by_which_it_counts(monkeypatch):
    law = solve(double_integrator())
    assert (law.status, law.said, law.accepted_by, law.attempt) == ("optimal", "Solved", "status", 1)
    monkeypatch.setitem(block_program._ASKED, "CLARABEL", conic.Accuracy(1e-17, 1e-17))
    rounded = solve(double_integrator())
    assert (rounded.status, rounded.said, rounded.accepted_by) == ("optimal_inaccurate", "AlmostSolved", "accuracy")
    assert rounded.duality_gap <= 1e-8 and max(rounded.primal_residual, rounded.dual_residual) <= 1e-7
    assert rounded.objective == pytest.approx(law.objective, rel=1e-7)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: HalfPlane(0, [1.0], 0.0, 0.5, "door"), "'door': probability must lie strictly between 0 and 0.5"),
        (lambda p: replace(p, state_weight=np.zeros((4, 2, 2))), r"state_weight must have shape \(4, 3, 3\)"),
        (lambda p: replace(p, final_covariance=np.zeros((3, 3))), "final_covariance must be positive definite"),
        (
            lambda p: replace(p, system=p.system._replace(initial_covariance=np.triu(np.ones((3, 3))))),
            "system.initial_covariance must be symmetric",
        ),
        (
            # Altitude in m and path angle in rad, with a correlation of 2: far below a billionth of the largest entry.
            lambda p: replace(
                p,
                system=p.system._replace(
                    initial_covariance=np.array([[1e6, 0.0, 0.2], [0.0, 1.0, 0.0], [0.2, 0.0, 1e-8]])
                ),
            ),
            "system.initial_covariance must be positive semidefinite, .* eigenvalue -1",
        ),
        (lambda p: closed_loop(p.system, np.ones((4, 5, 2, 3))), "gain is not causal"),
    ],
)
def test_bad_input_is_refused(rich, make, message):
    with pytest.raises(ValueError, match=message):
        make(rich)


def test_of_white_disturbances_the_present_state_says_all():
    """The feedback of all history and that of the present state have the same covariances; of others they have not."""
    for white in (True, False):
        system = random_system(5)
        intervals, n, m = system.control.shape
        if white:
            apart = np.kron(np.eye(intervals), np.ones((n, n)))
            system = system._replace(disturbance_covariance=system.disturbance_covariance * apart)
        weights = np.tile(np.eye(n), (intervals, 1, 1)), 0.1 * np.tile(np.eye(m), (intervals, 1, 1))
        law = solve(SteeringProgram(system, weights[0], weights[1], weights[1]))
        gain = np.zeros_like(law.gain)
        gain[np.arange(intervals), np.arange(intervals)] = present_gains(system, law)
        apart = np.abs(closed_loop(system, gain).covariance - law.covariance).max()
        assert apart < 1e-6 if white else apart > 1e-3
