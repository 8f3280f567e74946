"""Sensitivities as states, against derivatives of the discrete flow by other means."""

from dataclasses import replace

import numpy as np
import pytest

from marsedl.methods.collocation import SCHEMES, Condition, Guess, Problem, Program, Variable, resimulate
from marsedl.methods.desensitization import Desensitized, Gain, Perturbation, column
from marsedl.methods.linearization import linearize
from marsedl.methods.sensitivity import (
    adjoint_rows,
    closed_loop,
    midpoint_responses,
    midpoint_transitions,
    propagate_columns,
)
from marsedl.models.atmosphere import casadi_log_density

NAMES = ("range", "speed", "path", "roll")
PUSH = Perturbation("push", {"speed": 1.0, "roll": -0.5})
AIR = Perturbation("air", parameters={"density": 1.0, "wind": 0.3})
MIXED = Perturbation("mixed", {"path": 0.7}, {"wind": 2.0})


def glide(distance, speed, path, roll, thrust, turn, trim, density, wind):
    """A nonlinear glide in which nothing depends on the range and everything else on everything."""
    return (
        speed * np.cos(path) + wind * np.cos(roll),
        thrust - density * speed**2 - np.sin(path) + trim * wind,
        density * speed * np.cos(roll) - np.cos(path) / speed + 0.1 * np.sin(thrust * path),
        turn - 0.3 * roll**3 + 0.2 * wind * path,
    )


@pytest.fixture(scope="module")
def base():
    """Fly it as far as it gets for the least control."""
    return Problem(
        rates=glide,
        states=tuple(Variable(n, s) for n, s in zip(NAMES, (3.0, 1.0, 0.5, 2.0), strict=True)),
        controls=(Variable("thrust", 0.5, -2.0, 2.0), Variable("turn", 0.8)),
        final_time=Variable("final_time", 2.0, 0.5, 4.0),
        initial={"range": 0.0, "speed": 1.2, "path": 0.1, "roll": 0.4},
        final={"range": 1.5, "roll": -0.3},
        running_cost=lambda *a: a[4] ** 2 + 0.3 * a[5] ** 2 + 0.1 * a[2] ** 2,
        end_cost=lambda start, end, parameters: parameters["trim"] ** 2 + 0.1 * end["path"] * parameters["wind"],
        path=(Condition("corridor", lambda *a: a[2] + 0.1 * a[8], -0.2, 1.0),),
        free=(Variable("trim", 0.1, -1.0, 1.0),),
        given=("density", "wind"),
    )


GIVEN = {"density": 0.9, "wind": 0.2}
MESH = np.array([0.0, 0.1, 0.25, 0.45, 0.6, 0.8, 0.9, 1.0])


def flat(intervals=7):
    """A guess for the base."""
    states = np.column_stack([np.linspace(0, 1.5, intervals + 1), *np.full((3, intervals + 1), [[1.2], [0.1], [0.1]])])
    return Guess(states, np.full((intervals, 2), 0.2), 1.5, {"trim": 0.0})


def fixed_gains(gains, values):
    """Gains that are held at values."""
    return tuple(replace(g, lower=v, upper=v) for g, v in zip(gains, values, strict=True))


GAINS = (Gain("thrust", "speed", 2.0), Gain("turn", "range", -1.0), Gain("turn", "roll", 0.5), Gain("thrust", "path"))
VALUES = (-0.4, 0.7, -1.2, 0.25)


def matrix(gains, values):
    """The feedback matrix K, (2, 4)."""
    feedback = np.zeros((2, 4))
    for gain, value in zip(gains, values, strict=True):
        feedback[("thrust", "turn").index(gain.control), NAMES.index(gain.state)] += gain.unit * value
    return feedback


def changes(scheme, rates, start, end, nominal_start, nominal_end, gain, h, control):
    """Change over an interval with the control u + K (x - x_nominal) wherever the scheme evaluates rates."""

    def at(x, nominal):
        return np.array(rates(x, control + gain @ (x - nominal)))

    if scheme == "midpoint":
        return h * at((start + end) / 2, (nominal_start + nominal_end) / 2)
    first, last = at(start, nominal_start), at(end, nominal_end)
    if scheme == "trapezoid":
        return h * (first + last) / 2
    slopes = [np.array(rates(x, control)) for x in (nominal_start, nominal_end)]
    nominal_middle = np.real((nominal_start + nominal_end) / 2 + h * (slopes[0] - slopes[1]) / 8)
    middle = (start + end) / 2 + h * (first - last) / 8
    return h * (first + 4 * at(middle, nominal_middle) + last) / 6


