"""The funnel without disturbance, on the slices of the inputs."""

from dataclasses import replace

from marsedl.papers.funnels import environment
from marsedl.papers.funnels.basics import SLICE
from marsedl.papers.funnels.inputs import Planet, Recursion, Vehicle
from marsedl.papers.funnels.programs import propagate, samples
from marsedl.papers.funnels.records import Gains, Linearization, UndisturbedFunnel
from marsedl.replication.catalogue import stage


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet, vehicle: Vehicle, recursion: Recursion, linearization: Linearization, gains: Gains
) -> UndisturbedFunnel:
    """Propagate the level without disturbance."""
    air = environment.undisturbed_air(planet)
    loop = environment.closed_loop(planet, vehicle, air, linearization, gains.half_gain)
    still = replace(
        loop,
        rates=lambda half, state, control, _: loop.rates(half, state, control, (0.0,) * environment.DISTURBANCES),
        disturbances=0,
    )
    levels, outcome = propagate(recursion, still, gains, samples(recursion, SLICE), recursion.steps_per_slice)
    return UndisturbedFunnel(undisturbed_level=levels, undisturbed_outcome=outcome)
