"""Flights of the desensitized laws with errors at entry: single ones, sweeps, and random ones by the thousand.

Expected numbers are those of an independent study of the paper; half of the last digit is meant as their tolerance.
"""

from dataclasses import replace

import numpy as np
import pytest

from marsedl.montecarlo.outcomes import COMPLETED, CRASHED
from marsedl.papers.desensitized import environment, montecarlo, responses
from marsedl.papers.desensitized.entry_problem import BANK
from marsedl.papers.desensitized.gains import flown_law
from marsedl.papers.desensitized.records import CHANNELS, LAWS
from marsedl.replication.records import store

RADIUS = 3397e3
DEGREE = np.pi / 180.0
LENGTHS = np.array([1.0, RADIUS, RADIUS])
PLAIN, SHAPED, FIRST = 0, 1, 2  # no_doc, reshaped, and the law of the first channel
TRIALS = 2000
SIGMAS = 4.0
DEVIATIONS = np.array([200.0, 1000.0, 200.0])
UNITS = np.array([1.0, 1.0 / RADIUS, 1.0 / RADIUS, 0.1, 0.1, 0.1])  # of the covariances that are compared


def norms(errors):
    return np.linalg.norm(errors, axis=-1)


def final(flights, law, channel):
    """Final errors of a drawn history."""
    return flights.error[law, CHANNELS.index(channel), -1]


def final_errors(desensitized, law, channel, sizes, gains=None, **options):
    """Final errors (sizes, 3) of errors of one channel under a law, by its number."""
    inputs = desensitized.stage_inputs("corrected", "responses")
    return inputs.call(
        environment.final_errors,
        inputs.call(environment.surroundings),
        *flown_law(gains or desensitized.gains(), law),
        environment.along_channel(CHANNELS.index(channel), sizes),
        **options,
    )


# --- histories --------------------------------------------------------------------------------------------------------


def test_the_nominals_are_flown_again(desensitized):
    """Runge-Kutta steps of half a second against a method of order eight: millimetres."""
    flights, nominal = desensitized.responses(), desensitized.nominal()
    assert list(flights.law) == list(LAWS)
    difference = flights.nominal[PLAIN] - nominal.flown
    assert np.abs(difference[:, :3] * LENGTHS).max() < 2e-3
    assert np.abs(difference[:, 3:6]).max() < 1e-4 and np.abs(difference[:, 6:]).max() < 1e-9
    assert flights.nominal_cumulative[PLAIN] == pytest.approx(nominal.cumulative, rel=1e-9)
    np.testing.assert_array_equal(flights.nominal_acceleration[PLAIN, :-1], nominal.bank_acceleration)
    np.testing.assert_array_equal(flights.nominal_acceleration[PLAIN, -1], nominal.bank_acceleration[-1])
    for law in range(FIRST, FIRST + 3):
        np.testing.assert_array_equal(flights.nominal[law], flights.nominal[PLAIN])
    # What is missed at 100 intervals is about what feedback leaves of an error.
    target = np.array([10e3, 0.0, 12.2 * DEGREE])
    np.testing.assert_allclose((flights.nominal[PLAIN, -1, :3] - target) * LENGTHS, [-14.9, 24.1, 10.1], atol=0.051)


