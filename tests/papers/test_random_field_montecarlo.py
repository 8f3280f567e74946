"""Statistics of the flights through random fields against known values, linear covariance, and another propagator.

Known values are those of an independent program with 5,000 trials of each case. Tolerances are four standard errors of
both samples combined, so that a correct program fails less than once in ten thousand comparisons; seeds are fixed.
"""

import numpy as np
import pytest

from marsedl.models import orbits
from marsedl.montecarlo.outcomes import CRASHED, ESCAPED
from marsedl.montecarlo.statistics import percentile
from marsedl.papers.random_field import components, montecarlo
from marsedl.papers.random_field.flight_statistics import (
    delta_v_percentile,
    lost,
    percentile_with_lost,
    step_violations,
)
from marsedl.papers.random_field.records import CAPTURED, NOT_EXITED

RADIUS, MU = 3397e3, 4.2828e13
MISSION = 5 * RADIUS, 2 * RADIUS, MU
TRIALS, REFERENCE_TRIALS, SIGMAS = 2000, 5000, 4.0
BOTH = np.sqrt(1 + TRIALS / REFERENCE_TRIALS)  # of a standard error of ours, with the reference's
UNITS = np.array([1e3, 1.0, np.radians(1.0)])
MOTION = [components.ALTITUDE, components.VELOCITY, components.FLIGHT_PATH_ANGLE]


def simulator(random_field, reading="corrected", gains=None, number=-1, **changes):
    """The function `simulate_block` of a reading with changed inputs, under the law of a number."""
    inputs = random_field.stage_inputs(reading, "montecarlo", **changes)
    records = {"nominal": random_field.nominal(reading), "gains": gains or random_field.gains(reading)}
    return inputs.call(montecarlo.block_simulator, **records, number=number)


def nodes_of(ensemble, partition):
    return np.searchsorted(ensemble.time, partition)


# --- delta-v ----------------------------------------------------------------------------------------------------------

PERCENTILES = {  # of the laws of all iterations, with standard errors
    "corrected": ((301.9, 0.6), (293.0, 0.3), (302.4, 0.2)),
    "pf_printed": ((349.6, 1.6), (335.4, 0.7), (346.9, 0.9)),
    "metres": ((285.4, 0.1), (287.9, 0.3), (301.6, 0.4)),
}


@pytest.mark.parametrize("reading", PERCENTILES)
def test_percentiles_agree_with_another_program(random_field, reading):
    ensemble = random_field.ensemble(reading)
    assert not lost(ensemble).any()
    for law, (reference, reference_error) in enumerate(PERCENTILES[reading], start=1):
        value, error = delta_v_percentile(ensemble, law)
        assert value == pytest.approx(reference, abs=SIGMAS * np.hypot(error, reference_error) + 0.051), law


def test_open_loop_delta_v_agrees_with_another_program(random_field):
    ensemble = random_field.ensemble()
    delta_v, apoapsis = ensemble.delta_v[0], ensemble.apoapsis[0]
    value, error = delta_v_percentile(ensemble, 0)
    assert value == pytest.approx(574.7, abs=SIGMAS * np.hypot(error, 7.9))
    assert np.mean(delta_v) == pytest.approx(352.2, abs=SIGMAS * 67.0 / np.sqrt(TRIALS) * BOTH)
    median, error = percentile(delta_v, 0.5)
    assert median == pytest.approx(332.4, abs=SIGMAS * error * BOTH)
    # Heavy tails: errors from the fourth moments of the flights.
    for sample, deviation in ((delta_v, 67.0), (apoapsis, 1.28)):
        variance, fourth = sample.var(), ((sample - sample.mean()) ** 4).mean()
        error = np.sqrt((fourth - variance**2) / TRIALS) / (2 * np.sqrt(variance))
        assert sample.std() == pytest.approx(deviation, abs=SIGMAS * error * BOTH + 0.0051 * deviation)


