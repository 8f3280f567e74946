"""One stage of a funnel: the polynomial whose maximum over the slice and the disturbances bounds the next slice."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from marsedl.methods.checks import require_at_least, require_one_of, require_positive, require_shape
from marsedl.methods.funnels.closed_loop import ClosedLoop
from marsedl.methods.taylor import Series
from marsedl.summaries import summary

__all__ = ["FunnelStage", "cholesky_factor", "lyapunov_rate", "spread_of"]

_CONDITIONS = ("flow", "euler")


@dataclass(frozen=True, eq=False)
class FunnelStage:
    r"""Stage condition between two slices of a funnel (robust entry funnels, Eqs. 18, 22, 23, 26 and 28).

    A point is $(y, w)$, and stands for the deviation

        $\bar{x} = \sqrt{2 \rho_k} L_k^{-\top} y, \quad P_k = L_k L_k^\top$

    so that $\left| y \right| = 1$ is the boundary of the slice, $\frac{1}{2} \bar{x}^\top P_k \bar{x} = \rho_k$;
    $\left| w \right| = 1$ is the boundary of the disturbances. The stage asks for the least $s$ with $s \ge b(y, w)$ on
    both spheres; then $\rho_{k+1} = s \rho_k$. With $c_i$ the part of degree $i$ of the Taylor polynomial in
    $(\bar{x}, w)$ of the flow of the error over the stage, and $f_i$ that of the error rate at its beginning,

        $\text{"flow":} \quad b = \frac{1}{\rho_k} \sum_{i + j \le \text{order} + 1} \frac{1}{2} c_i^\top P_{k+1} c_j$
        $\text{"euler":} \quad b = \frac{1}{\rho_k} \left( \frac{1}{2} \bar{x}^\top P_{k+1} \bar{x} + (t_{k+1} - t_k)
          \left( \sum_{i \le \text{order}} f_i \right)^\top P_k \bar{x} \right)$

    Both are polynomials of degree order + 1. "euler" is Eq. 22; it drops terms of second order in the step, so it does
    not bound the step. "flow" bounds what the integrated equations of motion do, up to the terms left out.

    Eq. 26, read literally, draws points $x^\top x = 2$ that know neither $P_k$ nor $\rho_k$:
    $\bar{x} = \sqrt{2} \, \text{scale} \, y$, of which $\left| y \right| = 1$ is not the boundary of the slice.
    `raw_scale` asks for it, in the units that it gives; $s \rho_k$ does not depend on $\rho_k$ then.

    Args:
        loop: the closed loop about its reference.
        first, last: fine steps at which the stage begins and ends.
        shape: $P_k$, (nx, nx).
        next_shape: $P_{k+1}$, (nx, nx).
        rho: $\rho_k$.
        order: order of the Taylor polynomial, 1 or more.
        condition: "flow" or "euler".
        raw_scale: None, or the units of the components of $x$ in Eq. 26, (nx,).

    Raises:
        ValueError: if a shape is not positive definite, or another argument is out of range.
    """

    loop: ClosedLoop
    first: int
    last: int
    shape: np.ndarray
    next_shape: np.ndarray
    rho: float
    order: int = 3
    condition: str = "flow"
    raw_scale: np.ndarray | None = None

    __repr__ = summary

    def __post_init__(self):  # noqa: D105
        require_one_of("condition", self.condition, _CONDITIONS)
        if not 0 <= self.first < self.last <= self.loop.steps:
            raise ValueError(
                f"a stage from fine step {self.first} to {self.last} does not fit into the {self.loop.steps} fine "
                "steps of the loop"
            )
        require_at_least("order", self.order, 1)
        if not (np.isfinite(self.rho) and self.rho > 0):
            raise ValueError(f"rho must be positive and finite, not {self.rho}")
        states = self.loop.dimension
        for name, size in (("shape", (states, states)), ("next_shape", (states, states)), ("raw_scale", (states,))):
            if getattr(self, name) is not None:
                require_shape(name, getattr(self, name), size)
        if self.raw_scale is not None:
            require_positive("raw_scale", self.raw_scale)
        # Both factors at once: an indefinite shape is refused here, not at the first value.
        _ = self.spread, self.next_factor

    @property
    def degree(self):
        """Degree of the polynomial b."""
        return self.order + 1

    @cached_property
    def spread(self):
        """Matrix S of xb = S y, (nx, nx): sqrt(2 rho_k) L_k^-T, or sqrt(2) diag(scale) of the literal samples."""
        spread = spread_of(self.shape, self.rho, f"P at fine step {self.first}")
        if self.raw_scale is not None:
            return np.sqrt(2) * np.diag(np.asarray(self.raw_scale, dtype=float))
        return spread

    @cached_property
    def next_factor(self):
        """L_{k+1}, (nx, nx)."""
        return cholesky_factor(self.next_shape, f"P at fine step {self.last}")

    def deviations(self, points):
        """Deviations of points (m, nx + nw) from the reference at the beginning, (m, nx) in the units of the states."""
        return self._split(points)[0].T

    def values(self, points):
        """Values of the polynomial b.

        Args:
            points: (y, w), (m, nx + nw); they need not lie on the spheres.

        Returns:
            b, (m,), relative to rho_k.
        """
        deviations, disturbances = self._split(points)
        ray = [Series.along(0.0, component, self.order) for component in deviations]
        pushed = [Series.along(0.0, component, self.order) for component in disturbances]
        if self.condition == "euler":
            step = self.loop.time[self.last] - self.loop.time[self.first]
            rates = self._coefficients(self.loop.error_rates(2 * self.first, ray, pushed), deviations.shape).sum(axis=0)
            grown = np.sum((self.next_factor.T @ deviations) ** 2, axis=0) / 2
            return (grown + step * np.sum(rates * (self.shape @ deviations), axis=0)) / self.rho
        whitened = self.next_factor.T @ self._coefficients(
            self.loop.flow(self.first, self.last, ray, pushed), deviations.shape
        )
        # Each c_i meets the sum of the c_j with j <= order + 1 - i.
        parts = whitened[1:]
        return np.sum(parts * np.cumsum(parts, axis=0)[::-1], axis=(0, 1)) / (2 * self.rho)

    def true_values(self, points):
        """V_{k+1}/rho_k of the integrated error itself, with no series and no Euler step.

        Args:
            points: (y, w), (m, nx + nw).

        Returns:
            Array (m,); at most s on the slice if the stage bounds the motion.
        """
        deviations, disturbances = self._split(points)
        final = self.loop.flow(self.first, self.last, list(deviations), list(disturbances))
        return np.sum((self.next_factor.T @ np.array(np.broadcast_arrays(*final))) ** 2, axis=0) / (2 * self.rho)

    def _split(self, points):
        """Deviations (nx, m) and disturbances (nw, m) of points."""
        points = np.asarray(points, dtype=float)
        states = self.loop.dimension
        why = f" of {states} states and {self.loop.disturbances} disturbances"
        require_shape("points", points, ("m", states + self.loop.disturbances), why)
        return self.spread @ points[:, :states].T, points[:, states:].T

    def _coefficients(self, components, shape):
        """Coefficients of the series of all components, (order + 1, nx, m); a rate of nothing is a plain zero."""
        out = np.zeros((self.order + 1, *shape))
        for i, component in enumerate(components):
            if isinstance(component, Series):
                out[:, i] = component.coefficients
        return out


def lyapunov_rate(loop, half_index, shape, shape_rate, deviations, disturbances):
    r"""Rate of the Lyapunov function along the closed loop (robust entry funnels, Eqs. 15, 29 and Fig. 4).

        $\dot{V} = \bar{x}^\top P \left( f(x^* + \bar{x}, u^* + K \bar{x}, w) - f(x^*, u^*, 0) \right) + \frac{1}{2}
          \bar{x}^\top \dot{P} \bar{x}$

    Args:
        loop: the closed loop about its reference.
        half_index: index of the half-step grid, 0 ... 2 n.
        shape: P, (nx, nx).
        shape_rate: its rate $\dot{P}$, (nx, nx).
        deviations: $\bar{x}$, (m, nx).
        disturbances: w, (m, nw).

    Returns:
        $\dot{V}$, (m,), 1/s in the units of V.
    """
    deviations, disturbances = np.asarray(deviations), np.asarray(disturbances)
    rates = loop.error_rates(half_index, list(deviations.T), list(disturbances.T))
    forces = shape @ np.array(np.broadcast_arrays(*rates)) + shape_rate @ deviations.T / 2
    return np.sum(forces * deviations.T, axis=0)


def spread_of(matrix, level, name="P"):
    r"""The matrix that takes the unit sphere to the boundary $x^\top P x / 2 = \rho$ of an ellipsoid (Eqs. 26 and 27).

        $x = S y, \quad S = \sqrt{2 \rho} L^{-\top}, \quad P = L L^\top, \quad |y| = 1$

    The paper leaves out $P$ and $\rho$, which puts the points on the ellipsoid of $P = I$, $\rho = 1$ only.

    Args:
        matrix: P, (n, n).
        level: $\rho$, 1.
        name: what an error calls P.

    Returns:
        S, (n, n).

    Raises:
        ValueError: as `cholesky_factor`, or if the level is not positive.
    """
    if not level > 0:
        raise ValueError(f"the level of an ellipsoid must be positive, not {level}")
    return np.sqrt(2 * level) * np.linalg.inv(cholesky_factor(matrix, name)).T


def cholesky_factor(matrix, name="P"):
    """Lower Cholesky factor L of a symmetric positive definite matrix, P = L L'.

    Args:
        matrix: P, (n, n).
        name: what an error calls it.

    Returns:
        L, (n, n).

    Raises:
        ValueError: if the matrix is not finite, not symmetric or not positive definite, with its least eigenvalue.
    """
    matrix = np.asarray(matrix, dtype=float)
    if not np.isfinite(matrix).all():
        raise ValueError(f"{name} is not finite")
    size = np.sqrt(np.abs(np.diag(matrix)))
    if (np.abs(matrix - matrix.T) > 1e-9 * np.outer(size, size)).any():
        raise ValueError(f"{name} is not symmetric")
    try:
        return np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError as error:
        least = np.linalg.eigvalsh(matrix)[0]
        raise ValueError(f"{name} is not positive definite: its least eigenvalue is {least:.3g}") from error
