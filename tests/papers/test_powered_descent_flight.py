"""The simulated flight: the compiled kernel against a plain oracle and against what is known exactly."""

from functools import partial

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from marsedl.montecarlo.outcomes import COMPLETED, CRASHED
from marsedl.montecarlo.statistics import wishart_deviance
from marsedl.montecarlo.streams import normals
from marsedl.papers.powered_descent import flight, montecarlo, segments
from marsedl.papers.powered_descent.records import DEPTH, THRUST

GRAVITY, MASS_FLOW, NOISE_DENSITY, WET_MASS = 3.71, 1 / (210 * 9.81), 360.0, 1500.0
DURATIONS = (26.0, 15.0)


def simulator(pipeline, case="closed_loop", reading="corrected", **changes):
    inputs = pipeline.stage_inputs(reading, "montecarlo", **changes)
    records = {"nominal": pipeline.nominal(reading), "gains": pipeline.gains(reading)}
    return inputs.call(montecarlo.block_simulator, **records, case=case)


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
        ("rk4", "prior_mass", 12, 7),  # divides neither segment
        ("euler_maruyama", "open_loop", 5, None),
        ("semi_implicit_euler", "closed_loop", 6, 5),
    ],
)
def test_kernel_flies_the_equations(pipeline, scheme, case, trial, hold):
    step, gains = 0.1, pipeline.gains()
    seed = pipeline.stage_inputs("corrected", "montecarlo").seed
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
    inputs, gains = pipeline.stage_inputs("corrected", "montecarlo"), pipeline.gains()
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


# --- nothing depends on how it is run ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("time_step", "output_interval"), [(0.3, 0.7), (1.0, 0.5), (0.07, 3.0)])
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


# --- integrators ------------------------------------------------------------------------------------------------------


def test_at_the_production_step_runge_kutta_has_no_bias_and_euler_maruyama_a_known_one(pipeline):
    """Flights on shared Brownian paths, against steps of 0.01 s."""
    inputs, gains, trials = pipeline.stage_inputs("corrected", "montecarlo"), pipeline.gains(), 1000
    times = segments.grids(inputs.segment_durations, inputs.design_interval)
    start = flight.Start(segments.initial_mean(inputs.entry), inputs.initial_covariance, WET_MASS)
    states = flight.initial_states(start, inputs.seed, np.arange(trials))

    def ends(scheme, refinement):
        schedules = flight.schedules_of(times, gains, [2600 // refinement, 1500 // refinement])
        draws, every = flight.Draws(inputs.seed, increments=refinement), [schedule.steps for schedule in schedules]
        plant = flight.Plant(GRAVITY, MASS_FLOW, NOISE_DENSITY)
        return flight.fly(schedules, plant, states, draws, steps_per_output=every, integrator=scheme).final_state.T

    reference = ends("rk4", 1)
    for scheme, bias, spread in (
        ("rk4", np.zeros(5), (0.0118, 0.0075, 0.0030, 0.0050, 0.0038)),
        ("euler_maruyama", (-0.060, -0.284, 0.221, 0.104, -0.316), (0.066, 0.285, 0.221, 0.106, 0.317)),
    ):
        difference = ends(scheme, 10) - reference
        error = difference.std(axis=0) / np.sqrt(trials)
        # The known values are of 2,000 trials and have half a digit.
        assert (np.abs(difference.mean(axis=0) - bias) < 4 * 1.3 * error + 5e-4).all(), scheme
        np.testing.assert_allclose(np.sqrt((difference**2).mean(axis=0)), spread, rtol=0.11)
