"""What else says the same of the funnels of the Dubins car, and what of them is proven; beyond Fig. 2 of the paper."""

import numpy as np

from marsedl.methods.funnels.linear import linear_exact, slice_jacobians
from marsedl.methods.funnels.recursion import FunnelError, StageRule, backward
from marsedl.methods.funnels.remainder import covering_spheres, proven_stages
from marsedl.methods.sos.design import well_chosen_design
from marsedl.papers.funnels.basics import BASIS_DEGREE
from marsedl.papers.funnels.dubins import FUNNELS, closed_loop, does_not_exist, spheres
from marsedl.papers.funnels.funnel import solver
from marsedl.papers.funnels.inputs import Car, Recursion
from marsedl.papers.funnels.records import Dubins, DubinsStudy
from marsedl.replication.pipeline.catalogue import stage

PROVEN = ("flow", "wind")  # the others leave out a part of the motion anyway
BACKWARD_TOLERANCE = 1e-6


@stage()
def compute(recursion: Recursion, car: Car, dubins: Dubins) -> DubinsStudy:
    """Compare with levels of linear dynamics and backwards, and prove what can be proven."""
    proven = [_proven_stages(recursion, car, dubins, name) for name in PROVEN]

    return DubinsStudy(
        linear_level=np.array([_linear_levels(car, dubins, wind) for _, wind in FUNNELS.values()]),
        backward_level=_backwards(recursion, car, dubins).rho,
        proven_funnel=np.array(PROVEN),
        proven_level=np.array([[car.dubins_level, *(stage.levels[-1] for stage in stages)] for stages in proven]),
    )


def _loop(car: Car, dubins, wind):
    """The closed loop with or without wind."""
    return closed_loop(dubins, car.dubins_speed, car.dubins_wind if wind else None)


def _linear_levels(car: Car, dubins, wind):
    transitions, responses, _ = slice_jacobians(_loop(car, dubins, wind), dubins.slice_step)
    return linear_exact(transitions, responses, dubins.shape[dubins.slice_step], car.dubins_level)


def _backwards(recursion: Recursion, car: Car, dubins):
    """The first funnel, backwards from its last level."""
    condition, wind = FUNNELS[dubins.funnel[0]]
    return backward(
        _loop(car, dubins, wind),
        dubins.shape[dubins.slice_step],
        dubins.slice_step,
        dubins.level[0, -1],
        well_chosen_design(spheres(wind), recursion.design_seed, BASIS_DEGREE),
        StageRule(solver=solver(recursion), order=recursion.taylor_order, condition=condition),
        tolerance=BACKWARD_TOLERANCE,
    )


def _proven_stages(recursion: Recursion, car: Car, dubins, name):
    """Stages of a funnel, proven for the integrated motion from the whole first slice under any wind of the disc."""
    _, wind = FUNNELS[name]
    loop = _loop(car, dubins, wind)
    design = well_chosen_design(covering_spheres(loop), recursion.design_seed, BASIS_DEGREE)
    stages = proven_stages(loop, dubins.shape, dubins.slice_step, car.dubins_level, design, recursion.taylor_order)
    try:
        return list(stages)
    except FunnelError as error:
        raise does_not_exist(f"proof of funnel '{name}'", error) from error
