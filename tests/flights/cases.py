"""Named flights of four papers, whose bits `digests.json` holds.

`python tests/flights/cases.py --write` writes that file anew: only for a change that is meant to change flights.

Nothing that is flown depends on a solver, on linear algebra or on the processor: laws are closed formulas, and what
comes from readings is rounded to `DIGITS` significant digits.
"""
# ruff: noqa: E402

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
DIGESTS = Path(__file__).with_name("digests.json")
if __name__ == "__main__":
    from marsedl.replication.pipeline.numerics import pin_numerics

    pin_numerics(ROOT)  # before numpy is imported

import hashlib
import json
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

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
FEW, SOME, MANY = 129, 257, 2049  # trials, none a multiple of the trials that are flown side by side


class Case(NamedTuple):
    """A flight, and which of its trials `digests.json` holds."""

    prepare: Callable  # prepare(trials, first) returns a function that flies them
    trials: int = FEW
    first: int = 0

    def fly(self):
        """Fly the trials; returns `Trajectories`."""
        return self.prepare(self.trials, self.first)()


CASES: dict[str, Case] = {}


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


def entry(
    law="nominal",
    trigger="velocity",
    by_time=False,
    law_fields=None,
    end_time=None,
    substeps=4,
    deviations=1.0,
    **options,
):
    """A flight; options: `stored`, and inputs in place of those of the reading."""
    stored = options.pop("stored", {})
    end_time = end_time or (400.0 if trigger == "velocity" else 240.3)

    def prepare(trials, first):
        plant = entry_plant(tuple(options.items()), deviations)
        flown = entry_law(law, by_time, **(law_fields or {}))
        vehicles = entry_flight.vehicles_of(plant.dispersions, ENTRY_SEED, np.arange(first, first + trials))
        return lambda: entry_flight.fly(
            plant.settings,
            plant.atmosphere,
            flown,
            vehicles,
            trigger=trigger,
            end_time=end_time,
            substeps=substeps,
            seed=ENTRY_SEED,
            first_trial=first,
            **stored,
        )

    return prepare


ENTRIES = {
    "nominal": {},
    "apollo_velocity": {"law": "apollo"},
    "apollo_time": {"law": "apollo", "trigger": "time"},
    "stochastic_velocity": {"law": "stochastic", "by_time": True},
    "stochastic_time": {"law": "stochastic", "by_time": True, "trigger": "time"},
}
for name, options in ENTRIES.items():
    slug = f"stochastic_entry/{name}"
    CASES[slug] = Case(entry(**options), MANY if name in ("apollo_velocity", "stochastic_time") else SOME)
    CASES[f"{slug}/printed_rate_limit"] = Case(entry(**options, rate_limit_form="printed"))
    CASES[f"{slug}/printed_alignment"] = Case(entry(**options, heading_alignment_form="printed"))
    CASES[f"{slug}/period_2s"] = Case(entry(**options, guidance_period=2.0))
