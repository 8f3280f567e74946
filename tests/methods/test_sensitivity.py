import numpy as np
import pytest
from scipy.linalg import expm

from marsedl.methods.sensitivity import (
    POINTS,
    adjoint_rows,
    closed_loop,
    midpoint_responses,
    midpoint_transitions,
    propagate_columns,
    scheme_responses,
    scheme_transitions,
)


def example(intervals=7, n=4, m=2):
    """State matrices, forcing, unequal steps."""
    random = np.random.default_rng(4)
    return (
        random.standard_normal((intervals, n, n)),
        random.standard_normal((intervals, n, m)),
        random.uniform(0.1, 0.4, intervals),
    )


def test_a_double_integrator_has_its_closed_form():
    state_matrix, forcing, step = np.tile([[0.0, 1.0], [0.0, 0.0]], (3, 1, 1)), np.tile([[0.0], [1.0]], (3, 1, 1)), 0.7
    np.testing.assert_allclose(midpoint_transitions(state_matrix, step), np.tile([[1, 0.7], [0, 1]], (3, 1, 1)))
    np.testing.assert_allclose(
        midpoint_responses(state_matrix, forcing, step), np.tile([[0.7**2 / 2], [0.7]], (3, 1, 1))
    )


def test_one_interval_is_the_quotient_of_the_paper():
    state_matrix, forcing, step = example()
    transitions, responses = midpoint_transitions(state_matrix, step), midpoint_responses(state_matrix, forcing, step)
    for k, h in enumerate(step):
        inverse = np.linalg.inv(np.eye(4) - h / 2 * state_matrix[k])
        np.testing.assert_allclose(transitions[k], inverse @ (np.eye(4) + h / 2 * state_matrix[k]), rtol=0, atol=2e-14)
        np.testing.assert_allclose(responses[k], h * inverse @ forcing[k], rtol=0, atol=2e-14)


def test_one_step_for_all_intervals_is_the_same_as_equal_steps():
    state_matrix, forcing, _ = example()
    equal = np.full(7, 0.3)
    assert (midpoint_transitions(state_matrix, 0.3) == midpoint_transitions(state_matrix, equal)).all()
    assert (midpoint_responses(state_matrix, forcing, 0.3) == midpoint_responses(state_matrix, forcing, equal)).all()


def test_a_rotation_keeps_lengths_and_the_way_back_undoes_the_way():
    state_matrix, _, step = example()
    skew = state_matrix - state_matrix.swapaxes(1, 2)
    rotated = propagate_columns(midpoint_transitions(skew, step), np.eye(4))
    np.testing.assert_allclose(rotated.swapaxes(1, 2) @ rotated, np.tile(np.eye(4), (8, 1, 1)), rtol=0, atol=2e-14)
    there, back = midpoint_transitions(state_matrix, step), midpoint_transitions(-state_matrix, step)
    np.testing.assert_allclose(back @ there, np.tile(np.eye(4), (7, 1, 1)), rtol=0, atol=5e-14)


def test_sensitivities_approach_those_of_the_continuous_system_with_order_two():
    # In the frame that turns with exp(W t) the system is constant: S = exp(W t) exp(M t), though A(t) does not commute.
    turn = np.array([[0, 1.3, 0], [-1.3, 0, 0.4], [0, -0.4, 0]])
    constant, forcing, duration = np.array([[-0.5, 0.3, 0], [0.2, -0.1, 0.6], [-0.4, 0, -0.3]]), np.ones((3, 1)), 2.0
    exact = expm(turn * duration) @ np.hstack(
        [
            expm(constant * duration),
            np.linalg.solve(constant, (expm(constant * duration) - np.eye(3)) @ forcing),
        ]
    )
    errors = []
    for intervals in (20, 40, 80):
        step = duration / intervals
        to_fixed = expm(turn * ((np.arange(intervals) + 0.5) * step)[:, None, None])
        state_matrix = turn + to_fixed @ constant @ to_fixed.swapaxes(1, 2)
        responses = np.zeros((intervals, 3, 4))
        responses[:, :, 3:] = midpoint_responses(state_matrix, to_fixed @ forcing, step)
        final = propagate_columns(midpoint_transitions(state_matrix, step), np.eye(3, 4), responses)[-1]
        errors.append(np.abs(final - exact).max(axis=0))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2, atol=0.02)


