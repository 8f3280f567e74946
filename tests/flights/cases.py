"""The flights that `cases.yaml` names, of four papers, whose bits `digests.json` holds.

`python tests/flights/cases.py --write` writes that file anew: only for a change that is meant to change flights.

Nothing that is flown depends on a solver, on linear algebra or on the processor: laws are closed formulas, and what
comes from readings is rounded to `DIGITS` significant digits.
"""
# ruff: noqa: E402

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
CASES_FILE, DIGESTS = (Path(__file__).with_name(name) for name in ("cases.yaml", "digests.json"))
if __name__ == "__main__":
    from marsedl.replication.pipeline.numerics import pin_numerics

    pin_numerics(ROOT)  # before numpy is imported

import hashlib
import json
from functools import cache

import numpy as np
import yaml

from marsedl.montecarlo.streams import normals
from marsedl.papers import input_model
from marsedl.papers.desensitized import environment as desensitized_air
from marsedl.papers.desensitized import flight as desensitized_flight
from marsedl.papers.powered_descent import flight as descent_flight
from marsedl.papers.random_field import flight as field_flight
from marsedl.papers.stochastic_entry import environment as entry_air
from marsedl.papers.stochastic_entry import flight as entry_flight
from marsedl.replication.inputs.readings import load_study

ARRAYS = ("history", "observed", "observed_maximum", "final_state", "outcome", "length")
DIGITS = 10
FEW = 129  # trials; no number of them is a multiple of the trials that are flown side by side


def rounded(values, digits=DIGITS):
    """Values to so many significant digits, as a new array."""
    values = np.asarray(values, dtype=float)
    return np.array([float(f"{value:.{digits - 1}e}") for value in values.flat]).reshape(values.shape)


def rounded_record(record):
    """A record of constants, its floating-point ones rounded."""
    if hasattr(record, "_fields"):
        return rounded_tuple(record)
    new = record.copy()
    for name in record.dtype.names:
        if record.dtype[name].kind == "f":
            new[name] = rounded(record[name])
    return new


def rounded_tuple(values):
    """A named tuple, its arrays and floating-point numbers rounded."""
    return values._replace(
        **{
            name: rounded(value) if isinstance(value, np.ndarray) else float(rounded(value))
            for name, value in values._asdict().items()
            if isinstance(value, np.ndarray | float)
        }
    )


@cache
def study(slug):
    return load_study(slug, input_model(slug), ROOT)


def sections(slug, reading="corrected", **changes):
    """The inputs of a reading, with others in place of some, by their names without that of the section."""
    model = input_model(slug)
    inputs = model.from_plain(study(slug).readings[reading].inputs.plain())
    changed = {}
    for name, section in model.sections().items():
        own = {key: value for key, value in changes.items() if key in section.model_fields}
        changed[name] = getattr(inputs, name).model_copy(update=own)
    return inputs.model_copy(update=changed)


def scattered(*shape):
    """Numbers within -1 and 1 without a pattern, by whole numbers alone."""
    numbers = np.arange(int(np.prod(shape)), dtype=np.int64)
    return ((numbers * 7919 + numbers * numbers * 31 + 1047) % 2003 - 1001.0).reshape(shape) / 1001.0


# --- stochastic entry -------------------------------------------------------------------------------------------------

ENTRY_SEED = 20210423


@cache
def entry_plant(changes=(), deviations=1.0):
    """What trials fly in, and the distribution they are drawn from."""
    given = sections("stochastic_entry", **dict(changes))
    plant = entry_flight.plant_of(given)
    air = rounded_tuple(plant.atmosphere)
    return plant._replace(
        settings=rounded_record(plant.settings),
        atmosphere=air._replace(deviation=deviations * air.deviation),
        dispersions=rounded_tuple(plant.dispersions)._replace(body=rounded_tuple(plant.dispersions.body)),
    )


