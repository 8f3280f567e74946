"""Ratios of linear covariance to flights, on flights whose covariance is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from marsedl.comparison import accuracy
from marsedl.montecarlo.outcomes import COMPLETED

TRIALS = 20_000
COVARIANCE = np.array([[4.0, 1.0, 0.5], [1.0, 9.0, -1.0], [0.5, -1.0, 1.0]])
QUANTITIES = (("altitude", "m"), ("velocity", "m/s"), ("flight path angle", "rad"))


@pytest.fixture
def flights():
    return np.random.default_rng(5).multivariate_normal(np.ones(3), COVARIANCE, TRIALS)


def test_a_true_prediction_has_the_ratio_one_within_its_standard_error(flights):
    for row in accuracy.deviations("case", QUANTITIES, np.sqrt(np.diag(COVARIANCE)), flights):
        assert abs(row.ratio - 1.0) < 4 * row.ratio_error
        assert row.ratio_error == pytest.approx(1 / np.sqrt(2 * TRIALS), rel=0.05)  # of normal samples


def test_lost_flights_are_left_out_and_counted(flights):
    lost = np.array(flights)
    lost[:7, 2] = np.nan
    rows = accuracy.deviations("case", QUANTITIES, [2.0, 3.0, 1.0], flights[7:])
    assert accuracy.deviations("case", QUANTITIES, [2.0, 3.0, 1.0], lost) == [row._replace(lost=7) for row in rows]


def test_where_no_flight_is_left_no_number_is_given():
    (row,) = accuracy.deviations("case", QUANTITIES[:1], [2.0], np.full((4, 1), np.nan))
    assert np.isnan(row.ratio)
    assert (row.trials, row.lost) == (0, 4)
    table = accuracy.table({"funnels": [row]})
    assert table[["Monte Carlo", "ratio", "ratio: standard error"]].isna().all(axis=None)
    assert table[["number of flights", "lost"]].to_numpy().tolist() == [[0, 4]]
    accuracy.figure({"funnels": [row]})


def test_the_sensitivity_of_the_desensitized_landing_carries_the_errors_at_entry():
    final = np.array([[[1.0, 2.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 0.5]]])
    deviations = np.array([200.0, 1000.0, 300.0])
    errors = np.random.default_rng(9).normal(size=(1, TRIALS, 3)) * deviations
    gains = SimpleNamespace(law=np.array(["no_doc"]), final=final)
    final_states = SimpleNamespace(final_error=errors @ final[0].T)
    ensemble = SimpleNamespace(initial_deviations=deviations)
    for row in accuracy.desensitized(ensemble, gains, final_states):
        assert abs(row.ratio - 1.0) < 4 * row.ratio_error


def test_linear_flights_of_the_funnels_have_the_predicted_deviations():
    """Starts and disturbances uniform on their boundaries, carried by a constant closed loop."""
    draw, states, steps, end = np.random.default_rng(10), 6, 400, 2.0
    matrix, control, gain = draw.normal(size=(states, states)) / 3, draw.normal(size=states), draw.normal(size=states)
    disturbance = draw.normal(size=(states, 2))
    half = 2 * steps + 1
    linearization = SimpleNamespace(
        time=np.linspace(0.0, end, steps + 1),
        state_matrix=np.tile(matrix, (half, 1, 1)),
        control_matrix=np.tile(control, (half, 1)),
        disturbance_matrix=np.tile(disturbance, (half, 1, 1)),
    )
    shape, level = np.diag(draw.uniform(1.0, 4.0, states)), 0.7
    gains = SimpleNamespace(half_gain=np.tile(gain / 5, (half, 1)), shape=shape[np.newaxis])

    def sphere(size):
        points = draw.normal(size=(TRIALS, size))
        return points / np.linalg.norm(points, axis=1, keepdims=True)

    start = np.sqrt(2 * level) * sphere(states) / np.sqrt(np.diag(shape))
    assert np.einsum("ti,ij,tj->t", start, shape, start) / 2 == pytest.approx(level)
    joint = np.zeros((states + 2, states + 2))
    joint[:states, :states], joint[:states, states:] = matrix + np.outer(control, gain / 5), disturbance
    final_states = np.hstack([start, sphere(2)]) @ expm(end * joint).T
    ensemble = SimpleNamespace(final_state=final_states, outcome=np.full(TRIALS, COMPLETED))
    inputs, funnel = SimpleNamespace(planet_radius=1000.0), SimpleNamespace(level=np.array([level]))
    rows = accuracy.funnels(inputs, linearization, gains, funnel, ensemble)
    for row in rows:
        assert abs(row.ratio - 1.0) < 4 * row.ratio_error
    assert rows[1].sampled == pytest.approx(1000.0 * final_states[:, 1].std(ddof=1))
    assert [row.unit for row in rows] == ["m", "m", "m", "m/s", "rad", "rad"]


def test_the_table_has_a_row_for_each_and_says_how_many_were_lost(flights):
    rows = accuracy.deviations("case", QUANTITIES, [2.0, 3.0, 1.0], flights)
    table = accuracy.table({"funnels": rows})
    assert table["ratio"].tolist() == [row.ratio for row in rows]
    assert set(table["number of flights"]) == {20_000} and set(table["lost"]) == {0}