def midpoint_flow(start, friction, gain, nominal, controls, step):
    """Pendulum with friction under feedback by the implicit midpoint rule, Newton's method also in complex numbers."""
    states = [start]
    for k, control in enumerate(controls):
        state = states[-1].copy()
        for _ in range(20):
            angle, rate = (state + states[-1]) / 2
            deviation = 0 if nominal is None else (state + states[-1]) / 2 - (nominal[k] + nominal[k + 1]) / 2
            command = control + np.sum(gain * deviation)
            defect = state - states[-1] - step * np.array([rate, -np.sin(angle) - friction * rate**3 + command])
            slope = np.array([[0, 1], [-np.cos(angle) + gain[0], -3 * friction * rate**2 + gain[1]]])
            state = state - np.linalg.solve(np.eye(2) - step / 2 * slope, defect)
        states.append(state)
    return np.array(states)


def test_they_are_the_exact_derivatives_of_a_discrete_midpoint_flow():
    step, friction, gain = 0.25, 0.3, np.array([-0.4, 0.2])
    controls = 0.5 * np.sin(np.arange(16.0))
    nominal = midpoint_flow(np.array([2.0, -0.5]), friction, gain, None, controls, step)
    angle, rate = ((nominal[1:] + nominal[:-1]) / 2).T
    state_matrix = np.zeros((16, 2, 2))
    state_matrix[:, 0, 1], state_matrix[:, 1, 0], state_matrix[:, 1, 1] = 1, -np.cos(angle), -3 * friction * rate**2
    forcing = np.stack([np.zeros((16, 3)), np.outer(-(rate**3), [0, 0, 1])], axis=1)
    loop = closed_loop(state_matrix, np.tile([[0.0], [1.0]], (16, 1, 1)), gain[None])
    columns = propagate_columns(midpoint_transitions(loop, step), np.eye(2, 3), midpoint_responses(loop, forcing, step))

    tiny = 1e-30j
    starts = np.array([2.0, -0.5]) + tiny * np.eye(3, 2)
    frictions = friction + tiny * np.array([0, 0, 1])
    for i in range(3):
        perturbed = midpoint_flow(starts[i], frictions[i], gain, nominal, controls, step)
        np.testing.assert_allclose(perturbed.real, nominal, rtol=0, atol=1e-14)
        np.testing.assert_allclose(columns[:, :, i], perturbed.imag / 1e-30, rtol=0, atol=2e-14)


def test_a_state_that_enters_no_rate_keeps_its_column_to_the_last_bit():
    random = np.random.default_rng(1)
    # Mixed units make pivots jump, and then the quotient as printed loses the last bits.
    unit = 10.0 ** np.array([-4, 2, 0, -1, 3, 0, 4, 1])
    state_matrix = random.standard_normal((100, 8, 8)) * unit[:, None] / unit
    control_matrix, gain = random.standard_normal((100, 8, 1)) * unit[:, None], random.standard_normal((1, 8)) / unit
    state_matrix[:, :, 6], gain[:, 6] = 0, 0
    identity, step = np.eye(8), 0.05
    quotient = np.linalg.solve(identity - step / 2 * state_matrix, identity + step / 2 * state_matrix)
    assert (quotient[:, :, 6] != identity[6]).any()
    for matrix in (state_matrix, closed_loop(state_matrix, control_matrix, gain)):
        columns = propagate_columns(midpoint_transitions(matrix, step), identity)
        assert (columns[:, :, 6] == identity[6]).all()
        assert np.abs(columns[-1] - identity).max() > 0.1
    gain[:, 6] = 1 / unit[6]
    moved = propagate_columns(midpoint_transitions(closed_loop(state_matrix, control_matrix, gain), step), identity)
    assert (moved[-1, :, 6] != identity[6]).any()


def test_adjoint_rows_give_the_final_outputs_from_every_node():
    state_matrix, forcing, step = example()
    transitions, responses = midpoint_transitions(state_matrix, step), midpoint_responses(state_matrix, forcing, step)
    random = np.random.default_rng(5)
    rows, columns = random.standard_normal((3, 4)), random.standard_normal((4, 2))
    adjoint = adjoint_rows(transitions, rows)
    free = propagate_columns(transitions, columns)
    np.testing.assert_allclose(adjoint @ free, np.tile(rows @ free[-1], (8, 1, 1)), rtol=1e-12, atol=1e-13)
    forced = propagate_columns(transitions, columns, responses)
    total = adjoint[0] @ columns + (adjoint[1:] @ responses).sum(axis=0)
    np.testing.assert_allclose(total, rows @ forced[-1], rtol=1e-12, atol=1e-13)
    assert np.abs(forced[-1] - free[-1]).max() > 0.1


def test_the_closed_loop_adds_each_gain_where_its_control_acts():
    state_matrix, control_matrix, _ = example()
    gain = np.arange(8.0).reshape(2, 4) - 3
    loop = closed_loop(state_matrix, control_matrix, gain)
    for k, i, j in np.ndindex(7, 4, 4):
        expected = state_matrix[k, i, j] + sum(control_matrix[k, i, a] * gain[a, j] for a in range(2))
        assert loop[k, i, j] == pytest.approx(expected, abs=1e-14)