for name in ("apollo_velocity", "stochastic_time"):
    slug, options = f"stochastic_entry/{name}", ENTRIES[name]
    for number in (0, 77, 999):
        CASES[f"{slug}/trial_{number}"] = Case(entry(**options), 1, number)
    CASES[f"{slug}/from_101"] = Case(entry(**options), 333, 101)
    CASES[f"{slug}/printed_heading_sign"] = Case(entry(**options, heading_rate_form="printed"))
    CASES[f"{slug}/narrow_deadband"] = Case(entry(**options, deadband_widths=(1500.0, 300.0)))
    CASES[f"{slug}/printed_heading_sign_and_alignment"] = Case(
        entry(**options, heading_rate_form="printed", heading_alignment_form="printed")
    )
    CASES[f"{slug}/start_right"] = Case(entry(**options, initial_bank_direction=1))
    CASES[f"{slug}/weak_alignment"] = Case(entry(**options, heading_alignment_gain=3.0))
    CASES[f"{slug}/alignment_limits_reversed"] = Case(
        entry(**options, heading_alignment_limits=(0.6, 0.8), heading_alignment_limit_velocity=1000.0)
    )
    CASES[f"{slug}/stored_1"] = Case(entry(**options, stored={"every": 1}))
    CASES[f"{slug}/stored_2"] = Case(entry(**options, stored={"every": 2}))
    CASES[f"{slug}/place"] = Case(entry(**options, stored={"place": True}))
    CASES[f"{slug}/place_stored_1"] = Case(entry(**options, stored={"every": 1, "place": True}))
    CASES[f"{slug}/substeps_20"] = Case(entry(**options, substeps=20), 65)
    CASES[f"{slug}/substeps_1"] = Case(entry(**options, substeps=1))
    CASES[f"{slug}/ends_within"] = Case(entry(**options, law_fields={"ends_within": True}), SOME)
    CASES[f"{slug}/ends_within_stored_1"] = Case(
        entry(**options, law_fields={"ends_within": True}, stored={"every": 1})
    )
    CASES[f"{slug}/ends_within_printed_rate_limit"] = Case(
        entry(**options, law_fields={"ends_within": True}, rate_limit_form="printed")
    )
    CASES[f"{slug}/strong_gains"] = Case(entry(**options, law_fields={"factor": 20.0}))
    CASES[f"{slug}/no_number"] = Case(entry(**options, law_fields={"factor": np.nan}), 65)
    CASES[f"{slug}/deviations_20"] = Case(entry(**options, deviations=20.0))
    CASES[f"{slug}/still_air"] = Case(entry(**options, deviations=0.0))
for name in ("nominal", "apollo_velocity", "stochastic_velocity"):
    slug, options = f"stochastic_entry/{name}", ENTRIES[name]
    CASES[f"{slug}/late_trigger"] = Case(entry(**options, end_time=225.0))  # some trials reach it
    CASES[f"{slug}/no_trigger"] = Case(entry(**options, end_time=150.0))
    CASES[f"{slug}/began_below"] = Case(entry(**options, end_velocity=5800.0))  # half of them
CASES["stochastic_entry/nominal_time"] = Case(entry(trigger="time"))
CASES["stochastic_entry/stochastic_velocity_by_velocity"] = Case(entry("stochastic"))
CASES["stochastic_entry/apollo_velocity_by_time"] = Case(entry("apollo", by_time=True))
CASES["stochastic_entry/stochastic_time/whole_periods"] = Case(entry(**ENTRIES["stochastic_time"], end_time=231.0))
CASES["stochastic_entry/stochastic_time/some_crash"] = Case(entry(**ENTRIES["stochastic_time"], end_time=320.0))
CASES["stochastic_entry/apollo_time/all_crash"] = Case(entry(**ENTRIES["apollo_time"], end_time=380.0), 65)


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


def descent(integrator="rk4", held=None, *, prior_mass=False, open_loop=False, step=STEP, segments=2, **options):
    """A flight; options: `widening`, increments of a step, `every`, factor of the gains and noise density."""
    increments, every = options.pop("increments", 1), options.pop("every", 5)
    factor, noise = options.pop("factor", 1.0), options.pop("noise", DESCENT_PLANT.noise_density)

    def prepare(trials, first):
        starts = (0.0, DURATIONS[0])
        schedules = [
            descent_schedule(start, duration, step, prior_mass)
            for start, duration in list(zip(starts, DURATIONS, strict=True))[:segments]
        ]
        schedules = [schedule._replace(gain=factor * schedule.gain) for schedule in schedules]
        if open_loop:
            schedules = [descent_flight.open_loop(schedule) for schedule in schedules]
        if held:
            schedules = [descent_flight.with_held_command(schedule, held) for schedule in schedules]
        numbers = normals(DESCENT_SEED, descent_flight.INITIAL_STREAM, np.arange(first, first + trials), 4)
        states = DESCENT_START + np.pad(numbers, ((0, 0), (0, 1))) * DESCENT_DEVIATIONS
        draws = descent_flight.Draws(DESCENT_SEED, first, increments)
        plant = DESCENT_PLANT._replace(noise_density=noise)
        outputs = [every] * segments
        return lambda: descent_flight.fly(
            schedules, plant, states, draws, steps_per_output=outputs, integrator=integrator, **options
        )

    return prepare