def derivative_of_the_discrete_flow(scheme, solution, perturbation, gain):
    """d(states at the nodes)/d(perturbation): its equations are solved for an imaginary perturbation (complex step).

    Fixed-point iteration: slow and simple; the intervals are short enough for it to contract.
    """
    size, n = 1e-30, 4
    nominal, parameters = solution.states[:, :n], {**solution.free, **solution.given}
    for name, value in perturbation.parameters.items():
        parameters[name] = parameters[name] + 1j * size * value
    arguments = [parameters[name] for name in ("trim", "density", "wind")]
    direction = np.array([perturbation.states.get(name, 0.0) for name in NAMES])
    states = [nominal[0] + 1j * size * direction]
    for k, h in enumerate(np.diff(solution.time)):
        end = nominal[k + 1].astype(complex)
        for _ in range(200):
            end = states[-1] + changes(
                scheme,
                lambda x, u: glide(*x, *u, *arguments),
                states[-1],
                end,
                nominal[k],
                nominal[k + 1],
                gain,
                h,
                solution.controls[k],
            )
        states.append(end)
    assert np.abs(np.real(states) - nominal).max() < 1e-7  # the nominal solves the same equations
    return np.imag(states) / size


@pytest.mark.parametrize("gains", [(), GAINS], ids=["open loop", "closed loop"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_columns_are_the_derivatives_of_the_discrete_flow(scheme, gains, base):
    values = VALUES[: len(gains)]
    perturbations = (PUSH, AIR, MIXED)
    extended = Desensitized(base, perturbations, {"speed": 0.5, "range": 2.0}, fixed_gains(gains, values))
    solution = Program(extended.problem, MESH, scheme).solve(extended.guess(flat(), GIVEN), GIVEN, tolerance=1e-11)
    columns = extended.columns(solution)
    assert columns.shape == (8, 4, 3)
    feedback = matrix(gains, values)
    for number, perturbation in enumerate(perturbations):
        expected = derivative_of_the_discrete_flow(scheme, solution, perturbation, feedback)
        assert np.abs(expected[-1]).max() > 0.2
        np.testing.assert_allclose(columns[:, :, number], expected, rtol=0, atol=1e-9)
    # The base problem is solved as it was.
    alone = Program(base, MESH, scheme).solve(flat(), GIVEN, tolerance=1e-11)
    assert solution.objective == pytest.approx(alone.objective, abs=1e-9)
    assert solution.running_cost == pytest.approx(alone.running_cost, abs=1e-8)
    np.testing.assert_allclose(solution.states[:, :4], alone.states, rtol=0, atol=1e-5)


def recursion(base, solution, perturbations, gain):
    """The columns by the recursion of the midpoint rule, and its transitions."""
    h, n = np.diff(solution.time), 4
    middle = (solution.states[1:, :n] + solution.states[:-1, :n]) / 2
    parameters = [solution.free["trim"], *(solution.given[name] for name in base.given)]
    model = linearize(base.rates, middle, solution.controls, parameters)

    def of_given(*a):
        return base.rates(*a[:4], *a[6:8], a[8], *a[4:6])

    forced = linearize(
        of_given, middle, np.tile(parameters[1:], (len(middle), 1)), [*solution.controls.T, parameters[0]]
    ).control_matrix
    direction = np.array([[p.parameters.get(name, 0.0) for p in perturbations] for name in base.given])
    start = np.array([[p.states.get(name, 0.0) for p in perturbations] for name in NAMES])
    closed = closed_loop(model.state_matrix, model.control_matrix, gain)
    transitions = midpoint_transitions(closed, h)
    return propagate_columns(transitions, start, midpoint_responses(closed, forced @ direction, h)), transitions


def test_columns_of_the_midpoint_rule_are_those_of_its_recursion(base):
    perturbations, gain = (PUSH, AIR, MIXED), matrix(GAINS, VALUES)
    extended = Desensitized(base, perturbations, gains=fixed_gains(GAINS, VALUES))
    solution = Program(extended.problem, MESH).solve(extended.guess(flat(), GIVEN), GIVEN, tolerance=1e-11)
    columns = extended.columns(solution)
    expected, transitions = recursion(base, solution, perturbations, gain)
    np.testing.assert_allclose(columns, expected, rtol=0, atol=1e-10)
    # Rows that are carried backward from the end meet the column of initial states anywhere.
    backward = adjoint_rows(transitions, np.eye(4))
    for k in range(8):
        np.testing.assert_allclose(backward[k] @ columns[k, :, 0], columns[-1, :, 0], rtol=0, atol=1e-10)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_columns_approach_those_of_the_continuous_flow_with_the_order_of_the_scheme(scheme, base):
    # The rates that are flown hold those of the sensitivities, so that all can be flown.
    extended = Desensitized(base, (PUSH, AIR), gains=fixed_gains(GAINS, VALUES))
    misses = []
    for intervals in (10, 20):
        guess = extended.guess(flat(intervals), GIVEN)
        solution = Program(extended.problem, intervals, scheme).solve(guess, GIVEN)
        flight = resimulate(solution, relative_tolerance=1e-12, absolute_tolerance=1e-13)
        misses.append(np.abs(flight - solution.states)[:, 4:].max())
    order = 4 if scheme == "hermite_simpson" else 2
    assert np.log2(misses[0] / misses[1]) == pytest.approx(order, abs=0.1 * order)


def test_rows_that_are_always_zero_are_left_out(base):
    # Nothing depends on the range: perturbed alone it stays as it is, and nothing else moves.
    ahead, push = Perturbation("ahead", {"range": 3.0}), Perturbation("push", {"speed": 1.0})
    extended = Desensitized(base, (ahead, push))
    names = [v.name for v in extended.problem.states[4:]]
    assert names == [column("range", "ahead"), *(column(name, "push") for name in NAMES)]
    solution = Program(extended.problem, MESH).solve(extended.guess(flat(), GIVEN), GIVEN, tolerance=1e-11)
    columns = extended.columns(solution)
    assert (columns[:, 0, 0] == 3.0).all()  # to the last bit
    assert (columns[:, 1:, 0] == 0.0).all()
    for number, perturbation in enumerate((ahead, push)):
        expected = derivative_of_the_discrete_flow("midpoint", solution, perturbation, np.zeros((2, 4)))
        np.testing.assert_allclose(columns[:, :, number], expected, rtol=0, atol=1e-9)
    # Fed back, it reaches everything that the control reaches.
    fed_back = Desensitized(base, (ahead,), gains=(Gain("turn", "range"),))
    assert [v.name for v in fed_back.problem.states[4:]] == [column(name, "ahead") for name in NAMES]


def test_a_guess_holds_the_columns_along_it(base):
    perturbations = (PUSH, AIR, MIXED)
    extended = Desensitized(base, perturbations, gains=GAINS)

    def stacked(solution, gain):
        columns, _ = recursion(base, solution, perturbations, gain)
        return np.concatenate([columns[:, :, number] for number in range(3)], axis=1)

    # Along a solution, on its own mesh: there is nothing left to be solved.
    alone = Program(base, MESH).solve(flat(), GIVEN, tolerance=1e-11)
    guess = extended.guess(alone)
    assert guess.free == {**alone.free, **dict.fromkeys((gain.parameter for gain in GAINS), 0.0)}
    np.testing.assert_array_equal(guess.states[:, :4], alone.states)
    np.testing.assert_allclose(guess.states[:, 4:], stacked(alone, np.zeros((2, 4))), rtol=0, atol=1e-12)
    # Along a guess with gains of its own, on equal intervals.
    on_equal = alone.guess(7)
    gain_values = {gain.parameter: value for gain, value in zip(GAINS, VALUES, strict=True)}
    guess = extended.guess(on_equal._replace(free={**alone.free, **gain_values}), GIVEN)
    assert guess.free == {**alone.free, **gain_values}
    equal = replace(alone, time=np.linspace(0, alone.final_time, 8), states=on_equal.states, controls=on_equal.controls)
    np.testing.assert_allclose(guess.states[:, 4:], stacked(equal, matrix(GAINS, VALUES)), rtol=0, atol=1e-12)


# ---- desensitization -------------------------------------------------------------------------------------------------


def oscillator(gains=()):
    """Swing a pendulum from rest at 1 to rest at -1, with a weight on the final sensitivity to the angle at the start.

    Returns what extends it, the problem with its cost, and a guess.
    """
    base = Problem(
        rates=lambda angle, rate, torque, weight: (rate, torque - np.sin(2 * angle)),
        states=(Variable("angle"), Variable("rate")),
        controls=(Variable("torque", 1.0, -20.0, 20.0),),
        final_time=Variable("final_time", 2.0, 2.0, 2.0),
        initial={"angle": 1.0, "rate": 0.0},
        final={"angle": -1.0, "rate": 0.0},
        running_cost=lambda angle, rate, torque, weight: torque**2,
        given=("weight",),
    )
    extended = Desensitized(base, (Perturbation("start", {"angle": 1.0}),), gains=gains)

    def cost(start, end, parameters):
        return parameters["weight"] * np.sqrt(end["angle/start"] ** 2 + end["rate/start"] ** 2 + 1e-10)

    along = np.linspace(0.0, 1.0, 31)
    guess = Guess(np.column_stack([1 - 2 * along, np.full(31, -1.0)]), np.zeros((30, 1)), 2.0)
    return extended, replace(extended.problem, end_cost=cost), extended.guess(guess, {"weight": 0.0})


def norm(column):
    """As in the cost."""
    return np.sqrt((column**2).sum() + 1e-10)


def test_weight_buys_a_smaller_sensitivity_at_its_price():
    extended, problem, guess = oscillator()
    program = Program(problem, 30)
    start = program.solve(guess, {"weight": 0.0}, tolerance=1e-11)
    centres = np.array([0.3, 3.0, 30.0])
    weights = np.repeat(centres, 2) * np.tile([1 - 1e-3, 1 + 1e-3], 3)
    branch = program.follow(start, "weight", weights, tolerance=1e-11)
    norms = np.array([norm(extended.columns(s)[-1]) for s in (start, *branch)])
    efforts = np.array([s.running_cost for s in (start, *branch)])
    np.testing.assert_allclose(efforts[1:] + weights * norms[1:], [s.objective for s in branch], rtol=1e-12)
    assert (np.diff(norms) < 0).all()
    assert (np.diff(efforts) > 0).all()
    assert norms[-1] < 0.8 * norms[0]
    # Where the sum is least, effort + weight norm, a smaller norm is bought at just that price.
    prices = (efforts[2::2] - efforts[1::2]) / (norms[2::2] - norms[1::2])
    np.testing.assert_allclose(prices, -centres, rtol=1e-5)


@pytest.mark.parametrize("lower", [-5.0, -0.2], ids=["free", "at its bound"])
def test_a_gain_goes_where_the_sensitivity_is_least(lower):
    from scipy.optimize import minimize_scalar

    gain = Gain("torque", "rate", 2.0, lower, 0.0)
    extended, problem, guess = oscillator((gain,))
    program, weight = Program(problem, 30), {"weight": 0.5}
    solution = program.solve(guess, weight, tolerance=1e-11)
    chosen = solution.free["torque/rate"]
    # Of the nominal that it found, the norm of the recursion's column over the gain.
    middle = (solution.states[1:, :2] + solution.states[:-1, :2]) / 2
    model = linearize(extended.base.rates, middle, solution.controls, [0.5])

    def final(value):
        closed = closed_loop(model.state_matrix, model.control_matrix, np.array([[0.0, 2.0 * value]]))
        return propagate_columns(midpoint_transitions(closed, 2.0 / 30), np.array([[1.0], [0.0]]))[-1]

    np.testing.assert_allclose(extended.columns(solution)[-1], final(chosen), rtol=0, atol=1e-9)
    best = minimize_scalar(lambda value: norm(final(value)), bounds=(lower, 0.0), method="bounded")
    if lower == -0.2:
        assert chosen == pytest.approx(lower, abs=1e-7)
        assert best.x == pytest.approx(lower, abs=1e-4)
    else:
        assert lower + 1 < chosen < -0.3
        assert chosen == pytest.approx(best.x, abs=1e-5)
    # A nominal has no deviation to feed back: reshaped for nothing but what the norm gains by it.
    plain, plain_problem, plain_guess = oscillator()
    without = Program(plain_problem, 30).solve(plain_guess, weight, tolerance=1e-11)
    assert norm(extended.columns(solution)[-1]) < 0.9 * norm(plain.columns(without)[-1])
    assert solution.objective < without.objective


def test_feedback_of_an_integrator_in_closed_form():
    # x' = u and s' = k s: the midpoint rule multiplies s by (1 + h k / 2) / (1 - h k / 2) in each interval.
    base = Problem(
        rates=lambda x, u: (u,),
        states=(Variable("x"),),
        controls=(Variable("u"),),
        final_time=Variable("final_time", 1.0, 2.0, 2.0),
        initial={"x": 0.0},
        final={"x": 1.0},
        running_cost=lambda x, u: u**2,
    )
    gain = Gain("u", "x", 0.1, -8.0, -8.0)
    extended = Desensitized(base, (Perturbation("start", {"x": 5.0}),), gains=(gain,))
    guess = Guess(np.zeros((11, 1)), np.zeros((10, 1)), 2.0)
    solution = Program(extended.problem, 10).solve(extended.guess(guess))
    expected = 5 * ((1 - 0.08) / (1 + 0.08)) ** np.arange(11)
    np.testing.assert_allclose(extended.columns(solution)[:, 0, 0], expected, rtol=1e-9)
    np.testing.assert_allclose(solution.controls, 0.5, atol=1e-9)


# ---- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"perturbations": (Perturbation("none"),)}, "perturbation none: perturbs nothing"),
        ({"perturbations": (PUSH, Perturbation("push", {"path": 1.0}))}, "path/push.*needs a name of its own"),
        ({"perturbations": (Perturbation("up", {"height": 1.0}),)}, "height: no state of the problem, which has range"),
        ({"scales": {"speed": 0.0}}, "speed/push: the scale must be positive"),
        ({"rates": lambda *a: a[:3]}, "rates returned 3 values for 4 states"),
    ],
)
def test_what_does_not_fit_the_problem_is_refused(arguments, message, base):
    base = replace(base, rates=arguments.pop("rates", base.rates))
    with pytest.raises(ValueError, match=message):
        Desensitized(**{"base": base, "perturbations": (PUSH,), **arguments})


