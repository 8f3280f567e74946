"""The random field: both forms of the steering program over the horizon, re-solves, flights, the whole paper.

The printed form is the paper's own: the unknown is L, and every constraint and term of the cost is written with the
square root of S as it stands there. "Build" is all that happens before the solver gets its matrices.
"""

import json
import resource
import statistics
import subprocess
import sys
import time
from contextlib import contextmanager
from itertools import cycle

import numba
import numpy as np
from measuring import CORES, RUN, designed, ensemble, inputs_of, interleaved, peak_memory, run, say

from marsedl.methods.covariance_steering.block_program import compile_program, solve
from marsedl.montecarlo.streams import normals
from marsedl.papers.random_field import PAPER, flight, gains, linearization, nominal
from marsedl.papers.random_field.inputs import MODEL

PIPELINE_LIMIT = 360.0  # CPU s
FIGURE = "fig12"
TRIALS = 5000  # the paper's
SCALING_TRIALS = 10_000  # enough work for both threads
ALL_TRIALS = 100_000  # under each law

FORMS = {"innovations": "innovations form", "history": "printed form"}
INTERVALS = (10, 20, 40, 80)  # of the scaling table, equal ones
LONG = 40  # intervals of the second comparison
FITTED = 3  # sizes behind an exponent
BUDGET = 10.0  # s, for repetitions of a program
TIME_LIMIT = 300.0  # s, for a program
MEMORY_LIMIT = 16.0  # GB


# --- the problems -----------------------------------------------------------------------------------------------------


def posed_along(partition, control, states):
    """The program about a trajectory on a partition."""
    i = inputs_of(PAPER.slug)
    motion = linearization.motion_of(i.planet, i.air, i.vehicle, i.mission, i.simulation)
    model = linearization.along(motion, partition, control, states)
    return gains.program(i.guidance, i.vehicle, motion, model, control)[0]


def first_program(flown, partition):
    """The first iteration's program on a partition."""
    states = nominal.states_of(inputs_of(PAPER.slug).planet.planet_radius, flown)
    return posed_along(partition, np.zeros(len(partition) - 1), states)


def equal_partition(intervals):
    """Nodes of equal intervals."""
    return np.linspace(0.0, inputs_of(PAPER.slug).mission.final_time, intervals + 1)


def problem(flown, made, trials):
    """Constants, air, last law and initial states, as `flight.fly` takes them, and its options."""
    i = inputs_of(PAPER.slug)
    plant = flight.plant_of(i.planet, i.air, i.vehicle, i.simulation)
    start = nominal.initial_state(i.planet, i.vehicle, flown.entry_flight_path_angle)
    every = round(i.simulation.output_interval / i.simulation.time_step)
    options = {"time_step": i.simulation.time_step, "seed": i.simulation.seed, "every": every}
    return (*plant, gains.law(made, -1), np.tile(start, (trials, 1))), options


# --- the same flight without compiled code ----------------------------------------------------------------------------


def density_variations(air, draw):
    """Density variations (nodes, trials); `draw(number)` gives the normals of a node, from the top downwards."""
    process = air.top_deviation * draw(0)
    variation = np.empty((len(air.altitude), len(process)))
    variation[-1] = process
    for number, node in enumerate(range(len(variation) - 2, -1, -1), start=1):
        process = air.retention[node] * process + air.innovation_deviation[node] * draw(number)
        variation[node] = process
    return variation


