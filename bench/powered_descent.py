"""The powered descent: kernel against strict C, array code and adaptive integration, scaling, ensembles, design."""

import ctypes
import statistics
import time

import compiled
import numba
import numpy as np
from measuring import (
    CORES,
    REPETITIONS,
    against_c,
    ensemble,
    inputs_of,
    interleaved,
    measure_ensembles,
    run,
    same_bits,
    say,
    sections,
    tell_ensemble,
)
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from marsedl.montecarlo.ensembles import new_trajectories, output_count
from marsedl.montecarlo.streams import normals
from marsedl.papers.powered_descent import PAPER, flight, nominal, segments

PIPELINE_LIMIT = 120.0  # CPU s
FIGURE = "fig07"
TRIALS = 2000  # the paper's
SCALING_TRIALS = 20_000  # enough work for both threads
ADAPTIVE_TRIALS = 3
PAPER_CORE_SECONDS = 12 * 3600 * 32 / 2000  # per trial: 12 h on 32 cores for 2,000 trials
ENSEMBLE_SIZES = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
LARGEST_MEMORY = 500.0  # MB, of any ensemble, most of it libraries and compiled code


# --- the problem ------------------------------------------------------------------------------------------------------


def problem(gains, trials):
    """Schedules, plant, initial states and draws of the closed loop, as `flight.fly` takes them, and the outputs."""
    i = inputs_of(PAPER.slug)
    durations, simulation, seed = i.mission.segment_durations, i.simulation, i.ensemble.seed
    steps = [flight.step_count(d, simulation.time_step, simulation.output_interval) for d in durations]
    times = segments.grids(durations, i.design.design_interval)
    schedules = flight.schedules_of(times, gains, [number for number, _ in steps])
    start = flight.Start(segments.initial_mean(i.entry), i.entry.initial_covariance, i.vehicle.wet_mass)
    states = flight.initial_states(start, seed, np.arange(trials))
    plant = flight.plant_of(i.planet, i.vehicle, i.noise)
    return (schedules, plant, states, flight.Draws(seed, 0)), [every for _, every in steps]


# --- the same flight without compiled code ----------------------------------------------------------------------------