SPREAD = """
125  .0047 17.82 .0088   .1276 16.57 .0855
175  .0986 47.15 .0446   .6531 26.80 .1938
250  .9107 76.34 .1676   .4382 8.505 .0657
400  5.967 81.18 .4861   .4720 5.702 .0799
"""  # s; km, m/s, deg of the open loop and of the third law


@pytest.mark.parametrize("row", SPREAD.strip().splitlines(), ids=lambda row: f"{row.split()[0]} s")
def test_spread_over_time(random_field, row):
    ensemble = random_field.ensemble()
    time, *texts = row.split()
    k = np.flatnonzero(ensemble.time == float(time))[0]
    deviation = np.sqrt(np.diagonal(ensemble.covariance[[0, 3], k], axis1=1, axis2=2))[:, MOTION] / UNITS
    for value, text in zip(deviation.ravel(), texts, strict=True):
        # Nearly normal: four standard errors of both, half a digit.
        digit = 10.0 ** -len(text.split(".")[1])
        assert value == pytest.approx(float(text), abs=SIGMAS / np.sqrt(2 * TRIALS) * BOTH * value + 0.51 * digit)


# --- commands and their limits ----------------------------------------------------------------------------------------


def test_commands_of_the_last_law(random_field):
    """Known mean and standard deviation of what is commanded, before the limits, on the intervals until 275 s."""
    mean = (0.300, 0.300, 0.296, -0.122, -0.124, -0.015, -0.077, -0.288, -0.308, -0.301)
    deviation = (0.000, 0.000, 0.045, 0.193, 0.294, 0.325, 0.319, 0.175, 0.100, 0.067)
    ensemble, gains = random_field.ensemble(), random_field.gains()
    at = nodes_of(ensemble, gains.partition[:10])
    mean_command = ensemble.mean[3][at, components.BANK_COSINE]
    spread = np.sqrt(ensemble.covariance[3][at, components.BANK_COSINE, components.BANK_COSINE])
    np.testing.assert_array_less(
        np.abs(mean_command - mean), SIGMAS * spread / np.sqrt(TRIALS) * BOTH + 1.1e-3 * np.ones(10)
    )
    np.testing.assert_allclose(spread, deviation, rtol=SIGMAS / np.sqrt(2 * TRIALS) * BOTH, atol=6e-4)
    # What linear covariance predicts of it, near the largest dynamic pressure.
    busy = spread > 0.1
    predicted = gains.control_deviation[3][:10][busy]
    assert np.abs(spread[busy] / predicted - 1.0).max() < 0.05 + SIGMAS / np.sqrt(2 * TRIALS)


def test_violations_are_counted_trial_by_trial(random_field):
    limits = -0.4, 0.8
    changes = {"control_limits": np.array(limits), "iterations": 2}
    ensemble, gains = random_field.ensemble(trials=500, **changes), random_field.gains(**changes)
    by_step, at_any = step_violations(ensemble, gains.partition)
    assert by_step.shape == (3, 14) and at_any.shape == (3,)
    assert not by_step[0].any() and not at_any[0]
    for law in (1, 2):
        trajectories = simulator(random_field, gains=gains, number=law, **changes)(0, 500)
        commanded = trajectories.history[nodes_of(ensemble, gains.partition[:-1]), components.BANK_COSINE]
        beyond = (commanded < limits[0]) | (commanded > limits[1])
        np.testing.assert_array_equal(by_step[law], beyond.sum(axis=1))
        assert at_any[law] == beyond.any(axis=0).sum() > 0


# --- lost trials ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reading", "lost_of_reference"), [("sign_printed", 4345), ("variance_printed", 4440), ("printed", 4860)]
)
def test_open_loop_trials_that_are_lost(random_field, reading, lost_of_reference):
    """Of 5,000 trials of another program; the counts depend on the floor of the density, which is the same."""
    trajectories = simulator(random_field, reading, number=0)(0, TRIALS)
    share = lost_of_reference / REFERENCE_TRIALS
    lost_share = (trajectories.outcome != CAPTURED).sum() / TRIALS
    # "About", but for the first: two per cent of the trials.
    allowed = SIGMAS * np.sqrt(share * (1 - share) * (1 / TRIALS + 1 / REFERENCE_TRIALS))
    assert lost_share == pytest.approx(share, abs=allowed + (0.0 if reading == "sign_printed" else 0.02))


