"""Simulated flights of a closed loop, against which a funnel is held (robust entry funnels, Sec. 4, Fig. 3)."""

import numpy as np

__all__ = [
    "fly",
    "greedy_additive",
    "greedy_disturbance",
    "quadratic_values",
]


def quadratic_values(value_matrix, deviations):
    """Lyapunov function V = x'P x / 2 (robust entry funnels, Sec. 3).

    Every entry depends on its own deviation only, to the last bit.

    Args:
        value_matrix: P, (nx, nx), symmetric.
        deviations: x, (nx, m), one row a component.

    Returns:
        V, (m,); infinite where the deviation is not finite.
    """
    values = 0.5 * np.sum(deviations * _gradient(value_matrix, deviations), axis=0)
    return np.where(np.isfinite(values), values, np.inf)


def greedy_disturbance(directions):
    """Adversary that raises V fastest: of the given w, the one with the largest x'P f(x, w), anew in every fine step.

    Args:
        directions: the w to choose from, (q, nw).

    Returns:
        Function for the `disturbance` of `fly`.
    """
    directions = np.atleast_2d(np.asarray(directions, dtype=float))

    def choose(loop, step, value_matrix, deviation):
        rates = loop.error_rates(2 * step, deviation[:, None, :], directions.T[:, :, None])
        slopes = _gradient(value_matrix, deviation)
        growth = sum(slope * rate for slope, rate in zip(slopes, rates, strict=True))
        return directions.T[:, np.argmax(growth, axis=0)]

    return choose


def greedy_additive(amplitudes):
    r"""Adversary that raises $V$ fastest with an additive input from an ellipsoid, anew in every fine step.

        $\max x^\top P a \text{ over } \sum_i (a_i / c_i)^2 \le 1 \text{:} \quad a =
          \frac{c \circ (c \circ P x)}{\left\| c \circ P x \right\|}$

    Args:
        amplitudes: semi-axes c, (nx,), units of the rates.

    Returns:
        Function for the `additive` of `fly`.
    """
    amplitudes = np.asarray(amplitudes, dtype=float)[:, None]

    def choose(loop, step, value_matrix, deviation):
        pull = amplitudes * _gradient(value_matrix, deviation)
        length = np.linalg.norm(pull, axis=0)
        return amplitudes * pull / np.where(length > 0, length, 1.0)

    return choose


def fly(loop, value_matrices, deviations, disturbance, additive=None, observer=None):
    """Fly many trajectories of a closed loop and record the Lyapunov function (robust entry funnels, Sec. 4).

    All trajectories advance together through the fine steps of the loop, on each of which disturbance and additive
    input are constant. Each of the two inputs is one of

    - an array with one row a trajectory, constant in time, (m, components);
    - an array (segments, m, components), drawn anew in each of the equal segments of the fine grid;
    - a function `choose(loop, step, value_matrix, deviation)`, (nx, m) to (components, m), asked at the start of every
      fine step (`greedy_disturbance`, `greedy_additive`).

    Args:
        loop: `ClosedLoop` with n fine steps.
        value_matrices: P at the nodes, (n + 1, nx, nx).
        deviations: at the first node, (m, nx).
        disturbance: w, nw components.
        additive: a, nx components in the units of the rates, or None for zero.
        observer: None, or a function called at every node as `observer(node, deviation, disturbance)` with arrays
            (nx, m) and (nw, m); the disturbance is that of the step ahead, at the last node that of the step before.

    Returns:
        V at the nodes, (n + 1, m); infinite from where a trajectory is no longer finite.

    Raises:
        ValueError: if shapes do not fit or an input is not finite.
    """
    value_matrices = np.asarray(value_matrices, dtype=float)
    deviations = np.asarray(deviations, dtype=float)
    nx = loop.dimension
    if value_matrices.shape != (loop.steps + 1, nx, nx):
        raise ValueError(f"value_matrices must have shape {(loop.steps + 1, nx, nx)}, not {value_matrices.shape}")
    if deviations.ndim != 2 or deviations.shape[1] != nx or not np.isfinite(deviations).all():
        raise ValueError(f"deviations must be finite and of shape (m, {nx}); their shape is {deviations.shape}")
    disturb = _in_steps("disturbance", disturbance, loop.steps, len(deviations), loop.disturbances)
    add = None if additive is None else _in_steps("additive", additive, loop.steps, len(deviations), nx)

    deviation = np.ascontiguousarray(deviations.T)
    values = np.empty((loop.steps + 1, len(deviations)))
    # A diverging trajectory may overflow on its way to an infinite V.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for step in range(loop.steps):
            value_matrix = value_matrices[step]
            values[step] = quadratic_values(value_matrix, deviation)
            w = disturb(loop, step, value_matrix, deviation)
            a = None if add is None else add(loop, step, value_matrix, deviation)
            if observer is not None:
                observer(step, deviation, w)
            deviation = np.array(loop.flow(step, step + 1, deviation, w, a))
        values[-1] = quadratic_values(value_matrices[-1], deviation)
        if observer is not None:
            observer(loop.steps, deviation, w)
    return values


def _gradient(value_matrix, deviations):
    """P x by sums over components: a matrix product may round a column by its place among the others."""
    return np.array([sum(p * x for p, x in zip(row, deviations, strict=True)) for row in value_matrix.tolist()])


def _in_steps(name, value, steps, count, components):
    """An input of `fly` as a function that gives its components on a step, (components, m)."""
    if callable(value):
        return value
    value = np.asarray(value, dtype=float)
    segments = value if value.ndim == 3 else value[None]
    if segments.shape[1:] != (count, components):
        raise ValueError(f"{name} must have shape ([segments,] {count}, {components}), not {value.shape}")
    if not len(segments) or steps % len(segments):
        raise ValueError(f"{name} has {len(segments)} segments, which do not divide the {steps} fine steps")
    if not np.isfinite(segments).all():
        raise ValueError(f"{name} must be finite")
    steps_per_segment = steps // len(segments)
    rows = np.ascontiguousarray(segments.swapaxes(1, 2))
    return lambda loop, step, value_matrix, deviation: rows[step // steps_per_segment]
