"""What makes a funnel diverge: cheaper feedback, wider density and larger initial sets."""

from functools import partial

import numpy as np

from marsedl.methods.funnels.monte_carlo import boundary_deviations, fly, uniform_directions
from marsedl.papers.funnels import environment
from marsedl.papers.funnels import gains as gains_stage
from marsedl.papers.funnels.basics import SLICE
from marsedl.papers.funnels.inputs import Guidance, Planet, Recursion, Studies, Uncertainty, Vehicle
from marsedl.papers.funnels.programs import propagate, samples
from marsedl.papers.funnels.records import Divergence, Linearization
from marsedl.replication.artifacts import finite
from marsedl.replication.catalogue import stage

FLIGHTS = 21  # stream of random numbers, keyed by that of the design


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    vehicle: Vehicle,
    guidance: Guidance,
    uncertainty: Uncertainty,
    recursion: Recursion,
    studies: Studies,
    linearization: Linearization,
) -> Divergence:
    """Cheaper feedback, wider density and larger initial sets, each with a funnel and with flights."""
    air, weights = environment.disturbed_air(planet, uncertainty), gains_stage.weights_of(planet, guidance)
    semi_axes = environment.initial_semi_axes(planet, uncertainty)
    changes = [
        *(
            ("scale of the bank angle", f, air, weights._replace(bank=f * weights.bank), semi_axes)
            for f in studies.studied_bank_factors
        ),
        *(
            ("disturbance of the density", f, _more_disturbed(air, f), weights, semi_axes)
            for f in studies.studied_density_factors
        ),
        *(
            ("initial set", f, air, weights, environment.initial_semi_axes(planet, uncertainty, f))
            for f in studies.studied_initial_factors
        ),
    ]
    design = samples(recursion)
    rows = []
    for _, _, other_air, other_weights, other_axes in changes:
        close = partial(environment.closed_loop, planet, vehicle, other_air, linearization)
        gains = gains_stage.designed(close, linearization, other_weights, other_axes, recursion.shape)
        loop = close(gains.half_gain)
        spacing = environment.spacing_of(loop, studies.coarse_stages)
        levels, outcome = propagate(recursion, loop, gains, design, spacing)
        largest, lost = _flights(loop, gains, recursion.design_seed, int(studies.studied_trials))
        rows.append((gains.initial_level, levels, outcome, largest, lost))
    first, levels, outcome, largest_values, lost = (list(column) for column in zip(*rows, strict=True))
    return Divergence(
        change=np.array([name for name, *_ in changes]),
        change_factor=np.array([factor for _, factor, *_ in changes]),
        change_initial_level=np.array(first),
        change_level=np.array(levels),
        change_outcome=np.array(outcome),
        change_flown=finite(largest_values),
        change_lost=np.array(lost),
    )


def _more_disturbed(air, factor):
    """The air with larger disturbances."""
    amplitude, slope_amplitude = factor * air.density_amplitude, factor * air.density_slope_amplitude
    return air._replace(density_amplitude=amplitude, density_slope_amplitude=slope_amplitude)


def _flights(loop, gains, seed, count):
    """Largest V of flights from the first slice, and the number of flights lost."""
    generator = np.random.Generator(np.random.Philox((seed, FLIGHTS)))
    start = boundary_deviations(
        gains.shape[0], gains.initial_level, uniform_directions(generator, count, SLICE.variables)
    )
    values = fly(loop, gains.shape, start, uniform_directions(generator, count, environment.DISTURBANCES)).max(axis=0)
    alive = np.isfinite(values)
    return values[alive].max() if alive.any() else np.nan, int(np.count_nonzero(~alive))
