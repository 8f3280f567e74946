import numpy as np
import pytest

from marsedl.methods.guidance.longitudinal import linear_model
from marsedl.models.dynamics.longitudinal_entry import longitudinal_entry_rates

DRAG_FACTOR, LIFT_FACTOR, GRAVITATIONAL_PARAMETER = 1 / 270, 0.24 / 270, 4.2828e13
CONSTANTS = (DRAG_FACTOR, LIFT_FACTOR, GRAVITATIONAL_PARAMETER)
DECAY_FACTOR, PLANET_RADIUS = 2.0, 3.397e6


def profile(radius):
    """Mean density, 1/H and d(1/H)/dr of ln rho = a + b h + c h^2, a scale height that falls with altitude."""
    altitude = radius - PLANET_RADIUS
    a, b, c = -4.23, -8.7e-5, -3.4e-10
    return np.exp(a + b * altitude + c * altitude**2), -b - 2 * c * altitude, -2 * c + 0 * altitude


def full_rates(points):
    """Rates as functions of state and bank cosine alone, (k, 6) -> (k, 5)."""
    mean, inverse, _ = profile(points[:, 0])
    return np.stack(
        longitudinal_entry_rates(points.T[:5], points.T[5], mean, inverse, DECAY_FACTOR * inverse, *CONSTANTS), axis=1
    )


def example(count=40, relative_density=1.0):
    """States with descending and climbing flight, (k, 5), and bank cosines, (k,)."""
    random = np.random.default_rng(7)
    altitude, velocity = random.uniform(10e3, 90e3, count), random.uniform(500, 5800, count)
    states = np.stack(
        [
            PLANET_RADIUS + altitude,
            velocity,
            random.uniform(-0.28, 0.03, count),
            random.uniform(-6e5, 0, count),
            profile(PLANET_RADIUS + altitude)[0] * relative_density,
        ],
        axis=1,
    )
    return states, random.uniform(-1, 1, count)


def model(states, cosine):
    return linear_model(states, cosine, *profile(states[:, 0]), DECAY_FACTOR, *CONSTANTS)


def comparable(matrices):
    """Entries of A in 1/s, each state in a unit of the size of its deviations."""
    scale = np.array([1e3, 100.0, 0.01, 1e3, 5e-3])
    return matrices * scale / scale[:, np.newaxis]


@pytest.mark.parametrize("relative_density", [1.0, 1.3, 0.6])
def test_matrices_are_the_derivatives_of_the_rates_as_functions_of_the_radius(relative_density):
    states, cosine = example(relative_density=relative_density)
    state_matrix, control_matrix = model(states, cosine)
    points, step = np.column_stack([states, cosine]), 1e-30
    columns = [full_rates(points + 1j * step * unit).imag / step for unit in np.eye(6)]
    expected = np.stack(columns, axis=2)
    # Rounding; the largest entries are of order one.
    assert np.abs(comparable(state_matrix - expected[..., :5])).max() < 1e-14
    np.testing.assert_allclose(control_matrix, expected[..., 5], rtol=1e-14)


def test_central_differences_approach_the_density_row_with_order_two():
    states, cosine = example()
    state_matrix, _ = model(states, cosine)
    points, errors = np.column_stack([states, cosine]), []
    for step in (400.0, 200.0, 100.0):
        shift = np.eye(6)[0] * step
        quotient = (full_rates(points + shift) - full_rates(points - shift)) / (2 * step)
        errors.append(np.abs(quotient[:, 4] / state_matrix[:, 4, 0] - 1).max())
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2, atol=0.02)


def test_matrices_on_the_mean_density_by_hand():
    states, cosine = example()
    radius, velocity, path, _, density = states.T
    _, inverse, inverse_slope = profile(radius)
    decay, gravity = DECAY_FACTOR * inverse, GRAVITATIONAL_PARAMETER / radius**2
    sine, cos = np.sin(path), np.cos(path)
    sink_rate = -velocity * sine
    expected = np.zeros((len(states), 5, 5))
    expected[:, 0, 1], expected[:, 0, 2] = sine, velocity * cos
    expected[:, 1, 0], expected[:, 1, 1] = 2 * gravity * sine / radius, -2 * DRAG_FACTOR * density * velocity
    expected[:, 1, 2], expected[:, 1, 4] = -gravity * cos, -DRAG_FACTOR * velocity**2
    expected[:, 2, 0] = (2 * gravity / radius - velocity**2 / radius**2) * cos / velocity
    expected[:, 2, 1] = LIFT_FACTOR * density * cosine + (gravity / velocity**2 + 1 / radius) * cos
    expected[:, 2, 2] = (gravity - velocity**2 / radius) * sine / velocity
    expected[:, 2, 4] = LIFT_FACTOR * velocity * cosine
    expected[:, 3, 1], expected[:, 3, 2] = cos, -velocity * sine
    expected[:, 4, 0] = (inverse_slope * density - decay * density * inverse) * sink_rate
    expected[:, 4, 1], expected[:, 4, 2] = -density * inverse * sine, -density * inverse * velocity * cos
    expected[:, 4, 4] = (inverse - decay) * sink_rate
    state_matrix, control_matrix = model(states, cosine)
    assert np.abs(comparable(state_matrix - expected)).max() < 1e-14
    np.testing.assert_array_equal(control_matrix[:, [0, 1, 3, 4]], 0)
    np.testing.assert_allclose(control_matrix[:, 2], LIFT_FACTOR * density * velocity, rtol=1e-15)
