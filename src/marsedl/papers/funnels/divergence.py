"""What makes a funnel diverge: cheaper feedback, wider density and larger initial sets."""

from types import SimpleNamespace

import numpy as np

from marsedl.methods.funnels.monte_carlo import boundary_deviations, fly, uniform_directions
from marsedl.papers.funnels import environment
from marsedl.papers.funnels import gains as gains_stage
from marsedl.papers.funnels.basics import SLICE, finite
from marsedl.papers.funnels.programs import propagate, samples
from marsedl.papers.funnels.records import Divergence, Linearization
from marsedl.replication.catalogue import stage

FLIGHTS = 21  # stream of random numbers, keyed by that of the design


@stage(claimed_in=("corrected",))
def compute(inputs, linearization: Linearization) -> Divergence:
    """Cheaper feedback, wider density and larger initial sets, each with a funnel and with flights."""
    cases = [
        *(("scale of the bank angle", f, {"scale_bank": f * inputs.scale_bank}) for f in inputs.studied_bank_factors),
        *(
            (
                "disturbance of the density",
                f,
                {
                    "density_amplitude": f * inputs.density_amplitude,
                    "density_slope_amplitude": f * inputs.density_slope_amplitude,
                },
            )
            for f in inputs.studied_density_factors
        ),
        *(
            (
                "initial set",
                f,
                {
                    "initial_lengths": f * inputs.initial_lengths,
                    "initial_velocity": f * inputs.initial_velocity,
                    "initial_angles": f * inputs.initial_angles,
                },
            )
            for f in inputs.studied_initial_factors
        ),
    ]
    design = samples(inputs)
    rows = [_changed(inputs, linearization, design, values) for _, _, values in cases]
    first, levels, outcome, flown, lost = (list(column) for column in zip(*rows, strict=True))
    return Divergence(
        change=np.array([name for name, _, _ in cases]),
        change_factor=np.array([factor for _, factor, _ in cases]),
        change_initial_level=np.array(first),
        change_level=np.array(levels),
        change_outcome=np.array(outcome),
        change_flown=finite(flown),
        change_lost=np.array(lost),
    )


def _changed(inputs, linearization, design, values):
    """First level, levels, how the funnel ended, largest V of flights from its first slice, and flights lost."""
    changed = SimpleNamespace(**vars(inputs) | values)
    gains = gains_stage.compute(changed, linearization)
    loop = environment.closed_loop(changed, linearization, gains.half_gain)
    levels, outcome = propagate(changed, loop, gains, design, inputs.backward_steps_per_slice)
    generator = np.random.Generator(np.random.Philox((inputs.design_seed, FLIGHTS)))
    count = int(inputs.studied_trials)
    start = boundary_deviations(
        gains.shape[0], gains.initial_level, uniform_directions(generator, count, SLICE.variables)
    )
    values = fly(loop, gains.shape, start, uniform_directions(generator, count, environment.DISTURBANCES)).max(axis=0)
    alive = np.isfinite(values)
    flown = values[alive].max() if alive.any() else np.nan
    return gains.initial_level, levels, outcome, flown, int(np.count_nonzero(~alive))
