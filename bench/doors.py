"""The doors of `marsedl.design` and the budget of flights, each beside what it saves or what the papers do instead."""

import statistics
from dataclasses import replace
from time import process_time
from typing import NamedTuple
from unittest.mock import patch

import front_door
import numpy as np
from measuring import inputs_of, run, seconds

from marsedl.design import Gain, Sensitivity, desensitize, optimal, steering
from marsedl.design.funnel import funnel
from marsedl.fly import Below, fly
from marsedl.methods.collocation import Guess, Problem, Program, Variable, resimulate
from marsedl.methods.covariance_steering import block_program
from marsedl.methods.desensitization import Desensitized, Perturbation, column
from marsedl.models.dynamics.vinh_entry import vinh_entry_rates
from marsedl.papers.funnels import environment, gains, linearization
from marsedl.papers.funnels.beyond.programs import propagate, samples
from marsedl.papers.powered_descent import segments
from marsedl.papers.random_field.gains import along_motion
from marsedl.papers.random_field.linearization import motion_of

REPETITIONS = 3
PERIODS = 25
FLIGHTS = 20_000
NOTE = "Median ratio of CPU times of pairs that take turns; our own target."


def compared(functions):
    """CPU times (s) of functions that take turns, (repetitions, functions); each runs once beforehand."""
    rounds = [[seconds(function, process_time) for function in functions] for _ in range(REPETITIONS + 1)]
    return np.array(rounds[1:])


def beside(row, door, other, quantities, below):
    """Rows of the door's time, and of its ratio to that of the other; quantities: what both rows are called."""
    taken = compared([door, other])
    row(quantities[0], statistics.median(taken[:, 0]), "CPU s")
    row(quantities[1], statistics.median(taken[:, 0] / taken[:, 1]), "ratio", below=below, note=NOTE)


def measure(row):
    """Measure everything of the doors; row: `measuring.add_row` for them."""
    budget(row)
    steered(row)
    entry(row)
    trajectories(row)


# ---- budget ----------------------------------------------------------------------------------------------------------


def budget(row):
    """The deviation of an entry's range by moved flights, and by many."""
    options = {"law": front_door.law, "trigger": Below("velocity", 480.0), "end_time": 420.0}

    def flown(trials):
        return fly(front_door.CAPSULE, front_door.START, trials=trials, **options)

    few = flown(200)
    found = few.budget("range")
    beside(
        row,
        lambda: replace(few).budget("range"),  # which remembers no flights
        lambda: flown(FLIGHTS).values("range").std(),
        (f"budget of an entry's range, {found.flights:,} flights", f"budget over {FLIGHTS:,} flights"),
        below=1.0,
    )


# ---- steering --------------------------------------------------------------------------------------------------------


class Flat(NamedTuple):
    """State of the powered descent."""

    x: float
    z: float
    vx: float
    vz: float


class Thrust(NamedTuple):
    """Force or noise."""

    fx: float
    fz: float


class Craft(NamedTuple):
    """What does not change; the mass is that of the segment's middle."""

    mass: float
    density: float
    gravity: float


def descent(state, command: Thrust, noise: Thrust, p: Craft) -> Flat:
    """Motion under thrust and gravity."""
    across = (command.fx + p.density * noise.fx) / p.mass
    return Flat(state.vx, state.vz, across, (command.fz + p.density * noise.fz) / p.mass - p.gravity)