def fly_numpy(constants, air, law, states, variation, *, time_step, every):
    """The kernel's scheme, law and outputs in array code, for flights inside both tables.

    Returns history (outputs, 6, trials) and final state (4, trials).
    """
    c = {name: constants[name][0] for name in constants.dtype.names}
    radius, limits = c["planet_radius"], (c["lower_limit"], c["upper_limit"])
    value, slope = air.log_density, air.log_density_slope * air.spacing
    rise = np.diff(value)
    square, cube = 3.0 * rise - 2.0 * slope[:-1] - slope[1:], slope[:-1] + slope[1:] - 2.0 * rise
    trial, last = np.arange(len(states)), len(air.altitude) - 1

    def look_up(altitude):
        position = (altitude - c["bottom"]) * c["cells_per_metre"]
        cell = position.astype(np.intp)
        rest = position - cell
        log_density = value[cell] + rest * (slope[cell] + rest * (square[cell] + rest * cube[cell]))
        position = np.clip((altitude - c["field_bottom"]) * c["nodes_per_metre"], 0.0, last)
        node = np.minimum(position.astype(np.intp), last - 1)
        rest = position - node
        below = variation[node, trial]
        return np.exp(log_density), below + rest * (variation[node + 1, trial] - below)

    def rates(x, control, found):
        r, speed, path = x
        mean, relative = found or look_up(r - radius)
        flux = mean * np.maximum(1.0 + relative, c["density_floor"]) * speed
        gravity, sine = c["gravitational_parameter"] / (r * r), np.sin(path)
        lift = c["lift_factor"] * flux * control
        turn = lift - (gravity / speed - speed / r) * np.cos(path)
        return np.array([speed * sine, -c["drag_factor"] * flux * speed - gravity * sine, turn])

    state, deviations = states.T.copy(), []
    history, floored = [], np.zeros(len(states))

    def observe(found, command):
        mean, relative = found
        pressure = 0.5 * mean * state[flight.SPEED] ** 2
        history.append(np.array([state[0] - radius, *state[1:], relative, pressure, command]))

    for k, steps in enumerate(np.rint(np.diff(law.start) / time_step).astype(int)):
        deviations.append(state - law.reference[k][:, np.newaxis])
        command = law.control[k] + sum(
            gain @ deviation for gain, deviation in zip(law.gain[k], deviations, strict=False)
        )
        control = np.clip(command, *limits)
        for step in range(steps):
            found = look_up(state[0] - radius)
            floored += 1.0 + found[1] < c["density_floor"]
            if step % every == 0:
                observe(found, command)
            first = rates(state, control, found)
            second = rates(state + 0.5 * time_step * first, control, None)
            third = rates(state + 0.5 * time_step * second, control, None)
            fourth = rates(state + time_step * third, control, None)
            state = state + time_step / 6.0 * (first + 2.0 * (second + third) + fourth)
    observe(look_up(state[0] - radius), command)
    return np.array(history), np.array([*history[-1][:3], floored])


# --- measuring programs -----------------------------------------------------------------------------------------------


@contextmanager
def solver_clock(entered=lambda: None):
    """A list that gets the seconds of every run of a solver meanwhile; `entered()` is called before each."""
    from cvxpy.reductions.solvers.solving_chain import SolvingChain

    run, seconds = SolvingChain.solve_via_data, []

    def timed(*args, **options):
        entered()
        start = time.perf_counter()
        result = run(*args, **options)
        seconds.append(time.perf_counter() - start)
        return result

    SolvingChain.solve_via_data = timed
    try:
        yield seconds
    finally:
        SolvingChain.solve_via_data = run


def clocked(function, entered=lambda: None):
    """Seconds outside and inside of the solver that a function takes, and its result."""
    with solver_clock(entered) as seconds:
        start = time.perf_counter()
        result = function()
        total = time.perf_counter() - start
    return total - sum(seconds), sum(seconds), result


def program_in_this_process(form, intervals):
    """Build and solve a program; prints what is known so far as JSON, a line when built and one when solved."""
    resource.setrlimit(resource.RLIMIT_AS, (int(MEMORY_LIMIT * 1e9),) * 2)
    flown = run(PAPER.slug).record("nominal")
    posed = first_program(flown, equal_partition(intervals))
    solve(first_program(flown, equal_partition(4)), form=form)  # loads everything
    start = time.perf_counter()

    def built():
        found = {"build": time.perf_counter() - start, "memory": peak_memory()}
        print(json.dumps(found), flush=True)

    times = []
    while not times or (len(times) < 5 and time.perf_counter() - start < BUDGET):
        build, solver, law = clocked(lambda: solve(posed, form=form), built if not times else lambda: None)
        times.append((build, solver))
    build, solver = (statistics.median(part) for part in zip(*times, strict=True))
    print(json.dumps({"build": build, "solver": solver, "memory": peak_memory(), "objective": law.objective}))