@cache
def entry_reference():
    """What laws feed back of the mean vehicle in still air, in every second; velocities fall. (rows, 7) and (rows,)."""
    plant = entry_plant()
    quiet = plant.dispersions._replace(
        entry_deviations=np.zeros_like(plant.dispersions.entry_deviations), drag_error=0.0, lift_error=0.0
    )
    vehicles = entry_flight.vehicles_of(quiet, 0, np.arange(1))
    air = entry_air.undisturbed(plant.atmosphere)
    flown = entry_flight.fly(
        plant.settings, air, entry_flight.NOMINAL_LAW, vehicles, trigger="velocity", end_time=400.0, substeps=4, seed=0
    )
    altitude, velocity, path_angle, downrange, density, _, cosine = flown.history[: flown.length[0], :, 0].T
    radius = altitude + plant.settings.planet_radius
    drag = vehicles.drag_factor[0] * density * velocity * velocity
    features = (radius, velocity, path_angle, downrange, density, drag, velocity * path_angle)
    return rounded(np.column_stack(features), 6), rounded(cosine, 6)


GAINS = {  # by radius, velocity, flight path angle, downrange, density, drag and altitude rate
    "apollo": np.array([0.0, 0.0, 0.0, -2e-5, 0.0, 0.03, -0.004]),
    "stochastic": np.array([-5e-5, -1e-3, -2.0, -2e-5, 5.0, 0.0, 0.0]),
}


def entry_law(name, by_time=False, factor=1.0, **fields):
    """A law whose gains grow along the reference."""
    if name == "nominal":
        return entry_flight.NOMINAL_LAW
    reference, cosine = entry_reference()
    if not by_time:
        slowing = np.flatnonzero(reference[:, 1] < 5750.0)
        slowing = slowing[slowing > 40][::-1]  # ascending velocities, those behind the peak
        reference, cosine = reference[slowing], cosine[slowing]
    growth = 0.5 + np.arange(len(reference)) / len(reference)
    gain = factor * (growth if by_time else growth[::-1])[:, np.newaxis] * GAINS[name]
    kind = entry_flight.BY_TIME if by_time else entry_flight.BY_VELOCITY
    least_drag = 0.5 if name == "apollo" else 0.0
    return entry_flight.Law(kind, reference[:, 1].copy(), gain, reference, cosine, least_drag)._replace(**fields)


def entry(trials, first, law="nominal", trigger="velocity", by_time=False, **options):
    """Options: `law_fields`, `stored`, `end_time`, `substeps`, `deviations` of the density, and inputs."""
    fields, stored = options.pop("law_fields", {}), options.pop("stored", {})
    end_time = options.pop("end_time", 400.0 if trigger == "velocity" else 240.3)
    substeps, deviations = options.pop("substeps", 4), options.pop("deviations", 1.0)
    plant = entry_plant(tuple(options.items()), deviations)
    vehicles = entry_flight.vehicles_of(plant.dispersions, ENTRY_SEED, np.arange(first, first + trials))
    flown = plant.settings, plant.atmosphere, entry_law(law, by_time, **fields), vehicles
    own = {"trigger": trigger, "end_time": end_time, "substeps": substeps, "seed": ENTRY_SEED, "first_trial": first}
    return entry_flight.fly(*flown, **own, **stored)


# --- powered descent --------------------------------------------------------------------------------------------------

DESCENT_SEED = 20210601
DURATIONS, STEP = (26.0, 15.0), 0.1
GRAVITY = 3.71
DESCENT_PLANT = descent_flight.Plant(GRAVITY, 4.854e-4, 360.0)
DESCENT_START = np.array([250.0, 500.0, 46.985, -17.101, 1500.0])
DESCENT_DEVIATIONS = np.array([6.3246, 6.3246, 2.2361, 2.2361, 0.0])


