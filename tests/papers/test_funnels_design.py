"""The funnels paper up to the funnel: nominal, reference, linear model, regulator, shapes and first level.

Expected numbers are those of an independent study of the paper, by multiple shooting in kilometres; half of the last
digit is meant as their tolerance where no other reason is stated.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import root

from marsedl.papers.funnels import environment, gains, nominal
from marsedl.replication.errors import MarsedlError, SolverError

DEGREE = np.pi / 180.0
RADIUS, MU, SPIN, BALLISTIC, LIFT_TO_DRAG = 3389.5, 4.2828e4, 7.0882e-5, 135.0, 0.24  # km, s
# A start for each of the four optima.
FEW_STARTS = {"start_banks": np.radians([63.0]), "start_final_times": np.array([200.0, 265.0, 280.0])}
ONE_START = {"start_banks": np.radians([63.0]), "start_final_times": np.array([240.0])}


@pytest.fixture(scope="module")
def inputs(funnels):
    """Function that returns inputs, with few starts and some of them changed."""
    return lambda reading="corrected", **changes: funnels.inputs(reading, **(FEW_STARTS | changes))


def air_of(given):
    """The air and its disturbances."""
    return environment.disturbed_air(given.planet, given.uncertainty)


def loop_of(given, model, designed):
    """The closed loop under a regulator."""
    return environment.closed_loop(given.planet, given.vehicle, air_of(given), model, designed.half_gain)


def motion(x, bank, w=(0.0, 0.0)):
    """Eq. 37 in km, s and rad, written down once more with its inertial terms."""
    h, _, phi, v, gamma, psi = x
    r = RADIUS + h
    g = MU / r**2
    density = np.exp((-4.2589552921 + 0.05 * w[0]) + (-0.0967828019 + 0.001 * w[1]) * h)
    drag = 1e3 * density * v**2 / (2 * BALLISTIC)
    lift = LIFT_TO_DRAG * drag
    s, c, sp, cp = np.sin(gamma), np.cos(gamma), np.sin(phi), np.cos(phi)
    centrifugal = SPIN**2 * r * cp
    return np.array(
        [
            v * s,
            v * c * np.cos(psi) / (r * cp),
            v * c * np.sin(psi) / r,
            -drag - g * s + centrifugal * (s * cp - c * sp * np.sin(psi)),
            (lift * np.cos(bank) - (g - v**2 / r) * c) / v
            + 2 * SPIN * cp * np.cos(psi)
            + centrifugal * (c * cp + s * sp * np.sin(psi)) / v,
            -(lift * np.sin(bank) + v**2 / r * c**2 * np.cos(psi) * np.tan(phi)) / (v * c)
            + 2 * SPIN * (np.tan(gamma) * cp * np.sin(psi) - sp)
            - centrifugal * sp * np.cos(psi) / (v * c),
        ]
    )


KM = np.array([1e3, 1.0, 1.0, 1e3, 1.0, 1.0])  # metres and radians in a unit of `motion`
ENTRY = np.array([125.0, 0.0, 0.0, 5.8, -15.5 * DEGREE, 0.0])


@pytest.fixture(scope="module")
def trajectory(funnels):
    return funnels.nominal()


@pytest.fixture(scope="module")
def model(funnels):
    return funnels.linearization()


@pytest.fixture(scope="module")
def regulator(funnels):
    return funnels.gains()


# --- nominal ----------------------------------------------------------------------------------------------------------


def test_nominal_numbers(trajectory):
    final = trajectory.state[-1]
    assert trajectory.status == "Solve_Succeeded"
    assert trajectory.time[-1] == pytest.approx(241.733, abs=5e-4)
    assert trajectory.cost == pytest.approx(0.433e-2, abs=5e-6)
    assert final[1:4] == pytest.approx([0.194719, -0.015320, 510.09], abs=5e-7, rel=1e-5)
    assert final[4] / DEGREE == pytest.approx(-16.074, abs=5e-4)
    assert final[5] == pytest.approx(-0.45635, abs=5e-6)
    bank = [31.06, 31.08, 31.88, 42.79, 54.26, 52.69, 49.60, 47.54, 46.50, 46.13, 46.07]
    # The two transcriptions differ by some 1e-4 degrees.
    assert trajectory.bank[::10] / DEGREE == pytest.approx(bank, abs=5.3e-3)
    altitude = [125.00, 89.38, 57.69, 32.15, 19.70, 17.00, 16.67, 16.26, 15.10, 13.00, 10.00]
    assert trajectory.state[::10, 0] / 1e3 == pytest.approx(altitude, abs=5e-3)
    velocity = [5.800, 5.819, 5.787, 5.136, 3.157, 1.853, 1.268, 0.958, 0.762, 0.621, 0.510]
    assert trajectory.state[::10, 3] / 1e3 == pytest.approx(velocity, abs=5e-4)
    assert np.diff(trajectory.bank) == pytest.approx(trajectory.bank_rate * np.diff(trajectory.time), abs=1e-12)
    assert trajectory.cost == pytest.approx(trajectory.bank_rate**2 @ np.diff(trajectory.time), rel=1e-12)


def test_solution_flies_to_its_end(trajectory):
    """The bank angle in other units, by another integrator and another copy of the equations."""
    state = ENTRY
    for start, end, bank, rate in zip(
        trajectory.time[:-1], trajectory.time[1:], trajectory.bank, trajectory.bank_rate, strict=False
    ):
        solution = solve_ivp(
            lambda t, x, t0=start, bank=bank, rate=rate: motion(x, bank + rate * (t - t0)),
            (start, end),
            state,
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
        )
        state = solution.y[:, -1]
    miss = state * KM - trajectory.state[-1]
    # A millimetre and hundredths of a microradian are the error of the transcription; the flights agree far below.
    assert np.abs(miss / [1e-3, 1e-8, 1e-8, 1e-4, 1e-7, 1e-8]).max() < 1.0


def test_without_heat_limit_the_optimum_is_a_constant_bank_found_by_shooting(inputs):
    """A bank rate of zero costs nothing; bank and time then solve two equations, which it meets to h^4."""

    def miss(unknown):
        motion_to_end = solve_ivp(
            lambda _, x: motion(x, unknown[0]),
            (0.0, 250.0 * unknown[1]),
            ENTRY,
            rtol=1e-11,
            atol=1e-13,
            method="DOP853",
        )
        return motion_to_end.y[0, -1] - 10.0, motion_to_end.y[1, -1] * RADIUS - 660.0

    bank, final_time = root(miss, [0.85, 1.0], tol=1e-12).x * [1.0, 250.0]
    errors = []
    for intervals in (25, 50):
        free = inputs(intervals=intervals, **ONE_START)
        limits = nominal.Limits(660e3, 1e9)
        solution = free.call(nominal.search, limits, intervals, nominal.starts(free.mission, free.guidance))[0]
        assert solution.objective < 1e-15
        errors.append([solution.state("bank")[-1] - bank, solution.final_time - final_time])
    errors = np.array(errors)
    assert np.abs(errors[-1]) == pytest.approx([0.0, 0.0], abs=2e-4)
    assert errors[:-1] / errors[1:] == pytest.approx(16.0, rel=0.06)


@pytest.fixture(scope="module")
def optima(inputs, trajectory):
    given, limits = inputs(), nominal.Limits(trajectory.final_downrange, trajectory.heat_rate_limit)
    starts = nominal.starts(given.mission, given.guidance)
    return nominal.distinct(given.call(nominal.search, limits, 100, starts))


def test_optima_are_made_by_the_nodes_of_the_heat_limit(inputs, trajectory, optima):
    """Every one has the peak of the heat rate half-way between two nodes at the limit, each its own two."""
    cost = np.array([one.objective for one in optima]) * DEGREE**2
    final_time = np.array([one.final_time for one in optima])
    peaks = np.array([inputs().call(nominal.peak_heat_rate, one)[1] for one in optima])
    assert cost * 100 == pytest.approx([0.311, 0.433, 1.093, 3.429], abs=6e-4)
    assert final_time == pytest.approx([233.97, 241.73, 250.05, 259.07], abs=5e-3)
    assert peaks / final_time * 100 == pytest.approx([31.5, 30.5, 29.5, 28.5], abs=2e-3)
    assert trajectory.cost == pytest.approx(cost[1], rel=1e-9), "that of the guess"
    assert trajectory.heat_rate.max() == pytest.approx(6.1e5, rel=2e-7)
    assert list(np.flatnonzero(trajectory.heat_rate > 6.1e5 * (1 - 1e-7))) == [30, 31]
    # A parabola through nodes of equal height rises above them by an eighth of its second difference.
    log = np.log(trajectory.heat_rate[29:33])
    rise = -(log[0] - log[1] - log[2] + log[3]) / 2 / 8
    assert np.log(trajectory.peak_heat_rate / 6.1e5) == pytest.approx(rise, rel=0.02)
    assert trajectory.peak_heat_rate == pytest.approx(61.168e4, abs=5.0)


def test_best_of_starts_is_the_cheapest(inputs, trajectory, optima):
    best = inputs(nominal_choice="best_of_starts", start_final_times=np.array([200.0])).call(nominal.compute)
    assert best.cost == pytest.approx(optima[0].objective * DEGREE**2, rel=1e-9)
    assert best.cost < trajectory.cost


def test_the_guess_is_a_start_and_none_stands_twice(inputs):
    grid = inputs(start_banks=np.radians([35.0, 63.0]), start_final_times=np.array([240.0, 280.0]))
    assert [(round(bank / DEGREE), time) for bank, time in nominal.starts(grid.mission, grid.guidance)] == [
        (63, 240.0),
        (35, 240.0),
        (35, 280.0),
        (63, 280.0),
    ]


def test_starts_that_lead_nowhere_are_left_out_and_the_guess_is_missed(inputs):
    deep = {"start_banks": np.radians([105.0]), "start_final_times": np.array([500.0])}
    inputs(nominal_choice="best_of_starts", intervals=25, **deep).call(nominal.compute)
    with pytest.raises(MarsedlError, match=r"nominal: the guess leads to no solution; .* give another guess_bank"):
        inputs(intervals=25, guess_bank=105.0 * DEGREE, guess_final_time=500.0).call(nominal.compute)
    with pytest.raises(
        SolverError, match=r"none of 4 starts .* Maximum_Iterations_Exceeded after 3 .* heat_rate_limit"
    ) as e:
        inputs(nominal_choice="best_of_starts", intervals=25, nominal_iterations=3).call(nominal.compute)
    assert set(environment.STATES) < set(e.value.iterate)


# --- reference and linear model ---------------------------------------------------------------------------------------


def test_reference_follows_the_nominal(trajectory, model):
    assert len(model.time) == 241 and len(model.half_time) == len(model.state) == 481
    assert model.half_time[::2] == pytest.approx(model.time, abs=1e-12)
    # At times that both grids have.
    assert model.state[::24] / KM == pytest.approx(trajectory.state[::5] / KM, abs=1e-5)
    assert np.abs((model.state[-1] - trajectory.state[-1]) / KM).max() < 1e-6
    assert model.bank == pytest.approx(np.interp(model.half_time, trajectory.time, trajectory.bank), abs=1e-15)
    assert model.heat_rate.max() == pytest.approx(trajectory.peak_heat_rate, rel=2e-4)
    top = model.deceleration.argmax()
    assert model.deceleration[top] / 9.80665 == pytest.approx(9.1, abs=0.05)
    assert model.half_time[top] == pytest.approx(87.0, abs=0.5)
    last = model.half_time > 0.9 * model.time[-1]
    assert model.deceleration[last].max() / 9.80665 == pytest.approx(0.5, abs=0.05)


def test_jacobians_are_those_of_the_equations(model):
    """Complex steps through the other copy of the equations, in its units."""
    step = 1e-30
    for k in (0, 101, 250, 480):
        x, bank = model.state[k] / KM, model.bank[k]
        by_state = [motion(x + 1j * step * row, bank).imag / step for row in np.eye(6)]
        by_bank = motion(x, bank + 1j * step).imag / step
        by_air = [motion(x, bank, 1j * step * row).imag / step for row in np.eye(2)]
        for matrix, expected in (
            (model.state_matrix[k] / KM[:, None] * KM, np.transpose(by_state)),
            (model.control_matrix[k] / KM, by_bank),
            (model.disturbance_matrix[k] / KM[:, None], np.transpose(by_air)),
        ):
            assert matrix == pytest.approx(expected, rel=1e-10, abs=1e-15)


# --- regulator, shapes and first level --------------------------------------------------------------------------------


def test_regulator_numbers(regulator):
    diagonal = np.diag(regulator.shape[0]) * KM**2
    expected = [9.0578, 9.1352e6, 1.35258e7, 3614.0, 2.08648e6, 3.6105e5]
    assert diagonal == pytest.approx(expected, rel=1e-5)
    assert regulator.initial_level == pytest.approx(0.179254, abs=5e-7)


def test_regulator_is_the_same_in_other_units(model, regulator):
    """The Riccati recursion once more, in km, with the gain that its formula gives."""
    scale = np.array([1.0, 2.0 / RADIUS, 2.0 / RADIUS, 0.03, 0.6 * DEGREE, 0.6 * DEGREE])
    weight, step = np.diag(1.0 / scale**2), model.time[1]
    r = step / 60 / (3.0 * DEGREE) ** 2
    value, feedback_gains = weight, []
    for k in reversed(range(240)):
        a = model.state_matrix[2 * k + 1] / KM[:, None] * KM
        b = model.control_matrix[2 * k + 1] / KM
        exponential = expm(np.block([[a, b[:, None]], [np.zeros((1, 7))]]) * step)
        ad, bd = exponential[:6, :6], exponential[:6, 6]
        gain = -(bd @ value @ ad) / (r + bd @ value @ bd)
        closed = ad + np.outer(bd, gain)
        value = weight * step / 60 + r * np.outer(gain, gain) + closed.T @ value @ closed
        feedback_gains.append(gain / KM)
    gain = regulator.half_gain[:-2:2]  # of every step, at its beginning
    size = np.abs(gain).max(axis=0)
    assert gain[::-1] / size == pytest.approx(np.array(feedback_gains) / size, abs=1e-9)
    assert regulator.shape[0] * np.outer(KM, KM) == pytest.approx(value, rel=1e-8)
    assert regulator.half_gain[101] == pytest.approx((gain[50] + gain[51]) / 2)


def test_first_slice_holds_the_initial_set_and_touches_it(inputs, regulator):
    semi_axes = inputs().call(environment.initial_semi_axes)
    assert semi_axes == pytest.approx([150.0, 250.0 / 3389.5e3, 250.0 / 3389.5e3, 1.5, *[0.015 * DEGREE] * 2])
    m = environment.initial_set(inputs().call(environment.initial_semi_axes)) * np.outer(semi_axes, semi_axes)
    assert m == pytest.approx(2.0 * np.eye(6))  # so that 1/2 x'M x = 1 at the end of a semi-axis
    p = regulator.shape[0] * np.outer(semi_axes, semi_axes)
    assert np.linalg.eigvalsh(m - p / regulator.initial_level)[0] == pytest.approx(0.0, abs=1e-12)
    points = np.random.Generator(np.random.Philox(7)).standard_normal((2000, 6))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    assert (np.einsum("ki,ij,kj->k", points, p, points) / 2).max() <= regulator.initial_level


def test_shapes_of_least_trace_start_at_the_initial_set(inputs, model, regulator):
    """Every other disturbance of the linear model stays inside at rho = 1, also one that turns at every step."""
    other = inputs("minkowski_shape").call(gains.compute, model)
    first = environment.initial_set(inputs().call(environment.initial_semi_axes))
    scale = inputs().call(environment.state_scale)
    assert other.initial_level == pytest.approx(1.0, rel=1e-12)
    assert other.shape[0] * np.outer(scale, scale) == pytest.approx(first * np.outer(scale, scale), rel=1e-9, abs=1e-9)
    assert np.array_equal(other.half_gain, regulator.half_gain)
    loop = loop_of(inputs(), model, other)
    random = np.random.Generator(np.random.Philox(8))
    states = inputs().call(environment.initial_semi_axes)[:, None] * random.standard_normal((6, 500))
    states /= np.sqrt(np.einsum("ik,ij,jk->k", states, first, states) / 2)
    largest = 0.0
    for k in range(100):
        transition, response, _ = loop.flow_jacobians(k, k + 1)
        turn = random.uniform(0.0, 2 * np.pi, 500)
        states = transition @ states + response @ [np.cos(turn), np.sin(turn)]
        largest = max(largest, (np.einsum("ik,ij,jk->k", states, other.shape[k + 1], states) / 2).max())
    assert 0.5 < largest <= 1.0 + 1e-9


def test_closed_loop_is_the_one_designed(inputs, model, regulator):
    """A small deviation moves as the other copy of the equations says, under the feedback."""
    loop = loop_of(inputs(), model, regulator)
    deviation, w, k = np.array([300.0, 1e-4, -2e-4, 10.0, 2e-3, -1e-3]), (0.3, -0.7), 130
    bank = model.bank[2 * k] + regulator.half_gain[2 * k] @ deviation
    expected = motion((model.state[2 * k] + deviation) / KM, bank, w) - motion(
        model.state[2 * k] / KM, model.bank[2 * k]
    )
    assert np.array(loop.error_rates(2 * k, deviation, w)) / KM == pytest.approx(expected, rel=1e-9)
    assert inputs("additive").call(environment.additive_amplitudes) == pytest.approx(
        [1.0, 2.0 / 3389.5e3, 2.0 / 3389.5e3, 5e-3, 5e-6, 5e-6]
    )
    steps = environment.slices(loop_of(inputs(), model, regulator), 4)
    assert list(steps[[0, 1, -1]]) == [0, 4, 240] and len(steps) == 61