for integrator in descent_flight.INTEGRATORS:
    slug = f"powered_descent/{integrator}"
    for name, held in (("continuous", None), ("held_0.5s", 0.5), ("held_1s", 1.0)):
        CASES[f"{slug}/{name}"] = Case(descent(integrator, held), MANY if (integrator, held) == ("rk4", None) else SOME)
        CASES[f"{slug}/{name}/prior_mass"] = Case(descent(integrator, held, prior_mass=True))
    CASES[f"{slug}/held_0.7s"] = Case(descent(integrator, 0.7))  # divides neither segment
    CASES[f"{slug}/widening_2"] = Case(descent(integrator, widening=2.0))
    for increments in (2, 4):
        CASES[f"{slug}/increments_{increments}"] = Case(descent(integrator, increments=increments))
    CASES[f"{slug}/trial_77"] = Case(descent(integrator), 1, 77)
    CASES[f"{slug}/from_101"] = Case(descent(integrator), 333, 101)
    CASES[f"{slug}/open_loop"] = Case(descent(integrator, open_loop=True), SOME)
    CASES[f"{slug}/one_segment"] = Case(descent(integrator, segments=1))
    CASES[f"{slug}/stored_1"] = Case(descent(integrator, every=1))
    CASES[f"{slug}/no_number"] = Case(descent(integrator, factor=np.nan), 65)
    CASES[f"{slug}/no_noise"] = Case(descent(integrator, noise=0.0), 65)
CASES["powered_descent/rk4/held_0.5s/increments_2"] = Case(descent("rk4", 0.5, increments=2))
CASES["powered_descent/rk4/held_0.5s/widening_2"] = Case(descent("rk4", 0.5, widening=2.0))
CASES["powered_descent/rk4/held_0.5s/stored_1"] = Case(descent("rk4", 0.5, every=1))
CASES["powered_descent/rk4/held_0.5s/trial_77"] = Case(descent("rk4", 0.5), 1, 77)
CASES["powered_descent/rk4/fine_steps"] = Case(descent(step=0.05, every=10))


# --- desensitized entry -----------------------------------------------------------------------------------------------

INTERVALS, FINAL_TIME = 100, 265.0
# A gain that keeps trials near the nominal, and standard deviations at entry.
FEEDBACK = np.array([-1.77e-8, -0.02, 0.055, -1.77e-7, 1.77e-7, 4.71e-7, 0.0, 0.0])
POSITIONS = np.array([1000.0, 3e-4, 3e-4, 0.0, 0.0, 0.0, 0.0, 0.0])
WIDE = np.array([1000.0, 3e-4, 3e-4, 10.0, 10.0, 10.0, 0.05, 1e-4])
NARROW = 3.5e-3  # a bound that the nominal keeps and many trials reach


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
def landing_surroundings(reading, bound):
    """Constants and density of a reading."""
    given = sections("desensitized", reading, **({} if bound is None else {"bank_acceleration_bound": bound}))
    constants, cells = desensitized_air.surroundings(given.planet, given.vehicle)
    return rounded_record(constants), rounded(cells)


def landing(gain=FEEDBACK, spread=POSITIONS, *, reading="corrected", bound=None, steep=None, factor=None, **options):
    """A flight; steep: the trial of every so many that falls steeply. factor: of the density, or "by_trial"."""
    options = {"substeps": 5, "every": 5} | options

    def prepare(trials, first):
        air, reference = landing_surroundings(reading, bound), landing_reference()
        numbers = normals(7, 0, np.arange(first, first + trials), 8)
        states = reference.initial_state + numbers * spread
        if steep:
            states[::steep, 3:6] = [-4338.8, 0.0, 5170.8]
        density = 1.0 if factor is None else factor
        if density == "by_trial":
            density = 1.0 + 0.1 * scattered(first + trials)[first:]
        return lambda: desensitized_flight.fly(*air, reference, gain, states, density_factor=density, **options)

    return prepare