def descent_schedule(start, duration, step, prior_mass):
    """A cubic to rest at 100 m downrange and 50 m altitude, with feedback that grows on the way."""
    steps, end = round(duration / step), sum(DURATIONS)
    time = start + np.arange(2 * steps + 1) * (step / 2)
    share = time / end
    from_start = 1.0 - share * share * (3.0 - 2.0 * share)
    speed_share = share * (1.0 - share) * (1.0 - share)
    mean, thrust = np.empty((len(time), 4)), np.empty((len(time), 2))
    mass = 1500.0 - 2.9 * time
    for axis, target in enumerate((100.0, 50.0)):
        distance, speed = DESCENT_START[axis] - target, DESCENT_START[2 + axis]
        mean[:, axis] = target + distance * from_start + speed * end * speed_share
        mean[:, 2 + axis] = -6.0 * distance / end * share * (1.0 - share) + speed * (1.0 - share) * (1.0 - 3.0 * share)
        bend = -6.0 * distance / end * (1.0 - 2.0 * share) + speed * (6.0 * share - 4.0)
        thrust[:, axis] = mass * (bend / end + GRAVITY * axis)
    gain = np.zeros((len(time), 2, 4))
    for axis in range(2):
        gain[:, axis, axis], gain[:, axis, 2 + axis] = 60.0 + 4.0 * time, 600.0 + 20.0 * time
        gain[:, axis, 1 - axis], gain[:, axis, 3 - axis] = 5.0 - 0.2 * time, 20.0 - 3.0 * time * axis
    prior = (mass,) if prior_mass else ()
    return descent_flight.Schedule(step, steps, gain, mean, thrust, *prior)


def descent(trials, first, integrator="rk4", held=None, prior_mass=False, open_loop=False, **options):
    """Options: `step`, `segments`, `increments`, `every`, `factor` of the gains, `noise` density, and `widening`."""
    step, segments = options.pop("step", STEP), options.pop("segments", 2)
    increments, every = options.pop("increments", 1), options.pop("every", 5)
    factor, noise = options.pop("factor", 1.0), options.pop("noise", DESCENT_PLANT.noise_density)
    schedules = []
    for start, duration in ((0.0, DURATIONS[0]), DURATIONS)[:segments]:
        schedule = descent_schedule(start, duration, step, prior_mass)
        schedule = schedule._replace(gain=factor * schedule.gain)
        schedule = descent_flight.open_loop(schedule) if open_loop else schedule
        schedules.append(descent_flight.with_held_command(schedule, held) if held else schedule)
    numbers = normals(DESCENT_SEED, descent_flight.INITIAL_STREAM, np.arange(first, first + trials), 4)
    states = DESCENT_START + np.pad(numbers, ((0, 0), (0, 1))) * DESCENT_DEVIATIONS
    flown = schedules, DESCENT_PLANT._replace(noise_density=noise), states
    draws = descent_flight.Draws(DESCENT_SEED, first, increments)
    return descent_flight.fly(*flown, draws, steps_per_output=[every] * segments, integrator=integrator, **options)


# --- desensitized entry -----------------------------------------------------------------------------------------------

INTERVALS, FINAL_TIME = 100, 265.0
FEEDBACK = np.array([-1.77e-8, -0.02, 0.055, -1.77e-7, 1.77e-7, 4.71e-7, 0.0, 0.0])  # keeps trials near the nominal
LANDING_GAINS = {
    "open_loop": np.zeros(8),
    "feedback": FEEDBACK,
    "strong": 10.0 * FEEDBACK,
    "no_number": np.full(8, np.nan),
}
POSITIONS = np.array([1000.0, 3e-4, 3e-4, 0.0, 0.0, 0.0, 0.0, 0.0])  # standard deviations at entry
LANDING_SPREADS = {
    "positions": POSITIONS,
    "wide": np.array([1000.0, 3e-4, 3e-4, 10.0, 10.0, 10.0, 0.05, 1e-4]),
    "far": 100.0 * POSITIONS,
    "none": np.zeros(8),
}