def steered(row):
    """Both segments of the powered descent: steered with held commands by cone programs, and by the paper's loop."""
    given = inputs_of("powered_descent")
    divert, linear = segments.divert_of(given), run("powered_descent").record("linearization")
    crafts = [
        Craft(1.0 / control[len(control) // 2, 2, 0], divert.noise_density, given.planet.gravity)
        for (control,) in segments.split(linear.segment, linear.control_matrix)
    ]

    def door():
        for number, craft in enumerate(crafts):
            ends = list(zip(divert.means, divert.covariances, strict=True))[number : number + 2]
            times = np.linspace(0.0, divert.times[number][-1], PERIODS + 1)
            hover = [0.0, craft.mass * craft.gravity]
            steering.solve(descent, craft, times, start=ends[0], goal=ends[1], guess=hover)

    beside(
        row,
        door,
        lambda: run("powered_descent").record("gains"),
        (
            f"steering of both segments of the powered descent in {PERIODS} periods each",
            "steering over the paper's design by closed form with its mass iteration",
        ),
        below=1.2,
    )
    row("steering over its cone programs alone", _over_programs(door), "ratio", below=1.5, note=NOTE)
    paper, given = run("random_field"), inputs_of("random_field")
    posed = given, motion_of(given), paper.record("nominal"), paper.record("linearization")
    loop = _over_programs(lambda: along_motion(*posed))
    row("the random field's own loop over its cone programs alone", loop, "ratio")


def _over_programs(function):
    """CPU time over that of the cone programs in it; it runs once beforehand."""
    spent, plain = [], block_program.solve

    def timed(*arguments, **options):
        began = process_time()
        try:
            return plain(*arguments, **options)
        finally:
            spent.append(process_time() - began)

    function()
    with patch.object(block_program, "solve", timed):
        return seconds(function, process_time) / sum(spent)


# ---- funnel ----------------------------------------------------------------------------------------------------------


class Entry(NamedTuple):
    """State of the entry."""

    altitude: float
    longitude: float
    latitude: float
    velocity: float
    flight_path_angle: float
    heading: float


class Bank(NamedTuple):
    """Command."""

    bank: float


class Density(NamedTuple):
    """Disturbances of the density and of its slope."""

    level: float
    slope: float


class Surroundings(NamedTuple):
    """Planet, vehicle and air."""

    level: float
    slope: float
    constants: tuple


def entry_rates(state, command: Bank, noise: Density, p) -> Entry:
    """The paper's equations of motion."""
    density = np.exp(p.level + noise.level + (p.slope + noise.slope) * state.altitude)
    return Entry(*vinh_entry_rates(state, command.bank, density, *p.constants))


def entry(row):
    """The funnel of the paper's entry by the door, and by the paper's stages; levels agree."""
    paper, given = run("funnels"), inputs_of("funnels")
    nominal, planet, vehicle = paper.record("nominal"), given.planet, given.vehicle
    air, guidance = environment.disturbed_air(planet, given.uncertainty), given.guidance
    drag = 0.5 / vehicle.ballistic_coefficient
    constants = planet.planet_radius, drag, drag * vehicle.lift_to_drag, planet.gravitational_parameter
    weight = np.diag(1.0 / environment.state_scale(planet, guidance) ** 2)
    bank_weight = 1.0 / (guidance.scale_bank**2 * guidance.control_cost_time)
    spacing, levels = given.recursion.steps_per_slice, {}

    def door():
        levels["door"] = funnel(
            entry_rates,
            Surroundings(air.log_density_at_surface, air.log_density_slope, (*constants, planet.rotation_rate)),
            np.linspace(0.0, nominal.time[-1], guidance.fine_steps + 1),
            lambda at: np.interp(at, nominal.time, nominal.bank)[:, np.newaxis],
            nominal.state[0],
            environment.initial_semi_axes(planet, given.uncertainty),
            weights=(weight / guidance.state_cost_time, [[bank_weight]], guidance.terminal_weight * weight),
            disturbances=Density(air.density_amplitude, air.density_slope_amplitude),
            every=spacing,
            seed=given.recursion.design_seed,
        ).levels

    def papers():
        linear = linearization.compute(given, nominal)
        designed = gains.compute(given, linear)
        loop = environment.disturbed_loop(given, linear, designed.half_gain)
        levels["paper"], _ = propagate(given.recursion, loop, designed, samples(given.recursion), spacing)

    beside(
        row, door, papers, ("funnel of the entry", "funnel over the paper's stages and programs, samples alone"), 1.2
    )
    np.testing.assert_allclose(levels["door"], levels["paper"], rtol=1e-5)


# ---- trajectories ----------------------------------------------------------------------------------------------------


class Sled(NamedTuple):
    """State of a sled."""

    position: float
    speed: float


class Pull(NamedTuple):
    """Command."""

    pull: float


class Drag(NamedTuple):
    """Parameters."""

    drag: float = 0.02


def sled(state, command: Pull, p) -> Sled:
    """Motion with a drag."""
    return Sled(state.speed, command.pull - p.drag * state.speed**2)


INTERVALS, WEIGHTS = 100, [0.1, 1.0, 10.0]


def by_parts():
    """The sled's trajectories put together from the methods, as the desensitized landing does it."""
    problem = Problem(
        rates=lambda position, speed, pull, drag, weight: (speed, pull - drag * speed**2),
        states=(Variable("position", 100.0), Variable("speed", 10.0)),
        controls=(Variable("pull"),),
        final_time=Variable("final_time", 30.0, 30.0, 30.0),
        initial={"position": 0.0, "speed": 0.0},
        final={"position": 100.0, "speed": 0.0},
        running_cost=lambda position, speed, pull, drag, weight: pull**2,
        given=("drag", "weight"),
    )
    extended = Desensitized(
        problem,
        (Perturbation("drag", parameters={"drag": 1.0}),),
        {"position": 1e5, "speed": 1e4},
        (Gain("pull", "speed", lower=-1.0, upper=0.0),),
    )
    miss = column("position", "drag")
    cost = replace(extended.problem, end_cost=lambda start, end, given: given["weight"] * (end[miss] / 1e3) ** 2)
    given, nodes = {"drag": 0.02, "weight": 0.0}, np.linspace([0.0, 0.0], [100.0, 0.0], INTERVALS + 1)
    least = Program(problem, INTERVALS).solve(Guess(nodes, np.ones((INTERVALS, 1)), 30.0), given)
    program = Program(cost, INTERVALS)
    path = program.follow(program.solve(extended.guess(least), given), "weight", WEIGHTS)
    for solution in (least, *path):
        resimulate(solution)
    return least, path


def trajectories(row):
    """A sled's least effort, and its path over weights: by the doors, and put together from the methods."""
    found = {}

    def best():
        options = {"intervals": INTERVALS, "scheme": "midpoint", "scales": {"speed": 10.0}}
        cost = lambda command: command.pull**2  # noqa: E731
        found["best"] = optimal(sled, Drag(), (0.0, 0.0), (100.0, 0.0), 30.0, cost, guess=(1.0,), **options)
        return found["best"]

    def door():
        feedback = Gain("pull", "speed", lower=-1.0, upper=0.0)
        found["door"] = desensitize(best(), WEIGHTS, Sensitivity("position", "drag", 1e-3), gains=[feedback])

    def parts():
        found["least"], found["parts"] = by_parts()

    quantities = f"optimal trajectory and {len(WEIGHTS)} desensitized ones of a sled, {INTERVALS} intervals"
    beside(row, door, parts, (quantities, "optimal and desensitize over the methods put together by hand"), 1.2)
    np.testing.assert_allclose(found["door"].references[-1].objective, found["parts"][-1].running_cost, rtol=1e-5)