OPEN = np.zeros(8)
for name, gain in (("open_loop", OPEN), ("feedback", FEEDBACK), ("strong_feedback", 10.0 * FEEDBACK)):
    slug = f"desensitized/{name}"
    CASES[slug] = Case(landing(gain), MANY if name == "feedback" else SOME)
    CASES[f"{slug}/all_states"] = Case(landing(gain, WIDE))
    CASES[f"{slug}/narrow_bound"] = Case(landing(gain, WIDE, bound=NARROW))
    CASES[f"{slug}/density"] = Case(landing(gain, factor="by_trial"))
    CASES[f"{slug}/some_crash"] = Case(landing(gain, steep=3))
    CASES[f"{slug}/all_crash"] = Case(landing(gain, steep=1), 65)
CASES |= {
    "desensitized/feedback/density_of_all": Case(landing(factor=1.05)),
    "desensitized/feedback/trial_77": Case(landing(), 1, 77),
    "desensitized/feedback/from_101": Case(landing(), 333, 101),
    "desensitized/feedback/stored_1": Case(landing(every=1)),
    "desensitized/feedback/stored_50": Case(landing(every=50)),
    "desensitized/feedback/substeps_1": Case(landing(substeps=1)),
    "desensitized/feedback/substeps_20": Case(landing(substeps=20), 65),
    "desensitized/feedback/stored_1_some_crash": Case(landing(every=1, steep=2)),
    "desensitized/feedback/without_deviations": Case(landing(spread=np.zeros(8)), 65),
    "desensitized/feedback/beyond_the_table": Case(landing(spread=100.0 * POSITIONS)),
    "desensitized/feedback/no_number": Case(landing(np.full(8, np.nan)), 65),
}


# --- random field -----------------------------------------------------------------------------------------------------

FIELD_SEED, FIELD_STEP = 20210719, 0.5
PARTITION = np.array([0.0, 50.0, *np.arange(75.0, 351.0, 25.0), 400.0])
UNEQUAL = np.array([0.0, 40.0, 45.0, 105.0, 107.5, 180.0, 250.0, 400.0])
AEROCAPTURE = np.array([3397e3 + 125e3, 6100.0, -0.174994])  # leaves again with zero lift control
STEEP = np.array([0.0, 0.0, -0.07])
SCALES = np.array([1e3, 100.0, 0.01])  # deviations that gains of order one turn into controls of order one
ENTRY_SPREAD = np.array([300.0, 3.0, 3e-4])


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
    """A law: "open_loop", "last_node" (feedback of the last node alone), "history" (of all) or "no_number"."""
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


def capture(kind="history", partition=PARTITION, *, reading="corrected", steep=None, **options):
    """A flight; steep: the trial of every so many that falls steeply. Options: of `fly`, and inputs."""
    own = {name: options.pop(name) for name in ("time_step", "every", "varied") if name in options}
    given = {"time_step": FIELD_STEP, "every": 5} | own
    spread = options.pop("spread", ENTRY_SPREAD)

    def prepare(trials, first):
        plant = capture_plant(reading, tuple(options.items()))
        law = field_law(kind, partition, capture_reference(tuple(partition)), SCALES)
        states = AEROCAPTURE + spread * normals(FIELD_SEED, 0, np.arange(first, first + trials), 3)
        if steep:
            states[::steep] += STEEP
        return lambda: field_flight.fly(*plant, law, states, seed=FIELD_SEED, first_trial=first, **given)

    return prepare


for kind in ("open_loop", "last_node", "history"):
    slug = f"random_field/{kind}"
    CASES[slug] = Case(capture(kind), MANY if kind == "history" else SOME)
    CASES[f"{slug}/some_crash"] = Case(capture(kind, steep=3))
    CASES[f"{slug}/unequal"] = Case(capture(kind, UNEQUAL))
    CASES[f"{slug}/mean_density"] = Case(capture(kind, varied=False))
    CASES[f"{slug}/same_start"] = Case(capture(kind, spread=np.zeros(3)))
