"""The entry: flight kernel against strict C and array code, all cells at full size, the dual against a search."""

import ctypes
import statistics
import time
from types import SimpleNamespace

import compiled
import numba
import numpy as np
from measuring import (
    CORES,
    against_c,
    designed,
    ensemble,
    inputs_of,
    interleaved,
    measure_ensembles,
    same_bits,
    say,
    tell_ensemble,
)
from scipy.optimize import elementwise

from marsedl.methods.covariance_steering.lqg_dual import solve, solve_over_weights
from marsedl.methods.guidance.bank_profile import ramped_bank_cosine
from marsedl.methods.guidance.lateral import (
    bank_direction,
    deadband,
    heading_alignment,
    heading_alignment_limit,
    rate_limited_bank,
)
from marsedl.methods.guidance.targeting import targeting_from_sines
from marsedl.models.density_variation import density_factor
from marsedl.models.dynamics.entry import entry_rates_from_sines
from marsedl.montecarlo.ensembles import Trajectories, pad_to_groups
from marsedl.montecarlo.lanes import LANES
from marsedl.montecarlo.streams import normals
from marsedl.papers.stochastic_entry import PAPER, flight, gains, montecarlo
from marsedl.papers.stochastic_entry.inputs import MODEL

PIPELINE_LIMIT = 300.0  # CPU s
FIGURE = "fig12"
TRIALS = 1000  # the paper's
SCALING_TRIALS = 10_000  # enough work for both threads
ALL_TRIALS = 100_000  # of each cell
ENSEMBLE_SIZES = (1_000, 10_000, 100_000, 1_000_000)  # of the two cells with the velocity trigger
LARGEST_MEMORY = 700.0  # MB, of any ensemble, most of it libraries and compiled code
PARTITION = 10.0  # s, 24 intervals
CASES = ("apollo_velocity", "stochastic_velocity")


# --- the problem ------------------------------------------------------------------------------------------------------


def problem(made, case, trials):
    """Settings, air, law and vehicles of a case, as `flight.fly` takes them, and its options."""
    i = inputs_of(PAPER.slug)
    plant = flight.plant_of(i.planet, i.air, i.vehicle, i.mission, i.guidance)
    law = gains.law(i.guidance, made.record("linearization"), made.record("gains"), case)
    vehicles = flight.vehicles_of(plant.dispersions, i.simulation.seed, np.arange(trials))
    trigger, end_time = montecarlo.end_of(i.mission, made.record("nominal"), case)
    options = {"trigger": trigger, "end_time": end_time}
    options |= {"substeps": i.simulation.flight_substeps, "seed": i.simulation.seed}
    return (plant.settings, plant.atmosphere, law, vehicles), options


# --- the same flight without compiled code ----------------------------------------------------------------------------


def density_factors(air, trials, draw):
    """Density over its mean, (nodes, trials); `draw(number)` gives the normals of a node, from the top downwards."""
    factor, process = np.empty((len(air.altitude), trials)), draw(0)
    factor[-1] = density_factor(air.deviation[-1] * process)
    for number, node in enumerate(range(len(factor) - 2, -1, -1), start=1):
        keep = air.retention[node]
        process = keep * process + np.sqrt(1.0 - keep * keep) * draw(number)
        factor[node] = density_factor(air.deviation[node] * process)
    return factor