def test_without_navigation_errors_most_flights_are_lost(random_field):
    """Known: 5,000, 1,077 and 1,426 of 5,000, but with gains of 1e17 the counts are rounding noise."""
    ensemble = random_field.ensemble("literal_gains")
    counts = lost(ensemble)
    assert counts[0] == 0 and (counts[1:] > 0.1 * TRIALS).all()
    for law in (1, 2, 3):
        assert np.isnan(delta_v_percentile(ensemble, law)).all()
    assert random_field.gains("literal_gains").delta_v_deviation[1] < 2.0  # which is what the design promises


@pytest.mark.parametrize("reading", ["literal_gains", "printed"])
def test_no_trial_is_dropped(random_field, reading):
    """Every trial has an outcome and an end; delta-v exists for those that are captured, and for no other."""
    ensemble = random_field.ensemble(reading)
    laws = 1 if reading == "printed" else 4
    assert ensemble.outcome.shape == ensemble.delta_v.shape == ensemble.apoapsis.shape == (laws, TRIALS)
    assert ensemble.final_state.shape == (laws, TRIALS, 4)
    captured = ensemble.outcome == CAPTURED
    np.testing.assert_array_equal(np.isfinite(ensemble.delta_v), captured)
    np.testing.assert_array_equal(np.isfinite(ensemble.apoapsis), captured)
    np.testing.assert_array_equal(lost(ensemble), TRIALS - captured.sum(axis=1))
    np.testing.assert_array_equal(lost(ensemble, 500), 500 - captured[:, :500].sum(axis=1))
    np.testing.assert_array_equal(ensemble.count + ensemble.excluded, TRIALS)
    altitude, velocity, angle = np.moveaxis(ensemble.final_state[..., :3], -1, 0)
    orbit = orbits.apoapsis_radius(altitude + RADIUS, velocity, angle, MU)
    np.testing.assert_array_equal(ensemble.outcome == CRASHED, altitude < 0.0)
    np.testing.assert_array_equal(ensemble.outcome == NOT_EXITED, (altitude >= 0.0) & (altitude < 100e3))
    np.testing.assert_array_equal(ensemble.outcome == ESCAPED, (altitude >= 100e3) & ~np.isfinite(orbit))
    if reading == "printed":
        assert (np.bincount(ensemble.outcome[0], minlength=5)[[CRASHED, ESCAPED]] > 0).all()
    delta_v = orbits.total_delta_v(altitude + RADIUS, velocity, angle, *MISSION)
    np.testing.assert_allclose(ensemble.delta_v[captured], delta_v[captured], rtol=1e-14)


def test_a_lost_trial_counts_as_the_largest():
    """The order statistics of 1,000 values of which the largest are unknown: until the percentile lies among them."""
    values = np.random.default_rng(3).permutation(np.linspace(300.0, 500.0, 1000))
    expected = percentile(values, 0.99)
    assert percentile_with_lost(values) == pytest.approx(expected)
    for number in (1, 5, 9):
        hidden = np.where(values >= np.sort(values)[-number], np.nan, values)
        value, error = percentile_with_lost(hidden)
        assert value == pytest.approx(expected[0], rel=1e-12) and 0.0 < error < expected[1] * 1.5
        assert value > np.nanquantile(hidden, 0.99)  # which is what dropping them would give
    for number in (10, 11, 500, 999, 1000):
        hidden = np.where(values >= np.sort(values)[-number], np.nan, values)
        assert np.isnan(percentile_with_lost(hidden)).all(), number
    value, _ = percentile_with_lost(np.where(values >= np.sort(values)[-400], np.nan, values), 0.5)
    assert value == pytest.approx(np.median(values))
    assert np.isnan(percentile_with_lost(np.array([np.nan, 300.0]))).all()