def landing_reference():
    """Two reversals: bank acceleration in smooth pulses, to and fro."""
    middle = (np.arange(INTERVALS) + 0.5) * (FINAL_TIME / INTERVALS)
    control = np.zeros(INTERVALS)
    for switch, turn in ((61.0, 2.157), (211.0, -1.770)):
        phase = (middle - switch) / 30.0
        pulse = np.where(np.abs(phase) < 1.0, -phase * (1.0 - phase * phase), 0.0)
        control += turn / 240.0 * pulse
    start = np.array([126.1e3, 0.0, 0.0, -1769.77, 0.0, 6513.87, -1.4923, 0.0])
    return desensitized_flight.Reference(start, control, FINAL_TIME)


@cache
def landing_surroundings(changes):
    """Constants and density."""
    given = sections("desensitized", **dict(changes))
    constants, cells = desensitized_air.surroundings(given.planet, given.vehicle)
    return rounded_record(constants), rounded(cells)


def landing(trials, first, gain="feedback", spread="positions", bound=None, steep=None, factor=1.0, **options):
    """Steep: the trial of every so many that falls steeply. factor: of the density, or "by_trial"."""
    air, reference = landing_surroundings((("bank_acceleration_bound", bound),) if bound else ()), landing_reference()
    numbers = normals(7, 0, np.arange(first, first + trials), 8)
    states = reference.initial_state + numbers * LANDING_SPREADS[spread]
    if steep:
        states[::steep, 3:6] = [-4338.8, 0.0, 5170.8]
    density = 1.0 + 0.1 * scattered(first + trials)[first:] if factor == "by_trial" else factor
    options = {"density_factor": density, "substeps": 5, "every": 5} | options
    return desensitized_flight.fly(*air, reference, LANDING_GAINS[gain], states, **options)


# --- random field -----------------------------------------------------------------------------------------------------

FIELD_SEED, FIELD_STEP = 20210719, 0.5
PARTITION = np.array([0.0, 50.0, *np.arange(75.0, 351.0, 25.0), 400.0])
PARTITIONS = {
    "usual": PARTITION,
    "unequal": np.array([0.0, 40.0, 45.0, 105.0, 107.5, 180.0, 250.0, 400.0]),
    "short": PARTITION[:4],  # ends in the atmosphere
}
AEROCAPTURE = np.array([3397e3 + 125e3, 6100.0, -0.174994])  # leaves again with zero lift control


@cache
def capture_plant(reading, changes):
    given = sections("random_field", reading, **dict(changes))
    plant = field_flight.plant_of(given)
    return field_flight.Plant(rounded_record(plant.settings), rounded_tuple(plant.air))


@cache
def capture_reference(partition):
    """States at the nodes of a partition, flown with zero control through the mean density."""
    law = field_flight.open_loop(partition, np.zeros(len(partition) - 1))
    _, states = field_flight.propagate_nominal(*capture_plant("corrected", ()), law, AEROCAPTURE, time_step=FIELD_STEP)
    return rounded(states[np.round(law.start / FIELD_STEP).astype(int)], 7)


