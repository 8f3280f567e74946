"""A funnel of the entry of which every stage is proven, with the remainders that the expansion leaves out."""

import numpy as np

from marsedl.methods.funnels.recursion import FunnelError
from marsedl.methods.funnels.remainder import covering_spheres, proven_stages
from marsedl.methods.sos.design import well_chosen_design
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import BASIS_DEGREE, COMPLETE, half_widths
from marsedl.papers.funnels.inputs import Inputs
from marsedl.papers.funnels.records import Gains, Linearization, Proven
from marsedl.replication.pipeline.catalogue import stage

# Degree of the Taylor models: the square of one of degree 6 has more terms than their rounding allows for.
MODEL_ORDER = 5
NO_ADDITIVE = "disturbances that are added to the rates are bounded for linear dynamics only: nothing is proven"


@stage(claimed_in=("corrected",))
def compute(given: Inputs, linearization: Linearization, gains: Gains) -> Proven:
    """Propagate the level from the initial set by proven bounds, until the end or until one does not exist."""
    loop = environment.disturbed_loop(given, linearization, gains.half_gain)
    design = well_chosen_design(covering_spheres(loop), given.recursion.design_seed, BASIS_DEGREE)
    steps = environment.slices(loop, given.recursion.steps_per_slice)
    if given.uncertainty.additive:
        stages, outcome = [], NO_ADDITIVE
    else:
        stages, outcome = propagate(loop, gains, design, steps, given.recursion.taylor_order)
    level = np.full(len(linearization.time), np.nan)
    level[0] = gains.initial_level
    for proof in stages:
        level[proof.nodes] = proof.levels

    def of_stages(name):
        missing = [np.nan] * (len(steps) - 1 - len(stages))
        return np.array([getattr(stage, name) for stage in stages] + missing)

    return Proven(
        outcome=outcome,
        proven=outcome == COMPLETE,
        step=steps,
        time=linearization.time[steps],
        level=level[steps],
        half_width=half_widths(2.0 * level[steps, np.newaxis, np.newaxis] * np.linalg.inv(gains.shape[steps])),
        node_time=linearization.time,
        node_level=level,
        bound=level[steps[1:]] / level[steps[:-1]],
        **{name: of_stages(name) for name in ("polynomial_bound", "truncation", "remainder", "rise")},
        basis_size=design.basis.shape[1],
        samples=len(design.points),
    )


def propagate(loop, gains: Gains, design, steps, order):
    """Proven stages up to the end or to the first that is not proven, and the outcome, a text."""
    stages = []
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # enclosures of too large slices
            for stage in proven_stages(loop, gains.shape, steps, gains.initial_level, design, order, MODEL_ORDER):
                stages.append(stage)
    except FunnelError as error:
        return stages, str(error)
    return stages, COMPLETE
