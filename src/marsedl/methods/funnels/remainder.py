"""Proven bounds of the flow over the stages of a funnel, with all remainders (robust entry funnels, Eq. 22)."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from marsedl.methods.funnels.recursion import FunnelError
from marsedl.methods.funnels.stage import cholesky_factor, spread_of
from marsedl.methods.sos.sampled_program import absorb_residual, rank_one
from marsedl.methods.sos.variety import Spheres
from marsedl.methods.taylor_model import Monomials, TaylorModel, variables
from marsedl.summaries import summary

__all__ = [
    "EnclosedGrowth",
    "ProvenBound",
    "ProvenStage",
    "covering_spheres",
    "enclosed_growths",
    "proven_bound",
    "proven_stages",
]

# Relative allowance for rounding outside of the models: of the Cholesky factors of the shapes, and of b at samples.
_WHITENING = 1e-9


@dataclass(frozen=True)
class ProvenBound:
    """Bound of the level after one stage, in units of the level before.

    Args:
        bound: s with V_{k+1}(phi(xb, w)) <= s rho_k, proven: polynomial bound, truncation, remainder and rise together.
        truncation: bound of the terms of degree > order + 1 of V_{k+1}(phi) / rho_k that are known as polynomials.
        remainder: bound of all that is left.
        rise: bound of what b may be larger inside slice and ball of disturbances than on their boundaries.
    """

    bound: float
    truncation: float
    remainder: float
    rise: float


@dataclass(frozen=True, eq=False)
class ProvenStage:
    """Levels of a funnel from one slice to the next, proven.

    Args:
        nodes: of the fine grid, from the one after slice k to slice k + 1.
        levels: V there is at most this, (nodes,).
        polynomial_bound: proven bound of the polynomial b at slice k + 1, over rho_k, on the boundary of the slice and
            in the ball of disturbances.
        truncation, remainder, rise: what is added to it, as of `ProvenBound`.
    """

    nodes: np.ndarray
    levels: np.ndarray
    polynomial_bound: float
    truncation: float
    remainder: float
    rise: float

    __repr__ = summary


@dataclass(frozen=True, eq=False)
class EnclosedGrowth:
    r"""V / rho_k at a node after slice k, for all deviations and disturbances: a polynomial and bounds of the rest.

    In whitened coordinates $g = L^\top \phi / \sqrt{2 \rho_k}$, of which $\left\| y \right\| \le 1$ is the slice and
    $\left\| w \right\| \le 1$,

        $V(\phi) / \rho_k = \left\| g \right\|^2 = b + \text{(polynomial terms of degree > order + 1)} + e, \quad \left|
          e \right| \le r$

    Args:
        monomials: of b, of degree 0 ... order + 1 in (y, w).
        coefficients: of b, (m,).
        states: number of coordinates y.
        truncation: bound of the other terms that are known as polynomials.
        remainder: r.
    """

    monomials: Monomials
    coefficients: np.ndarray
    states: int
    truncation: float
    remainder: float

    __repr__ = summary

    def values(self, points):
        """b at points (y, w), (k, nx + nw)."""
        return self.monomials.evaluate(points) @ self.coefficients

    @cached_property
    def slice_rise(self):
        """Bound of what b may be larger inside the slice than on its boundary, under the same w."""
        return _rise_inside(self.monomials, self.coefficients, range(self.states))

    @cached_property
    def disturbance_rise(self):
        """Bound of what b may be larger inside the ball of disturbances than on its boundary, at the same y."""
        variables = range(self.states, self.monomials.exponents.shape[1])
        return _rise_inside(self.monomials, self.coefficients, variables) if variables else 0.0

    def bound(self, polynomial_bound, on_disturbance_ball=False):
        """Bound of V / rho_k with nothing left out; the arguments as of `proven_bound`.

        Returns:
            `ProvenBound`.
        """
        rise = self.slice_rise + (0.0 if on_disturbance_ball else self.disturbance_rise)
        total = float(polynomial_bound) + self.truncation + self.remainder + rise
        return ProvenBound(total, self.truncation, self.remainder, rise)


def enclosed_growths(loop, first, nodes, shape, next_shapes, rho, order=3, model_order=None):
    """V / rho_k at nodes after a slice, enclosed over the slice and under all disturbances.

    Taylor models enclose the Runge-Kutta map phi, hence g and its square. The terms of norm(g)^2 up to degree order + 1
    involve the parts of g up to degree `order` only: they are the polynomial b that the stage program bounds. All
    others are bounded by Cauchy-Schwarz, degree by degree, and r holds what the models left out of the series and
    rounded.

    Args:
        loop: `ClosedLoop`.
        first: node of the fine grid of slice k.
        nodes: later nodes, increasing.
        shape: P_k, (nx, nx), of V = 1/2 xb'P xb.
        next_shapes: P at these nodes, (nodes, nx, nx).
        rho: rho_k.
        order: degree of the Taylor polynomial of phi in b.
        model_order: degree of the Taylor models, at least `order`; `order` + 2 by default.

    Returns:
        List of `EnclosedGrowth`, one a node.

    Raises:
        ValueError: if the shape is not positive definite, rho not positive, the domain too large for a remainder, or
            the model order below the order.
    """
    model_order = order + 2 if model_order is None else model_order
    if model_order < order:
        raise ValueError(f"Taylor models of order {model_order} do not hold a polynomial of order {order}")
    monomials = Monomials.of(_balls(loop), order + 1)
    growths = []
    for flow, next_shape in zip(_enclosures(loop, first, nodes, shape, rho, model_order), next_shapes, strict=True):
        whitening = cholesky_factor(next_shape).T / np.sqrt(2.0 * rho)
        square = _squared_norm(_combinations(whitening, flow), model_order + 1)
        growths.append(
            EnclosedGrowth(
                monomials=monomials,
                coefficients=square.coefficients[: len(monomials.degree)],
                states=loop.dimension,
                truncation=float(square.degree_bounds[order + 2 :].sum()),
                remainder=square.remainder + _WHITENING * square.bound,
            )
        )
    return growths


def proven_bound(
    loop, first, last, shape, next_shape, rho, polynomial_bound, order=3, model_order=None, on_disturbance_ball=False
):
    r"""Bound of $V_{k+1}(\phi(\bar{x}, w)) / \rho_k$ in which nothing is left out (robust entry funnels, Eq. 22).

    With $b$, truncation and remainder of `enclosed_growths`. If the second derivative of $b$ along one direction of $y$
    is nowhere below $-\kappa_y$, then every $y$ lies on a chord of that direction on which
    $b + \kappa_y \, \text{distance}^2 / 2$ is convex, and $b$ is larger inside than at the better end of the chord by
    $\kappa_y / 2$ at most; likewise for $w$:

        $V_{k+1}(\phi) / \rho_k \le \text{polynomial_bound} + \text{truncation} + \text{remainder} +
          \frac{\kappa_y + \kappa_w}{2}$

    for all $\left\| y \right\| \le 1$ and $\left\| w \right\| \le 1$. As $b$ is nearly $\left\| y \right\|^2$,
    $\kappa_y$ is zero unless the slice is very large. `polynomial_bound` must allow for the defects of its
    floating-point certificate (residual, least eigenvalue of the Gram matrix: `Certificate.safe_bound`). Reference and
    gains are exact as they are stored. That 1e-9 of the bound, which is part of the remainder, covers the rounding of
    the whitening and of $b$ at the samples of the program is taken for granted.

    Args:
        loop: `ClosedLoop`.
        first, last: nodes of the fine grid.
        shape, next_shape: $P_k, P_{k+1}$, (nx, nx), of $V = \frac{1}{2} \bar{x}^\top P \bar{x}$.
        rho: $\rho_k$.
        polynomial_bound: bound of $b$ on the spheres.
        order: degree of the Taylor polynomial of $\phi$ in $b$.
        model_order: degree of the Taylor models, at least `order`; `order` + 2 by default.
        on_disturbance_ball: whether `polynomial_bound` bounds $b$ for $\left\| w \right\| \le 1$ already; then
            $\kappa_w$ is not added.

    Returns:
        `ProvenBound`.

    Raises:
        ValueError: as `enclosed_growths`.
    """
    (growth,) = enclosed_growths(loop, first, [last], shape, [next_shape], rho, order, model_order)
    return growth.bound(polynomial_bound, on_disturbance_ball=on_disturbance_ball)


def covering_spheres(loop):
    """Spheres whose samples serve for the boundary of the slice and for the whole ball of disturbances.

    The ball of w is the shadow of a sphere with one coordinate more: norm(w) <= 1 for the first ones. On that sphere a
    sum of squares, averaged over the sign of the last coordinate v, v^2 = 1 - w'w, is one on the ball with a
    multiplier.

    Args:
        loop: `ClosedLoop`.

    Returns:
        `Spheres`.
    """
    return Spheres((loop.dimension, loop.disturbances + 1) if loop.disturbances else (loop.dimension,))


def proven_stages(loop, shapes, slices, first_level, design, order=3, model_order=None, solver=rank_one):
    """Propagate the level of a funnel so that every step is proven (robust entry funnels, Algorithm 1).

    The flow from a slice is enclosed at all fine nodes up to the next slice (`enclosed_growths`). There the polynomial
    is bounded by a sum of squares, n'Q n = s - b. In between it is nearly (1 - c) norm(y)^2 + c b, with c the part of
    the stage that has passed, so that (1 - c) + c s with c Q is a sum of squares but for a small residual, which
    `absorb_residual` turns into a rise.

    A deviation inside the first slice stays within the levels at all nodes under every w that is constant over each
    stage and whose norm never exceeds 1. What is taken for granted: see `proven_bound`.

    Args:
        loop: `ClosedLoop`.
        shapes: P at every fine node, (n + 1, nx, nx).
        slices: fine nodes of the slices, (N,), increasing.
        first_level: rho_1.
        design: `Design` on `covering_spheres(loop)`, of basis degree d with 2 d >= order + 1.
        order, model_order: as of `enclosed_growths`.
        solver: function of values (M,) and basis (M, p) that returns a `Certificate`.

    Yields:
        `ProvenStage`, one a stage.

    Raises:
        FunnelError: if a stage cannot be proven; the message names its slice, counted from 1.
    """
    if design.spheres != covering_spheres(loop):
        raise FunnelError(f"the design must be on {covering_spheres(loop)}, not on {design.spheres}")
    if 2 * design.degree < order + 1:
        raise FunnelError(f"a basis of degree {design.degree} cannot carry a polynomial of degree {order + 1}")
    points = design.points[:, : loop.dimension + loop.disturbances]
    at_points = Monomials.of(_balls(loop), order + 1).evaluate(points)
    level = float(first_level)
    for k, (first, last) in enumerate(pairwise(np.asarray(slices).tolist())):
        nodes = np.arange(first + 1, last + 1)
        try:
            growths = enclosed_growths(loop, first, nodes, shapes[first], shapes[nodes], level, order, model_order)
        except ValueError as error:
            raise FunnelError(f"nothing is proven after slice {k + 1}, rho = {level:.4g}: {error}") from error
        certificate = solver(at_points @ growths[-1].coefficients, design.basis)
        fraction = (loop.time[nodes[:-1]] - loop.time[first]) / (loop.time[last] - loop.time[first])
        safe = [
            absorb_residual(
                at_points @ growth.coefficients, design.basis, 1.0 - c + c * certificate.bound, c * certificate.gram
            )[0]
            for c, growth in zip(fraction, growths, strict=False)
        ]
        safe.append(certificate.safe_bound)
        bounds = [growth.bound(s, on_disturbance_ball=True) for growth, s in zip(growths, safe, strict=True)]
        levels = level * np.array([bound.bound for bound in bounds])
        if not np.isfinite(levels).all():
            raise FunnelError(f"nothing is proven after slice {k + 1}, rho = {level:.4g}: {certificate.status}")
        end = bounds[-1]
        yield ProvenStage(nodes, levels, certificate.safe_bound, end.truncation, end.remainder, end.rise)
        level = float(levels[-1])


def _enclosures(loop, first, nodes, shape, rho, order):
    """Enclosures of the flow at several nodes after a slice."""
    coordinates = variables(_balls(loop), order)
    disturbance = coordinates[loop.dimension :]
    deviation = _combinations(spread_of(shape, rho), coordinates[: loop.dimension])
    flows = []
    for node in nodes:
        deviation = loop.flow(first, int(node), deviation, disturbance)
        first = int(node)
        flows.append(list(deviation))
    return flows


def _rise_inside(monomials, coefficients, among):
    """Half the most negative curvature of a polynomial along one direction of some variables."""

    def along(direction, coefficients):
        return sum(d * monomials.derivative(coefficients, i) for d, i in zip(direction, among, strict=True))

    # The direction of the largest curvature at zero.
    hessian = [[monomials.derivative(monomials.derivative(coefficients, i), j)[0] for j in among] for i in among]
    direction = np.linalg.eigh(hessian)[1][:, -1]
    curvature = along(direction, along(direction, coefficients))
    return max(0.0, float(monomials.degree_bounds(curvature)[1:].sum() - curvature[0]) / 2)


def _squared_norm(components, order):
    """Sum of squares; constant terms, which are zero but for rounding, count as remainders."""
    total = 0.0
    for component in components:
        coefficients = component.coefficients.copy()
        constant, coefficients[0] = abs(coefficients[0]), 0.0
        centred = TaylorModel(coefficients, component.remainder + constant, component.monomials).lifted(order)
        total = total + centred * centred
    return total


def _balls(loop):
    return (loop.dimension, loop.disturbances) if loop.disturbances else (loop.dimension,)


def _combinations(matrix, components):
    """Matrix times a sequence of components; zero entries are skipped."""
    rows = [[(entry, c) for entry, c in zip(row, components, strict=True) if entry] for row in matrix.tolist()]
    return [sum(entry * c for entry, c in row) for row in rows]