def field_law(kind, start, reference, scales):
    """A law: "open_loop", "last_node" (feedback of the last node alone), "history" (of all) or "no_number".

    scales: deviations that gains of order one turn into controls of order one.
    """
    intervals, states = len(start) - 1, len(scales)
    control = 0.2 * scattered(intervals)
    if kind == "open_loop":
        return field_flight.open_loop(start, control, states)
    gain = 0.2 * scattered(intervals, intervals + 1, states) / scales
    if kind == "last_node":
        gain = np.where(np.eye(intervals, intervals + 1, dtype=bool)[:, :, np.newaxis], 2.0 * gain, 0.0)
    if kind == "no_number":
        gain[intervals // 2] = np.nan
    return field_flight.Law(start, control, gain, reference)


def capture(trials, first, kind="history", partition="usual", reading="corrected", steep=None, **options):
    """Steep: the trial of every so many that falls steeply. Options: of `fly`, and inputs."""
    own = {name: options.pop(name) for name in ("time_step", "every", "varied") if name in options}
    given = {"time_step": FIELD_STEP, "every": 5, "seed": FIELD_SEED, "first_trial": first} | own
    spread = np.zeros(3) if options.pop("spread", None) == "none" else np.array([300.0, 3.0, 3e-4])
    start = PARTITIONS[partition]
    law = field_law(kind, start, capture_reference(tuple(start)), np.array([1e3, 100.0, 0.01]))
    states = AEROCAPTURE + spread * normals(FIELD_SEED, 0, np.arange(first, first + trials), 3)
    if steep:
        states[::steep] += [0.0, 0.0, -0.07]
    return field_flight.fly(*capture_plant(reading, tuple(options.items())), law, states, **given)


POINT_PARTITIONS = {"usual": np.arange(11.0), "unequal": np.array([0.0, 1.0, 1.5, 4.0, 4.1, 10.0])}
POINT_GRID = np.arange(101) * 0.2 - 10.0


def field_root():
    """A root of a covariance that decays with the distance, without the linear algebra: (nodes, normals)."""
    root = np.zeros((len(POINT_GRID), len(POINT_GRID)))
    for row in range(len(POINT_GRID)):
        for column in range(row + 1):
            power = 0.3 if column == 0 else 0.13
            for _ in range(row - column):
                power *= 0.9
            root[row, column] = power
    return root


def point(trials, first, kind="history", partition="usual", reach=1.0, **options):
    """Reach: factor of the starts, beyond the grid if it is large."""
    start = POINT_PARTITIONS[partition]
    reference = np.column_stack([-5.0 + 0.5 * start, np.full(len(start), 0.5)])
    law = field_law(kind, start, reference, np.array([2.0, 2.0]))
    spread = np.array([0.3, 0.1]) * normals(FIELD_SEED, 0, np.arange(first, first + trials), 2)
    states = reach * np.array([-5.0, 0.5]) + spread
    options = {"time_step": 0.02, "seed": FIELD_SEED, "first_trial": first, "every": 5} | options
    return field_flight.fly_double_integrator(law, POINT_GRID, field_root(), states, **options)


# --- digests ----------------------------------------------------------------------------------------------------------

PREPARED = {function.__name__: function for function in (entry, descent, landing, capture, point)}
CASES = yaml.safe_load(CASES_FILE.read_text(encoding="utf-8"))


def fly(name):
    """The flights of a case, `Trajectories`."""
    options = {"trials": FEW, "first": 0} | CASES[name]
    options = {key: tuple(value) if isinstance(value, list) else value for key, value in options.items()}
    return PREPARED[options.pop("flight")](**options)


def digest(array):
    """Of type, shape and bits, all NaN being one."""
    array = np.ascontiguousarray(array)
    if array.dtype.kind == "f":
        array = np.where(np.isnan(array), np.nan, array)
    head = f"{array.dtype.str}{array.shape}".encode()
    return hashlib.sha256(head + array.tobytes()).hexdigest()[:24]


def digests(name):
    """The digests of what a case flies, by array; what is stored behind a trial's end is of no meaning."""
    flown = fly(name)
    ended = np.arange(len(flown.history))[:, np.newaxis, np.newaxis] >= flown.length
    arrays = {array: getattr(flown, array) for array in ARRAYS}
    arrays |= {array: np.where(ended, np.nan, arrays[array]) for array in ("history", "observed")}
    return {array: digest(values) for array, values in arrays.items()}


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit(f"usage: {sys.argv[0]} --write")
    written = json.dumps({name: digests(name) for name in CASES}, indent=1)
    DIGESTS.write_text(written + "\n", encoding="utf-8")
