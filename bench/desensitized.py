"""The desensitized landing: derivatives, solves, the path of Table 3, flights, the whole paper."""

import time

import numba
import numpy as np
from measuring import CORES, inputs_of, interleaved, say

from marsedl.methods.collocation import ACCEPTABLE, SOLVED, Program
from marsedl.models.dynamics.velocity_component_entry import velocity_component_entry_rates
from marsedl.montecarlo.streams import normals
from marsedl.papers.desensitized import PAPER, components, entry_problem, environment, flight, nominal, tradeoff
from marsedl.papers.desensitized.entry_problem import WARM, Setup, gain_vector
from marsedl.papers.desensitized.gains import Law, reference

PIPELINE_LIMIT = 480.0  # CPU s
FIGURE = "fig04"
TRIALS = 5000
SCALING_TRIALS = 10_000  # enough work for both threads
WEIGHT = 45.0  # near that of the row c1 = 1
SCALED_GAIN = np.array([-0.2, -0.07, 0.18, -0.1, 0.1, 0.26])  # close to the least gains against radius errors


# --- the same flight without compiled code ----------------------------------------------------------------------------


def fly_numpy(constants, cells, flown, gain, states, substeps):
    """The kernel's scheme, law and nominal in array code; returns the final states, (8, trials)."""
    c = {name: constants[name][0] for name in constants.dtype.names}
    bound = c["bank_acceleration_bound"]

    def rates(state, control):
        position = (state[0] - c["bottom"]) * c["cells_per_metre"]
        cell = np.clip(np.floor(position).astype(np.intp) + 1, 0, len(cells) - 1)
        x = position - (cell - 1)
        c0, c1, c2, c3 = cells[cell].T
        density = np.exp(c0 + x * (c1 + x * (c2 + x * c3)))
        planet = c["gravitational_parameter"], c["planet_radius"]
        vehicle = c["ballistic_coefficient"], c["lift_to_drag"]
        return np.array(velocity_component_entry_rates(state, control, density, vehicle, planet))

    def both(pair, held):
        trial, beside = pair
        control = np.clip(held + gain @ (trial - beside), -bound, bound)
        return np.array([rates(trial, control), rates(beside, np.full(trial.shape[1], held))])

    pair = np.array([states.T, np.broadcast_to(flown.initial_state[:, np.newaxis], states.T.shape)])
    step = flown.final_time / len(flown.bank_acceleration) / substeps
    for held in np.repeat(flown.bank_acceleration, substeps):
        first = both(pair, held)
        second = both(pair + 0.5 * step * first, held)
        third = both(pair + 0.5 * step * second, held)
        fourth = both(pair + step * third, held)
        pair = pair + step / 6.0 * (first + 2.0 * (second + third) + fourth)
    return pair[0]


# --- measuring --------------------------------------------------------------------------------------------------------


def compare_derivatives(row, solver, name, declared, guess, weight):
    """One solve with exact derivatives of expanded equations, against approximate ones and equations as they stand."""
    kinds = {
        "exact, expanded": Program(declared, solver.intervals, solver.scheme),
        "limited-memory, expanded": Program(declared, solver.intervals, solver.scheme, hessian="limited-memory"),
        "exact, not expanded": Program(declared, solver.intervals, solver.scheme, expand=False),
    }
    objectives = {}

    def solving(kind):
        def run():
            solution = kinds[kind].solve(
                guess, entry_problem.given(weight), barrier=WARM, iterations=2000, accept=(SOLVED, ACCEPTABLE)
            )
            objectives[kind] = solution.objective

        return run

    times = dict(zip(kinds, interleaved([solving(kind) for kind in kinds]), strict=True))
    np.testing.assert_allclose(list(objectives.values()), objectives["exact, expanded"], rtol=1e-5)
    for kind, seconds in times.items():
        row(f"{name}: {kind}", seconds, "s")
    best = times["exact, expanded"]
    row(f"{name}: speed of exact over limited-memory", times["limited-memory, expanded"] / best, "ratio")
    row(f"{name}: speed of expanded over not expanded", times["exact, not expanded"] / best, "ratio")


