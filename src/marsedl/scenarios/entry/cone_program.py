"""Covariance steering by the cone program of the aerocapture, on the linear model of the stochastic entry guidance.

Objective and limits are those of its Problem 1: the least range error at the velocity trigger, with chance constraints
on the bank cosine, the final altitude and the final flight path angle.
"""

import numpy as np

from marsedl.methods.covariance_steering import block_program
from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.methods.covariance_steering.steering_program import (
    BlockSystem,
    HalfPlane,
    SteeringProgram,
    present_gains,
)
from marsedl.methods.field_disturbance import regularize
from marsedl.methods.lincov import compose
from marsedl.papers.stochastic_entry import gains
from marsedl.papers.stochastic_entry.records import STATES

__all__ = ["INTERVAL", "problem", "steered", "with_density", "without_density"]

INTERVAL = 5.0  # s, over which the program holds the control; its unknowns grow with the square of their count
DENSITY = STATES - 1
TRACE = 1e-9  # share of the largest variance of a disturbance below which a direction is rounding


def problem(onboard, control_weight=1.0):
    """Problem 1 for the velocity trigger, what follows behind the last control being one interval.

    Args:
        onboard: `Onboard`. control_weight: over that of the stochastic entry guidance.

    Returns:
        `ChanceConstrainedProblem`, and for its nodes the rise of the mean density with the radius, (N + 1,), kg/m^4.
    """
    given, model = onboard.given, onboard.linearization
    whole = gains.problem(given.guidance, given.design, model, 1, INTERVAL)
    starts = gains.partition_starts(given.guidance, given.design, len(model.control), INTERVAL)
    controlled = int(np.flatnonzero(whole.system.control.any(axis=(1, 2)))[-1]) + 1
    posed = whole._replace(
        system=compose(whole.system, np.arange(controlled + 1)),
        control_weight=control_weight * whole.control_weight[: controlled + 1],
        control_limits=whole.control_limits[: controlled + 1],
    )
    nodes = np.append(starts[: controlled + 1], len(model.control))
    return posed, -(model.inverse_scale_height * model.state[:, DENSITY])[nodes]


def with_density(posed) -> BlockSystem:
    """The linear model with the density as a state, in units of deviations."""
    unit = posed.state_scale
    noise = np.array([_without_traces(noise / np.outer(unit, unit)) for noise in posed.system.noise])
    system = posed.system._replace(
        transition=posed.system.transition * unit / unit[:, np.newaxis],
        control=posed.system.control / unit[:, np.newaxis],
        noise=noise,
    )
    return BlockSystem.of(system, np.zeros(STATES), posed.initial_covariance / np.outer(unit, unit))


def without_density(posed, slopes, navigation) -> BlockSystem:
    r"""The model of radius, velocity, path angle and downrange, which the variation of the density disturbs.

    What the density has beyond that of the altitude, $\nu = \rho - \frac{d\rho}{dr} r$, does not depend on the flight:

        $\nu_{k+1} = a_k \nu_k + e_k, \quad w_k = c_k \nu_k + n_k$

    so that the disturbances w are correlated over time.

    Args:
        posed: `ChanceConstrainedProblem` with the density as a state.
        slopes: $\frac{d\rho}{dr}$ at the nodes, (N + 1,), kg/m^4.
        navigation: deviation in every interval, of states in their units, that keeps gains from answering what no
            navigation would see.

    Returns:
        `BlockSystem` in units of deviations.
    """
    system, unit = posed.system, posed.state_scale[:DENSITY]
    apart, together = (np.tile(np.eye(STATES), (len(slopes), 1, 1)) for _ in range(2))
    apart[:, DENSITY, 0], together[:, DENSITY, 0] = -slopes, slopes
    across = apart[1:] @ system.transition @ together[:-1]
    noise = apart[1:] @ system.noise @ apart[1:].swapaxes(1, 2)
    decay, effect = across[:, DENSITY, DENSITY], across[:, :DENSITY, DENSITY] / unit
    count, variance = len(decay), posed.initial_covariance[DENSITY, DENSITY]
    covariance = np.zeros((count, DENSITY, count, DENSITY))
    for k in range(count):
        own = noise[k, :DENSITY, :DENSITY] / np.outer(unit, unit)
        covariance[k, :, k] = variance * np.outer(effect[k], effect[k]) + own
        with_variation = decay[k] * variance * effect[k] + noise[k, :DENSITY, DENSITY] / unit  # Cov(w_k, nu_(k+1))
        for later in range(k + 1, count):
            covariance[k, :, later] = np.outer(with_variation, effect[later])
            covariance[later, :, k] = covariance[k, :, later].T
            with_variation = decay[later] * with_variation
        variance = decay[k] ** 2 * variance + noise[k, DENSITY, DENSITY]
    return BlockSystem(
        transition=across[:, :DENSITY, :DENSITY] * unit / unit[:, np.newaxis],
        control=system.control[:, :DENSITY] / unit[:, np.newaxis],
        affine=np.zeros((count, DENSITY)),
        initial_mean=np.zeros(DENSITY),
        initial_covariance=posed.initial_covariance[:DENSITY, :DENSITY] / np.outer(unit, unit),
        disturbance_covariance=regularize(covariance.reshape(count * DENSITY, -1), np.full(DENSITY, navigation)),
    )


def steered(posed, system: BlockSystem, chance_level) -> tuple[np.ndarray, object]:
    """Solve the program.

    The final variance of the range error is that before the last interval, carried over it, and a constant.

    Args:
        posed: `ChanceConstrainedProblem`. system: one of the two above. chance_level: with which its limits hold.

    Returns:
        Gains on the present state, per unit of the five states, (N, 5), and `SteeringLaw` in units of deviations.

    Raises:
        InfeasibleProgram: if the limits cannot be met.
    """
    count, states, _ = system.control.shape
    unit = posed.state_scale[:states]
    tail = (1.0 - chance_level) / 2.0
    sigmas = upper_quantile(tail)
    towards = system.transition[-1].T @ (posed.objective[:states] * unit)
    state_weight = np.zeros((count, states, states))
    state_weight[-1] = np.outer(towards, towards)
    control_weight = posed.control_weight[:, np.newaxis, np.newaxis]
    directions = posed.final_directions[:, :states] * unit / posed.final_limits[:, np.newaxis]
    program = SteeringProgram(
        system,
        state_weight,
        control_weight,
        control_weight,
        state_constraints=tuple(
            HalfPlane(count, sign * direction, sigmas, tail) for direction in directions for sign in (1.0, -1.0)
        ),
        control_constraints=tuple(
            HalfPlane(k, np.array([sign]), sigmas * limit, tail)
            for k, limit in enumerate(posed.control_limits[:-1])
            for sign in (1.0, -1.0)
        ),
    )
    law = block_program.solve(program, accept_ill_conditioned=True)
    gain = np.zeros((count, STATES))
    gain[:, :states] = present_gains(system, law)[:, 0] / unit
    return gain, law


def _without_traces(covariance):
    """A covariance without the directions whose variance is rounding."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.where(values > TRACE * values[-1], values, 0.0) @ vectors.T
