"""The simulated flight: the compiled kernel against a plain oracle, and that nothing depends on how it is run."""

from dataclasses import fields, replace
from functools import partial

import numba
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from marsedl.montecarlo.ensembles import Trajectories
from marsedl.montecarlo.outcomes import COMPLETED, CRASHED, NON_FINITE
from marsedl.montecarlo.statistics import wishart_deviance
from marsedl.montecarlo.streams import normals
from marsedl.papers.powered_descent import flight, montecarlo, segments
from marsedl.papers.powered_descent.records import DEPTH, THRUST
from marsedl.replication import artifacts
from marsedl.replication.catalogue import Flown, Trial
from marsedl.replication.jobs import arguments_of, compute_record

GRAVITY, MASS_FLOW, NOISE_DENSITY, WET_MASS = 3.71, 1 / (210 * 9.81), 360.0, 1500.0
DURATIONS = (26.0, 15.0)


def simulator(pipeline, case="closed_loop", reading="corrected", **changes):
    inputs = pipeline.stage_inputs(reading, "montecarlo_chunk", **changes)
    records = {"nominal": pipeline.nominal(reading), "gains": pipeline.gains(reading)}
    return inputs.call(montecarlo.block_simulator, **records, case=case)


def assert_identical(first, second):
    for field in fields(first):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name), err_msg=field.name)


# --- the kernel against the equations ---------------------------------------------------------------------------------


def control_law(gains, number, feedback):
    """Control u(t, x) of a segment (Eq. 24), t from its start, by splines through the nodes of the design."""
    nodes = np.flatnonzero(gains.segment == number)
    time = gains.time[nodes] - gains.time[nodes[0]]
    gain, mean, feedforward = (CubicSpline(time, t[nodes]) for t in (gains.gain, gains.mean, gains.feedforward))
    return lambda t, x: feedforward(t) - feedback * gain(t) @ (x[:4] - mean(t))


def rates(thrust, t, x, force, mass=None):
    """Eqs. 1, 2 and 49; mass: the prior profile, m(t), if the plant has it in place of its own."""
    u = thrust(t, x)
    acceleration = (u + force) / (x[4] if mass is None else mass(t)) + np.array([0.0, -GRAVITY])
    return np.concatenate([x[2:4], acceleration, [-MASS_FLOW * np.linalg.norm(u)]])


def oracle(gains, seed, trial, step, scheme, feedback=True, prior=None, hold=None):
    """One trial, slowly; states (k, 5) and thrust magnitudes (k,) at all steps of both segments.

    prior: `Nominal` of the mass that the plant has. hold: steps over which a command is held.
    """
    counts = [round(duration / step) for duration in DURATIONS]
    draws = iter(normals(seed, flight.NOISE_STREAM, [trial], 2 * sum(counts))[0].reshape(-1, 2))
    initial = normals(seed, flight.INITIAL_STREAM, [trial], 4)[0]
    angle = np.radians(110)
    state = np.array([250, 500, 50 * np.sin(angle), 50 * np.cos(angle), WET_MASS])
    state[:4] += np.sqrt([40.0, 40.0, 5.0, 5.0]) * initial
    states, thrusts = [], []
    for number, count in enumerate(counts):
        law = thrust = control_law(gains, number, feedback)
        mass = None
        if prior is not None:
            nodes = np.flatnonzero(prior.segment == number)
            mass = CubicSpline(prior.time[nodes] - prior.time[nodes[0]], prior.mass[nodes])
        for k in range(count):
            t = step * k
            if hold and k % hold == 0:
                thrust = partial(lambda command, t, x: command, law(t, state))
            states.append(state)
            thrusts.append(np.linalg.norm(thrust(t, state)))
            force = NOISE_DENSITY * next(draws) / np.sqrt(step)
            slope_1 = rates(thrust, t, state, force, mass)
            if scheme == "euler_maruyama":
                state = state + step * slope_1
                continue
            if scheme == "semi_implicit_euler":
                later = state + step * slope_1
                state = np.concatenate([state[:2] + step * later[2:4], later[2:]])
                continue
            slope_2 = rates(thrust, t + step / 2, state + step / 2 * slope_1, force, mass)
            slope_3 = rates(thrust, t + step / 2, state + step / 2 * slope_2, force, mass)
            slope_4 = rates(thrust, t + step, state + step * slope_3, force, mass)
            state = state + step / 6 * (slope_1 + 2 * slope_2 + 2 * slope_3 + slope_4)
        states.append(state)
        thrusts.append(np.linalg.norm((thrust if hold and count % hold else law)(DURATIONS[number], state)))
    return np.array(states), np.array(thrusts)


