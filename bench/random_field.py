"""The random field: design, both forms of the steering program, flights.

The printed form is the paper's own: the unknown is L, and every constraint and term of the cost is written with the
square root of S as it stands there.
"""

import numpy as np
from measuring import cpu_seconds, designed, ensembles_seconds, inputs_of, interleaved

from marsedl.methods.covariance_steering.block_program import solve
from marsedl.papers.random_field import PAPER, gains, linearization, nominal
from marsedl.papers.random_field.inputs import Inputs

FIGURE = "fig12"
ALL_TRIALS = 100_000  # under each law


def first_program(flown, partition):
    """The first iteration's program on a partition."""
    i = inputs_of(PAPER.slug)
    states, control = nominal.states_of(i.planet.planet_radius, flown), np.zeros(len(partition) - 1)
    motion = linearization.motion_of(i)
    model = linearization.along(motion, partition, control, states)
    return gains.program(i.guidance, i.vehicle, motion, model, control)[0]


def compare_forms(row, posed):
    """Agreement of the program's two forms, then their times."""
    forms = [lambda form=form: solve(posed, form=form) for form in ("innovations", "history")]
    np.testing.assert_allclose(*(form().objective for form in forms), rtol=1e-7)
    mine, printed = interleaved(forms)
    title = f"{len(posed.system.control)} intervals"
    row(f"innovations form of {title}, build and solve", mine, "s")
    row(f"printed form of {title}, build and solve", printed, "s")
    row(f"speed of the innovations form over the printed form, {title}", printed / mine, "ratio", at_least=8.0)


def measure(row):
    """Measure everything of this paper; row: `measuring.add_row` for it."""
    paper, design = designed(PAPER.slug), cpu_seconds(lambda: designed(PAPER.slug))
    row("nominal, linear model and laws of three iterations, compiled", design, "CPU s")
    compare_forms(row, first_program(paper.record("nominal"), paper.record("linearization").partition))
    title = f"{ALL_TRIALS:,} trials under each of {len(paper.record('gains').control)} laws, statistics included"
    row(title, ensembles_seconds(paper, Inputs.CASES, ALL_TRIALS), "CPU s")