def program_in_own_process(form, intervals):
    """What `program_in_this_process` prints last; with `stopped` (the reason) and `after` (s) if it did not end."""
    command = [sys.executable, str(RUN), "--program", PAPER.slug, form, str(intervals)]
    start, stopped = time.perf_counter(), ""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            printed, complaints = process.communicate(timeout=TIME_LIMIT)
        except subprocess.TimeoutExpired:
            stopped, memory = f"{TIME_LIMIT:g} s", peak_memory(process.pid)
            process.kill()
            printed, complaints = process.communicate()
    known = json.loads(printed.splitlines()[-1]) if printed else {}
    if not stopped and process.returncode:
        killed = process.returncode < 0
        assert killed or "MemoryError" in complaints or "bad_alloc" in complaints, complaints[-3000:]
        stopped, memory = f"{MEMORY_LIMIT:g} GB", known.get("memory", 1e3 * MEMORY_LIMIT)
    return known | ({"stopped": stopped, "after": time.perf_counter() - start, "memory": memory} if stopped else {})


def scaling_of_programs(row):
    """Times of both forms against the number of intervals, and the powers of it that they follow."""
    found = {}
    for form, name in FORMS.items():
        for intervals in INTERVALS:
            say(f"random_field: {name}, {intervals} intervals")
            done = found[form, intervals] = program_in_own_process(form, intervals)
            title = f"{name}, {intervals} intervals"
            if "build" in done:
                row(f"{title}: build", done["build"], "s")
            if "solver" in done:
                row(f"{title}: solver", done["solver"], "s")
            if "stopped" in done:
                stage = "solver" if "build" in done else "build"
                row(f"{title}: stopped in the {stage} at the limit of {done['stopped']}, after", done["after"], "s")
            row(f"{title}: peak memory of the process", done["memory"], "MB")
        for part in ("build", "solver"):
            ended = [(n, found[form, n][part]) for n in INTERVALS if "solver" in found[form, n]][-FITTED:]
            if len(ended) > 1:
                slope = np.polyfit(*np.log(np.array(ended).T), 1)[0]
                sizes = f"{ended[0][0]} to {ended[-1][0]} intervals"
                row(f"{name}: {part} grows with this power of the intervals, {sizes}", slope, "power")
    return found


def compare_forms(row, times, printed_times, intervals, least):
    """Rows of both forms at one size; times: seconds of build and of solver."""
    mine, theirs = sum(times), sum(printed_times)
    title = f"{intervals} intervals"
    row(f"innovations form of {title}, build and solve", mine, "s")
    row(f"printed form of {title}, build and solve", theirs, "s")
    row(f"speed of the innovations form over the printed form, {title}", theirs / mine, "ratio", at_least=least)
    row(f"the printed form's solver alone over all of the other, {title}", printed_times[1] / mine, "ratio")


def both_forms(row, posed, repetitions=7):
    """The paper's program in both forms, taking turns."""
    times = {form: [] for form in FORMS}
    for _ in range(repetitions + 1):
        for form, taken in times.items():
            build, solver, law = clocked(lambda form=form: solve(posed, form=form))
            taken.append((build, solver, law.objective))
    # Without the first round, which loads everything.
    mine, theirs = (np.median(taken[1:], axis=0) for taken in times.values())
    np.testing.assert_allclose(mine[2], theirs[2], rtol=1e-7)
    compare_forms(row, mine[:2], theirs[:2], len(posed.system.control), 8.0)


