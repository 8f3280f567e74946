"""The entry: design, flight kernel against strict C, scaling with threads, all cells at full size."""

import measuring
import numpy as np

from marsedl.montecarlo.ensembles import Trajectories, pad_to_groups
from marsedl.montecarlo.lanes import LANES
from marsedl.papers.stochastic_entry import PAPER, dispersions, flight, gains, montecarlo, records
from marsedl.papers.stochastic_entry.inputs import Inputs

FIGURE = "fig12"
TRIALS = 1000  # the paper's
SCALING_TRIALS = 10_000  # enough work for both threads
ALL_TRIALS = 100_000  # of each cell
CASES = ("apollo_velocity", "stochastic_velocity")


def problem(made, case, trials):
    """Settings, air, law and vehicles of a case, as `flight.fly` takes them, and its options."""
    i = measuring.inputs_of(PAPER.slug)
    plant = flight.plant_of(i)
    law = gains.law(i.guidance, made.record("linearization"), made.record("gains"), case)
    vehicles = flight.vehicles_of(plant.dispersions, i.simulation.seed, np.arange(trials))
    trigger, end_time = montecarlo.end_of(i.mission, made.record("nominal"), case)
    options = {"trigger": trigger, "end_time": end_time}
    options |= {"substeps": i.simulation.flight_substeps, "seed": i.simulation.seed}
    return (plant.settings, plant.atmosphere, law, vehicles), options


def fly_c(library, settings, air, law, vehicles, *, trigger, end_time, substeps, seed):
    """`flight.fly` in C to the velocity trigger, with the states of every guidance period and without outcomes."""
    assert trigger == "velocity"
    cycles, trials = int(np.ceil(end_time / settings.period)), len(vehicles.drag_factor)
    tables = air.log_density, np.append(np.diff(air.log_density), 0.0), air.deviation, air.log_retention
    flown = [pad_to_groups(part) for part in (vehicles.entry_state.T, vehicles.drag_factor, vehicles.lift_factor)]
    padded = flown[0].shape[1]
    shapes = (cycles, records.HISTORY), (cycles, records.OBSERVED), (records.OBSERVED,), (records.FINAL,)
    numbers = (np.zeros((*shape, padded)) for shape in shapes)
    stored = Trajectories(*numbers, np.zeros(padded, np.int8), np.empty(padded, np.int64))
    constants = np.array([settings], [*type(settings).__annotations__.items()])  # a C structure of doubles and integers
    values = [constants, *map(np.array, (*tables, *law[1:5])), *flown]
    values += [law.least_drag, float(end_time), len(air.altitude), law.kind == flight.BY_TIME, len(law.gain), cycles]
    values += [substeps, padded, seed, dispersions.DENSITY_STREAM, 0]
    outputs = stored.history, stored.observed, stored.observed_maximum, stored.length, stored.final_state
    measuring.call(library.fly, values, [*outputs, np.empty((len(air.altitude), LANES))])
    return stored.first(trials)


def compare(row, made, case):
    """Agreement of the kernel with C, then their times, which include all random numbers."""
    posed, options = problem(made, case, TRIALS)
    label, flights = f"{TRIALS:,} flights of {case} with outputs", {"kernel": lambda: flight.fly(*posed, **options)}
    if library := measuring.library("stochastic_entry"):
        flights["strict C"] = lambda: fly_c(library, *posed, **options)
        measuring.same_bits(flights["strict C"](), flights["kernel"]())
    measuring.compare_flights(row, label, TRIALS, flights, at_least=0.95)


def measure(row):
    """Measure everything of this paper; row: `measuring.add_row` for it."""
    made = measuring.designed(PAPER.slug)
    design = measuring.cpu_seconds(lambda: measuring.designed(PAPER.slug))
    row("nominal, linear model and gains, compiled", design, "CPU s")
    for case in CASES:
        compare(row, made, case)
    posed, options = problem(made, CASES[0], SCALING_TRIALS)
    measuring.scaling(row, lambda: flight.fly(*posed, **options))
    seconds = measuring.ensembles_seconds(made, Inputs.CASES, ALL_TRIALS)
    row(f"{ALL_TRIALS:,} trials of all four cells, statistics included", seconds, "CPU s", below=120.0)