CASES |= {
    "random_field/history/all_crash": Case(capture(steep=1), 65),
    "random_field/history/trial_77": Case(capture(), 1, 77),
    "random_field/history/from_101": Case(capture(), 333, 101),
    "random_field/history/floor_0.8": Case(capture(density_floor=0.8)),
    "random_field/history/floor_0": Case(capture(density_floor=0.0)),
    "random_field/history/no_floor": Case(capture(density_floor=-1e3)),
    "random_field/history/actual_density": Case(capture(dynamic_pressure_density="actual")),
    "random_field/history/variation_mean": Case(capture(variation_mean=0.1)),
    "random_field/history/narrow_limits": Case(capture(control_limits=(-0.2, 0.3))),
    "random_field/history/stored_1": Case(capture(every=1)),
    "random_field/history/stored_1_some_crash": Case(capture(every=1, steep=2)),
    "random_field/history/stored_50": Case(capture(every=50)),
    "random_field/history/step_0.25": Case(capture(time_step=0.25)),
    "random_field/history/unequal_stored_1": Case(capture(partition=UNEQUAL, every=1, steep=4)),
    "random_field/history/low_field": Case(capture(field_altitudes=(60e3, 90e3))),  # flown beyond both ends
    "random_field/history/short": Case(capture(partition=PARTITION[:4])),  # ends in the atmosphere
    "random_field/history/exponential": Case(capture(reading="exponential")),
    "random_field/history/no_number": Case(capture("no_number"), 65),
}

POINT_PARTITION = np.arange(11.0)
POINT_UNEQUAL = np.array([0.0, 1.0, 1.5, 4.0, 4.1, 10.0])
POINT_GRID = np.arange(101) * 0.2 - 10.0
POINT_START = np.array([-5.0, 0.5])


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


def point(kind="history", partition=POINT_PARTITION, *, every=5, reach=1.0, **options):
    """A flight of the double integrator; reach: factor of the starts, beyond the grid if it is large."""

    def prepare(trials, first):
        reference = np.column_stack([-5.0 + 0.5 * partition, np.full(len(partition), 0.5)])
        law = field_law(kind, partition, reference, np.array([2.0, 2.0]))
        states = reach * POINT_START + np.array([0.3, 0.1]) * normals(
            FIELD_SEED, 0, np.arange(first, first + trials), 2
        )
        root = field_root()
        return lambda: field_flight.fly_double_integrator(
            law,
            POINT_GRID,
            root,
            states,
            **{"time_step": 0.02, "seed": FIELD_SEED, "first_trial": first, "every": every} | options,
        )

    return prepare


for kind in ("open_loop", "last_node", "history"):
    CASES[f"random_field/double_integrator/{kind}"] = Case(point(kind), SOME)
    CASES[f"random_field/double_integrator/{kind}/calm"] = Case(point(kind, varied=False))
CASES |= {
    "random_field/double_integrator/trial_77": Case(point(), 1, 77),
    "random_field/double_integrator/from_101": Case(point(), 333, 101),
    "random_field/double_integrator/unequal": Case(point(partition=POINT_UNEQUAL)),
    "random_field/double_integrator/stored_1": Case(point(every=1)),
    "random_field/double_integrator/mean": Case(point(mean=0.2)),
    "random_field/double_integrator/calm_mean": Case(point(mean=0.2, varied=False)),
    "random_field/double_integrator/beyond_the_grid": Case(point(reach=1.9)),
    "random_field/double_integrator/no_number": Case(point("no_number"), 65),
}


# --- digests ----------------------------------------------------------------------------------------------------------


def digest(array):
    """Of type, shape and bits, all NaN being one."""
    array = np.ascontiguousarray(array)
    if array.dtype.kind == "f":
        array = np.where(np.isnan(array), np.nan, array)
    head = f"{array.dtype.str}{array.shape}".encode()
    return hashlib.sha256(head + array.tobytes()).hexdigest()[:24]


def digests(name):
    """The digests of what a case flies, by array; what is stored behind a trial's end is of no meaning."""
    flown = CASES[name].fly()
    ended = np.arange(len(flown.history))[:, np.newaxis, np.newaxis] >= flown.length
    arrays = {array: getattr(flown, array) for array in ARRAYS}
    arrays |= {array: np.where(ended, np.nan, arrays[array]) for array in ("history", "observed")}
    return {array: digest(values) for array, values in arrays.items()}


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit(f"usage: {sys.argv[0]} --write")
    written = json.dumps({name: digests(name) for name in CASES}, indent=1)
    DIGESTS.write_text(written + "\n", encoding="utf-8")
