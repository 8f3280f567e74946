"""Funnels of the Dubins car: its path, its levels against flights and other programs, and what is proven."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from generators import generator
from marsedl.methods.funnels.monte_carlo import fly
from marsedl.methods.funnels.stage import spread_of
from marsedl.methods.sos.variety import Spheres
from marsedl.papers.funnels import dubins
from marsedl.papers.funnels.beyond import dubins_study
from marsedl.replication.errors import SolverError

FLOW, EULER, WIND = range(3)
SPEED, STRONGEST = 1.0, 0.03  # m/s, of the car and of the wind
# A fifth of the path, in stages of the same length and as many fine steps each.
SHORT = {"dubins_duration": 0.8, "dubins_fine_steps": 80}


@pytest.fixture(scope="module")
def car(funnels):
    return funnels.dubins()


@pytest.fixture(scope="module")
def short(funnels):
    return funnels.inputs("corrected", **SHORT).call(dubins.compute)


@pytest.fixture(scope="module")
def study(funnels, short):
    return funnels.inputs("corrected", **SHORT).call(dubins_study.compute, short)


# ---- the path and the loop -------------------------------------------------------------------------------------------


def test_levels_do_not_depend_on_where_the_path_begins(funnels, short):
    """Moved and turned, the path is the same, and so are weights that are equal in x and y: rho stays."""
    moved = funnels.inputs("corrected", **SHORT, dubins_start=np.array([2.0, -1.0, 0.7])).call(dubins.compute)
    cos, sin = np.cos(0.7), np.sin(0.7)
    expected = short.state[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + [2.0, -1.0]
    np.testing.assert_allclose(moved.state[:, :2], expected, atol=1e-12)
    np.testing.assert_allclose(moved.level, short.level, rtol=1e-5)


def test_path_is_the_integral_of_one_sine(car):
    def heading(time):
        return 0.8 * 4.0 / (2 * np.pi) * (1 - np.cos(2 * np.pi * time / 4.0))

    assert car.turn_rate == pytest.approx(0.8 * np.sin(2 * np.pi * car.half_time / 4.0), abs=1e-14)
    assert car.state[:, 2] == pytest.approx(heading(car.half_time), abs=1e-10)
    for node in (200, 555, 800):
        for component, function in enumerate((np.cos, np.sin)):
            reached = quad(lambda time, f=function: f(heading(time)), 0.0, car.half_time[node], epsabs=1e-13)[0]
            assert car.state[node, component] == pytest.approx(reached, abs=1e-10)
    assert car.state[-1] == pytest.approx([3.26954, 1.82581, 0.0], abs=2e-5)  # with straight lines between half steps


def test_regulator_is_that_of_the_continuous_path(car):
    weight, terminal = np.eye(3), 2.0 * np.eye(3)

    def riccati(time, packed):
        heading = 1.6 / np.pi * (1 - np.cos(np.pi * time / 2))
        state = np.zeros((3, 3))
        state[0, 2], state[1, 2] = -np.sin(heading), np.cos(heading)
        value, push = packed.reshape(3, 3), np.array([0.0, 0.0, 1.0])
        rate = state.T @ value + value @ state + weight - np.outer(value @ push, value @ push)
        return -rate.ravel()

    solution = solve_ivp(riccati, (4.0, 0.0), terminal.ravel(), t_eval=[2.0, 0.0], rtol=1e-10, atol=1e-12)
    middle, first = solution.y.T.reshape(2, 3, 3)
    # Controls held over a step of a hundredth of a second, and a cost summed at its start: half a step off.
    assert car.shape[200] == pytest.approx(middle, rel=0.01, abs=0.01)
    assert car.shape[0] == pytest.approx(first, rel=0.01, abs=0.01)
    assert np.abs(car.shape[0] - first).max() > 1e-4
    assert np.diag(car.shape[0]) == pytest.approx([4.06735, 2.81609, 1.91208], abs=5e-5)
    assert car.half_gain[400] == pytest.approx(-middle[2], rel=0.02)


def test_wind_blows_and_leaves_the_rest_alone(car):
    still, windy = dubins.closed_loop(car, SPEED), dubins.closed_loop(car, SPEED, STRONGEST)
    assert (still.disturbances, windy.disturbances) == (0, 2)
    deviation = [0.1, -0.2, 0.05]
    calm, blown = (np.array(windy.error_rates(77, deviation, wind)) for wind in ([0.0, 0.0], [0.6, -0.8]))
    assert np.array_equal(calm, still.error_rates(77, deviation, []))
    assert blown - calm == pytest.approx([0.018, -0.024, 0.0], abs=1e-15)


# ---- levels ----------------------------------------------------------------------------------------------------------


def test_levels_at_the_quarters_of_the_path(car):
    assert list(car.funnel) == ["flow", "euler", "wind"]
    expected = [
        [0.15, 0.12126, 0.09450, 0.07003, 0.04668],
        [0.15, 0.12060, 0.09509, 0.07023, 0.04690],
        [0.15, 0.15368, 0.14927, 0.13601, 0.10962],
    ]
    assert car.level[:, ::10] == pytest.approx(np.array(expected), abs=6e-6)
    assert (np.diff(car.level[FLOW]) < 0).all()  # without wind nothing pushes outwards
    assert np.diff(car.level[WIND])[0] > 0
    assert car.level[:, 1:] == pytest.approx(car.level[:, :-1] * car.bound, rel=1e-14)


def test_programs_are_sound_and_have_the_samples_that_they_need(car):
    assert car.sound.all() and (car.status == "optimal").all()
    assert list(car.samples) == list(car.rank) == [25, 25, 85]


def test_a_stage_bounds_the_car_itself_and_hardly_more(car):
    """The car, not its deviation, from points all over the slice: an oracle without error rates, series or programs."""
    number = 25
    first, last = car.slice_step[number : number + 2]
    directions = Spheres((3,)).random_points(20_000, generator(3))
    start = (directions @ spread_of(car.shape[first], car.level[FLOW, number]).T) + car.state[2 * first]

    def rates(time, packed):
        state = packed.reshape(3, -1)
        # Between half steps the path is a cubic to 1e-9; the gains are linear there.
        path = np.array([np.interp(time, fine, row) for row in dense.T])
        gain = np.array([np.interp(time, car.half_time, row) for row in car.half_gain.T])
        turn = 0.8 * np.sin(np.pi * time / 2) + gain @ (state - path[:, None])
        return np.array([np.cos(state[2]), np.sin(state[2]), turn]).ravel()

    fine = np.linspace(car.time[first], car.time[last], 2001)
    heading = 1.6 / np.pi * (1 - np.cos(np.pi * fine / 2))
    dense = np.array([*(_integral(f(heading), fine) for f in (np.cos, np.sin)), heading]).T
    dense[:, :2] += car.state[2 * first, :2]
    span = (car.time[first], car.time[last])
    final_states = solve_ivp(rates, span, start.T.ravel(), rtol=1e-9, atol=1e-11, max_step=0.02).y[:, -1].reshape(3, -1)
    away = final_states - car.state[2 * last][:, None]
    reached = 0.5 * np.einsum("im,ij,jm->m", away, car.shape[last], away).max() / car.level[FLOW, number]
    assert reached <= car.bound[FLOW, number] * (1 + 1e-7)
    assert reached == pytest.approx(car.bound[FLOW, number], rel=5e-4)  # as dense as the points are


def _integral(values, times):
    """Trapezoids with a correction for the slopes at their ends: fourth order."""
    spacing, slope = times[1] - times[0], np.gradient(values, times, edge_order=2)
    pieces = spacing * (values[1:] + values[:-1]) / 2 - spacing**2 / 12 * (slope[1:] - slope[:-1])
    return np.concatenate([[0.0], np.cumsum(pieces)])


@pytest.mark.parametrize(("number", "wind"), [(FLOW, False), (WIND, True)])
def test_flights_stay_inside_and_come_near(car, number, wind):
    loop, draw = dubins.closed_loop(car, SPEED, STRONGEST if wind else None), generator(3)
    start = Spheres((3,)).random_points(1000, draw) @ spread_of(car.shape[0], car.level[number, 0]).T
    values = fly(loop, car.shape, start, Spheres((2,)).random_points(1000, draw) if wind else np.zeros((1000, 0)))
    largest = values.max(axis=1)
    level = np.interp(np.arange(401), car.slice_step, car.level[number])
    assert (largest <= level * (1 + 1e-9)).all()
    assert 0.75 < largest[-1] / level[-1] < 0.9


def test_a_funnel_that_does_not_exist_says_so(funnels):
    with pytest.raises(SolverError, match=r"dubins, funnel 'flow': .*slice 2 of 9.*lower dubins_level"):
        funnels.inputs("corrected", **SHORT, dubins_level=1e9).call(dubins.compute)


# ---- the study -------------------------------------------------------------------------------------------------------


def test_linear_levels_are_lower_and_so_no_bound(short, study):
    assert study.linear_level[FLOW, 0] == short.level[FLOW, 0]
    # Without wind the flow is cubic at least beyond its first order, and raises V.
    for number in (FLOW, WIND):
        assert (study.linear_level[number, 1:] < short.level[number, 1:]).all()
        assert study.linear_level[number] == pytest.approx(short.level[number], rel=0.02)
    loop = dubins.closed_loop(short, SPEED)
    small = Spheres((3,)).random_points(20_000, generator(3)) @ spread_of(short.shape[0], 1e-10).T
    grown = fly(loop, short.shape, small, np.zeros((len(small), 0)))[short.slice_step[1]].max() / 1e-10
    assert study.linear_level[FLOW, 1] / study.linear_level[FLOW, 0] == pytest.approx(grown, rel=5e-4)


def test_proven_levels_hold_the_whole_slice_and_cost_little(short, study):
    assert list(study.proven_funnel) == ["flow", "wind"]
    for row, (number, wind) in enumerate([(FLOW, False), (WIND, True)]):
        level = study.proven_level[row]
        assert (level[1:] > short.level[number, 1:]).all()
        assert level == pytest.approx(short.level[number], rel=0.02)
        loop, draw = dubins.closed_loop(short, SPEED, STRONGEST if wind else None), generator(row)
        start = Spheres((3,)).random_points(2000, draw) @ spread_of(short.shape[0], level[0]).T
        start *= draw.random((2000, 1)) ** (1 / 3)  # from the inside too
        pushed = Spheres((2,)).random_points(2000, draw) * draw.random((2000, 1)) if wind else np.zeros((2000, 0))
        reached = fly(loop, short.shape, start, pushed)[short.slice_step].max(axis=1)
        assert (reached <= level).all()
