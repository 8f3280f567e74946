"""Trajectory optimisation by direct collocation, on problems whose answers are known."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.methods import collocation
from marsedl.methods.collocation import (
    SCHEMES,
    BranchEndError,
    Condition,
    Guess,
    NotConvergedError,
    Problem,
    Program,
    Variable,
    resimulate,
    simulate,
)
from marsedl.methods.linearization import linearize

ORDERS = {"midpoint": 2, "trapezoid": 2, "hermite_simpson": 4}


def flat(problem, intervals, final_time, state=0.1, control=0.1, free=()):
    """A guess that knows nothing."""
    shape = (intervals + 1, len(problem.states)), (intervals, len(problem.controls))
    return Guess(np.full(shape[0], state), np.full(shape[1], control), final_time, dict(free))


def double_integrator(duration=2.0, bound=inf, **changes):
    """From rest at 0 to rest at 1 with the least integral of the squared acceleration."""
    problem = Problem(
        rates=lambda position, velocity, acceleration: (velocity, acceleration),
        states=(Variable("position", 3.0), Variable("velocity", 0.5)),
        controls=(Variable("acceleration", 2.0, -bound, bound),),
        final_time=Variable("final_time", 4.0, duration, duration),
        initial={"position": 0.0, "velocity": 0.0},
        final={"position": 1.0, "velocity": 0.0},
        running_cost=lambda position, velocity, acceleration: acceleration**2,
    )
    return replace(problem, **changes)


def pendulum(duration=6.0, **changes):
    """Swing a damped pendulum from hanging at rest to standing at rest, with the least squared torque."""
    problem = Problem(
        rates=lambda angle, rate, torque: (rate, torque - np.sin(angle) - 0.1 * rate),
        states=(Variable("angle", 2.0), Variable("rate", 0.7)),
        controls=(Variable("torque", 0.3),),
        final_time=Variable("final_time", 4.0, duration, duration),
        initial={"angle": 0.0, "rate": 0.0},
        final={"angle": np.pi, "rate": 0.0},
        running_cost=lambda angle, rate, torque: torque**2,
    )
    return replace(problem, **changes)


def swing_guess(intervals, duration=6.0):
    """Straight up."""
    along = np.linspace(0.0, 1.0, intervals + 1)
    states = np.column_stack([np.pi * along, np.full(intervals + 1, 0.5)])
    return Guess(states, np.full((intervals, 1), 0.3), duration)


def bryson_denham(limit, **changes):
    """Turn a velocity of 1 into -1 in unit time without passing the limit: 4 / (9 limit), below a limit of 1/6."""
    problem = Problem(
        rates=lambda position, velocity, acceleration: (velocity, acceleration),
        states=(Variable("position", 0.2), Variable("velocity")),
        controls=(Variable("acceleration", 5.0),),
        final_time=Variable("final_time", 1.0, 1.0, 1.0),
        initial={"position": 0.0, "velocity": 1.0},
        final={"position": 0.0, "velocity": -1.0},
        running_cost=lambda position, velocity, acceleration: acceleration**2 / 2,
        path=(Condition("wall", lambda position, velocity, acceleration: position, -inf, limit, 0.1),),
    )
    return replace(problem, **changes)


# ---- transcriptions --------------------------------------------------------------------------------------------------


def forced():
    """A damped pendulum on a known torque of its clock: nothing is free, so that only the equations are solved."""
    return Problem(
        rates=lambda angle, rate, clock: (rate, np.cos(2 * clock) - np.sin(angle) - 0.2 * rate**2, 1.0),
        states=(Variable("angle", 2.0), Variable("rate", 0.5), Variable("clock")),
        controls=(),
        final_time=Variable("final_time", 2.0, 3.0, 3.0),
        initial={"angle": 0.5, "rate": 0.1, "clock": 0.0},
        running_cost=lambda angle, rate, clock: angle * rate**2 + np.sin(clock),
    )


@pytest.fixture(scope="module")
def forced_motion():
    """Its states as a function of time, and the integral of its cost, by another integrator and other code."""

    def rates(t, y):
        return y[1], np.cos(2 * t) - np.sin(y[0]) - 0.2 * y[1] ** 2, y[0] * y[1] ** 2 + np.sin(t)

    return solve_ivp(rates, (0.0, 3.0), [0.5, 0.1, 0.0], method="LSODA", rtol=1e-13, atol=1e-14, dense_output=True).sol


def graded(intervals):
    """A mesh whose intervals differ by a factor of four."""
    along = np.linspace(0.0, 1.0, intervals + 1)
    return along + 0.6 * np.sin(2 * np.pi * along) / (2 * np.pi)


@pytest.mark.parametrize("mesh", [int, graded], ids=["equal", "graded"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_error_of_the_states_falls_with_the_order_of_the_scheme(scheme, mesh, forced_motion):
    problem, errors, integrals = forced(), [], []
    for intervals in (20, 40, 80):
        solution = Program(problem, mesh(intervals), scheme).solve(flat(problem, intervals, 3.0), tolerance=1e-12)
        reference = forced_motion(solution.time)
        np.testing.assert_allclose(solution.states[:, 2], solution.time, rtol=0, atol=1e-13)  # the clock
        errors.append(np.abs(solution.states[:, :2] - reference[:2].T).max())
        integrals.append(abs(solution.running_cost - reference[2, -1]))
    assert solution.objective == solution.running_cost
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, ORDERS[scheme], rtol=0, atol=0.075 * ORDERS[scheme])
    order = np.log2(integrals[1] / integrals[2])
    np.testing.assert_allclose(order, ORDERS[scheme], rtol=0, atol=0.075 * ORDERS[scheme])


@pytest.mark.parametrize("scheme", SCHEMES)
def test_miss_of_an_optimum_that_is_flown_falls_with_the_order_of_the_scheme(scheme):
    problem, solution, misses = pendulum(), swing_guess(20), []
    for intervals in (20, 40, 80):
        start = solution if intervals == 20 else solution.guess(intervals)
        solution = Program(problem, intervals, scheme).solve(start)
        misses.append(np.abs(resimulate(solution)[-1] - solution.states[-1]).max())
    orders = np.log2(np.divide(misses[:-1], misses[1:]))
    np.testing.assert_allclose(orders, ORDERS[scheme], rtol=0, atol=0.075 * ORDERS[scheme])


def test_flown_states_agree_with_another_integrator():
    problem = pendulum(
        rates=lambda angle, rate, torque, damping, gravity: (rate, torque - gravity * np.sin(angle) - damping * rate),
        running_cost=lambda angle, rate, torque, damping, gravity: torque**2,
        free=(Variable("damping", 0.3, 0.1, 0.2),),
        given=("gravity",),
    )
    program = Program(problem, graded(15))
    solution = program.solve(swing_guess(15)._replace(free={"damping": 0.15}), {"gravity": 1.1})
    states, substeps = [solution.states[0]], 400

    def rates(y, torque):
        damping, gravity = solution.free["damping"], 1.1
        return np.array([y[1], torque - gravity * np.sin(y[0]) - damping * y[1]])

    for control, length in zip(solution.controls[:, 0], np.diff(solution.time), strict=True):
        y, h = states[-1], length / substeps
        for _ in range(substeps):
            k1 = rates(y, control)
            k2 = rates(y + h / 2 * k1, control)
            k3 = rates(y + h / 2 * k2, control)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(y + h * k3, control))
        states.append(y)
    tight = resimulate(solution, relative_tolerance=1e-13, absolute_tolerance=1e-13)
    np.testing.assert_allclose(tight, states, rtol=0, atol=1e-10)
    np.testing.assert_allclose(resimulate(solution), tight, rtol=0, atol=3e-8)


def test_equations_are_those_of_the_schemes():
    # One interval with an unknown end: the equation itself, solved by hand for x' = -x^2 with h = 1/2 from x = 1.
    problem = Problem(
        rates=lambda x: (-(x**2),),
        states=(Variable("x", 3.0),),
        controls=(),
        final_time=Variable("final_time", 1.0, 0.5, 0.5),
        initial={"x": 1.0},
    )
    guess, h = flat(problem, 1, 0.5, 0.7), 0.5
    ends = {s: Program(problem, 1, s).solve(guess, tolerance=1e-13).states[1, 0] for s in SCHEMES}
    # x1 = 1 - h (1 + x1)^2 / 4 and x1 = 1 - h (1 + x1^2) / 2 are quadratic; the third is of degree four.
    assert ends["midpoint"] == pytest.approx((-(1 + h / 2) + np.sqrt((1 + h / 2) ** 2 + h * (1 - h / 4))) / (h / 2))
    assert ends["trapezoid"] == pytest.approx((-1 + np.sqrt(1 + 2 * h * (1 - h / 2))) / h)
    x1 = ends["hermite_simpson"]
    middle = (1 + x1) / 2 + h * (-1 + x1**2) / 8
    assert x1 - 1 == pytest.approx(-h * (1 + 4 * middle**2 + x1**2) / 6, abs=1e-12)


# ---- optima ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", SCHEMES)
def test_double_integrator_with_least_energy(scheme):
    # All three are exact for it. Of controls held on N intervals the least cost is 12 / T^3 / (1 - 1/N^2).
    problem, intervals = double_integrator(), 10
    solution = Program(problem, intervals, scheme).solve(flat(problem, intervals, 2.0))
    share = 1 - 1 / intervals**2
    assert solution.objective == pytest.approx(12 / 2.0**3 / share, rel=1e-9)
    middle = (solution.time[1:] + solution.time[:-1]) / 2
    np.testing.assert_allclose(solution.controls[:, 0], 6 / 4 * (1 - middle) / share, atol=1e-8)
    np.testing.assert_allclose(resimulate(solution), solution.states, rtol=0, atol=1e-9)
    # From (x, v) at the end of an interval with t left the least cost is 12 d^2/t^3 + 12 d v/t^2 + 4 v^2/t, d = x - 1:
    # along the optimum its slope in x stays -24 / T^3, that in v is -12 / T^2 at first and vanishes half way.
    np.testing.assert_allclose(solution.costates[:, 0], -24 / 2.0**3 / share, rtol=1e-8)
    np.testing.assert_allclose(solution.costates[:, 1], -12 / 2.0**2 * (1 - middle) / share, atol=1e-7)


def test_least_time_by_bang_bang():
    problem = double_integrator(
        bound=1.0,
        running_cost=lambda position, velocity, acceleration: 1.0,
        final_time=Variable("final_time", 4.0, 0.1, 10.0),
    )
    solution = Program(problem, 20).solve(flat(problem, 20, 1.0))
    assert solution.final_time == pytest.approx(2.0, abs=1e-7)
    assert solution.objective == pytest.approx(solution.final_time, abs=1e-12)
    np.testing.assert_allclose(solution.controls[:, 0], np.repeat([1.0, -1.0], 10), atol=1e-6)
    # The least time is 2 sqrt(distance): its slope in position is -1. That in velocity vanishes at the switch, which
    # an even number of intervals leaves undetermined by half an interval.
    middle = (solution.time[1:] + solution.time[:-1]) / 2
    np.testing.assert_allclose(solution.costates[:, 0], -1.0, atol=1e-6)
    late = solution.costates[:, 1] - (middle - 1)
    np.testing.assert_allclose(late, late[0], atol=1e-6)
    assert abs(late[0]) < 0.05
    # An odd one must coast on its middle interval: 10 and 10 of 21, h^2 (10^2 + 10) = 1.
    coasting = Program(problem, 21).solve(flat(problem, 21, 1.0))
    final_time = 21 / np.sqrt(110)
    assert coasting.final_time == pytest.approx(final_time, abs=1e-7)
    np.testing.assert_allclose(coasting.controls[:, 0], [1.0] * 10 + [0.0] + [-1.0] * 10, atol=1e-6)
    middle = (coasting.time[1:] + coasting.time[:-1]) / 2
    expected = final_time / 2 * np.column_stack([-np.ones(21), middle - final_time / 2])
    np.testing.assert_allclose(coasting.costates, expected, atol=1e-5)


def test_brachistochrone_approaches_the_cycloid():
    # A wheel of unit radius rolls half a turn: from rest to (pi, 2) in time pi. Straight pieces take longer, by O(h^2).
    problem = Problem(
        rates=lambda x, drop, speed, angle: (speed * np.sin(angle), speed * np.cos(angle), np.cos(angle)),
        states=(Variable("x"), Variable("drop"), Variable("speed")),
        controls=(Variable("angle", 1.0, -0.5, 2.5),),
        final_time=Variable("final_time", 3.0, 0.5, 10.0),
        initial={"x": 0.0, "drop": 0.0, "speed": 0.0},
        final={"x": np.pi, "drop": 2.0},
        running_cost=lambda *arguments: 1.0,
    )
    excess = []
    for intervals in (20, 40):
        along = np.linspace(0.0, 1.0, intervals + 1)
        states = np.outer(along, [np.pi, 2.0, 2.0])
        solution = Program(problem, intervals).solve(Guess(states, np.full((intervals, 1), 0.8), 3.0))
        excess.append(solution.final_time - np.pi)
        np.testing.assert_allclose(solution.state("speed") ** 2, 2 * solution.state("drop"), atol=1e-8)  # energy
    assert 0 < excess[1] < 3e-4
    assert np.log2(excess[0] / excess[1]) == pytest.approx(2, abs=0.05)


def test_path_condition_is_active_where_it_should_be():
    # On the wall from 3 limit to 1 - 3 limit, before it at limit (1 - (1 - t / (3 limit))^3).
    limit, dips, costs, offs = 0.1, [], [], []
    for intervals in (30, 60, 120):
        problem = bryson_denham(limit)
        solution = Program(problem, intervals).solve(flat(problem, intervals, 1.0), tolerance=1e-12)
        time, position = solution.time, solution.state("position")
        assert position.max() < limit + 1e-8
        arrival, leave = round(0.3 * intervals), round(0.7 * intervals)
        np.testing.assert_allclose(position[[arrival, leave]], limit, rtol=0, atol=2e-9)
        dips.append(limit - position[arrival : leave + 1].min())
        offs.append(np.abs(position - limit * (1 - (1 - time / 0.3) ** 3))[: arrival + 1].max())
        costs.append(solution.objective - 4 / (9 * limit))
    for errors in (dips, offs, costs):
        np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2, rtol=0, atol=0.05)


def test_path_and_boundary_conditions_with_bounds_apart_and_several_controls():
    # In the plane from rest to a disc of radius 1 around (3, 4), at rest, with at most unit acceleration in any
    # direction: 4 along the diagonal in 2 sqrt(4) s. The second path condition, on a state, is idle.
    def rates(x, y, vx, vy, ax, ay):
        return vx, vy, ax, ay

    problem = Problem(
        rates=rates,
        states=tuple(Variable(name, scale) for name, scale in zip(("x", "y", "vx", "vy"), (3, 4, 1, 2), strict=True)),
        controls=(Variable("ax", 1.0, -2.0, 2.0), Variable("ay", 2.0, -2.0, 2.0)),
        final_time=Variable("final_time", 2.0, 0.5, 20.0),
        initial={"x": 0.0, "y": 0.0, "vx": 0.0, "vy": 0.0},
        final={"vx": 0.0, "vy": 0.0},
        running_cost=lambda *arguments: 1.0,
        boundary=(
            Condition("distance", lambda _, end: (end["x"] - 3) ** 2 + (end["y"] - 4) ** 2, 0.0, 1.0, 2.0),
            Condition("side", lambda start, end: end["x"] - start["x"], 0.5, 50.0),
        ),
        path=(
            Condition("thrust", lambda *a: a[4] ** 2 + a[5] ** 2, 0.0, 1.0, 0.5),
            Condition("speed", lambda *a: a[2] ** 2 + a[3] ** 2, -1.0, 100.0, 10.0),
        ),
    )
    solution = Program(problem, 20).solve(flat(problem, 20, 5.0))
    assert solution.final_time == pytest.approx(4.0, abs=1e-6)
    np.testing.assert_allclose(solution.states[-1, :2], [12 / 5, 16 / 5], atol=1e-5)
    np.testing.assert_allclose(np.hypot(*solution.controls.T), 1.0, atol=1e-6)
    # T = 2 sqrt(5 - sqrt(bound)): an active upper bound has a negative multiplier, an idle one none.
    assert solution.boundary_multipliers["distance"] == pytest.approx(-0.25, abs=1e-5)
    assert solution.boundary_multipliers["side"] == pytest.approx(0.0, abs=1e-6)


# ---- multipliers -----------------------------------------------------------------------------------------------------


def slopes_of_the_optimum(problem, mesh, guess, end, step=1e-4):
    """d(objective)/d(values that are fixed there) of re-solved problems, central differences."""
    slopes = []
    for name, value in getattr(problem, end).items():
        shifted = [replace(problem, **{end: {**getattr(problem, end), name: value + d}}) for d in (-step, step)]
        below, above = (Program(one, mesh).solve(guess, tolerance=1e-11).objective for one in shifted)
        slopes.append((above - below) / (2 * step))
    return slopes


def test_costates_are_slopes_of_the_optimum():
    problem, mesh = pendulum(), graded(15)
    solution = Program(problem, mesh).solve(swing_guess(15), tolerance=1e-11)
    middle, h = (solution.states[1:] + solution.states[:-1]) / 2, np.diff(solution.time)
    half = h[:, np.newaxis, np.newaxis] / 2 * linearize(problem.rates, middle, solution.controls).state_matrix
    # Of the midpoint rule: an addition to the change over an interval moves its end by (I - h/2 A)^-1; the cost holds
    # no state.
    at_starts = np.einsum("ki,kij->kj", solution.costates, np.eye(2) + half)
    at_ends = np.einsum("ki,kij->kj", solution.costates, np.eye(2) - half)
    np.testing.assert_allclose(at_ends[:-1], at_starts[1:], rtol=0, atol=1e-8)
    guess = solution.guess()
    np.testing.assert_allclose(at_starts[0], slopes_of_the_optimum(problem, mesh, guess, "initial"), rtol=1e-6)
    # To demand a final state that is higher by one is to lose one on the way.
    np.testing.assert_allclose(-at_ends[-1], slopes_of_the_optimum(problem, mesh, guess, "final"), rtol=1e-6)


@pytest.mark.parametrize("scale", [1.0, 50.0])
def test_boundary_multipliers_are_slopes_of_the_optimum(scale):
    def with_height(lower, upper):
        height = Condition("height", lambda start, end: -np.cos(end["angle"]), lower, upper, scale)
        return pendulum(final={"rate": 0.0}, boundary=(height,))

    def solved(lower, upper):
        return Program(with_height(lower, upper), 20).solve(swing_guess(20), tolerance=1e-10)

    step = 1e-4
    for bounds, moves in (((0.5, 0.5), (1, 1)), ((0.5, 2.0), (1, 0))):
        solution = solved(*bounds)
        below, above = (solved(bounds[0] + d * moves[0], bounds[1] + d * moves[1]) for d in (-step, step))
        slope = (above.objective - below.objective) / (2 * step)
        assert slope > 0.1  # higher costs more
        assert solution.boundary_multipliers["height"] == pytest.approx(slope, rel=1e-5)


# ---- solver ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{"hessian": "limited-memory"}, {"expand": False}], ids=str)
def test_hessian_and_expansion_do_not_change_the_optimum(options):
    problem, guess = pendulum(), swing_guess(25)
    expected = Program(problem, 25).solve(guess, tolerance=1e-9)
    solution = Program(problem, 25, **options).solve(guess, tolerance=1e-9)
    assert solution.objective == pytest.approx(expected.objective, rel=1e-7)
    np.testing.assert_allclose(solution.states, expected.states, rtol=0, atol=1e-4)


def test_equations_with_a_table():
    import casadi

    # A cubic spline holds a cubic exactly.
    nodes = np.linspace(-2.0, 8.0, 12)
    table = casadi.interpolant("table", "bspline", [nodes], nodes**3 / 50)

    def problem(force):
        return pendulum(rates=lambda angle, rate, torque: (rate, torque - force(angle)))

    guess = swing_guess(20)
    expected = Program(problem(lambda angle: angle**3 / 50), 20).solve(guess)
    solution = Program(problem(table), 20, expand=False).solve(guess)
    np.testing.assert_allclose(solution.states, expected.states, rtol=0, atol=1e-6)
    np.testing.assert_allclose(resimulate(solution), resimulate(expected), rtol=0, atol=1e-6)


def test_scales_do_not_change_the_optimum():
    problem = pendulum(
        path=(Condition("speed", lambda angle, rate, torque: rate, -1.0, 1.0),),
        boundary=(Condition("height", lambda start, end: np.cos(end["angle"]), -1.0, -0.9),),
        final={"rate": 0.0},
    )

    def rescaled(variable, factor):
        return replace(variable, scale=variable.scale * factor)

    other = replace(
        problem,
        states=(rescaled(problem.states[0], 7.0), rescaled(problem.states[1], 0.2)),
        controls=(rescaled(problem.controls[0], 30.0),),
        final_time=rescaled(problem.final_time, 0.1),
        path=(rescaled(problem.path[0], 5.0),),
        boundary=(rescaled(problem.boundary[0], 0.3),),
    )
    one, two = (Program(p, 20).solve(swing_guess(20), tolerance=1e-10) for p in (problem, other))
    assert one.state("rate").max() == pytest.approx(1.0, abs=1e-6)
    assert two.objective == pytest.approx(one.objective, rel=1e-7)
    np.testing.assert_allclose(two.states, one.states, rtol=0, atol=1e-6)
    np.testing.assert_allclose(two.costates, one.costates, rtol=0, atol=1e-5)
    assert two.boundary_multipliers["height"] == pytest.approx(one.boundary_multipliers["height"], rel=1e-5)


def test_a_solution_is_a_good_guess_on_another_mesh():
    problem = pendulum()
    coarse = Program(problem, 20).solve(swing_guess(20))
    finer = Program(problem, 60)
    refined = finer.solve(coarse.guess(60), barrier=1e-6)
    cold = finer.solve(swing_guess(60))
    assert refined.objective == pytest.approx(cold.objective, rel=1e-8)
    assert refined.iterations < cold.iterations
    # A guess holds the trajectory: its nodes lie on the lines between those of the coarse one.
    guess = coarse.guess(60)
    np.testing.assert_allclose(guess.states[::3], coarse.states, atol=1e-14)
    np.testing.assert_allclose(guess.states[1::3], (2 * coarse.states[:-1] + coarse.states[1:]) / 3, atol=1e-14)
    np.testing.assert_array_equal(guess.controls, np.repeat(coarse.controls, 3, axis=0))
    assert guess.final_time == coarse.final_time
    # Onto a mesh that is not equal, and back.
    other = Program(problem, graded(60))
    bent = other.solve(coarse.guess(other.mesh), barrier=1e-6)
    assert bent.objective == pytest.approx(refined.objective, rel=2e-3)
    back = bent.guess(20)
    np.testing.assert_allclose(back.states, coarse.states, rtol=0, atol=0.05)
    np.testing.assert_array_equal(coarse.guess().states, coarse.states)


# ---- continuation ----------------------------------------------------------------------------------------------------


def well(end_cost, lower=-inf):
    """The objective is a function of one number, "place", and of a given "tilt": branches are its local minima."""
    return Problem(
        rates=lambda idle, place, tilt: (0.0,),
        states=(Variable("idle"),),
        controls=(),
        final_time=Variable("final_time", 1.0, 1.0, 1.0),
        initial={"idle": 0.0},
        end_cost=lambda start, end, parameters: end_cost(parameters["place"], parameters["tilt"]),
        free=(Variable("place", 1.0, lower),),
        given=("tilt",),
    )


FOLD = 2 / (3 * np.sqrt(3))  # of the minima of z^4/4 - z^2/2 + tilt z: where z^3 - z + tilt has a double root


@pytest.fixture(scope="module")
def right_well():
    """A program with two wells, and its solution in the right one."""
    program = Program(well(lambda place, tilt: place**4 / 4 - place**2 / 2 + tilt * place), 1)
    return program, program.solve(Guess(np.zeros((2, 1)), np.zeros((1, 0)), 1.0, {"place": 0.9}), {"tilt": 0.0})


def near(before, after):
    return abs(after.free["place"] - before.free["place"]) < 0.3


def test_continuation_reaches_the_values_in_their_order(right_well):
    program, start = right_well
    values, steps_taken = [0.3, 0.1, 0.1, -0.7, 0.35], []
    solutions = program.follow(start, "tilt", values, same_branch=near, on_step=steps_taken.append)
    assert [solution.given["tilt"] for solution in solutions] == values
    for solution in solutions:
        z = max(np.roots([1, 0, -1, solution.given["tilt"]]).real)
        assert solution.free["place"] == pytest.approx(z, abs=1e-7)
    steps = [solution.given["tilt"] for solution in steps_taken]
    assert [v for v in steps if v in values] == [0.3, 0.1, -0.7, 0.35]  # staying takes no step
    assert set(map(id, solutions)) <= set(map(id, steps_taken))


def test_continuation_shortens_a_step_that_is_too_large(right_well):
    program, start = right_well
    steps_taken = []
    allowed = 0.05

    def close(before, after):
        return abs(after.free["place"] - before.free["place"]) < allowed

    (end,) = program.follow(start, "tilt", [0.37], same_branch=close, on_step=steps_taken.append)
    assert end.given["tilt"] == 0.37
    assert len(steps_taken) > 4
    places = [start.free["place"], *(solution.free["place"] for solution in steps_taken)]
    assert np.abs(np.diff(places)).max() < allowed
    assert (np.diff([solution.given["tilt"] for solution in steps_taken]) > 0).all()


def test_continuation_says_where_a_branch_folds(right_well):
    program, start = right_well
    steps_taken = []
    with pytest.raises(BranchEndError, match=r"the branch ends between tilt = 0\.38") as caught:
        program.follow(start, "tilt", [0.2, 0.5], same_branch=near, on_step=steps_taken.append)
    end = caught.value
    assert end.reached < FOLD < end.target
    assert end.target - end.reached < 2e-3 * (0.5 - 0.2)
    assert end.solution is steps_taken[-1]
    assert end.solution.given["tilt"] == end.reached
    assert end.solution.free["place"] > 1 / np.sqrt(3)  # where it folds
    assert end.beyond.given["tilt"] == end.target
    assert end.beyond.free["place"] < -1.0  # in the other well


def test_continuation_says_where_there_is_nothing_any_more():
    # place^2 = 1 - tilt, the nearest to 2: nothing beyond a tilt of 1.
    curve = Condition("curve", lambda start, end: end["idle"], 0.0, 0.0)
    problem = well(lambda place, tilt: (place - 2) ** 2, lower=0.0)
    problem = replace(problem, rates=lambda idle, place, tilt: (place**2 - (1 - tilt),), boundary=(curve,))
    program = Program(problem, 1)
    start = program.solve(Guess(np.zeros((2, 1)), np.zeros((1, 0)), 1.0, {"place": 0.9}), {"tilt": 0.0})
    assert start.free["place"] == pytest.approx(1.0)
    with pytest.raises(BranchEndError) as caught:
        program.follow(start, "tilt", [0.6, 1.4], smallest_step=1e-2)
    assert caught.value.reached <= 1 + 1e-7 < caught.value.target
    assert caught.value.target - caught.value.reached <= 0.02 * 0.8
    assert caught.value.beyond is None
    assert caught.value.solution.given["tilt"] == caught.value.reached


# ---- failures --------------------------------------------------------------------------------------------------------


def test_an_unreachable_end_is_reported_with_the_worst_constraint():
    # At most 1/2 for 2 s reaches 1/2, not 1.
    problem = double_integrator(bound=0.5)
    with pytest.raises(NotConvergedError, match="Infeasible_Problem_Detected after") as caught:
        Program(problem, 10).solve(flat(problem, 10, 2.0))
    solution = caught.value.solution
    defects = np.diff(solution.states, axis=0) - 0.2 * np.column_stack(
        [(solution.states[1:, 1] + solution.states[:-1, 1]) / 2, solution.controls[:, 0]]
    )
    scaled = np.abs(defects) / [3.0, 0.5]
    interval, state = np.unravel_index(scaled.argmax(), scaled.shape)
    assert solution.residual.value == pytest.approx(np.abs(defects)[interval, state], rel=1e-9)
    assert solution.residual.value > 0.01
    name, start = problem.states[state].name, f"{solution.time[interval]:.4g}"
    expected = f"the equation of {name} on interval {interval} at {start} s, off by {solution.residual.value:.3g}"
    assert str(solution.residual) == expected
    assert str(caught.value).endswith(f"the worst constraint is {expected}")
    assert solution.states.shape == (11, 2)


@pytest.mark.parametrize("rate", [lambda x: np.sqrt(x - 5), lambda x: 1 / (x - 0.1)], ids=["nan", "infinite"])
def test_rates_that_are_not_finite_at_the_guess(rate):
    problem = double_integrator(rates=lambda x, v, a: (v, a + rate(x)))
    with pytest.raises(NotConvergedError, match="Invalid_Number_Detected after 0 iterations") as caught:
        Program(problem, 10).solve(flat(problem, 10, 2.0))
    assert "the worst constraint is the equation of velocity on interval" in str(caught.value)
    assert str(caught.value).endswith(" s, not finite")
    with pytest.raises(RuntimeError, match="flying the controls from 0 s on failed: the rates there are not finite"):
        simulate(problem, [0.1, 0.0], np.zeros((10, 1)), np.linspace(0, 2, 11))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"controls": (Variable("acceleration", 1.0, inf),)}, "acceleration: no number lies in its bounds"),
        ({"boundary": (Condition("gate", max),), "path": (Condition("gate", max),)}, "gate: each condition needs a"),
        (
            {"states": (Variable("position", 1.0, 0.0, 0.9), Variable("velocity"))},
            "final value of position, 1, lies outside of its bounds, 0 to 0.9",
        ),
    ],
)
def test_a_declaration_that_cannot_be_meant_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        double_integrator(**changes)


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        ({}, {"scheme": "euler"}, "scheme must be one of midpoint, trapezoid, hermite_simpson, not 'euler'"),
        ({}, {"intervals": [0.0, 0.5, 0.5, 1.0]}, "must increase from 0 to 1"),
        ({"rates": lambda x, v, a: (v,)}, {}, "rates must return one value per state: 1 values for 2 states"),
    ],
)
def test_a_program_that_cannot_be_meant_is_refused(changes, arguments, message):
    with pytest.raises(ValueError, match=message):
        Program(double_integrator(**changes), **{"intervals": 10, **arguments})


def test_guesses_and_parameters_that_do_not_fit_are_refused():
    problem = double_integrator(
        rates=lambda x, v, a, spring, drag: (v, a - spring * x - drag * v),
        running_cost=lambda x, v, a, spring, drag: a**2,
        free=(Variable("spring", 1.0, 0.0, 1.0),),
        given=("drag",),
    )
    program, good = Program(problem, 4), flat(problem, 4, 2.0, free={"spring": 0.5})
    parameters = {"drag": 0.1}
    shapes = r"shapes \(\(5, 2\), \(4, 1\)\), got \(\({}, 2\), \({}, 1\)\)"
    holed = np.where(np.arange(10).reshape(5, 2) == 3, np.nan, 0.0)
    for guess, message in (
        (flat(problem, 3, 2.0), shapes.format(4, 3)),
        (good._replace(controls=np.zeros((5, 1))), shapes.format(5, 5)),
        (good._replace(free={}), "the guess has no value of the free parameter spring"),
        (good._replace(states=holed), "the guess's states: not all finite"),
        (good._replace(controls=np.full((4, 1), inf)), "the guess's controls: not all finite"),
        (good._replace(final_time=np.nan), "the guess's final time: not all finite"),
        (good._replace(free={"spring": np.nan}), "the guess's free parameters: not all finite"),
    ):
        with pytest.raises(ValueError, match=message):
            program.solve(guess, parameters)
    with pytest.raises(ValueError, match="given parameters must be drag; got none"):
        program.solve(good)
    with pytest.raises(ValueError, match="given parameters must be drag; got drag, mass"):
        program.solve(good, {"drag": 0.1, "mass": 1.0})
    with pytest.raises(ValueError, match="given parameter drag: must be finite, got nan"):
        program.solve(good, {"drag": np.nan})
    solution = program.solve(good, parameters)
    with pytest.raises(ValueError, match=r"must have shapes \(\(2,\), \(4, 1\), \(2,\)\), got"):
        simulate(problem, solution.states[0], solution.controls, solution.time)
    with pytest.raises(ValueError, match=r"must have shapes \(\(2,\), \(3, 1\), \(2,\)\), got"):
        simulate(problem, solution.states[0], solution.controls, solution.time[1:], [0.5, 0.1])


def test_a_simulation_that_does_not_come_on_says_so(monkeypatch):
    """Below some height the air is as good as solid, and steps become ever shorter."""
    problem = Problem(
        rates=lambda height, speed, push: (speed, push - 3.7 + np.exp(-height) * speed**2),
        states=(Variable("height"), Variable("speed")),
        controls=(Variable("push"),),
        final_time=Variable("final_time", 1.0, 1.0, 100.0),
    )
    monkeypatch.setattr(collocation, "_MOST_EVALUATIONS", 2000)
    with pytest.raises(RuntimeError, match=r"from \d+ s on failed: the steps become ever shorter"):
        simulate(problem, [10.0, 0.0], np.zeros((4, 1)), np.linspace(0.0, 40.0, 5))