def test_errors_are_against_the_flown_nominal(desensitized):
    """Not against the target, nor against the transcription."""
    flights = desensitized.responses()
    expected = (flights.state[..., :3] - flights.nominal[:, np.newaxis, :, :3]) * LENGTHS
    np.testing.assert_array_equal(np.isnan(flights.error), np.isnan(expected))
    np.testing.assert_allclose(flights.error, expected, rtol=0, atol=1e-6)
    start = np.zeros((len(LAWS), 3, 3))
    start[:, range(3), range(3)] = [200.0, 1000.0, 200.0]
    np.testing.assert_allclose(flights.error[:, :, 0], start, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(flights.drawn_error, [200.0, 1000.0, 200.0])


def test_final_errors_of_the_figures(desensitized):
    flights = desensitized.responses()
    np.testing.assert_allclose(final(flights, PLAIN, "radius"), [105, -191, 1620], atol=0.51)
    np.testing.assert_allclose(final(flights, SHAPED, "radius"), [41, -5, 1232], atol=0.51)
    for law, channel, expected, near in (
        (PLAIN, "radius", 1635, 0.51),
        (SHAPED, "radius", 1233, 0.51),
        (FIRST, "radius", 128, 0.51),
        (PLAIN, "crossrange", 977.4, 0.051),
        (FIRST + 1, "crossrange", 31, 0.51),
        (PLAIN, "downrange", 200.0, 0.051),
        (FIRST + 2, "downrange", 5.6, 0.051),
    ):
        assert norms(final(flights, law, channel)) == pytest.approx(expected, abs=near), (law, channel)


def test_final_errors_of_the_tabulated_size(desensitized):
    """Of 1000 m and -1000 m; one unit of the last digit at the largest, which lies between two of them."""
    error_norm = norms(desensitized.responses().tabulated_error)
    for law, channel, expected, near in (
        (PLAIN, 0, [8175.3, 8168.1], 0.1),
        (SHAPED, 0, [6171, 6154], 0.51),
        (FIRST, 0, [3016, 2612], 0.51),
        (PLAIN, 1, [977.4, 977.4], 0.051),
        (FIRST + 1, 1, [31, 32], 0.51),
        (PLAIN, 2, [1000.0, 1000.0], 0.051),
        (FIRST + 2, 2, [125, 108], 0.51),
    ):
        np.testing.assert_allclose(error_norm[law, channel], expected, rtol=0, atol=near)


@pytest.mark.parametrize(("channel", "effort"), [("radius", 4.976), ("downrange", 5.148), ("crossrange", 5.045)])
def test_effort_of_the_drawn_flights(desensitized, channel, effort):
    """Known as sums of |u| at the starts of the intervals; flown is the integral, here by the mean of both ends."""
    flights, gains, number = desensitized.responses(), desensitized.gains(), CHANNELS.index(channel)
    law = FIRST + number
    steps, acceleration = np.diff(flights.time[law]), flights.acceleration[law, number]
    assert steps @ np.abs(acceleration[:-1]) / DEGREE == pytest.approx(effort, abs=5.1e-4)
    fed_back = (flights.state[law, number] - flights.nominal[law]) @ gains.gain[law]
    middle = gains.bank_acceleration[law] + (fed_back[1:] + fed_back[:-1]) / 2.0
    assert flights.cumulative[law, number] == pytest.approx(steps @ np.abs(middle), rel=2e-5)
    assert 0.0355 < np.abs(acceleration).max() / DEGREE < 0.0375
    assert flights.largest_command[law, number] / DEGREE < 0.04  # no bound near


# --- what the flights obey --------------------------------------------------------------------------------------------


def test_small_errors_are_those_of_the_linear_sensitivity(desensitized):
    """10 m, times 100: within what the discretisation leaves, 0.05 and 0.13 per cent."""
    for law, size, linear in ((PLAIN, 8172, desensitized.linearization().final[0]), (SHAPED, 6162, None)):
        errors = final_errors(desensitized, law, "radius", np.array([10.0, -10.0]))
        mean = 100.0 * (errors[0] - errors[1]) / 2.0
        assert norms(mean) == pytest.approx(size, abs=0.51)
        if linear is not None:
            np.testing.assert_allclose(mean, 1000.0 * linear[:, 0], rtol=0, atol=0.001 * size)
    assert norms(mean) == pytest.approx(norms(desensitized.linearization().final[4][:, 0]) * 1000.0, rel=2e-3)


@pytest.mark.parametrize(
    ("channel", "sizes"), [("radius", [10, 20, 40]), ("crossrange", [100, 200, 400]), ("downrange", [50, 100, 200])]
)
def test_feedback_leaves_errors_of_second_order(desensitized, channel, sizes):
    """The even part of the final error; the odd one is due to the discretisation and the third order."""
    law, sizes = FIRST + CHANNELS.index(channel), np.array(sizes, dtype=float)
    up, down = (final_errors(desensitized, law, channel, sign * sizes) for sign in (1.0, -1.0))
    even, odd = norms(up + down) / 2.0, norms(up - down) / 2.0
    assert (even > 1e-3).all()
    np.testing.assert_allclose(even[1:] / even[:-1], 4.0, rtol=0.1)
    plain = norms(final_errors(desensitized, PLAIN, channel, sizes))
    assert (odd / plain < 0.01).all()
    # An error twenty times as large without any feedback is proportional.
    np.testing.assert_allclose(plain / sizes, plain[0] / sizes[0], rtol=2e-3)


# --- sweeps -----------------------------------------------------------------------------------------------------------


def test_sweeps_pass_through_the_other_flights(desensitized):
    """No error leads to none; the same error leads to the same flight, to the last bit, wherever it stands."""
    flights = desensitized.responses()
    assert flights.wide.shape == flights.narrow.shape == (3, 9)
    np.testing.assert_array_equal(flights.wide[0], np.linspace(-2000.0, 2000.0, 9))
    np.testing.assert_array_equal(flights.narrow[2], np.linspace(-200.0, 200.0, 9))
    assert not flights.wide_error[:, :, 4].any() and not flights.narrow_error[:, :, 4].any()
    np.testing.assert_array_equal(flights.wide_error[:, :, [6, 2]], flights.tabulated_error)
    for channel, sweep, at in (
        ("radius", "narrow_error", 8),
        ("crossrange", "wide_error", 6),
        ("downrange", "narrow_error", 8),
    ):
        number = CHANNELS.index(channel)
        np.testing.assert_array_equal(getattr(flights, sweep)[:, number, at], flights.error[:, number, -1])


@pytest.fixture(scope="module")
def doomed(desensitized):
    """Laws of which one follows a trajectory that dives, as an unfinished solve may leave behind."""
    gains = desensitized.gains()
    control, state = gains.bank_acceleration.copy(), gains.state.copy()
    control[FIRST], state[FIRST, 0, BANK:] = 0.0, [np.pi, 0.0]
    state[FIRST, 0, 3:6] = [-6000.0, 0.0, 3000.0]
    return replace(gains, bank_acceleration=control, state=state)


def test_a_law_whose_own_nominal_is_lost_does_not_stop_the_others(desensitized, doomed, tmp_path):
    inputs = desensitized.stage_inputs("corrected", "responses")
    flights = inputs.call(responses.compute, doomed)
    assert np.isnan(flights.nominal[FIRST, -1]).all() and np.isnan(flights.wide_error[FIRST]).all()
    assert np.isfinite(flights.nominal_cumulative).all()
    usual = desensitized.responses()
    for law in (PLAIN, SHAPED, FIRST + 1):
        np.testing.assert_array_equal(flights.wide_error[law], usual.wide_error[law])
    ensemble = desensitized.fly("corrected", doomed, trials=20)
    assert np.isnan(ensemble.nominal[FIRST, -1]).all()
    assert np.isnan(ensemble.final_error[FIRST]).all() and (ensemble.outcome[FIRST] == CRASHED).all()
    for number, artifact in enumerate((flights, ensemble)):
        path = tmp_path / f"{number}.h5"
        store.save(path, artifact, paper="desensitized", reading="corrected", provenance={})
        again = store.load(path, type(artifact), paper="desensitized", reading="corrected")
        np.testing.assert_array_equal(again.nominal, artifact.nominal)


# --- Monte Carlo ------------------------------------------------------------------------------------------------------


def assert_covariance(covariance, expected, trials):
    """A sample covariance within its sampling error, entry by entry."""
    variances = np.outer(np.diag(expected), np.diag(expected))
    error = SIGMAS * np.sqrt((variances + expected**2) / trials)
    np.testing.assert_array_less(np.abs(covariance - expected), error + 1e-12)


def test_covariances_without_feedback_are_the_linear_ones(desensitized):
    """S P S' at every stored time, of all states; the bank angle does not move."""
    ensemble, linear = desensitized.ensemble(), desensitized.linearization()
    assert ensemble.time.shape == (6, 21)
    np.testing.assert_allclose(ensemble.time[PLAIN], linear.time[::5], rtol=1e-15)
    for k in range(21):
        columns = (linear.sensitivity[5 * k] * DEVIATIONS)[:6] / UNITS[:, np.newaxis]
        covariance = ensemble.covariance[PLAIN, k][:6, :6] / np.outer(UNITS, UNITS)
        assert_covariance(covariance, columns @ columns.T, TRIALS)
    assert np.abs(ensemble.covariance[[PLAIN, SHAPED]][:, :, BANK:]).max() < 1e-20


@pytest.fixture(scope="module")
def flown_sensitivity(desensitized):
    """Final positions against those at entry, (laws, 3, 3), by differences of flights that are 2 cm apart."""
    size = np.array([0.01, -0.01])
    return np.array(
        [
            np.transpose(
                [
                    final_errors(desensitized, law, channel, size)[0]
                    - final_errors(desensitized, law, channel, size)[1]
                    for channel in CHANNELS
                ]
            )
            / 0.02
            for law in range(len(LAWS))
        ]
    )


def test_closed_loop_sensitivities_are_those_of_the_flights(desensitized, flown_sensitivity):
    """But for the discretisation: hundredths, and thousandths without feedback.

    Not so for the gains for all columns: large ones that make a column of 0.1 by cancellation, on 100 intervals only.
    """
    difference = np.abs(flown_sensitivity - desensitized.gains().final).max(axis=(1, 2))
    assert (difference[:2] < 0.01).all() and (difference[FIRST : FIRST + 3] < 0.04).all()
    assert 0.5 < difference[-1] < 1.5


def test_no_trial_is_dropped(desensitized):
    """Each has an outcome and an end; those below the ground have no final error, and are left in the counts."""
    ensemble = desensitized.ensemble()
    assert ensemble.outcome.shape == (6, TRIALS) and ensemble.final_state.shape == (6, TRIALS, 9)
    np.testing.assert_array_equal(ensemble.outcome == CRASHED, ensemble.final_state[:, :, 0] < 0.0)
    completed = ensemble.outcome == COMPLETED
    np.testing.assert_array_equal(np.isfinite(ensemble.final_error).all(axis=-1), completed)
    np.testing.assert_array_equal(np.isfinite(ensemble.final_error).any(axis=-1), completed)
    np.testing.assert_array_equal(ensemble.count + ensemble.excluded, TRIALS)
    np.testing.assert_array_equal(ensemble.flying[:, -1], completed.sum(axis=1))
    lost = (~completed).sum(axis=1)
    assert lost[PLAIN] == lost[SHAPED] == 0 and 0 < lost[FIRST] < 20
    assert np.isfinite(ensemble.covariance).all()


@pytest.mark.parametrize(("intervals", "step"), [(10, 1), (97, 1), (100, 5), (105, 5)])
def test_stored_times_divide_the_intervals(intervals, step):
    assert montecarlo.output_step(intervals) == step