def repeated_solves(row, posed, further):
    """A compiled program solved for changing numbers, against compiling it, and against translating each of them."""
    compiled, alternating = compile_program(posed), cycle((further, posed))
    for program in (posed, further):
        np.testing.assert_allclose(compiled.solve(program).objective, solve(program).objective, rtol=1e-7)
    first, again, alone = interleaved(
        (
            lambda: compile_program(posed).solve(posed),
            lambda: compiled.solve(next(alternating)),
            lambda: solve(posed),
        )
    )
    row("program compiled and solved for the first time", first, "s")
    row("solved again with other numbers", again, "s")
    row("speed of solving again over the first time", first / again, "ratio", at_least=5.0)
    row("the same without compiling, each program translated with its numbers", alone, "s")
    pays = 1.0 + max(first - alone, 0.0) / (alone - again) if alone > again else np.inf
    row("programs from which on compiling pays", pays, "1")
    build, solver, _ = clocked(lambda: compiled.solve(further))
    row("share of the solver in solving again", solver / (build + solver), "1")


# --- measuring flights ------------------------------------------------------------------------------------------------


def compare_with_array_code(row, flown, made):
    """Agreement of both, then their times with the drawing of all random numbers of the density."""
    posed, options = problem(flown, made, TRIALS)
    air, every = posed[1], options["every"]
    expected = flight.fly(*posed, **options)
    draws = normals(options["seed"], flight.FIELD_STREAM, np.arange(TRIALS), len(air.altitude)).T.copy()
    steps = {"time_step": options["time_step"], "every": every}
    history, final = fly_numpy(*posed, density_variations(air, lambda number: draws[number]), **steps)
    np.testing.assert_allclose(history, expected.history, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(final, expected.final_state, rtol=1e-8, atol=1e-8)

    generator = np.random.Generator(np.random.Philox(options["seed"]))

    def array_code():
        fly_numpy(*posed, density_variations(air, lambda number: generator.standard_normal(TRIALS)), **steps)

    label = f"{TRIALS:,} flights of the last law with outputs"
    compiled, array = interleaved((lambda: flight.fly(*posed, **options), array_code), 5)
    row(f"kernel, {label}", 1e6 * compiled / TRIALS, "us per trial")
    row(f"array code, {label}", 1e6 * array / TRIALS, "us per trial")
    row("speed of the kernel over array code", array / compiled, "ratio", at_least=3.0)


def measure(row):
    """Measure everything of this paper; row: of `measuring.Rows`."""
    numba.set_num_threads(1)
    say("random_field: design")
    paper = designed(PAPER.slug)
    flown, linear, made = (paper.record(name) for name in ("nominal", "linearization", "gains"))
    cpu = []
    for _ in range(3):
        start = time.process_time()
        designed(PAPER.slug)
        cpu.append(time.process_time() - start)
    row("nominal, linear model and laws of three iterations, compiled", statistics.median(cpu), "CPU s")

    say("random_field: both forms of the program")
    posed = first_program(flown, linear.partition)
    both_forms(row, posed)
    say("random_field: a compiled program again")
    (*plant, _, starts), options = problem(flown, made, 1)
    steered = flight.open_loop(linear.partition, made.control[1])
    states = flight.propagate_nominal(*plant, steered, starts[0], time_step=options["time_step"] / 2)[1]
    repeated_solves(row, posed, posed_along(linear.partition, made.control[1], states))
    found = scaling_of_programs(row)
    mine, theirs = ([found[form, LONG].get(part, np.nan) for part in ("build", "solver")] for form in FORMS)
    compare_forms(row, mine, theirs, LONG, 50.0)

    say("random_field: kernel against array code")
    compare_with_array_code(row, flown, made)

    say("random_field: scaling with threads")
    posed, options = problem(flown, made, SCALING_TRIALS)

    def with_threads(number):
        def fly():
            numba.set_num_threads(number)
            flight.fly(*posed, **options)

        return fly

    one, two = interleaved((with_threads(1), with_threads(2)), 5)
    numba.set_num_threads(1)
    row(f"speed of 2 threads over 1 ({CORES} cores)", one / two, "ratio", at_least=1.8)

    laws = len(made.control)
    say(f"random_field: {ALL_TRIALS:,} trials under each of {laws} laws")
    (case,), start = MODEL.CASES, time.process_time()
    flights = ensemble(paper, case, ALL_TRIALS)
    assert (flights.count + flights.excluded == ALL_TRIALS).all()
    title = f"{ALL_TRIALS:,} trials under each of {laws} laws, statistics included"
    row(title, time.process_time() - start, "CPU s")