def fly_numpy(settings, air, law, vehicles, factor, *, cycles, substeps):
    """The kernel's scheme, guidance, outputs and trigger of the velocity cases in array code.

    Flights that have ended are left out of the arrays; the last step of all of them is halved at once in the end.
    Returns history (cycles, 7, trials) and final state without the count of negative densities (8, trials).
    """
    c = SimpleNamespace(**{name: settings[name][0] for name in settings.dtype.names})
    log_step, last = np.diff(air.log_density), len(air.log_density) - 1
    step = c.period / substeps

    def densities(radius, trial):
        position = np.clip((radius - c.planet_radius - c.bottom) * c.nodes_per_metre, 0.0, last)
        node = np.minimum(position.astype(np.intp), last - 1)
        rest = position - node
        below = factor[node, trial]
        return np.exp(air.log_density[node] + rest * log_step[node]) * (
            below + rest * (factor[node + 1, trial] - below)
        )

    def rates(x, trial, vehicle):
        radius, _, latitude, velocity, path, azimuth = x
        sine, cosine, drag_factor, lift_factor = vehicle
        return np.array(
            entry_rates_from_sines(
                *(radius, velocity, (np.sin(latitude), np.cos(latitude)), (np.sin(path), np.cos(path))),
                *((np.sin(azimuth), np.cos(azimuth)), (sine, cosine), densities(radius, trial)),
                *((drag_factor, lift_factor), (c.gravitational_parameter, c.rotation_rate), c.heading_sign),
            )
        )

    def advanced(x, h, trial, vehicle):
        first = rates(x, trial, vehicle)
        second = rates(x + 0.5 * h * first, trial, vehicle)
        third = rates(x + 0.5 * h * second, trial, vehicle)
        fourth = rates(x + h * third, trial, vehicle)
        return x + h / 6.0 * (first + 2.0 * (second + third) + fourth)

    def features(x, trial, drag_factor):
        radius, longitude, latitude, velocity, path, azimuth = x
        to_target = c.target_longitude - longitude
        downrange, crossrange = targeting_from_sines(
            *(radius, velocity, (np.sin(latitude), np.cos(latitude)), (np.sin(to_target), np.cos(to_target))),
            *(np.cos(path), (np.sin(azimuth), np.cos(azimuth)), c.rotation_rate),
            (c.sin_target_latitude, c.cos_target_latitude),
        )
        density = densities(radius, trial)
        drag = drag_factor * density * velocity**2
        feature = (radius, velocity, path, -c.planet_radius * downrange, density, drag, velocity * np.sin(path))
        return np.array(feature), downrange, crossrange

    def corrections(cycle, feature):
        if law.kind == flight.BY_TIME:
            row = min(cycle, len(law.gain) - 1)
            return law.bank_cosine[row] + law.gain[row] @ (feature - law.reference[row][:, np.newaxis])
        radius, velocity = feature[:2]
        row = np.clip(np.searchsorted(law.velocity, velocity, side="right") - 1, 0, len(law.velocity) - 2)
        rest = np.clip((velocity - law.velocity[row]) / (law.velocity[row + 1] - law.velocity[row]), 0.0, 1.0)
        gain = law.gain[row] + rest[:, np.newaxis] * (law.gain[row + 1] - law.gain[row])
        reference = law.reference[row] + rest[:, np.newaxis] * (law.reference[row + 1] - law.reference[row])
        ramp = (c.fast_velocity, c.slow_velocity, c.fast_cosine, c.slow_cosine)
        slowing = feature[flight.DRAG] * velocity > -c.gravitational_parameter / radius**2 * feature[-1]
        corrected = slowing & (velocity <= law.velocity[-1]) & (feature[flight.DRAG] >= law.least_drag)
        change = np.einsum("tj,jt->t", gain, feature) - np.einsum("tj,tj->t", gain, reference)
        return ramped_bank_cosine(velocity, *ramp) + np.where(corrected, change, 0.0)

    trials = len(vehicles.drag_factor)
    history, final = np.full((cycles, flight.HISTORY, trials), np.nan), np.empty((8, trials))
    trial, state = np.arange(trials), vehicles.entry_state.T.copy()
    aero = np.array([vehicles.drag_factor, vehicles.lift_factor])
    direction, reversals = np.full(trials, c.initial_direction), np.zeros(trials)
    bank, aligning = np.zeros(trials), np.zeros(trials, bool)
    ended = []
    for cycle in range(cycles):
        feature, downrange, crossrange = features(state, trial, aero[0])
        velocity = feature[1]
        aligning |= velocity <= c.alignment_velocity
        cosine = np.clip(corrections(cycle, feature), -1.0, 1.0)
        width = deadband(
            *(cycle * c.period, c.deadband_start, c.deadband_start_width, c.deadband_end, c.deadband_end_width)
        )
        turned = np.where(aligning, direction, bank_direction(direction, c.planet_radius * crossrange, width))
        reversals += turned != direction
        direction, command = turned, turned * np.arccos(cosine)
        if aligning.any():
            limits = c.alignment_limit_velocity, c.alignment_first_limit, c.alignment_last_limit
            limit = heading_alignment_limit(velocity, *limits)
            aligned = heading_alignment(downrange, crossrange, c.alignment_gain, limit, c.alignment_form)
            command, cosine = np.where(aligning, aligned, command), np.where(aligning, np.cos(aligned), cosine)
        bank = rate_limited_bank(command, bank, c.largest_bank_change) if cycle else command
        history[cycle, :5, trial], history[cycle, 0, trial] = feature[:5].T, feature[0] - c.planet_radius
        history[cycle, 5, trial], history[cycle, 6, trial] = c.planet_radius * crossrange, cosine
        vehicle = np.array([np.sin(bank), np.cos(bank), *aero])
        for substep in range(substeps):
            before, state = state, advanced(state, step, trial, vehicle)
            done = state[flight.SPEED] <= c.end_velocity
            if done.any():
                start = np.full(np.count_nonzero(done), cycle * c.period + substep * step)
                ended.append((trial[done], before[:, done], vehicle[:, done], start, reversals[done]))
                flying = ~done
                trial, state, aero, vehicle = trial[flying], state[:, flying], aero[:, flying], vehicle[:, flying]
                direction, reversals, bank, aligning = (a[flying] for a in (direction, reversals, bank, aligning))
        if not trial.size:
            break

    trial, before, vehicle, start, reversals = (np.concatenate(part, axis=-1) for part in zip(*ended, strict=True))

    def excess(part, place):
        ahead = advanced(before[:, place], part, trial[place], vehicle[:, place])
        return ahead[flight.SPEED] - c.end_velocity

    ends = np.zeros(len(trial)), np.full(len(trial), step)
    part = elementwise.find_root(excess, ends, args=(np.arange(len(trial)),)).x
    feature, _, crossrange = features(advanced(before, part, trial, vehicle), trial, vehicle[2])
    final[:5, trial], final[5, trial] = feature[:5], c.planet_radius * crossrange
    final[0, trial] -= c.planet_radius
    final[flight.END_TIME, trial], final[flight.REVERSALS, trial] = start + part, reversals
    return history, final


