"""Choices that the paper leaves open, each against what it must be equal to where that is known exactly."""

import numpy as np
import pytest

from marsedl.papers.random_field.double_integrator import (
    nominal_states,
    program,
    system,
)
from marsedl.papers.random_field.partition import steps_between_outputs, with_halved_end_steps

CLOSED = 1
NODES = [0.0, 50.0, *np.arange(75.0, 351.0, 25.0), 400.0]


# --- partitions -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("nodes", "longest", "steps"),
    [
        (NODES, 2.5, 5),
        ([0.0, 51.0, 400.0], 2.5, 2),
    ],
)
def test_stored_states_meet_all_nodes(nodes, longest, steps):
    assert steps_between_outputs(nodes, 0.5, longest) == steps
    assert not np.any(np.rint(np.array(nodes) / 0.5).astype(int) % steps)


def test_a_partition_of_other_times_is_flown_without_another_input(random_field):
    """Nodes that 2.5 s do not divide: the states are stored once a second."""
    changes = {"partition": np.array([0.0, 51.0, 100.0, 130.0, 160.0, 190.0, 300.0, 400.0]), "iterations": 1}
    gains = random_field.gains("corrected", **changes)
    assert np.diff(gains.time) == pytest.approx(1.0)
    ensemble = random_field.ensemble("corrected", trials=10, **changes)
    assert np.isin(gains.partition, ensemble.time).all()


def test_end_steps_are_halved_and_nothing_else():
    assert with_halved_end_steps(NODES, 0.5) == [*np.arange(0.0, 401.0, 25.0)]
    assert with_halved_end_steps((0.0, 50.0, 75.0, 76.5), 0.5) == [0.0, 25.0, 50.0, 75.0, 76.0, 76.5]
    assert with_halved_end_steps([0.0, 0.5, 1.0], 0.5) == [0.0, 0.5, 1.0]


# --- the mean of the density variation --------------------------------------------------------------------------------


def test_a_mean_variation_is_a_denser_atmosphere_whose_variation_is_smaller(random_field):
    """rho (1 + m + d) = rho (1 + m) (1 + d / (1 + m)): the same flights, to rounding."""
    mean = 0.1
    table = random_field.stage_inputs("corrected", "nominal").density_table
    denser = {
        "density_table": np.column_stack([table[:, 0], (1.0 + mean) * table[:, 1]]),
        "variance_at_top": 0.148 / (1.0 + mean) ** 2,
        "density_floor": 1e-3 / (1.0 + mean),
    }
    raised = {"variation_mean": mean}
    shifted, other = (random_field.nominal("corrected", **changes) for changes in (raised, denser))
    assert shifted.entry_flight_path_angle == pytest.approx(other.entry_flight_path_angle, rel=1e-9)
    np.testing.assert_allclose(shifted.dynamic_pressure, other.dynamic_pressure, rtol=1e-6)
    assert abs(np.degrees(shifted.entry_flight_path_angle - random_field.nominal().entry_flight_path_angle)) > 0.05
    shifted, other = (random_field.linearization("corrected", **changes) for changes in (raised, denser))
    scale = np.sqrt(np.diag(other.disturbance_covariance.reshape(42, 42)))
    difference = (shifted.disturbance_covariance - other.disturbance_covariance).reshape(42, 42)
    assert np.abs(difference / np.outer(scale, scale)).max() < 1e-6
    shifted, other = (
        random_field.ensemble("corrected", trials=20, iterations=1, **changes) for changes in (raised, denser)
    )
    np.testing.assert_allclose(shifted.delta_v[0], other.delta_v[0], atol=1e-4)


# --- what feedback refers to, and the guess ---------------------------------------------------------------------------


def test_feedback_refers_to_what_the_reading_says(random_field):
    gains = {
        name: random_field.gains("corrected", feedback_reference=name)
        for name in ("mean", "expansion_point", "propagated_mean")
    }
    nodes = np.searchsorted(gains["mean"].time, gains["mean"].partition)
    states = np.stack(
        [gains["mean"].altitude + 3397e3, gains["mean"].velocity, gains["mean"].flight_path_angle], axis=-1
    )
    expected = {
        "mean": gains["mean"].reference[1:],
        "expansion_point": states[:-1, nodes],
        "propagated_mean": states[1:, nodes],
    }
    for name, laws in gains.items():
        np.testing.assert_allclose(laws.feedback_reference[1:], expected[name], rtol=1e-12)
        # The program knows nothing of it.
        np.testing.assert_array_equal(laws.gain, gains["mean"].gain)
    assert np.abs(expected["mean"] - expected["expansion_point"])[..., 0].max() > 1e3


