"""The desensitized landing: the path of Table 3, flights."""

import time

import numpy as np
from measuring import compare_flights, inputs_of, run, scaling, seconds

from marsedl.montecarlo.streams import normals
from marsedl.papers.desensitized import PAPER, environment, flight
from marsedl.papers.desensitized.entry_problem import gain_vector
from marsedl.papers.desensitized.gains import Law, reference

FIGURE = "fig04"
TRIALS = 5000
SCALING_TRIALS = 10_000  # enough work for both threads
SCALED_GAIN = np.array([-0.2, -0.07, 0.18, -0.1, 0.1, 0.26])  # close to the least gains against radius errors


def flights(found, trials):
    """The function that flies errors of the position at entry under feedback."""
    i = inputs_of(PAPER.slug)
    law = reference(Law(found.time, found.state, found.bank_acceleration))
    posed = *environment.surroundings(i.planet, i.vehicle), law, gain_vector(i.planet, i.design, SCALED_GAIN)
    errors = normals(i.ensemble.seed, 0, range(trials), 3) * 50.0
    states = environment.displaced(i.planet, found.state[0], errors)
    return lambda: flight.fly(*posed, states, substeps=i.simulation.substeps)


def measure(row):
    """Measure everything of this paper; row: `measuring.add_row` for it."""
    paper = run(PAPER.slug)
    found = paper.record("nominal")
    taken, path = seconds(lambda: paper.record("tradeoff"), time.process_time), paper.record("tradeoff")
    row("path and rows of Table 3", taken, "CPU s")
    row("solves on it", path.solves, "1")
    row("a solve on it", taken / path.solves, "CPU s")
    compare_flights(row, f"{TRIALS:,} flights with feedback and outputs", TRIALS, {"kernel": flights(found, TRIALS)})
    scaling(row, flights(found, SCALING_TRIALS))