def fly_numpy(schedules, plant, every, states, fill):
    """The kernel's scheme and outputs in array code; `fill(out)` writes the normals (2, trials) of a step."""
    state = np.ascontiguousarray(states.T)
    trials = state.shape[1]
    slope, stage, total, scaled = (np.empty_like(state) for _ in range(4))
    error, thrust, force = np.empty((4, trials)), np.empty((2, trials)), np.empty((2, trials))
    magnitude, square, depth = (np.empty(trials) for _ in range(3))
    largest = np.full((2, trials), -np.inf)
    histories, observations = [], []

    def control(x, mean, gain, feedforward):
        np.subtract(x[:4], mean, out=error)
        np.matmul(gain, error, out=thrust)
        np.subtract(feedforward, thrust, out=thrust)
        np.multiply(thrust[0], thrust[0], out=magnitude)
        np.multiply(thrust[1], thrust[1], out=square)
        np.add(magnitude, square, out=magnitude)
        np.sqrt(magnitude, out=magnitude)

    def drift(x):
        slope[:2] = x[2:4]
        np.add(thrust, force, out=slope[2:4])
        np.divide(slope[2:4], x[4], out=slope[2:4])
        np.subtract(slope[3], plant.gravity, out=slope[3])
        np.multiply(magnitude, -plant.mass_flow_constant, out=slope[4])

    def observe(output):
        np.negative(state[1], out=depth)
        np.maximum(largest[0], magnitude, out=largest[0])
        np.maximum(largest[1], depth, out=largest[1])
        if output is not None:
            history[output] = state
            observed[output, 0] = magnitude
            observed[output, 1] = depth

    for schedule, steps_per_output in zip(schedules, every, strict=True):
        step, steps, gain = schedule.step, schedule.steps, schedule.gain
        mean, feedforward = schedule.mean[:, :, np.newaxis], schedule.feedforward[:, :, np.newaxis]
        history = np.empty((steps // steps_per_output + 1, 5, trials))
        observed = np.empty((len(history), 2, trials))
        for k in range(steps):
            fill(force)
            np.multiply(force, plant.noise_density / np.sqrt(step), out=force)
            control(state, mean[2 * k], gain[2 * k], feedforward[2 * k])
            observe(k // steps_per_output if k % steps_per_output == 0 else None)
            drift(state)
            np.copyto(total, slope)
            for half_index, length, weight in (
                (2 * k + 1, step / 2, 2),
                (2 * k + 1, step / 2, 2),
                (2 * k + 2, step, 1),
            ):
                np.multiply(slope, length, out=stage)
                np.add(stage, state, out=stage)
                control(stage, mean[half_index], gain[half_index], feedforward[half_index])
                drift(stage)
                np.multiply(slope, weight, out=scaled)
                np.add(total, scaled, out=total)
            np.multiply(total, step / 6, out=total)
            np.add(state, total, out=state)
        control(state, mean[-1], gain[-1], feedforward[-1])
        observe(steps // steps_per_output)
        histories.append(history)
        observations.append(observed)
    return np.concatenate(histories), np.concatenate(observations), largest, state


def fly_adaptive(schedules, plant, state, draws):
    """One trial by scipy's adaptive Runge-Kutta method; draws: normals (steps, 2) of the force held over each step."""
    first = 0
    for schedule in schedules:
        duration, step = schedule.step * schedule.steps, schedule.step
        tables = np.concatenate([schedule.gain.reshape(-1, 8), schedule.mean, schedule.feedforward], axis=1)
        spline = CubicSpline(np.linspace(0.0, duration, len(tables)), tables)
        forces = plant.noise_density / np.sqrt(step) * draws[first : first + schedule.steps]

        def rates(t, x, spline=spline, forces=forces, step=step):
            row = spline(t)
            thrust = row[12:] - row[:8].reshape(2, 4) @ (x[:4] - row[8:12])
            rate = (thrust + forces[min(int(t / step), len(forces) - 1)]) / x[4]
            loss = -plant.mass_flow_constant * np.sqrt(thrust @ thrust)
            return np.array([x[2], x[3], rate[0], rate[1] - plant.gravity, loss])

        state = solve_ivp(rates, (0.0, duration), state, rtol=1e-6).y[:, -1]
        first += schedule.steps
    return state


# --- the same flight in C ---------------------------------------------------------------------------------------------

_SEGMENT = compiled.structure(
    "Segment",
    **dict.fromkeys(("gain", "mean", "feedforward"), ctypes.c_void_p),
    **dict.fromkeys(("gravity", "mass_flow", "noise_density", "step"), ctypes.c_double),
    **dict.fromkeys(("steps", "every", "trials", "first_increment"), ctypes.c_int64),
    **dict.fromkeys(("seed", "stream", "first_trial"), ctypes.c_uint64),
)


def fly_c(library, schedules, plant, initial_states, draws, *, steps_per_output):
    """`flight.fly` in C, without outcomes."""
    counts = [output_count(s.steps, n) for s, n in zip(schedules, steps_per_output, strict=True)]
    flown = new_trajectories(initial_states.T, sum(counts), flight.OBSERVED)
    trials, output, increment = flown.final_state.shape[1], 0, 0
    for control, every, count in zip(schedules, steps_per_output, counts, strict=True):
        segment = _SEGMENT(
            *map(compiled.pointer, (control.gain, control.mean, control.feedforward)),
            *(*plant, control.step, control.steps, every, trials, increment),
            *(draws.seed, flight.NOISE_STREAM, draws.first_trial),
        )
        stored = flown.history[output : output + count], flown.observed[output : output + count]
        arrays = (flown.final_state, *stored, flown.observed_maximum)
        library.fly_segment(ctypes.byref(segment), *map(compiled.pointer, arrays))
        output, increment = output + count, increment + control.steps
    return flown.first(len(initial_states))


# --- measuring --------------------------------------------------------------------------------------------------------


def ensemble_in_this_process(trials):
    """Fly and gather an ensemble; prints seconds and peak memory (MB) as JSON."""
    numba.set_num_threads(1)
    design = run(PAPER.slug)
    ensemble(design, "closed_loop", 100)  # designs, and loads the compiled code

    def fly():
        flown = ensemble(design, "closed_loop", trials)
        assert flown.count + flown.excluded == trials

    tell_ensemble(fly, trials)


def compare_flights(row, gains):
    """Agreement of the kernel with C, array code and adaptive integration, then their times."""
    posed, every = problem(gains, TRIALS)
    schedules, plant, states, (seed, *_) = posed

    def kernel():
        return flight.fly(*posed, steps_per_output=every)

    say("powered_descent: kernel, C, array code and adaptive integration agree")
    steps = sum(schedule.steps for schedule in schedules)
    draws = normals(seed, flight.NOISE_STREAM, np.arange(TRIALS), 2 * steps).reshape(TRIALS, steps, 2)
    replayed = iter(np.ascontiguousarray(draws.transpose(1, 2, 0)))
    expected = kernel()
    if library := compiled.library("powered_descent"):
        same_bits(fly_c(library, *posed, steps_per_output=every), expected)
    found = fly_numpy(schedules, plant, every, states, lambda out: np.copyto(out, next(replayed)))
    pairs = zip(
        found, (expected.history, expected.observed, expected.observed_maximum, expected.final_state), strict=True
    )
    for mine, theirs in pairs:
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-9)
    adaptive = [fly_adaptive(schedules, plant, states[trial], draws[trial]) for trial in range(ADAPTIVE_TRIALS)]
    np.testing.assert_allclose(
        adaptive, expected.final_state.T[:ADAPTIVE_TRIALS], atol=0.3
    )  # its error control is loose

    label = f"{TRIALS:,} trials with outputs"
    if library:
        say("powered_descent: kernel against strict C")
        against_c(row, kernel, lambda: fly_c(library, *posed, steps_per_output=every), label, TRIALS, at_least=0.88)
    say("powered_descent: kernel against array code")
    generator = np.random.Generator(np.random.Philox(seed))
    taken, array = interleaved(
        (kernel, lambda: fly_numpy(schedules, plant, every, states, lambda out: generator.standard_normal(out=out)))
    )
    row(f"kernel, {label}", 1e6 * taken / TRIALS, "us per trial")
    row(f"array code, {label}", 1e6 * array / TRIALS, "us per trial")
    row("speed of the kernel over array code", array / taken, "ratio", at_least=3.0)

    say("powered_descent: kernel against adaptive integration")

    def each_adaptive():
        for trial in range(ADAPTIVE_TRIALS):
            fly_adaptive(schedules, plant, states[trial], draws[trial])

    taken, adaptive = interleaved((kernel, each_adaptive), 3)
    row("adaptive integration (scipy, RK45, 1e-6)", 1e6 * adaptive / ADAPTIVE_TRIALS, "us per trial")
    ratio = (adaptive / ADAPTIVE_TRIALS) / (taken / TRIALS)
    row("speed of the kernel over adaptive integration", ratio, "ratio", at_least=100.0)


def measure(row):
    """Measure everything of this paper; row: of `measuring.Rows`."""
    numba.set_num_threads(1)
    say("powered_descent: design")
    gains = run(PAPER.slug).record("gains")
    cpu, taken = [], sections(PAPER.slug, nominal.compute)
    for _ in range(REPETITIONS):
        start = time.process_time()
        nominal.compute(**taken)
        cpu.append(time.process_time() - start)
    row("design with mass iteration, compiled", statistics.median(cpu), "CPU s", below=1.0)

    compare_flights(row, gains)

    say("powered_descent: scaling with threads")
    posed, _ = problem(gains, SCALING_TRIALS)

    def with_threads(number):
        def fly():
            numba.set_num_threads(number)
            flight.fly(*posed, steps_per_output=[schedule.steps for schedule in posed[0]])

        return fly

    one, two = interleaved((with_threads(1), with_threads(2)))
    numba.set_num_threads(1)
    row(f"speed of 2 threads over 1 ({CORES} cores)", one / two, "ratio", at_least=1.8)

    ours = measure_ensembles(row, PAPER, ENSEMBLE_SIZES, LARGEST_MEMORY) / max(ENSEMBLE_SIZES)
    row("ensemble, statistics included", ours, "core-s per trial")
    row("the same in the paper", PAPER_CORE_SECONDS, "core-s per trial")
    row("paper over ours", PAPER_CORE_SECONDS / ours, "ratio")
