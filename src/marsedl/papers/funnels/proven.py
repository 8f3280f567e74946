"""A funnel of the entry of which every stage is proven, with the remainders that the expansion leaves out."""

from dataclasses import dataclass

import numpy as np

from marsedl.methods.funnels.recursion import FunnelError
from marsedl.methods.funnels.remainder import covering_spheres, proven_stages
from marsedl.methods.sos.design import well_chosen_design
from marsedl.papers.funnels import environment
from marsedl.papers.funnels.environment import STATE_UNIT
from marsedl.papers.funnels.funnel import COMPLETE, largest_heat_rate
from marsedl.papers.funnels.gains import Gains
from marsedl.papers.funnels.linearization import Linearization
from marsedl.replication.artifacts import quantity

BASIS_DEGREE = 2  # of the sums of squares
# Degree of the Taylor models: the square of one of degree 6 has more terms than their rounding allows for.
MODEL_ORDER = 5
NO_ADDITIVE = "disturbances that are added to the rates are bounded for linear dynamics only: nothing is proven"

PER_STAGE = ("stages",)


@dataclass(frozen=True)
class Proven:
    """Levels within which every deviation from the first slice is proven to stay, at all nodes of the fine grid.

    Proven is this of the closed loop as integrated by the Runge-Kutta rule on the fine grid, for the reference and the
    gains as stored, under every disturbance of the density in the unit disc that is constant over each stage. Nothing
    is said of the error of that rule, and of times between its nodes. Taken for granted is that numpy's elementary
    functions are right to 1e-13, and that rounding outside of the enclosures, of the whitening and of polynomials at
    samples, changes no bound by more than 1e-9 of it, which is added. NaN where nothing is proven.
    """

    outcome: str = quantity("1", (), "complete, or why nothing is proven beyond some stage", "str")
    proven: bool = quantity("1", (), "whether all stages are proven")
    step: np.ndarray = quantity("1", ("slices",), "fine step of each slice", "int64")
    time: np.ndarray = quantity("s", ("slices",), "its time")
    level: np.ndarray = quantity("1", ("slices",), "its proven level rho", allow_nan=True)
    half_width: np.ndarray = quantity(
        STATE_UNIT, ("slices", 6), "largest deviation of each state in it", allow_nan=True
    )
    node_time: np.ndarray = quantity("s", ("nodes",), "nodes of the fine grid")
    node_level: np.ndarray = quantity("1", ("nodes",), "proven level there, between slices too", allow_nan=True)
    node_nominal_heat_rate: np.ndarray = quantity("W/m^2", ("nodes",), "heat rate of the reference there")
    node_heat_rate: np.ndarray = quantity(
        "W/m^2", ("nodes",), "largest heat rate within that level, with any disturbance of the density", allow_nan=True
    )
    interpolation_excess: float = quantity(
        "1", (), "by how much a level between slices is above the straight line at most, relative", allow_nan=True
    )
    bound: np.ndarray = quantity(
        "1", PER_STAGE, "proven bound of V at the next slice, over the level: the sum of the next four", allow_nan=True
    )
    polynomial_bound: np.ndarray = quantity(
        "1", PER_STAGE, "bound of its polynomial part, on the slice and for all of the disc", allow_nan=True
    )
    truncation: np.ndarray = quantity("1", PER_STAGE, "bound of known terms of higher degrees", allow_nan=True)
    remainder: np.ndarray = quantity("1", PER_STAGE, "bound of everything else", allow_nan=True)
    rise: np.ndarray = quantity(
        "1", PER_STAGE, "by how much the polynomial may be larger inside of the slice", allow_nan=True
    )
    basis_size: int = quantity("1", (), "polynomials in the basis, of the slice and a sphere whose shadow the disc is")
    samples: int = quantity("1", (), "samples there")


def compute(inputs, linearization: Linearization, gains: Gains) -> Proven:
    """Propagate the level from the initial set by proven bounds, until the end or until one does not exist."""
    loop = environment.closed_loop(inputs, linearization, gains.half_gain)
    design = well_chosen_design(covering_spheres(loop), inputs.design_seed, BASIS_DEGREE)
    steps = environment.slices(inputs)
    stages, outcome = propagate(inputs, loop, gains, design, steps)
    level = np.full(len(linearization.time), np.nan)
    level[0] = gains.initial_level
    for stage in stages:
        level[stage.nodes] = stage.levels
    straight = np.interp(np.arange(len(level)), steps, level[steps])
    reached = np.isfinite(straight)

    def of_stages(name):
        missing = [np.nan] * (len(steps) - 1 - len(stages))
        return np.array([getattr(stage, name) for stage in stages] + missing)

    return Proven(
        outcome=outcome,
        proven=outcome == COMPLETE,
        step=steps,
        time=linearization.time[steps],
        level=level[steps],
        half_width=half_widths(gains.shape[steps], level[steps]),
        node_time=linearization.time,
        node_level=level,
        node_nominal_heat_rate=linearization.heat_rate[::2],
        node_heat_rate=np.array(
            [
                largest_heat_rate(inputs, state, shape, rho)
                for state, shape, rho in zip(linearization.state[::2], gains.shape, level, strict=True)
            ]
        ),
        interpolation_excess=float((level[reached] / straight[reached]).max() - 1.0) if len(stages) else np.nan,
        bound=level[steps[1:]] / level[steps[:-1]],
        **{name: of_stages(name) for name in ("polynomial_bound", "truncation", "remainder", "rise")},
        basis_size=design.basis.shape[1],
        samples=len(design.points),
    )


def propagate(inputs, loop, gains: Gains, design, steps):
    """Proven stages up to the end or to the first that is not proven, and the outcome, a text."""
    if inputs.additive:
        return [], NO_ADDITIVE
    stages = []
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # enclosures of too large slices
            for stage in proven_stages(
                loop, gains.shape, steps, gains.initial_level, design, inputs.taylor_order, MODEL_ORDER
            ):
                stages.append(stage)
    except FunnelError as error:
        return stages, str(error)
    return stages, COMPLETE


def half_widths(shapes, levels):
    """Largest deviation of every state within {1/2 xb'P xb <= rho}, for many P and rho, (m, nx)."""
    variances = np.diagonal(np.linalg.inv(shapes), axis1=1, axis2=2)
    return np.sqrt(2.0 * levels[:, np.newaxis] * variances)