STATE, FORCING, STEP = example()
SINGULAR = STATE.copy()
SINGULAR[3] = np.diag([1.0, 5.0, -2.0, 0.0])  # 2/h = 5
NOT_FINITE = STATE.copy()
NOT_FINITE[2, 1, 1] = np.nan


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: midpoint_transitions(STATE[:, :3], STEP),
            r"state_matrix must have shape \(N, n, n\), not \(7, 3, 4\)",
        ),
        (lambda: midpoint_transitions(NOT_FINITE, STEP), "state_matrix has entries that are not finite"),
        (lambda: midpoint_transitions(STATE, 0.0), "step must be positive"),
        (lambda: midpoint_transitions(SINGULAR, 0.4), "step: .* is singular in interval 3"),
        (lambda: propagate_columns(STATE, np.eye(3)), r"columns must have shape \(4, any\), not \(3, 3\)"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def scheme_example(scheme, intervals=6, n=3, m=2):
    """Matrices and forcing at the points of a scheme, and unequal steps."""
    random = np.random.default_rng(7)
    points = POINTS[scheme]
    return (
        random.standard_normal((intervals, points, n, n)),
        random.standard_normal((intervals, points, n, m)),
        random.uniform(0.1, 0.4, intervals),
    )


def collocated(scheme, matrices, forcing, step, start):
    """The end of one interval from its start: the scheme's equations written down for unknown columns, and solved."""
    n = len(start)
    unknown = np.eye(n)

    def slope(matrix, columns):
        return matrix @ columns[0], matrix @ columns[1], matrix @ columns[2]

    first, last = (unknown, 0 * unknown, 0 * start), (0 * unknown, unknown, 0 * start)
    if scheme == "trapezoid":
        rates = [(step / 2, slope(matrices[0], first), forcing[0]), (step / 2, slope(matrices[1], last), forcing[1])]
    else:
        f0 = [a + b for a, b in zip(slope(matrices[0], first), (0, 0, forcing[0]), strict=True)]
        f1 = [a + b for a, b in zip(slope(matrices[2], last), (0, 0, forcing[2]), strict=True)]
        middle = [(a + b) / 2 + step / 8 * (p - q) for a, b, p, q in zip(first, last, f0, f1, strict=True)]
        rates = [
            (step / 6, slope(matrices[0], first), forcing[0]),
            (4 * step / 6, slope(matrices[1], middle), forcing[1]),
            (step / 6, slope(matrices[2], last), forcing[2]),
        ]
    before = sum(weight * part[0] for weight, part, _ in rates)
    after = sum(weight * part[1] for weight, part, _ in rates)
    pushed = sum(weight * (part[2] + force) for weight, part, force in rates)
    return np.linalg.solve(unknown - after, (unknown + before) @ start + pushed)


@pytest.mark.parametrize("scheme", ["trapezoid", "hermite_simpson"])
def test_the_columns_of_a_scheme_obey_its_equations_on_every_interval(scheme):
    matrices, forcing, step = scheme_example(scheme)
    responses = scheme_responses(scheme, matrices, forcing, step)
    columns = propagate_columns(scheme_transitions(scheme, matrices, step), np.eye(3, 2), responses.sum(axis=1))
    for k in range(len(step)):
        expected = collocated(scheme, matrices[k], forcing[k], step[k], columns[k])
        np.testing.assert_allclose(columns[k + 1], expected, rtol=0, atol=1e-12)


def test_by_the_midpoint_rule_they_are_the_printed_recursion():
    matrices, forcing, step = scheme_example("midpoint")
    assert (scheme_transitions("midpoint", matrices, step) == midpoint_transitions(matrices[:, 0], step)).all()
    pushed = scheme_responses("midpoint", matrices, forcing, step)
    assert (pushed[:, 0] == midpoint_responses(matrices[:, 0], forcing[:, 0], step)).all()


@pytest.mark.parametrize(("scheme", "order"), [("midpoint", 2), ("trapezoid", 2), ("hermite_simpson", 4)])
def test_each_scheme_has_its_order_against_the_matrix_exponential(scheme, order):
    constant, errors = np.array([[0.0, 1.0], [-4.0, -0.3]]), []
    for intervals in (10, 20, 40):
        matrices = np.tile(constant, (intervals, POINTS[scheme], 1, 1))
        final = propagate_columns(scheme_transitions(scheme, matrices, 2.0 / intervals), np.eye(2))[-1]
        errors.append(np.abs(final - expm(2.0 * constant)).max())
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), order, atol=0.1)