def problem(found):
    """Air, nominal and gains of flights, as `flight.fly` takes them, and the function of the initial states."""
    i = inputs_of(PAPER.slug)
    law = Law(found.time, found.state, found.bank_acceleration)
    posed = (
        *environment.surroundings(i.planet, i.vehicle),
        reference(law),
        gain_vector(i.planet, i.design, SCALED_GAIN),
    )

    def starts(trials):
        errors = normals(i.ensemble.seed, 0, range(trials), 3) * 50.0
        return environment.displaced(i.planet, found.state[0], errors)

    return posed, starts


def compare_with_array_code(row, posed, states, substeps):
    """Agreement of both, then their times."""
    constants, cells, flown, gain = posed
    expected = flight.fly(*posed, states, substeps=substeps)
    final = fly_numpy(constants, cells, flown, gain, states, substeps)
    np.testing.assert_allclose(final, expected.final_state[: components.STATES], rtol=1e-9, atol=1e-9)
    compiled, array = interleaved(
        (
            lambda: flight.fly(*posed, states, substeps=substeps),
            lambda: fly_numpy(constants, cells, flown, gain, states, substeps),
        ),
        3,
    )
    label = f"{TRIALS:,} flights with feedback and outputs"
    row(f"kernel, {label}", 1e6 * compiled / TRIALS, "us per trial")
    row(f"array code, {label}", 1e6 * array / TRIALS, "us per trial")
    row("speed of the kernel over array code", array / compiled, "ratio")


def measure(row):
    """Measure everything of this paper; row: of `measuring.Rows`."""
    numba.set_num_threads(1)
    inputs = inputs_of(PAPER.slug)
    setup = Setup(inputs.planet, inputs.vehicle, inputs.mission, inputs.solver, inputs.design)
    planet, vehicle, mission, solver, design = setup
    say("desensitized: nominal")
    found = nominal.compute(planet, vehicle, mission, solver)

    say("desensitized: derivatives")
    plain = entry_problem.problem(planet, vehicle, mission)
    compare_derivatives(row, solver, "no-DOC solve from its solution", plain, nominal.as_guess(found), 0.0)
    extended, transcribed = tradeoff.prepared(setup)
    start = entry_problem.solve(
        solver, "no weight", transcribed, extended.guess(nominal.as_guess(found), entry_problem.given()), barrier=WARM
    )
    (near,) = transcribed.follow(start, "weight", [0.02])[-1:]
    row("iterations of one continuation step", near.iterations, "1")
    last = start
    for weight in (0.2, 1.5, 10.0, WEIGHT):
        last = entry_problem.solve(solver, "start", transcribed, last, weight=weight)
    declared = transcribed.problem
    compare_derivatives(row, solver, "desensitized solve, one continuation step", declared, last, 1.1 * WEIGHT)

    say("desensitized: Table 3")
    start = time.process_time()
    path = tradeoff.compute(planet, vehicle, mission, solver, design, inputs.simulation, found)
    seconds = time.process_time() - start
    row("path and rows of Table 3", seconds, "CPU s")
    row("solves on it", path.solves, "1")
    row("a solve on it", seconds / path.solves, "CPU s")

    say("desensitized: kernel against array code")
    substeps, (posed, starts) = inputs.simulation.substeps, problem(found)
    compare_with_array_code(row, posed, starts(TRIALS), substeps)

    say("desensitized: scaling with threads")
    states = starts(SCALING_TRIALS)

    def with_threads(number):
        def run():
            numba.set_num_threads(number)
            flight.fly(*posed, states, substeps=substeps)

        return run

    one, two = interleaved((with_threads(1), with_threads(2)), 5)
    numba.set_num_threads(1)
    row(f"speed of 2 threads over 1 ({CORES} cores)", one / two, "ratio", at_least=1.8)
