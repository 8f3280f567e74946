import math

import numpy as np
import pytest

from marsedl.methods.linearization import linearize
from marsedl.models.atmosphere import casadi_log_density, tabulated
from marsedl.models.dynamics.powered_descent import powered_descent_rates


def glider(radius, speed, path_angle, bank, density, ballistic_coefficient):
    """A nonlinear example in which a parameter varies along the trajectory."""
    drag = density * speed**2 / (2 * ballistic_coefficient)
    return (
        speed * np.sin(path_angle),
        -drag - np.sin(path_angle) / radius**2,
        0.2 * drag * np.cos(bank) / speed + (speed / radius - 1 / (speed * radius**2)) * np.cos(path_angle),
    )


def example():
    random = np.random.default_rng(2)
    states = np.array([1.1, 0.9, -0.2]) + 0.1 * random.standard_normal((7, 3))
    return states, random.uniform(-1, 1, (7, 1)), (random.uniform(0.5, 2, 7), 1.3)


def differences(states, controls, parameters, step, method):
    """Jacobian with respect to states and controls, (k, n, n + m), by differences of the plain function."""
    points = np.hstack([states, controls])
    columns = []
    for i in range(points.shape[1]):
        shift = np.zeros(points.shape[1], dtype=complex if method == "complex" else float)
        shift[i] = 1j * step if method == "complex" else step
        ahead = np.array(glider(*(points + shift).T, *parameters))
        if method == "complex":
            columns.append(ahead.imag / step)
        else:
            columns.append((ahead - np.array(glider(*(points - shift).T, *parameters))) / (2 * step))
    return np.array(columns).transpose(2, 1, 0)


def test_jacobians_agree_with_the_complex_step():
    states, controls, parameters = example()
    model = linearize(glider, states, controls, parameters)
    reference = differences(states, controls, parameters, 1e-30, "complex")
    # Both are exact up to rounding; derivatives are of order one to ten.
    np.testing.assert_allclose(np.dstack([model.state_matrix, model.control_matrix]), reference, rtol=0, atol=2e-14)


def test_central_differences_approach_the_jacobians_with_order_two():
    states, controls, parameters = example()
    model = linearize(glider, states, controls, parameters)
    exact = np.dstack([model.state_matrix, model.control_matrix])
    errors = [np.abs(differences(states, controls, parameters, h, "central") - exact).max() for h in (4e-2, 2e-2, 1e-2)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2, atol=0.05)


def test_affine_term_closes_the_model():
    states, controls, parameters = example()
    model = linearize(glider, states, controls, parameters)
    value = np.array(glider(*states.T, *controls.T, *parameters)).T
    rebuilt = (model.state_matrix @ states[:, :, None] + model.control_matrix @ controls[:, :, None])[:, :, 0]
    np.testing.assert_allclose(rebuilt + model.affine, value, rtol=0, atol=1e-14)


def test_an_affine_system_is_returned_exactly():
    random = np.random.default_rng(3)
    a, b, c = random.standard_normal((3, 3)), random.standard_normal((3, 2)), random.standard_normal(3)

    def rates(x1, x2, x3, u1, u2):
        x, u = (x1, x2, x3), (u1, u2)
        return tuple(
            sum(a[i, j] * x[j] for j in range(3)) + sum(b[i, j] * u[j] for j in range(2)) + c[i] for i in range(3)
        )

    model = linearize(rates, random.standard_normal((5, 3)), random.standard_normal((5, 2)))
    assert (model.state_matrix == a).all()
    assert (model.control_matrix == b).all()
    np.testing.assert_allclose(model.affine, np.tile(c, (5, 1)), rtol=0, atol=3e-15)


def test_powered_descent_without_mass_state_is_the_design_model():
    def rates(r1, r2, v1, v2, u1, u2, mass):
        return powered_descent_rates((r1, r2, v1, v2, mass), (u1, u2), (0.0, 0.0), 3.71, 4.85e-4)[:4]

    mass = np.linspace(1500, 1350, 6)
    model = linearize(rates, np.ones((6, 4)), np.full((6, 2), 5000.0), (mass,))
    assert (model.state_matrix == np.eye(4, k=2)).all()
    np.testing.assert_allclose(model.control_matrix, np.eye(4, 2, k=-2) / mass[:, None, None], rtol=1e-15)
    np.testing.assert_allclose(model.affine, np.tile([0, 0, 0, -3.71], (6, 1)), atol=2e-15)


def test_derivatives_exist_at_zero_thrust():
    def rates(*arguments):
        return powered_descent_rates(arguments[:5], arguments[5:], (0.0, 0.0), 3.71, 4.85e-4)

    model = linearize(rates, np.ones((1, 5)), np.zeros((1, 2)))
    assert np.isfinite(model.control_matrix).all()


def test_a_system_without_control_is_allowed():
    model = linearize(lambda x: (-(x**2),), np.array([[3.0]]), np.empty((1, 0)))
    assert model.control_matrix.shape == (1, 1, 0)
    assert (model.state_matrix[0, 0, 0], model.affine[0, 0]) == (-6.0, 9.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((glider, np.ones((4, 3)), np.ones((3, 1)), (1.0, 1.0)), "do not fit"),
        ((lambda x, y: (x,), np.ones((4, 2)), np.ones((4, 0)), ()), "1 values for a state of 2"),
        ((glider, np.array([[1.0, 1, 0], [0.0, 1, 0]]), np.ones((2, 1)), (1.0, 1.0)), "point 1 of 2"),
    ],
)
def test_bad_input_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        linearize(*arguments)


def test_math_functions_do_not_pass_silently():
    with pytest.raises((TypeError, NotImplementedError, ValueError, RuntimeError)):
        linearize(lambda x: (math.sin(x),), np.ones((1, 1)), np.empty((1, 0)))


def test_rates_that_go_through_a_table_are_linearised_as_well():
    """CasADi traces splines by its other kind of symbols; the slopes are those of the same curve in numpy."""
    table = np.column_stack([np.linspace(0.0, 60e3, 13), 0.02 * np.exp(-(np.linspace(0.0, 6.0, 13) ** 1.1))])
    log_density, profile = casadi_log_density(table), tabulated(table)

    def fall(altitude, speed, throttle):
        import casadi

        assert isinstance(altitude, casadi.MX | casadi.SX)
        return speed, throttle - 3.7 + casadi.exp(log_density(altitude)) * speed**2

    states, controls = np.array([[41e3, -900.0], [12e3, -400.0]]), np.array([[0.0], [2.0]])
    model = linearize(fall, states, controls)
    value, slope, _ = profile(states[:, 0])
    density, speed = np.exp(value), states[:, 1]
    expected = np.array([[[0, 1], [r * s * v * v, 2 * r * v]] for r, s, v in zip(density, slope, speed, strict=True)])
    np.testing.assert_allclose(model.state_matrix, expected, rtol=1e-10)
    np.testing.assert_allclose(model.control_matrix, [[[0.0], [1.0]]] * 2)
