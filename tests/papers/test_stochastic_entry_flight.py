"""The entry flights: their limits and ends, what is printed, steps, and that nothing depends on how they are run."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import stats

from marsedl.montecarlo.outcomes import COMPLETED, CRASHED, ESCAPED, NON_FINITE
from marsedl.montecarlo.statistics import percentile
from marsedl.papers.stochastic_entry import dispersions, environment, flight, gains, montecarlo, records
from marsedl.papers.stochastic_entry.montecarlo import nominal_final
from marsedl.replication.pipeline.catalogue import Trial
from marsedl.replication.records import store

CASES = ("apollo_time", "apollo_velocity", "stochastic_time", "stochastic_velocity")
RADIUS = 3397e3


def undispersed(entry, case, reading="corrected", **inputs):
    """The flight of the mean vehicle in the mean atmosphere."""
    given, needed = entry.stage_inputs(reading, "montecarlo", **inputs), entry.needed("montecarlo", reading)
    plant = given.call(flight.plant_of)
    quiet = plant.dispersions._replace(entry_deviations=np.zeros(6), drag_error=0.0, lift_error=0.0)
    plant = plant._replace(atmosphere=environment.undisturbed(plant.atmosphere), dispersions=quiet)
    law = given.call(gains.law, needed["linearization"], needed["gains"], case)
    end = given.call(montecarlo.end_of, needed["nominal"], case)
    return montecarlo.simulator_of(plant, law, end, given.simulation)(0, 1)


def assert_identical(first, second):
    for field in fields(first):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name), err_msg=field.name)


# --- dispersions ------------------------------------------------------------------------------------------------------


def test_entry_states_are_those_of_table_2(entry):
    inputs = entry.stage_inputs("corrected", "montecarlo")
    trials = 20_000
    states = flight.vehicles_of(inputs.call(dispersions.dispersions_of), inputs.seed, np.arange(trials)).entry_state
    np.testing.assert_array_equal(states[:, 0], RADIUS + 125e3)
    mean = [*np.radians([125.973, 0.0]), 5800.0, *np.radians([-15.5, 90.05])]
    sigma = np.array([5e3 / RADIUS, 0.5e3 / RADIUS, 20.0, np.radians(0.5), np.radians(0.01)]) / 3.0
    scaled = (states[:, 1:] - mean) / sigma
    # Four standard errors of a mean, of a correlation and of a variance.
    assert np.abs(scaled.mean(axis=0)).max() < 4 / np.sqrt(trials)
    assert np.abs(np.cov(scaled, rowvar=False) - np.eye(5)).max() < 4 * np.sqrt(2 / trials)


@pytest.mark.parametrize(("reading", "lift", "drag"), [("corrected", 0.015, -0.02), ("printed", 0.15, 0.02)])
def test_aerodynamic_errors_are_uniform_and_of_one_variable(entry, reading, lift, drag):
    inputs = entry.stage_inputs(reading, "montecarlo")
    vehicles = flight.vehicles_of(inputs.call(dispersions.dispersions_of), inputs.seed, np.arange(5000))
    area = np.pi * 4.5**2 / 4
    drag_coefficient = 2 * 3200 * vehicles.drag_factor / area
    error = (drag_coefficient - 3200 / (135 * area)) / drag
    assert stats.kstest(error, stats.uniform(-1, 2).cdf).pvalue > 1e-3
    lift_coefficient = 2 * 3200 * vehicles.lift_factor / area
    np.testing.assert_allclose(lift_coefficient, 0.24 * 3200 / (135 * area) + lift * error, rtol=1e-9)


# --- without dispersion -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reading", ["corrected", "desensitized_density"])
@pytest.mark.parametrize("case", CASES)
def test_without_dispersion_every_law_flies_the_nominal(entry, reading, case):
    nominal = entry.nominal(reading)
    trajectories = undispersed(entry, case, reading)
    error = trajectories.final_state[:6, 0] - nominal_final(nominal)
    assert np.abs(error[[0, 3, 5]]).max() < 5e-3  # of 4 steps a second instead of 20
    assert np.abs(error[1]) < 0.05 and np.abs(error[2]) < 1e-4
    assert trajectories.final_state[records.END_TIME, 0] == pytest.approx(nominal.end_time, abs=0.05)
    assert trajectories.final_state[records.REVERSALS, 0] == len(nominal.reversal_time) == 3
    assert trajectories.final_state[records.NEGATIVE_DENSITIES, 0] == 0


# --- limits and ends --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES)
def test_flights_end_where_they_should(entry, case):
    ensemble, nominal = entry.ensemble("corrected", case), entry.nominal()
    final = ensemble.final_state
    assert (ensemble.outcome == COMPLETED).all()
    if case.endswith("velocity"):
        assert np.abs(final[:, records.VELOCITY] - 500.0).max() < 1e-9
        assert final[:, records.END_TIME].std() > 1.0
        # Whoever has ended by a time is not among those flying then.
        expected = (final[:, records.END_TIME] > ensemble.time[:, np.newaxis]).sum(axis=1)
        np.testing.assert_array_equal(ensemble.flying, expected)
    else:
        np.testing.assert_array_equal(final[:, records.END_TIME], nominal.end_time)
        assert ensemble.time[-1] == nominal.end_time and (ensemble.flying == len(final)).all()
        np.testing.assert_array_equal(final[: len(ensemble.kept_history), :6], ensemble.kept_history[:, -1, :6])


# --- trials that end badly --------------------------------------------------------------------------------------------


def test_trials_that_do_not_reach_the_trigger_are_counted(entry):
    ensemble = entry.fly("corrected", entry.gains(), "apollo_velocity", trials=200, time_limit=400.0)
    ends = np.sort(ensemble.final_state[:, records.END_TIME])
    limit = np.floor(ends[60])  # about 60 trials in time
    inputs = entry.stage_inputs("corrected", "montecarlo", time_limit=limit)
    needed = entry.needed("montecarlo", "corrected")
    options = {"case": "apollo_velocity", "trials": 200, "block_size": 100}
    cut = entry.whole(inputs, needed, **options)
    late = ensemble.final_state[:, records.END_TIME] > limit
    assert 100 < late.sum() < 190
    np.testing.assert_array_equal(cut.outcome == ESCAPED, late)
    np.testing.assert_array_equal(cut.outcome == COMPLETED, ~late)
    assert (cut.count, cut.excluded, len(cut.final_state)) == (200, 0, 200)
    np.testing.assert_array_equal(cut.final_state[~late], ensemble.final_state[~late])
    np.testing.assert_array_equal(cut.final_state[late, records.END_TIME], limit)
    assert (cut.final_state[late, records.VELOCITY] > 500.0).all()
    number = int(np.flatnonzero(late)[0])
    report = inputs.replay(montecarlo, **needed, trial=Trial("apollo_velocity", number))
    assert f"trial {number} of apollo_velocity: trigger not reached within the time limit" in report


def test_crashes_are_counted_and_not_dropped(entry):
    """Flown on for another 140 s, every vehicle is under the ground; the last ones get there around 350 s."""
    needed = entry.needed("montecarlo", "corrected")
    inputs = entry.stage_inputs("corrected", "montecarlo")
    options = {"case": "stochastic_time", "trials": 200, "block_size": 100}

    def until(end_time):
        return entry.whole(inputs, needed | {"nominal": replace(needed["nominal"], end_time=end_time)}, **options)

    late = until(330.0)
    below = late.final_state[:, records.ALTITUDE] < 0.0
    assert 0 < below.sum() < 200 or below.all() or not below.any()
    np.testing.assert_array_equal(late.outcome == CRASHED, below)
    all_down = until(380.0)
    assert (all_down.outcome == CRASHED).all() and all_down.count == 200
    report = inputs.replay(
        montecarlo,
        **needed | {"nominal": replace(needed["nominal"], end_time=380.0)},
        trial=Trial("stochastic_time", 7),
    )
    assert "trial 7 of stochastic_time: below the ground" in report


def test_gains_that_are_not_finite_make_trials_that_are_counted(entry, tmp_path):
    """The literal Eq. 55a: its gains are NaN where they overflow, in the first second already."""
    for case in ("stochastic_time", "stochastic_velocity"):
        ensemble = entry.ensemble("printed", case, trials=100)
        assert (ensemble.outcome == NON_FINITE).all()
        assert (ensemble.count, ensemble.excluded, len(ensemble.final_state)) == (0, 100, 100)
        assert np.isnan(ensemble.final_state[:, records.DOWNRANGE]).all() and np.isnan(ensemble.mean).all()
        assert (ensemble.flying == 0).all()
        store.save(tmp_path / "case.h5", ensemble, paper="stochastic_entry", reading="printed", provenance={})
        kind = type(ensemble)
        assert_identical(ensemble, store.load(tmp_path / "case.h5", kind, paper="stochastic_entry", reading="printed"))
    inputs, needed = entry.stage_inputs("printed", "montecarlo"), entry.needed("montecarlo", "printed")
    assert "not finite" in inputs.replay(montecarlo, **needed, trial=Trial("stochastic_time", 3))


# --- what is printed --------------------------------------------------------------------------------------------------


def test_printed_heading_alignment_leaves_kilometres_of_crossrange(entry):
    nominal = entry.nominal("printed_heading")
    assert nominal.crossrange[-1] == pytest.approx(6.2e3, abs=50)
    late = nominal.time >= nominal.alignment_time + 30
    np.testing.assert_allclose(np.degrees(nominal.bank[late]), 35.0, atol=1e-9)
    assert (np.diff(np.abs(nominal.crossrange[late])) > 0).all()  # and growing
    ensemble = entry.ensemble("printed_heading", "apollo_time", trials=500)
    assert np.median(np.abs(ensemble.final_state[:, records.CROSSRANGE])) == pytest.approx(6e3, rel=0.1)
    mended = entry.ensemble("corrected", "apollo_time")
    assert np.median(np.abs(mended.final_state[:, records.CROSSRANGE])) < 20.0


def test_printed_rate_limit_lets_the_bank_jump(entry):
    """Eq. 71: to the left at once, to the right after one second of 15 degrees."""
    nominal = entry.nominal("printed")
    bank = np.degrees(nominal.bank[np.isin(nominal.time, nominal.guidance_time)])
    changes = np.diff(bank)
    assert changes.min() < -80.0 and changes.max() > 70.0
    jumps = np.flatnonzero(changes > 15.0 + 1e-9)
    np.testing.assert_allclose(changes[jumps - 1], 15.0, atol=1e-9)
    limited = entry.nominal("corrected")
    bank = np.degrees(limited.bank[np.isin(limited.time, limited.guidance_time)])
    assert np.abs(np.diff(bank)).max() <= 15.0 + 1e-9


# --- steps ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("trigger", "end_time"), [("time", 230.3), ("velocity", 400.0)])
def test_flights_are_of_fourth_order_in_the_step(entry, trigger, end_time):
    """In an exponential atmosphere of a single table cell, as knots of a table take the order away."""
    inputs = entry.stage_inputs("corrected", "montecarlo")
    altitude = np.array([-10e3, 127e3])
    air = environment.Atmosphere(altitude, np.log(0.02) - altitude / 9e3, np.zeros(2), np.zeros(1))
    vehicles = flight.vehicles_of(inputs.call(dispersions.dispersions_of), inputs.seed, np.arange(64))

    def final(substeps):
        return flight.fly(
            inputs.call(flight.settings, air),
            air,
            flight.NOMINAL_LAW,
            vehicles,
            trigger=trigger,
            end_time=end_time,
            substeps=substeps,
            seed=1,
        ).final_state

    reference = final(64)
    final_states = {substeps: final(substeps) for substeps in (1, 2, 4, 8)}
    assert all((state[records.REVERSALS] == reference[records.REVERSALS]).all() for state in final_states.values())
    error = {substeps: np.median(np.abs(state - reference), axis=1) for substeps, state in final_states.items()}
    rows = [records.ALTITUDE, records.FLIGHT_PATH_ANGLE, records.DOWNRANGE, records.CROSSRANGE]
    rows.append(records.VELOCITY if trigger == "time" else records.END_TIME)
    for coarse, fine in ((1, 2), (2, 4), (4, 8)):
        np.testing.assert_allclose(np.log2(error[coarse][rows] / error[fine][rows]), 4.0, atol=0.1)
    assert error[4][records.DOWNRANGE] < 1e-4


@pytest.mark.parametrize("case", ["stochastic_velocity"])
def test_four_steps_a_second_are_enough_for_the_statistics(entry, case):
    """Against ten steps a second: single trials may turn a second apart, distributions stay."""
    four, ten = (entry.ensemble("corrected", case, flight_substeps=n).final_state for n in (4, 10))
    change = ten[:, records.DOWNRANGE] - four[:, records.DOWNRANGE]
    assert np.median(np.abs(change)) < 2.0
    assert np.sqrt(np.mean(change**2)) < 60.0
    apart = np.abs(change) > 50.0
    assert apart.mean() < 0.03
    for row in (records.ALTITUDE, records.FLIGHT_PATH_ANGLE, records.DOWNRANGE):
        for level in (0.01, 0.99):
            (first, error), (second, _) = (percentile(final[:, row], level) for final in (four, ten))
            assert abs(second - first) < error  # of these 2,000 trials; a few of them make the percentile
    # Changing the steps moves the mean by far less than its standard error.
    spread = four[:, records.DOWNRANGE].std() / np.sqrt(len(four))
    assert abs(change.mean()) < 0.15 * spread
    forty = entry.ensemble("corrected", case, trials=500, flight_substeps=40).final_state[:, records.DOWNRANGE]
    fine = forty - ten[:500, records.DOWNRANGE]
    # Decimetres for the Apollo law, whose gains grow towards the heading alignment; hardly a trial turns elsewhere.
    assert np.median(np.abs(fine)) < 0.3 and np.mean(np.abs(fine) > 50.0) <= 0.005