@pytest.mark.parametrize(
    ("scheme", "case", "trial", "hold"),
    [
        ("rk4", "closed_loop", 0, None),
        ("rk4", "closed_loop", 77, None),
        ("rk4", "open_loop", 3, None),
        ("rk4", "prior_mass", 9, None),
        ("rk4", "closed_loop", 11, 1),
        ("rk4", "closed_loop", 11, 5),
        ("rk4", "prior_mass", 12, 7),  # divides neither segment
        ("euler_maruyama", "closed_loop", 5, None),
        ("semi_implicit_euler", "closed_loop", 6, None),
        ("semi_implicit_euler", "prior_mass", 6, 5),
    ],
)
def test_kernel_flies_the_equations(pipeline, scheme, case, trial, hold):
    step, gains = 0.1, pipeline.gains()
    seed = pipeline.stage_inputs("corrected", "montecarlo_chunk").seed
    prior = pipeline.nominal() if case == "prior_mass" else None
    states, thrusts = oracle(gains, seed, trial, step, scheme, case != "open_loop", prior, hold)
    interval = {"command_interval": hold and hold * step}
    trajectories = simulator(pipeline, case, integrator=scheme, time_step=step, **interval)(trial, trial + 1)
    outputs = np.r_[0:261:5, 261:412:5]  # every 0.5 s, the switch twice
    # Rounding of 410 steps, of the order of 1e-12 of the largest state.
    np.testing.assert_allclose(trajectories.history[..., 0], states[outputs], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(trajectories.final_state[:, 0], states[-1], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(trajectories.observed[:, THRUST, 0], thrusts[outputs], rtol=1e-9)
    np.testing.assert_allclose(trajectories.observed[:, DEPTH, 0], -states[outputs, 1], rtol=1e-9, atol=1e-9)
    assert trajectories.observed_maximum[THRUST, 0] == pytest.approx(thrusts.max(), rel=1e-9)
    assert trajectories.observed_maximum[DEPTH, 0] == pytest.approx(-states[:, 1].min(), rel=1e-9)


def test_initial_states_have_the_given_moments(pipeline):
    states = simulator(pipeline)(0, 20_000).history[0].T
    inputs = pipeline.stage_inputs("corrected", "montecarlo_chunk")
    np.testing.assert_array_equal(states[:, 4], WET_MASS)
    spread = np.sqrt(np.diag(inputs.initial_covariance))
    scaled = (states[:, :4] - segments.initial_mean(inputs.entry)) / spread
    # Four standard errors of 20,000 trials: of a mean, of a correlation, of a variance.
    assert np.abs(scaled.mean(axis=0)).max() < 4 / np.sqrt(20_000)
    assert np.abs(np.cov(scaled, rowvar=False) - np.eye(4)).max() < 4 * np.sqrt(2 / 20_000)


def test_correlated_initial_states():
    covariance = np.array([[40.0, 10, 0, 3], [10, 40, 1, 0], [0, 1, 5, 2], [3, 0, 2, 5]])
    states = flight.initial_states(flight.Start(np.arange(4.0), covariance, 1500.0), 1, np.arange(20_000))
    scale = np.sqrt(np.diag(covariance))
    error = (np.cov(states[:, :4], rowvar=False) - covariance) / np.outer(scale, scale)
    assert np.abs(error).max() < 4 * np.sqrt(2 / 20_000)


def test_the_control_after_the_switch_is_that_of_the_second_segment(pipeline, node):
    trajectories, gains = simulator(pipeline)(0, 20), pipeline.gains()
    switch = 52
    np.testing.assert_array_equal(trajectories.history[switch], trajectories.history[switch + 1])
    for output, after in ((switch, False), (switch + 1, True)):
        k = node(gains, 26.0, after)
        error = trajectories.history[output, :4].T - gains.mean[k]
        expected = np.linalg.norm(gains.feedforward[k] - error @ gains.gain[k].T, axis=1)
        np.testing.assert_allclose(trajectories.observed[output, THRUST], expected, rtol=1e-9)
    assert (trajectories.observed[switch + 1, THRUST] < 0.6 * trajectories.observed[switch, THRUST]).all()


@pytest.mark.parametrize("interval", [0.1, 0.5])
def test_a_held_command_changes_only_when_it_is_renewed(pipeline, interval):
    trajectories = simulator(pipeline, command_interval=interval, output_interval=0.1)(0, 3)
    thrust, hold = trajectories.observed[:260, THRUST], round(interval / 0.1)
    steady = np.diff(thrust, axis=0) == 0
    renewed = np.arange(1, 260) % hold == 0
    assert steady[~renewed].all() and not steady[renewed].any()


def test_a_command_held_for_ever_shorter_times_is_the_continuous_one(pipeline):
    exact = simulator(pipeline, time_step=0.01)(0, 20).final_state[:4]
    errors = [
        np.abs(simulator(pipeline, time_step=0.01, command_interval=hold)(0, 20).final_state[:4] - exact).max()
        for hold in (0.5, 0.25, 0.125)
    ]
    assert errors[0] > 1.7 * errors[1] > 1.7**2 * errors[2] > 0  # first order in the interval


def test_a_wide_switch_scales_the_scatter_at_the_switch_and_nothing_before(pipeline, node):
    gains, switch = pipeline.gains(), 52
    plain, wide = simulator(pipeline)(0, 40), simulator(pipeline, "wide_switch")(0, 40)
    np.testing.assert_array_equal(wide.history[: switch + 1], plain.history[: switch + 1])
    mean = gains.mean[node(gains, 26.0, True)][:, np.newaxis]
    before, after = plain.history[switch, :4] - mean, wide.history[switch + 1, :4] - mean
    np.testing.assert_allclose(after, np.sqrt(1.5) * before, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(wide.history[switch + 1, 4], plain.history[switch, 4])
    same = simulator(pipeline, "wide_switch", wide_switch_factor=1.0)(0, 40)
    np.testing.assert_array_equal(same.final_state, plain.final_state)


def test_flights_with_the_prior_mass_have_the_moments_of_the_linear_design(pipeline):
    # The motion is then linear with the noise of the design: mean and covariance are those of the targets, exactly.
    final = simulator(pipeline, "prior_mass")(0, 20_000).final_state[:4].T
    target = np.diag([5.0, 0.25, 0.25, 0.25])
    assert (np.abs(final.mean(axis=0) - [100, 50, 0, 0]) < 4 * np.sqrt(np.diag(target) / 20_000)).all()
    assert wishart_deviance(np.cov(final, rowvar=False), 20_000, target).p_value > 1e-3
    # and those whose mass flows do not
    final_states = simulator(pipeline)(0, 20_000).final_state[:4].T
    assert wishart_deviance(np.cov(final_states, rowvar=False), 20_000, target).p_value < 1e-3


# --- without noise ----------------------------------------------------------------------------------------------------


def fly_quietly(pipeline, noise_density, spread, trials):
    """Final states of trials with another plant noise and an initial spread in units of the given one, (trials, 5)."""
    inputs, gains = pipeline.stage_inputs("corrected", "montecarlo_chunk"), pipeline.gains()
    times = segments.grids(inputs.segment_durations, inputs.design_interval)
    schedules = flight.schedules_of(times, gains, [260, 150])
    distribution = flight.Start(segments.initial_mean(inputs.entry), inputs.initial_covariance, WET_MASS)
    states = flight.initial_states(distribution, inputs.seed, np.arange(trials))
    start = np.append(distribution.mean, WET_MASS)
    plant, draws = flight.Plant(GRAVITY, MASS_FLOW, noise_density), flight.Draws(inputs.seed)
    return flight.fly(schedules, plant, start + spread * (states - start), draws, steps_per_output=[5, 5])


def test_a_flight_without_noise_and_dispersion_follows_the_mean_and_the_prior_mass(pipeline, node):
    trajectories, gains, prior = fly_quietly(pipeline, 0.0, 0.0, 1), pipeline.gains(), pipeline.nominal()
    times = np.concatenate([np.arange(0, 26.1, 0.5), np.arange(26, 41.1, 0.5)])
    nodes = [node(gains, time, after_switch=number > 52) for number, time in enumerate(times)]
    # The fourth-order error of steps of 0.1 s, against motion over hundreds of metres.
    np.testing.assert_allclose(trajectories.history[:, :4, 0], gains.mean[nodes], rtol=0, atol=1e-5)
    np.testing.assert_allclose(trajectories.history[:, 4, 0], prior.mass[nodes], rtol=0, atol=1e-5)
    thrust = np.linalg.norm(gains.feedforward[nodes], axis=1)
    np.testing.assert_allclose(trajectories.observed[:, THRUST, 0], thrust, rtol=1e-6)


def test_the_noise_is_injected(pipeline):
    # Without plant noise the final variances are those that the start alone leaves, well below the target.
    target = np.array([5.0, 0.25, 0.25, 0.25])
    quiet = fly_quietly(pipeline, 0.0, 1.0, 2000).final_state[:4].var(axis=1)
    noisy = fly_quietly(pipeline, NOISE_DENSITY, 1.0, 2000).final_state[:4].var(axis=1)
    assert (quiet < 0.5 * target).all()
    # 4 standard errors of a variance from 2,000 trials, and 2 % of nonlinearity
    np.testing.assert_allclose(noisy, target, rtol=4 * np.sqrt(2 / 2000) + 0.02)


# --- nothing depends on how it is run ---------------------------------------------------------------------------------


def test_results_do_not_depend_on_the_number_of_threads(pipeline):
    before = numba.get_num_threads()
    assert numba.config.NUMBA_NUM_THREADS > 1 or before == 1  # one core only: nothing to compare
    try:
        results = []
        for threads in {1, min(2, numba.config.NUMBA_NUM_THREADS), numba.config.NUMBA_NUM_THREADS}:
            numba.set_num_threads(threads)
            results.append(pipeline.fly("corrected", pipeline.gains(), trials=1500))
    finally:
        numba.set_num_threads(before)
    for result in results[1:]:
        assert_identical(results[0], result)


@pytest.mark.parametrize(("trials", "block_size", "chunks"), [(2500, 1000, 2), (2500, 1000, 3), (700, 100, 5)])
def test_results_do_not_depend_on_the_number_of_chunks(pipeline, trials, block_size, chunks):
    gains = pipeline.gains()
    whole = pipeline.fly("corrected", gains, trials=trials, block_size=block_size)
    parts = pipeline.fly("corrected", gains, trials=trials, block_size=block_size, chunks=chunks)
    assert whole.count == trials and len(whole.final_state) == trials
    assert (whole.flying == trials).all()
    assert_identical(whole, parts)


def test_a_case_in_one_go_is_its_chunks_gathered(pipeline):
    inputs, gains = pipeline.stage_inputs("corrected", "montecarlo"), pipeline.gains()
    options = {"case": "closed_loop", "trials": 1200, "block_size": 500}

    artifacts = {"gains": gains, "nominal": pipeline.nominal()}

    def give(function, **others):
        return arguments_of(function, inputs.values, lambda name, kind: artifacts.get(name), **others)

    record = compute_record(pipeline.paper.stages["montecarlo"].entries, give, options)
    assert_identical(record, pipeline.fly("corrected", gains, trials=1200, block_size=500, chunks=3))


def test_a_trial_does_not_depend_on_the_number_of_trials(pipeline):
    few, many = pipeline.ensemble(trials=300), pipeline.ensemble(trials=1500)
    for name in ("final_state", "observed_maximum", "outcome"):
        np.testing.assert_array_equal(getattr(few, name), getattr(many, name)[:300])
    np.testing.assert_array_equal(few.kept_history, many.kept_history)
    # and the large cases fly the same trials and more
    large = pipeline.ensemble(case="closed_loop_large", trials=1500)
    assert_identical(many, large)


@pytest.mark.parametrize("trial", [0, 63, 64, 1499])
def test_replay_is_the_trial_of_the_ensemble(pipeline, trial):
    ensemble, gains = pipeline.ensemble(trials=1500), pipeline.gains()
    alone = simulator(pipeline)(trial, trial + 1)
    np.testing.assert_array_equal(alone.final_state[:, 0], ensemble.final_state[trial])
    np.testing.assert_array_equal(alone.observed_maximum[:, 0], ensemble.observed_maximum[trial])
    if trial < len(ensemble.kept_history):
        np.testing.assert_array_equal(alone.history[..., 0], ensemble.kept_history[trial])
    inputs = pipeline.stage_inputs("corrected", "montecarlo")
    records = {"nominal": pipeline.nominal(), "gains": gains}
    text = inputs.call(montecarlo.replay, **records, trial=Trial("closed_loop", trial, ensemble))
    assert "the same to the last bit" in text and f"trial {trial} of closed_loop: completed" in text
    other = replace(ensemble, final_state=np.nextafter(ensemble.final_state, 0.0))
    assert "DIFFERS" in inputs.call(montecarlo.replay, **records, trial=Trial("closed_loop", trial, other))


def test_another_seed_gives_other_trials(pipeline):
    base, other = simulator(pipeline)(0, 10), simulator(pipeline, seed=1)(0, 10)
    assert (base.final_state != other.final_state).all()


def test_moments_and_maxima_are_those_of_the_trials(pipeline):
    ensemble = pipeline.fly("corrected", pipeline.gains(), trials=300, block_size=100)
    trajectories = simulator(pipeline)(0, 300)
    # Rounding only: blocks are merged instead of summed at once.
    np.testing.assert_allclose(ensemble.mean, trajectories.history.mean(axis=-1), rtol=1e-12, atol=1e-12)
    for k in (0, 20, 52, 53, 83):
        np.testing.assert_allclose(ensemble.covariance[k], np.cov(trajectories.history[k]), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(ensemble.observed_mean, trajectories.observed.mean(axis=-1), rtol=1e-12)
    np.testing.assert_array_equal(ensemble.maximum_over_trials, trajectories.observed.max(axis=-1))
    np.testing.assert_array_equal(ensemble.observed_maximum, trajectories.observed_maximum.T)
    np.testing.assert_array_equal(ensemble.final_state, trajectories.final_state.T)
    assert (ensemble.histogram.sum(axis=-1) == 300).all()
    expected = np.concatenate([np.arange(0, 26.1, 0.5), np.arange(26, 41.1, 0.5)])
    np.testing.assert_allclose(ensemble.time, expected, atol=1e-12)
    assert ensemble.segment.tolist() == [0] * 53 + [1] * 31


@pytest.mark.parametrize(("time_step", "output_interval"), [(0.1, 0.5), (0.3, 0.7), (1.0, 0.5), (0.07, 3.0)])
def test_outputs_end_with_each_segment_whatever_the_steps(pipeline, time_step, output_interval):
    sizes = {"time_step": time_step, "output_interval": output_interval}
    ensemble = pipeline.fly("corrected", pipeline.gains(), trials=10, **sizes)
    assert len(ensemble.time) == ensemble.mean.shape[0] == ensemble.kept_history.shape[1]
    ends = ensemble.time[[0, np.flatnonzero(ensemble.segment == 0)[-1], -1]]
    np.testing.assert_allclose(ends, [0.0, 26.0, 41.0], atol=1e-12)
    assert np.diff(ensemble.time).max() <= output_interval + 1e-12
    steps, every = flight.step_count(26.0, time_step, output_interval)
    assert 26.0 / steps <= time_step + 1e-12 and steps % every == 0


# --- trials that end badly --------------------------------------------------------------------------------------------


def test_crashes_are_counted_and_not_dropped(pipeline):
    # Open loop, with an output at every step, so that a crash is visible in the history.
    trajectories = simulator(pipeline, "open_loop", output_interval=0.1)(0, 600)
    below = (trajectories.history[:, 1] < 0).any(axis=0)
    assert 0 < below.sum() < 600
    np.testing.assert_array_equal(trajectories.outcome == CRASHED, below)
    np.testing.assert_array_equal(trajectories.outcome == COMPLETED, ~below)
    np.testing.assert_array_equal(trajectories.observed_maximum[DEPTH], -trajectories.history[:, 1].min(axis=0))
    ensemble = pipeline.fly("corrected", pipeline.gains(), "open_loop", trials=600, output_interval=0.1)
    assert (ensemble.outcome == CRASHED).sum() == below.sum()
    assert (ensemble.count, ensemble.excluded, len(ensemble.outcome)) == (600, 0, 600)
    np.testing.assert_allclose(ensemble.mean[-1], trajectories.final_state.mean(axis=1), rtol=1e-10)


def test_a_crash_between_two_outputs_is_seen():
    # Constant thrust upwards, 2 m/s^2 above the weight: from 8 m/s downwards it turns after 4 s and 16 m.
    steps, nodes = 100, 201
    upwards = np.tile([0.0, WET_MASS * (GRAVITY + 2.0)], (nodes, 1))
    control = flight.Schedule(0.1, steps, np.zeros((nodes, 2, 4)), np.zeros((nodes, 4)), upwards)
    starts = np.array([[0.0, altitude, 0.0, -8.0, WET_MASS] for altitude in (10.0, 15.9, 16.1, 30.0)])
    trajectories = flight.fly(
        [control], flight.Plant(GRAVITY, 0.0, 0.0), starts, flight.Draws(0), steps_per_output=[steps]
    )
    np.testing.assert_allclose(trajectories.history[:, 1], [starts[:, 1], starts[:, 1] + 20.0], atol=1e-9)
    assert trajectories.outcome.tolist() == [CRASHED, CRASHED, COMPLETED, COMPLETED]
    np.testing.assert_allclose(trajectories.observed_maximum[DEPTH], 16.0 - starts[:, 1], atol=1e-9)


def absurd(gains):
    """Gains under which every trial overflows."""
    return replace(gains, gain=1e200 * gains.gain)


def test_non_finite_trials_are_counted_and_kept_apart(pipeline):
    gains, inputs = pipeline.gains(), pipeline.stage_inputs("corrected", "montecarlo_chunk")
    nominal = pipeline.nominal()
    good, bad = (
        inputs.call(montecarlo.simulate, nominal=nominal, gains=law, flown=Flown("closed_loop", 400, 200, chunk, 2))
        for chunk, law in enumerate((gains, absurd(gains)))
    )
    both = pipeline.stage_inputs("corrected", "montecarlo_gather").call(montecarlo.gather, [good, bad])
    assert (both.count, both.excluded) == (200, 200)
    assert both.outcome.tolist() == [COMPLETED] * 200 + [NON_FINITE] * 200
    alone = pipeline.fly("corrected", gains, trials=200, block_size=200)
    for name in ("mean", "covariance", "observed_mean", "histogram", "maximum_over_trials"):
        np.testing.assert_array_equal(getattr(both, name), getattr(alone, name), err_msg=name)
    assert not np.isfinite(both.final_state[200:]).all(axis=1).any()
    trial = inputs.call(montecarlo.replay, nominal=nominal, gains=absurd(gains), trial=Trial("closed_loop", 3))
    assert "trial 3 of closed_loop: not finite" in trial


def test_a_case_with_only_non_finite_trials_can_still_be_stored(pipeline, tmp_path):
    gains, inputs = absurd(pipeline.gains()), pipeline.stage_inputs("corrected", "montecarlo_chunk")
    records = {"nominal": pipeline.nominal(), "gains": gains}
    chunk = inputs.call(montecarlo.simulate, **records, flown=Flown("closed_loop", 100, 100))
    gather = pipeline.stage_inputs("corrected", "montecarlo_gather")
    for records in (chunk, gather.call(montecarlo.gather, [chunk])):
        artifacts.save(tmp_path / "case.h5", records, paper="powered_descent", reading="corrected", provenance={})
        loaded = artifacts.load(tmp_path / "case.h5", type(records), paper="powered_descent", reading="corrected")
        assert_identical(records, loaded)


# --- integrators ------------------------------------------------------------------------------------------------------


def test_trajectories_have_the_fields_that_the_tests_compare():
    assert {field.name for field in fields(Trajectories)} == {
        *("history", "observed", "observed_maximum", "final_state", "outcome", "length")
    }


@pytest.fixture(scope="module")
def errors(pipeline):
    return pipeline.integrator_error(convergence_trials=2000)


def by_step(errors, name, scheme, step):
    k = np.flatnonzero(np.isclose(errors.step, step))
    return getattr(errors, name)[list(errors.scheme).index(scheme), k[0]]


def test_euler_maruyama_has_a_mean_bias_that_halves_with_the_step(errors):
    reference = {  # downrange, altitude, their rates, mass
        0.02: (-0.014, -0.057, 0.044, 0.020, -0.062),
        0.1: (-0.060, -0.284, 0.221, 0.104, -0.316),
        0.2: (-0.099, -0.571, 0.446, 0.217, -0.649),
        0.5: (-0.074, -1.46, 1.15, 0.602, -1.75),
    }
    for step, bias in reference.items():
        means = by_step(errors, "bias", "euler_maruyama", step)
        # Two samples of 2,000 trials, and half a digit of the known values.
        error = by_step(errors, "bias_standard_error", "euler_maruyama", step)
        digit = 5e-3 if step == 0.5 else 5e-4
        assert (np.abs(means - bias) < 4 * np.sqrt(2) * error + digit).all()
    small, large = (by_step(errors, "bias", "euler_maruyama", step)[1:] for step in (0.1, 0.2))
    np.testing.assert_allclose(large / small, 2.0, rtol=0.1)  # first order, with a second-order rest


def test_runge_kutta_has_no_resolved_bias_at_the_production_step(errors):
    for step in (0.05, 0.1, 0.2):
        bias, error = (by_step(errors, name, "rk4", step) for name in ("bias", "bias_standard_error"))
        assert (np.abs(bias) < 4 * error).all()
    assert (np.abs(by_step(errors, "variance_bias", "rk4", 0.1)) < 2e-3).all()


def test_both_schemes_have_strong_order_one(errors):
    reference = {
        ("rk4", 0.1): (0.0118, 0.0075, 0.0030, 0.0050, 0.0038),
        ("rk4", 0.2): (0.0232, 0.0149, 0.0061, 0.0102, 0.0076),
        ("rk4", 0.5): (0.0598, 0.0389, 0.0156, 0.0255, 0.0195),
        ("euler_maruyama", 0.1): (0.066, 0.285, 0.221, 0.106, 0.317),
        ("euler_maruyama", 0.2): (0.113, 0.572, 0.447, 0.219, 0.651),
    }
    for (scheme, step), expected in reference.items():
        # A root mean square over 2,000 trials has a relative error of 1.6 %; four of both samples' are 9 %.
        np.testing.assert_allclose(by_step(errors, "strong_error", scheme, step), expected, rtol=0.09)


def test_the_reference_of_the_study_is_the_finest_run(pipeline, errors):
    assert errors.reference_step == pytest.approx(0.01)
    assert errors.trials == 2000
    np.testing.assert_allclose(errors.step, [0.02, 0.05, 0.1, 0.2, 0.5])


# --- choices of the simulation ----------------------------------------------------------------------------------------


def test_the_mean_of_a_choice_is_that_of_many_trials(pipeline):
    """The estimate from flights compared with linear ones, against plain means of forty times the trials."""
    choices = pipeline.choices()
    for index, changes in (
        ((0, 0, 0), {}),
        ((0, 0, 3), {"integrator": "euler_maruyama", "time_step": 0.05}),
        ((0, 2, 0), {"command_interval": 0.5}),
        ((2, 0, 0), {"mass_profile": "first_pass_without_feedback"}),
    ):
        many = pipeline.ensemble(trials=20_000, **changes)
        error = np.sqrt(np.diag(many.covariance[-1, :4, :4] / many.count + choices.mean_error[index]))
        assert (np.abs(choices.mean[index] - many.mean[-1, :4]) < 4 * error).all(), index
        # and far more precise than the plain mean of as many trials
        plain = np.diag(choices.covariance[index]) / choices.trials
        assert (np.diag(choices.mean_error[index]) < 0.1 * plain).all(), index


def test_a_command_that_is_held_for_one_euler_step_is_the_continuous_one(pipeline):
    choices = pipeline.choices()
    coarsest = np.flatnonzero((choices.step == 0.1) & (choices.scheme != "rk4"))
    assert choices.command_interval[1] == 0.1
    np.testing.assert_array_equal(choices.mean[:, 1, coarsest], choices.mean[:, 0, coarsest])