def test_a_guess_moves_the_entry_angle_and_is_where_the_iteration_starts(random_field):
    lifted = {"initial_control": 0.2, "iterations": 1}
    angle = random_field.nominal("corrected", **lifted).entry_flight_path_angle
    assert np.degrees(angle - random_field.nominal().entry_flight_path_angle) < -0.05  # lift up, so it enters steeper
    gains = random_field.gains("corrected", **lifted)
    assert gains.control[0] == pytest.approx(0.2)
    assert np.abs(gains.control[1] - 0.2).max() == pytest.approx(0.1, abs=1e-6)
    assert gains.apoapsis[0] == pytest.approx(5.0, abs=1e-9)
    # The norm of Eq. 54 is the root of the weighted square.
    tighter = random_field.gains("corrected", control_trust_weight=4.0, iterations=1)
    assert np.abs(tighter.control[1]).max() == pytest.approx(0.05, abs=1e-6)


def test_correlated_initial_deviations_are_flown_and_designed_for(random_field):
    deviations, correlations = np.array([100.0, 2.0, 1e-4]), np.array([0.5, -0.3, 0.2])
    changes = {"initial_deviations": deviations, "initial_correlations": correlations, "iterations": 1}
    gains = random_field.gains("corrected", **changes)
    matrix = np.array([[1.0, 0.5, -0.3], [0.5, 1.0, 0.2], [-0.3, 0.2, 1.0]])
    np.testing.assert_allclose(gains.covariance[1, 0], matrix * np.outer(deviations, deviations), rtol=1e-9)
    ensemble = random_field.ensemble("corrected", trials=500, **changes)
    covariance = ensemble.covariance[0, 0, :3, :3]
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(covariance / np.outer(scale, scale), matrix, atol=4.0 / np.sqrt(500))
    np.testing.assert_allclose(scale, deviations, rtol=4.0 / np.sqrt(1000))


# --- double integrator ------------------------------------------------------------------------------------------------


def test_the_nominal_of_the_double_integrator_is_the_integral_of_its_acceleration(random_field):
    point_mass = random_field.inputs("corrected", double_integrator_force_mean=-3e-3).point_mass
    control = np.array([0.01, -0.02, 0.0, 0.03, 0.005])
    time = np.linspace(0.0, 5.0, 100_001)
    acceleration = control[np.minimum(time.astype(int), 4)] - 3e-3
    step = time[1]
    velocity = 0.1 + np.append(0.0, np.cumsum(acceleration[:-1] * step))
    place = 0.1 + np.append(0.0, np.cumsum(velocity[:-1] * step + 0.5 * acceleration[:-1] * step**2))
    states = nominal_states(point_mass, control, time)
    np.testing.assert_allclose(states[0], place, atol=1e-9)
    np.testing.assert_allclose(states[1], velocity, atol=1e-9)


def test_a_mean_force_is_steered_against(random_field):
    """The final mean is met by the design, and by its flights within their errors."""
    changes = {"double_integrator_force_mean": 2e-3, "double_integrator_iterations": 2}
    design = random_field.double_integrator("corrected", **changes)
    assert np.abs(design.control[CLOSED]).max() > 1e-3
    np.testing.assert_allclose(design.mean[CLOSED, -1], [0.6, 0.1], atol=1e-7)
    np.testing.assert_allclose(design.mean[0, -1], [0.6 + 0.5 * 2e-3 * 25, 0.1 + 2e-3 * 5], atol=1e-12)
    flights = random_field.double_integrator_flights("corrected", **changes)
    count = flights.count[CLOSED]
    for law in (0, CLOSED):
        error = np.sqrt(np.diag(flights.covariance[law, -1, :2, :2]) / count)
        assert (np.abs(flights.mean[law, -1, :2] - design.mean[law, -1]) < 4.0 * error).all(), law


def test_a_second_iteration_linearises_the_force_where_the_first_leads(random_field):
    """To another final position; where the mean coasts already, nothing changes."""
    wide = {"double_integrator_bounds": np.array([2.0, 0.0])}
    for final, moved in (([0.6, 0.1], False), ([0.55, 0.1], True)):
        first, second = (
            random_field.double_integrator(
                "corrected", double_integrator_final_mean=np.array(final), double_integrator_iterations=count, **wide
            )
            for count in (1, 2)
        )
        change = np.abs(second.disturbance_covariance - first.disturbance_covariance).max()
        assert (change > 1e-3 * np.abs(first.disturbance_covariance).max()) == moved
        assert (second.objective == pytest.approx(first.objective, rel=1e-9)) != moved


def test_the_force_without_its_period_is_the_other_factor_of_its_covariance(random_field):
    point_mass = random_field.inputs("corrected", double_integrator_kernel="squared_exponential").point_mass
    long_period = random_field.inputs("corrected", double_integrator_period=1e9).point_mass
    nominal, other = system(point_mass), system(long_period)
    np.testing.assert_allclose(nominal.disturbance_covariance, other.disturbance_covariance, rtol=1e-9)
    assert program(point_mass).percentiles == ()