# --- the same flight in C ---------------------------------------------------------------------------------------------

_PROBLEM = compiled.structure(
    "Problem",
    **dict.fromkeys(("settings", "log_density", "log_step", "deviation", "log_retention"), ctypes.c_void_p),
    **dict.fromkeys(("table", "gain", "reference", "bank_cosine"), ctypes.c_void_p),
    **dict.fromkeys(("entry_state", "drag_factor", "lift_factor"), ctypes.c_void_p),
    **dict.fromkeys(("least_drag", "end_time"), ctypes.c_double),
    **dict.fromkeys(("nodes", "kind", "rows", "velocity_trigger", "cycles", "substeps", "trials"), ctypes.c_int64),
    **dict.fromkeys(("seed", "stream", "first_trial"), ctypes.c_uint64),
)


def fly_c(library, settings, air, law, vehicles, *, trigger, end_time, substeps, seed):
    """`flight.fly` in C, with the states of every guidance period and without outcomes."""
    cycles, trials = round(end_time / settings["period"][0]), len(vehicles.drag_factor)
    cycles += cycles * settings["period"][0] < end_time
    velocity_trigger = trigger == "velocity"
    tables = (air.log_density, np.append(np.diff(air.log_density), 0.0), air.deviation, air.log_retention)
    flown = [pad_to_groups(part) for part in (vehicles.entry_state.T, vehicles.drag_factor, vehicles.lift_factor)]
    padded, times = flown[0].shape[1], cycles + (not velocity_trigger)
    arrays = [np.array(part) for part in (settings, *tables, *law[1:5])] + flown
    problem = _PROBLEM(
        *map(compiled.pointer, arrays),
        *(law.least_drag, end_time, len(air.altitude), law.kind, len(law.gain), velocity_trigger, cycles),
        *(substeps, padded, seed, flight.DENSITY_STREAM, 0),
    )
    stored = Trajectories(
        history=np.empty((times, flight.HISTORY, padded)),
        observed=np.empty((times, flight.OBSERVED, padded)),
        observed_maximum=np.zeros((flight.OBSERVED, padded)),
        final_state=np.empty((flight.FINAL, padded)),
        outcome=np.zeros(padded, np.int8),
        length=np.empty(padded, np.int64),
    )
    outputs = stored.history, stored.observed, stored.observed_maximum, stored.length, stored.final_state
    scratch = np.empty((len(air.altitude), LANES))
    library.fly(ctypes.byref(problem), *map(compiled.pointer, (*outputs, scratch)))
    return stored.first(trials)


# --- measuring --------------------------------------------------------------------------------------------------------


def ensemble_in_this_process(trials):
    """Fly and gather this number of trials under each law; prints seconds and peak memory (MB) as JSON."""
    numba.set_num_threads(1)
    made = designed(PAPER.slug)
    ensemble(made, CASES[0], 100)  # loads the compiled code

    def fly():
        for case in CASES:
            flown = ensemble(made, case, trials)
            assert flown.count + flown.excluded == trials

    tell_ensemble(fly, len(CASES) * trials)