def test_a_guess_without_a_parameter_is_refused(base):
    extended = Desensitized(base, (PUSH,))
    with pytest.raises(ValueError, match="density, wind: the guess needs a value"):
        extended.guess(flat())
    with pytest.raises(ValueError, match="trim: the guess needs a value"):
        extended.guess(flat()._replace(free={}), GIVEN)
    with pytest.raises(ValueError, match="do not fit"):
        extended.guess(flat()._replace(controls=np.zeros((9, 2))), GIVEN)


def test_sensitivities_through_a_table_are_those_of_the_closed_form():
    """A vehicle falls into an exponential atmosphere, which a table of it follows to 1e-5."""
    altitude = np.linspace(-5e3, 60e3, 131)
    log_density = casadi_log_density(np.column_stack([altitude, 0.02 * np.exp(-altitude / 11e3)]))

    def falling(density):
        def rates(height, speed, push, factor):
            return speed, push - 3.7 + factor * density(height) * speed**2 / 200.0

        return Problem(
            rates=rates,
            states=(Variable("height", 1e4), Variable("speed", 100.0)),
            controls=(Variable("push", 1.0),),
            final_time=Variable("final_time", 10.0, 20.0, 20.0),
            initial={"height": 2e4, "speed": -500.0},
            final={"height": 1.4e4},
            running_cost=lambda *a: a[2] ** 2,
            given=("factor",),
        )

    perturbations = (Perturbation("height", {"height": 1.0}), Perturbation("air", parameters={"factor": 1.0}))
    guess = Guess(np.column_stack([np.linspace(2e4, 1.4e4, 11), np.full(11, -300.0)]), np.zeros((10, 1)), 20.0)
    solutions = []
    for density, expand in ((lambda h: np.exp(log_density(h)), False), (lambda h: 0.02 * np.exp(-h / 11e3), True)):
        falls = Desensitized(falling(density), perturbations, {"height": 1e3, "speed": 1e2})
        solution = Program(falls.problem, 10, expand=expand).solve(falls.guess(guess, {"factor": 1.0}), {"factor": 1.0})
        solutions.append(falls.columns(solution)[-1])
    np.testing.assert_allclose(solutions[0], solutions[1], rtol=2e-3)
    assert np.abs(solutions[1]).min() > 0.0
