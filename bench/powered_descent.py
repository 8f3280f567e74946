"""The powered descent: design, kernel against strict C and array code, scaling with threads, ensembles."""

import measuring
import numpy as np
from measuring import run

from marsedl.montecarlo.ensembles import Trajectories, pad_to_groups
from marsedl.montecarlo.streams import normals
from marsedl.papers.powered_descent import PAPER, flight, segments

FIGURE = "fig07"
TRIALS = 2000  # the paper's
SCALING_TRIALS = 20_000  # enough work for both threads
PAPER_CORE_SECONDS = 12 * 3600 * 32 / 2000  # per trial: 12 h on 32 cores for 2,000 trials
ENSEMBLE = 1_000_000


def problem(gains, trials):
    """Schedules, plant, initial states and draws of the closed loop, as `flight.fly` takes them, and the outputs."""
    i = measuring.inputs_of(PAPER.slug)
    durations, simulation, seed = i.mission.segment_durations, i.simulation, i.ensemble.seed
    steps = [flight.step_count(d, simulation.time_step, simulation.output_interval) for d in durations]
    times = segments.grids(durations, i.design.design_interval)
    schedules = flight.schedules_of(times, gains, [number for number, _ in steps])
    start = flight.Start(segments.initial_mean(i.entry), i.entry.initial_covariance, i.vehicle.wet_mass)
    states = flight.initial_states(start, seed, np.arange(trials))
    plant = flight.plant_of(i)
    return (schedules, plant, states, flight.Draws(seed, 0)), [every for _, every in steps]


def fly_numpy(schedules, plant, every, states, draw):
    """The kernel's scheme and outputs in array code; `draw()` gives the normals (2, trials) of a step."""
    state, largest, history, observed = states.T, np.full((2, len(states)), -np.inf), [], []

    def control(x, schedule, row):
        mean, feedforward = schedule.mean[row, :, np.newaxis], schedule.feedforward[row, :, np.newaxis]
        thrust = feedforward - schedule.gain[row] @ (x[:4] - mean)
        return thrust, np.sqrt(thrust[0] * thrust[0] + thrust[1] * thrust[1])

    def drift(x, schedule, row, force):
        thrust, magnitude = control(x, schedule, row)
        across, down = (thrust + force) / x[4]
        return np.array([x[2], x[3], across, down - plant.gravity, -plant.mass_flow_constant * magnitude])

    for schedule, steps_per_output in zip(schedules, every, strict=True):
        step, scale = schedule.step, plant.noise_density / np.sqrt(schedule.step)
        for k in range(schedule.steps + 1):
            seen = np.array([control(state, schedule, 2 * k)[1], -state[1]])
            largest = np.maximum(largest, seen)
            if k % steps_per_output == 0:
                history.append(state), observed.append(seen)
            if k < schedule.steps:
                force = scale * draw()
                first = drift(state, schedule, 2 * k, force)
                second = drift(state + step / 2 * first, schedule, 2 * k + 1, force)
                third = drift(state + step / 2 * second, schedule, 2 * k + 1, force)
                fourth = drift(state + step * third, schedule, 2 * k + 2, force)
                state = state + step / 6 * (first + 2 * (second + third) + fourth)
    return np.array(history), np.array(observed), largest, state


def fly_c(library, schedules, plant, initial_states, draws, *, steps_per_output):
    """`flight.fly` in C, without outcomes."""
    counts = [s.steps // n + 1 for s, n in zip(schedules, steps_per_output, strict=True)]
    states = pad_to_groups(initial_states.T)
    trials, output, increment = states.shape[1], 0, 0
    history, observed = (np.empty((sum(counts), rows, trials)) for rows in (len(states), 2))
    outcome, length = np.zeros(trials, np.int8), np.full(trials, sum(counts), np.int64)
    flown = Trajectories(history, observed, np.full((2, trials), -np.inf), states, outcome, length)
    for control, every, count in zip(schedules, steps_per_output, counts, strict=True):
        values = [control.gain, control.mean, control.feedforward, *map(float, (*plant, control.step))]
        values += [control.steps, every, trials, increment, draws.seed, flight.NOISE_STREAM, draws.first_trial]
        stored = flown.history[output : output + count], flown.observed[output : output + count]
        measuring.call(library.fly_segment, values, (flown.final_state, *stored, flown.observed_maximum))
        output, increment = output + count, increment + control.steps
    return flown.first(len(initial_states))


def compare(row, gains):
    """Agreement of the kernel with C and array code, then their times."""
    posed, every = problem(gains, TRIALS)
    schedules, plant, states, (seed, *_) = posed
    flights = {"kernel": lambda: flight.fly(*posed, steps_per_output=every)}
    expected = flights["kernel"]()
    steps = sum(schedule.steps for schedule in schedules)
    draws = normals(seed, flight.NOISE_STREAM, np.arange(TRIALS), 2 * steps).reshape(TRIALS, steps, 2)
    replayed = iter(np.ascontiguousarray(draws.transpose(1, 2, 0)))
    found = fly_numpy(schedules, plant, every, states, lambda: next(replayed))
    stored = expected.history, expected.observed, expected.observed_maximum, expected.final_state
    for mine, theirs in zip(found, stored, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-9)
    normal = np.random.Generator(np.random.Philox(seed)).standard_normal
    flights["array code"] = lambda: fly_numpy(schedules, plant, every, states, lambda: normal((2, TRIALS)))
    if library := measuring.library("powered_descent"):
        flights["strict C"] = lambda: fly_c(library, *posed, steps_per_output=every)
        measuring.same_bits(flights["strict C"](), expected)
    label = f"{TRIALS:,} trials with outputs"
    seconds = measuring.compare_flights(row, label, TRIALS, flights, at_least=0.88)
    row("speed of the kernel over array code", seconds["array code"] / seconds["kernel"], "ratio", at_least=3.0)


def measure(row):
    """Measure everything of this paper; row: `measuring.add_row` for it."""
    made = measuring.designed(PAPER.slug)
    design = measuring.cpu_seconds(lambda: run(PAPER.slug).record("nominal"), measuring.REPETITIONS)
    row("design with mass iteration, compiled", design, "CPU s", below=1.0)
    compare(row, made.record("gains"))
    posed, _ = problem(made.record("gains"), SCALING_TRIALS)
    whole = [schedule.steps for schedule in posed[0]]
    measuring.scaling(row, lambda: flight.fly(*posed, steps_per_output=whole))
    ours = measuring.ensembles_seconds(made, ["closed_loop"], ENSEMBLE) / ENSEMBLE
    row(f"ensemble of {ENSEMBLE:,} trials, speed", 1 / ours, "trials per s and core")
    row("ensemble, statistics included", ours, "core-s per trial")
    row("the same in the paper", PAPER_CORE_SECONDS, "core-s per trial")
    row("paper over ours", PAPER_CORE_SECONDS / ours, "ratio")
