"""Constant feedback gains that null or reduce sensitivities on a fixed nominal (desensitized, Eqs. 5 and 6).

The nominal does not depend on the gains, for it has no deviation to feed back. So its matrices are constant, and the
equations are in the gains alone: r(k) = 0, where r holds the required outputs of the final sensitivity columns. Where
there are more gains than equations, the smallest gains are a choice that can be stated without naming a solver.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from marsedl.methods.sensitivity import (
    POINTS,
    adjoint_rows,
    closed_loop,
    propagate_columns,
    scheme_columns,
    scheme_responses,
    scheme_transitions,
)
from marsedl.summaries import summary

__all__ = [
    "GainDesign",
    "GainProblem",
    "final_errors",
    "gain_matrix",
    "linearized",
    "minimum_norm",
]

# Singular values below this part of the largest are rounding; hard but regular problems have some at 1e-6.
_NEGLIGIBLE = 1e-12
# Dimensions: N intervals, s points of the scheme, n states, m controls, c perturbations, p outputs, f measured states.
# The midpoint rule has one point, whose dimension is left out.
_DIMENSIONS = {
    "control_matrix": "Nsnm",
    "state_matrix": "Nsnn",
    "step": "N",
    "columns": "nc",
    "outputs": "pn",
    "state_scale": "f",
    "control_scale": "m",
}


@dataclass(frozen=True, eq=False)
class GainProblem:
    r"""What the gains are to reduce: a linear model along the nominal, perturbations, outputs and measured states.

    The feedback to control $a$ is, with dimensionless gains $k$ of $m$ controls and $f$ measured states,

        $\delta u_a = \text{control_scale}_a \sum_i k_{ai} \frac{\delta x_i}{\text{state_scale}_i}$

    Matrices are those in the middle of the intervals, as the midpoint rule has it. By another scheme they have a second
    dimension, its points (`sensitivity.POINTS`): (N, points, n, n) and so on.

    Raises:
        ValueError: naming the field, if a shape does not fit, a value is not finite, a step or scale is not positive,
            the scheme is unknown, or the measured states are not different states of the model.
    """

    state_matrix: np.ndarray  # A = df/dx in the middle of the intervals, (N, n, n)
    control_matrix: np.ndarray  # B = df/du, (N, n, m)
    step: np.ndarray  # lengths of the intervals, (N,) or one for all, s
    columns: np.ndarray  # directions of the perturbed initial state, per unit of the perturbation, (n, c)
    outputs: np.ndarray  # rows that turn the final state into errors in the required metric, (p, n)
    fed_back: np.ndarray  # indices of the measured states, (f,)
    state_scale: np.ndarray  # deviation of a measured state that counts as one, (f,)
    control_scale: np.ndarray = 1.0  # control that counts as one, (m,) or one for all
    scheme: str = "midpoint"  # by which the sensitivities are propagated

    __repr__ = summary

    def __post_init__(self):
        """Check the fields and bring them into full shape."""
        fed_back = np.asarray(self.fed_back)
        if fed_back.ndim != 1 or not fed_back.size or not np.issubdtype(fed_back.dtype, np.integer):
            raise ValueError("fed_back must be a list of indices of states")
        object.__setattr__(self, "fed_back", fed_back)
        if self.scheme not in POINTS:
            raise ValueError(f"scheme: '{self.scheme}' is none of {', '.join(POINTS)}")
        sizes = {"f": len(fed_back), "s": POINTS[self.scheme]}
        for name, dimensions in _DIMENSIONS.items():
            if self.scheme == "midpoint":
                dimensions = dimensions.replace("s", "")
            value = np.asarray(getattr(self, name), dtype=float)
            if value.ndim == 0 and len(dimensions) == 1 and dimensions != "f":
                value = np.broadcast_to(value, sizes[dimensions])
            if value.ndim != len(dimensions) or not all(
                sizes.setdefault(dimension, length) == length > 0
                for dimension, length in zip(dimensions, value.shape, strict=True)
            ):
                extents = "".join(
                    f", {dimension} = {sizes[dimension]}" for dimension in sizes if dimension in dimensions
                )
                expected = f"({', '.join(dimensions)}){extents}"
                raise ValueError(f"{name} must be a non-empty array of shape {expected}, not {value.shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"{name} has entries that are not finite")
            if name.endswith(("step", "scale")) and not (value > 0).all():
                raise ValueError(f"{name} must be positive")
            object.__setattr__(self, name, value)
        if len(set(fed_back.tolist())) < len(fed_back) or fed_back.min() < 0 or fed_back.max() >= sizes["n"]:
            raise ValueError(f"fed_back must name different states from 0 to {sizes['n'] - 1}, not {fed_back.tolist()}")

    @property
    def gain_shape(self):
        """Number of controls and of measured states, (m, f)."""
        return len(self.control_scale), len(self.fed_back)


class GainDesign(NamedTuple):
    """Gains, the errors that they leave, and how the search for them ended."""

    k: np.ndarray  # dimensionless gains, (m, f)
    errors: np.ndarray  # final errors per unit of the perturbations, (p, c)
    iterations: int
    converged: bool
    reason: str  # why the search ended, in a sentence

    __repr__ = summary


def gain_matrix(problem, k):
    """Feedback matrix K of dimensionless gains, K_ai = control_scale_a k_ai / state_scale_i.

    Args:
        problem: `GainProblem`.
        k: dimensionless gains, (m, f) or row by row in one vector; or one number for all.

    Returns:
        K in the units of the model, (m, n); zero for the states that are not measured.

    Raises:
        ValueError: if the shape of k does not fit or a gain is not finite.
    """
    gain = np.zeros((len(problem.control_scale), len(problem.columns)))
    gain[:, problem.fed_back] = _full(problem, k) * _unit(problem)
    return gain


@np.errstate(over="ignore", invalid="ignore")
def final_errors(problem, k):
    """Outputs of the final sensitivity under given gains, E = C S_N (desensitized, Eqs. 5 and 6).

    Args:
        problem: `GainProblem`.
        k: as in `gain_matrix`.

    Returns:
        E, error per unit of the perturbations, (p, c); not finite where the closed loop overflows.

    Raises:
        ValueError: as `gain_matrix`, or as `midpoint_transitions` for the closed loop.
    """
    return problem.outputs @ _closed(problem, k).sensitivity[-1]


@np.errstate(over="ignore", invalid="ignore")
def linearized(problem, k):
    r"""Final errors as a vector, (p c,), and their exact derivative with respect to the gains, (p c, m f).

    A gain acts as a forcing $B_a x_i$ at the points of the scheme, for the midpoint rule on the mean
    $(S_k + S_{k+1}) / 2$:

        $\frac{dE}{dk_{ai}} = \sum_k L_{k+1} R_{k,a} \frac{(S_k + S_{k+1})_i}{2} \cdot
          \frac{\text{control_scale}_a}{\text{state_scale}_i}$

    with the adjoint rows $L$ of the outputs and the responses $R$ of the closed loop to the controls. For other schemes
    the sum goes over their points as well.

    Args:
        problem: `GainProblem`.
        k: as in `gain_matrix`.

    Returns:
        Errors (p c,) and their derivative (p c, m f); not finite where the closed loop overflows.

    Raises:
        ValueError: as `final_errors`.
    """
    loop, scheme, step = _closed(problem, k), problem.scheme, problem.step
    rows = adjoint_rows(loop.transitions, problem.outputs)[1:, np.newaxis]
    to_outputs = rows @ scheme_responses(scheme, loop.matrices, loop.control, step)
    measured_columns = scheme_columns(scheme, loop.matrices, loop.sensitivity, step)[:, :, problem.fed_back]
    # Points of all intervals are counted one after the other.
    to_outputs, measured_columns = (part.reshape(-1, *part.shape[2:]) for part in (to_outputs, measured_columns))
    slope = np.einsum("kpa,kic->pcai", to_outputs, measured_columns) * _unit(problem)
    errors = problem.outputs @ loop.sensitivity[-1]
    return errors.ravel(), slope.reshape(errors.size, -1)


def minimum_norm(problem, start=0.0, step_limit=0.1, tolerance=1e-9, iterations=200):
    """The smallest gains that null the final errors, from a start: k <- J^+ (J k - r), the step limited in norm.

    The fixed point nulls the errors, and lies in the row space of J: it is the point of smallest norm of the linearised
    set of solutions, hence a stationary point of the norm on the set itself. Where that set is strongly curved, steps
    would go back and forth for ever: each one that turns back and is not half as long as the last halves the limit.

    There may be several such points, of which the start selects one: compare their norms. Where J has less than full
    rank, errors may not move although other gains null them: start elsewhere then.

    Args:
        problem: `GainProblem`; p c errors, at most as many as gains if they are to vanish.
        start: first k, as in `gain_matrix`.
        step_limit: longest step at first, in the norm of k.
        tolerance: step that ends the search, in the norm of k. Errors no larger than this step makes count as null.
        iterations: most steps.

    Returns:
        `GainDesign`. It has not `converged` if the steps do not end or errors remain; `reason` says which.

    Raises:
        ValueError: if step_limit, tolerance or iterations is not positive, or as `final_errors` for the start.
    """
    _require_positive(step_limit=step_limit, tolerance=tolerance, iterations=iterations)
    k = _full(problem, start).ravel()
    errors, slope = linearized(problem, k)
    steps, full_step, length = 0, np.zeros_like(k), np.inf
    for _ in range(iterations):
        if not (np.isfinite(errors).all() and np.isfinite(slope).all()):
            break
        previous_step, full_step = full_step, np.linalg.lstsq(slope, slope @ k - errors, rcond=_NEGLIGIBLE)[0] - k
        length = np.linalg.norm(full_step)
        if full_step @ previous_step < 0 and length > np.linalg.norm(previous_step) / 2:
            step_limit /= 2
        step = full_step * min(1.0, step_limit / max(length, tolerance))
        k = k + step
        errors, slope = linearized(problem, k)
        steps += 1
        if length <= tolerance:
            break
    converged, reason = _search_outcome(errors, slope, length, tolerance, steps)
    return GainDesign(k.reshape(problem.gain_shape), final_errors(problem, k), steps, converged, reason)


def _require_positive(**values):
    """Refuse numbers that are not positive."""
    for name, value in values.items():
        if not value > 0:
            raise ValueError(f"{name} must be positive, not {value}")


def _full(problem, k):
    """Finite gains in full shape, (m, f)."""
    k, shape = np.asarray(k, dtype=float), problem.gain_shape
    if k.shape not in ((), shape, (shape[0] * shape[1],)):
        raise ValueError(f"k must be one number or have shape {shape}, not {k.shape}")
    if not np.isfinite(k).all():
        raise ValueError("k has entries that are not finite")
    return np.full(shape, k) if k.ndim == 0 else k.reshape(shape)


def _unit(problem):
    """What a gain of one is in the units of the model, (m, f)."""
    return problem.control_scale[:, None] / problem.state_scale


class _ClosedLoop(NamedTuple):
    """A problem under gains."""

    matrices: np.ndarray  # of the states at the points of the scheme, (N, points, n, n)
    control: np.ndarray  # (N, points, n, m)
    transitions: np.ndarray  # (N, n, n)
    sensitivity: np.ndarray  # at the nodes, (N + 1, n, c)


def _closed(problem, k) -> _ClosedLoop:
    """The closed loop, and the sensitivity at the nodes."""

    def at_points(values):
        return values[:, np.newaxis] if problem.scheme == "midpoint" else values

    state, control = map(at_points, (problem.state_matrix, problem.control_matrix))
    points = state.shape[:2]
    matrices = closed_loop(
        state.reshape(-1, *state.shape[2:]), control.reshape(-1, *control.shape[2:]), gain_matrix(problem, k)
    ).reshape(*points, *state.shape[2:])
    transitions = scheme_transitions(problem.scheme, matrices, problem.step)
    sensitivity = propagate_columns(transitions, problem.columns)
    return _ClosedLoop(matrices, control, transitions, sensitivity)


def _search_outcome(errors, slope, length, tolerance, steps):
    """Whether a search for null errors succeeded, and a sentence on why it ended."""
    if not (np.isfinite(errors).all() and np.isfinite(slope).all()):
        return False, f"the errors are not finite after {steps} steps: the closed loop is unstable"
    if length > tolerance:
        return False, f"{steps} steps did not suffice: the last step wanted is still {length:.3g} long"
    remaining, full_rank = np.linalg.norm(errors), min(slope.shape)
    if remaining > np.linalg.norm(slope, 2) * tolerance:
        rank_of_slope = np.linalg.matrix_rank(slope, rtol=_NEGLIGIBLE)
        return False, (
            f"errors of norm {remaining:.3g} remain, which no small step reduces: "
            f"the Jacobian of {errors.size} errors has rank {rank_of_slope} of {full_rank} here"
        )
    return True, "the errors are null and the gains the smallest of the linearised solutions"