def compare_flights(row, made, case):
    """Agreement of the kernel with C and array code, then their times, which include all random numbers."""
    posed, options = problem(made, case, TRIALS)
    seed, substeps = options["seed"], options["substeps"]
    air, nodes = posed[1], len(posed[1].altitude)
    cycles = round(options["end_time"] / inputs_of(PAPER.slug).guidance.guidance_period)

    def kernel():
        return flight.fly(*posed, **options)

    label, expected = f"{TRIALS:,} flights of {case} with outputs", kernel()
    if library := compiled.library("stochastic_entry"):
        same_bits(fly_c(library, *posed, **options), expected)
    draws = normals(seed, flight.DENSITY_STREAM, np.arange(TRIALS), nodes).T.copy()
    factor = density_factors(air, TRIALS, lambda number: draws[number])
    history, final = fly_numpy(*posed, factor, cycles=cycles, substeps=substeps)
    np.testing.assert_allclose(final, expected.final_state[:8], rtol=1e-8, atol=1e-8)
    flying = np.arange(cycles)[:, np.newaxis] < expected.length
    found, stored = (np.moveaxis(table, 1, 2)[flying] for table in (history, expected.history))
    np.testing.assert_allclose(found, stored, rtol=1e-8, atol=1e-8)

    generator = np.random.Generator(np.random.Philox(seed))

    def array_code():
        factor = density_factors(air, TRIALS, lambda number: generator.standard_normal(TRIALS))
        fly_numpy(*posed, factor, cycles=cycles, substeps=substeps)

    if library:
        against_c(row, kernel, lambda: fly_c(library, *posed, **options), label, TRIALS, at_least=0.95)
    taken, array = interleaved((kernel, array_code), 5)
    row(f"kernel, {label}", 1e6 * taken / TRIALS, "us per trial")
    row(f"array code, {label}", 1e6 * array / TRIALS, "us per trial")
    row(f"speed of the kernel over array code, {case}", array / taken, "ratio", at_least=3.0)


def compare_with_search(row, linear):
    """The dual of the stochastic law against the search over LQG weights, on a partition that the search can take."""
    i = inputs_of(PAPER.slug)
    for trigger, name in enumerate(gains.TRIGGERS):
        posed = gains.problem(i.guidance, i.design, linear, trigger, interval=PARTITION)
        dual, search = solve(posed), solve_over_weights(posed)
        assert dual.status == "optimal"
        mine, theirs = interleaved((lambda p=posed: solve(p), lambda p=posed: solve_over_weights(p)))
        row(f"dual of {len(posed.control_limits)} intervals, {name} trigger", mine, "s")
        row("search over LQG weights, the same", theirs, "s")
        row(f"speed of the dual over the search, {name} trigger", theirs / mine, "ratio", at_least=20.0)
        ratio = search.cost / dual.cost
        row(f"cost of the search over that of the dual, {name} trigger", ratio, "ratio", at_least=1 - 1e-6)


def measure(row):
    """Measure everything of this paper; row: of `measuring.Rows`."""
    numba.set_num_threads(1)
    say("stochastic_entry: design")
    made = designed(PAPER.slug)
    cpu = []
    for _ in range(3):
        start = time.process_time()
        designed(PAPER.slug)
        cpu.append(time.process_time() - start)
    row("nominal, linear model and gains, compiled", statistics.median(cpu), "CPU s")
    for case in CASES:
        say(f"stochastic_entry: kernel against C and array code, {case}")
        compare_flights(row, made, case)

    say("stochastic_entry: dual against search")
    compare_with_search(row, made.record("linearization"))

    say("stochastic_entry: scaling with threads")
    posed, options = problem(made, CASES[0], SCALING_TRIALS)

    def with_threads(number):
        def fly():
            numba.set_num_threads(number)
            flight.fly(*posed, **options)

        return fly

    one, two = interleaved((with_threads(1), with_threads(2)), 5)
    numba.set_num_threads(1)
    row(f"speed of 2 threads over 1 ({CORES} cores)", one / two, "ratio", at_least=1.8)

    say(f"stochastic_entry: {ALL_TRIALS:,} trials of all four cells")
    start = time.process_time()
    for case in MODEL.CASES:
        flown = ensemble(made, case, ALL_TRIALS)
        assert flown.count + flown.excluded == ALL_TRIALS
    seconds = time.process_time() - start
    row(f"{ALL_TRIALS:,} trials of all four cells, statistics included", seconds, "CPU s", below=120.0)
    measure_ensembles(row, PAPER, ENSEMBLE_SIZES, LARGEST_MEMORY)
