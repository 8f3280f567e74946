"""Levels of a funnel from slice to slice, forward and backward (robust entry funnels, Algorithm 1)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import lgamma, pi

import numpy as np

from marsedl.methods.funnels.stage import FunnelStage, cholesky_factor
from marsedl.methods.sos.sampled_program import rank_one
from marsedl.summaries import summary

__all__ = ["Funnel", "FunnelError", "StageRule", "backward", "forward", "initial_level", "largest_feedback"]

# Largest distance from a bound to its dual value, relative to the values, at which a program counts as solved.
_CLOSED = 1e-5


class FunnelError(ValueError):
    """A funnel does not exist, or a stage of it could not be computed; the message names the slice."""


@dataclass(frozen=True, eq=False)
class Funnel:
    """Slices {1/2 xb'P_k xb <= rho_k} and what each of the stages between them gave (robust entry funnels, Eq. 18).

    Args:
        slices: fine steps at which the slices lie, (N,).
        shapes: P_k, (N, nx, nx).
        rho: levels, (N,).
        polynomial_bound: s_k of the sums-of-squares program, (N - 1,): nowhere on the boundaries of slice and
            disturbance set is the truncated polynomial of the stage above s_k rho_k, residuals and rounding of the
            program included (`Certificate.safe_bound`).
        true_maximum: largest V_{k+1}/rho_k of the integrated error, as found or proven, (N - 1,); nan if not sought.
        growth: factor by which the stage raised the level, (N - 1,): s_k, or true_maximum where that is larger and the
            funnel is inflated.
        additive: growth beta_k by disturbances outside the programs, (N - 1,):
            sqrt(rho_{k+1}) = sqrt(growth rho_k) + sqrt(beta_k), with <= in a backward funnel.
        gap: duality gap of the programs, (N - 1,), in units of V/rho_k.
        residual: largest violation of their equations at the samples, (N - 1,), in units of V/rho_k.
        iterations: iterations of the solver, (N - 1,).
        programs: programs solved for the stage, (N - 1,); one in a forward funnel.
        status: what the solver said, N - 1 texts.
        verifications: what the check of each stage returned, N - 1 objects, or none without a check.
    """

    slices: np.ndarray
    shapes: np.ndarray
    rho: np.ndarray
    polynomial_bound: np.ndarray
    true_maximum: np.ndarray
    growth: np.ndarray
    additive: np.ndarray
    gap: np.ndarray
    residual: np.ndarray
    iterations: np.ndarray
    programs: np.ndarray
    status: tuple
    verifications: tuple

    __repr__ = summary

    @property
    def violation(self):
        """How far the true maximum is above the bound of the polynomial, relative, (N - 1,); negative if below."""
        return self.true_maximum / self.polynomial_bound - 1

    @cached_property
    def half_widths(self):
        """Largest deviation of every state within every slice, sqrt(2 rho (P^-1)_ii), (N, nx)."""
        return np.array([_half_widths(shape, rho) for shape, rho in zip(self.shapes, self.rho, strict=True)])

    @cached_property
    def log_volumes(self):
        r"""Natural logarithm of the volumes of the slices, (N,).

            $\log\left( c_n (2 \rho)^{n/2} \det(P)^{-1/2} \right), \quad c_n = \frac{\pi^{n/2}}{\Gamma(n/2 + 1)}$

        Eq. 19 has the square of it, which changes no optimum.
        """
        n = self.shapes.shape[1]
        ball = n / 2 * np.log(pi) - lgamma(n / 2 + 1)
        logarithms = [np.log(np.diag(cholesky_factor(shape))).sum() for shape in self.shapes]
        return ball + n / 2 * np.log(2 * self.rho) - np.array(logarithms)


def initial_level(shape, initial_set):
    r"""Least level whose slice contains the initial set (robust entry funnels, Eq. 20).

        $\rho_1 = \text{largest eigenvalue of } M_1^{-1/2} P_1 M_1^{-1/2}, \quad M_1 - P_1 / \rho_1 \succeq 0
          \text{ and singular}$

    Args:
        shape: $P_1$, (nx, nx).
        initial_set: $M_1$ of the initial set $\left\{ \frac{1}{2} \bar{x}^\top M_1 \bar{x} \le 1 \right\}$, (nx, nx).

    Returns:
        $\rho_1$.

    Raises:
        ValueError: if a matrix is not positive definite.
    """
    outer = cholesky_factor(shape, "P of the first slice").T
    inner = cholesky_factor(initial_set, "the matrix of the initial set").T
    return float(np.linalg.norm(np.linalg.solve(inner.T, outer.T), 2) ** 2)


def largest_feedback(gain, shape, rho):
    """Largest control deviation within a slice, sqrt(2 rho K P^-1 K'), for every control.

    Args:
        gain: K, (nu, nx).
        shape: P, (nx, nx).
        rho: level of the slice.

    Returns:
        Array (nu,), units of the controls.
    """
    return np.sqrt(2 * rho) * np.linalg.norm(np.linalg.solve(cholesky_factor(shape), np.transpose(gain)), axis=0)


@dataclass(frozen=True, eq=False)
class StageRule:
    """How the stages of a funnel are bounded (robust entry funnels, Eqs. 22 to 26).

    Args:
        solver: function of values (M,) and basis (M, p) that returns a `Certificate`.
        order, condition, raw_scale: of `FunnelStage`.
        maximum: None, or a function of `FunnelStage` and s_k that returns the largest V_{k+1}/rho_k of the integrated
            error, no series between: found by an ascent, which shows where s_k is not a bound, or proven.
        inflate: raise the level to that maximum, where it is larger: rho_{k+1} = max(s_k, maximum) rho_k. Only with a
            proven maximum are the slices proven to follow one another.
        verify: None, or a function of design, certificate and polynomial whose results the funnel carries. One that is
            not `sound` makes no funnel.
        feedback_limit: None, or the largest control deviation for which the Taylor polynomial means something, (nu,).

    """

    solver: Callable = rank_one
    order: int = 3
    condition: str = "flow"
    raw_scale: np.ndarray | None = None
    maximum: Callable | None = None
    inflate: bool = False
    verify: Callable | None = None
    feedback_limit: np.ndarray | None = None

    __repr__ = summary


def forward(loop, shapes, slices, first_level, design, rule=None, *, additive=None, limit=1e3, progress=None):
    r"""Propagate the level of a funnel from its first slice to its last (robust entry funnels, Algorithm 1, Eq. 36).

        $\rho_{k+1} = s_k \rho_k, \quad s_k = \min \left\{ s \text{: } s - b_k
          \text{ is a sum of squares on the spheres} \right\}$

    As long as $s_k \rho_k$ does not decrease when $\rho_k$ grows, nothing is lost by taking one stage after the other:
    with fixed $P_k$ every level is the least one, and the levels also solve Eq. 25.

    Args:
        loop: `ClosedLoop` of n fine steps.
        shapes: $P_k$, (N, nx, nx).
        slices: fine steps at which the slices lie, (N,), increasing.
        first_level: $\rho_1$, see `initial_level`.
        design: well chosen samples (robust entry funnels, Eq. 24), of basis degree $d$ with $2 d \ge \text{order} + 1$.
        rule: `StageRule`; None: the one with all defaults.
        additive: None, or $\beta_k$ of `linear.additive_growth`, (N - 1,).
        limit: level above which the funnel counts as diverged.
        progress: None, or a function of slice number and level, called after each stage.

    Returns:
        `Funnel`.

    Raises:
        FunnelError: if a shape is not positive definite, a slice asks for more feedback than allowed, the funnel
            diverges, a stage is not closed, or its certificate fails the check; the message names the slice, counted
            from 1.
    """
    stages = _Stages(loop, shapes, slices, design, rule or StageRule(), additive)
    levels, outcomes = [float(first_level)], []
    stages.check_feedback(0, levels[0])
    for k in range(stages.count):
        outcome = stages.solve(k, levels[-1])
        level = float((np.sqrt(outcome.growth * levels[-1]) + np.sqrt(stages.additive[k])) ** 2)
        if not level <= limit:
            raise FunnelError(stages.divergence(k + 1, level, levels[0], limit))
        stages.check_feedback(k + 1, level)
        levels.append(level)
        outcomes.append(stages.verified(k, outcome))
        if progress is not None:
            progress(k + 2, level)
    return stages.funnel(levels, outcomes)


def backward(loop, shapes, slices, last_level, design, rule=None, *, additive=None, tolerance=1e-6):
    r"""Largest slices from which the last one is reached, from the last to the first (robust entry funnels, Sec. 5).

        $\text{largest } \rho_k \text{ with } \rho_k s_k(\rho_k) \le \rho_{k+1}$

    The samples depend on the unknown, so this is not a single program: $\ln\rho_k$ is found by the secant rule within a
    bracket, and a level is taken only if it satisfies the inequality.

    Args:
        last_level: $\rho_N$.
        tolerance: how far $\rho_k s_k$ may stay below $\rho_{k+1}$, relative.
        loop, shapes, slices, design, rule, additive: as for `forward`.

    Returns:
        `Funnel`.

    Raises:
        FunnelError: as `forward`, or if the disturbance leaves the next slice from everywhere in this one.
    """
    stages = _Stages(loop, shapes, slices, design, rule or StageRule(), additive)
    levels, outcomes, growth = [float(last_level)], [], 1.0
    for k in reversed(range(stages.count)):
        level, outcome = stages.largest_level(k, levels[0], growth, tolerance)
        stages.check_feedback(k, level)
        levels.insert(0, level)
        outcomes.insert(0, stages.verified(k, outcome))
        growth = outcome.growth
    return stages.funnel(levels, outcomes)


@dataclass(frozen=True, eq=False)
class _Outcome:
    """A solved stage."""

    stage: FunnelStage
    certificate: object
    true_maximum: float
    growth: float
    programs: int = 1
    verification: object = None


@dataclass(frozen=True, eq=False)
class _Stages:
    """All stages of a funnel, to be solved at levels that are not known yet."""

    loop: object
    shapes: np.ndarray
    slices: np.ndarray
    design: object
    rule: StageRule
    additive: np.ndarray | None

    def __post_init__(self):
        slices, shapes = np.asarray(self.slices), np.asarray(self.shapes, dtype=float)
        steps = self.loop.steps
        integers = slices.ndim == 1 and len(slices) > 1 and np.issubdtype(slices.dtype, np.integer)
        if not integers or (np.diff(slices) < 1).any() or slices[0] < 0 or slices[-1] > steps:
            raise FunnelError(f"slices must be two or more fine steps, increasing, within 0 ... {steps}")
        if len(shapes) != len(slices):
            raise FunnelError(f"{len(slices)} slices need as many shapes, not {len(shapes)}")
        spheres = (shapes.shape[-1], self.loop.disturbances)[: 2 if self.loop.disturbances else 1]
        if self.design.spheres.dimensions != spheres:
            raise FunnelError(f"the design must be on spheres {spheres}, not {self.design.spheres.dimensions}")
        order = self.rule.order
        if 2 * self.design.degree < order + 1:
            raise FunnelError(
                f"a basis of degree {self.design.degree} cannot carry the polynomial of degree {order + 1} of a stage "
                f"of order {order}"
            )
        additive = np.zeros(len(slices) - 1) if self.additive is None else np.asarray(self.additive, dtype=float)
        if additive.shape != (len(slices) - 1,) or not (additive >= 0).all():
            raise FunnelError(f"additive must be {len(slices) - 1} growths of 0 or more")
        if self.rule.inflate and self.rule.maximum is None:
            raise FunnelError("an inflated funnel needs the function `maximum`")
        for name, value in (("slices", slices), ("shapes", shapes), ("additive", additive)):
            object.__setattr__(self, name, value)
        for k, shape in enumerate(shapes):
            _or_funnel_error(cholesky_factor, shape, f"P of {self.name(k)}")

    @property
    def count(self):
        """Number of stages."""
        return len(self.slices) - 1

    def name(self, k):
        """What an error calls slice k, counted from 0 here and from 1 there."""
        return f"slice {k + 1} of {len(self.slices)} (t = {self.loop.time[self.slices[k]]:g} s)"

    def solve(self, k, rho):
        """Stage from slice k at level rho."""
        first, last = int(self.slices[k]), int(self.slices[k + 1])
        stage = _or_funnel_error(
            FunnelStage,
            self.loop,
            first,
            last,
            self.shapes[k],
            self.shapes[k + 1],
            rho,
            self.rule.order,
            self.rule.condition,
            self.rule.raw_scale,
        )
        with np.errstate(all="ignore"):
            values = stage.values(self.design.points)
        if not np.isfinite(values).all():
            raise FunnelError(f"the polynomial of the stage from {self.name(k)} at rho = {rho:.4g} is not finite")
        certificate = self.rule.solver(values, self.design.basis)
        bound = certificate.safe_bound
        # What counts is a bound with a sum of squares, close to the least one; not what the solver says of itself.
        if not bound - (certificate.bound - certificate.gap) <= _CLOSED * np.abs(values).max():
            raise FunnelError(
                f"the program of the stage from {self.name(k)} at rho = {rho:.4g} was not closed: {certificate.status} "
                f"(gap {certificate.gap:.2g}, residual {certificate.residual:.2g}, safe bound {bound:.6g})"
            )
        if not bound > 0:
            raise FunnelError(
                f"the {self.rule.condition} condition leaves no slice after {self.name(k)}: the bound on V is "
                f"{bound:.3g} rho_k; its step is too long"
            )
        true_maximum = np.nan if self.rule.maximum is None else float(self.rule.maximum(stage, bound))
        growth = max(bound, true_maximum) if self.rule.inflate else bound
        return _Outcome(stage, certificate, true_maximum, float(growth))

    def verified(self, k, outcome):
        """An outcome with the result of its check; one that fails it makes no funnel."""
        if self.rule.verify is None:
            return outcome
        check = self.rule.verify(self.design, outcome.certificate, outcome.stage.values)
        if not getattr(check, "sound", True):
            raise FunnelError(
                f"the certificate of the stage from {self.name(k)} at rho = {outcome.stage.rho:.4g} fails its check: "
                f"its identity is off by {check.identity_error:.2g}, the least value of the polynomial is "
                f"{check.least_value:.2g}, the least eigenvalue {check.least_eigenvalue:.2g}"
            )
        return replace(outcome, verification=check)

    def largest_level(self, k, next_level, guess, tolerance):
        """Largest level of slice k from which the next one stays within its own, and the stage there."""
        room = np.sqrt(next_level) - np.sqrt(self.additive[k])
        if not room > 0:
            raise FunnelError(f"additive disturbances alone leave {self.name(k + 1)} at rho = {next_level:.4g}")
        target = 2 * np.log(room)
        trial, slope = target - np.log(guess) - tolerance / 2, 1.0
        low, high, previous, best, failure = -np.inf, np.inf, None, None, None
        for programs in range(1, 61):
            try:
                outcome = self.solve(k, float(np.exp(trial)))
                excess, failure = trial + np.log(outcome.growth) - target, None
            except FunnelError as error:
                # Too large a slice for its series, perhaps; a smaller one may do.
                outcome, excess, failure = None, np.inf, error
            if -tolerance <= excess <= 0:
                return float(np.exp(trial)), replace(outcome, programs=programs)
            if excess <= 0:
                low, best = trial, outcome
            else:
                high = trial
            if high - low < 1e-3 * tolerance:
                return float(np.exp(low)), replace(best, programs=programs)
            if previous is not None and np.isfinite(excess):
                slope = np.clip((excess - previous[1]) / (trial - previous[0]), 0.1, 10.0)
            if np.isfinite(excess):
                previous = trial, excess
                trial = trial - (excess + tolerance / 2) / slope
            if not low < trial < high:
                trial = (low + high) / 2 if np.isfinite(low) else high - 1.0
            if trial < target - 30:
                raise failure or FunnelError(
                    f"no slice before {self.name(k + 1)} at rho = {next_level:.4g}: the disturbance leaves it from "
                    "everywhere"
                )
        raise FunnelError(f"the level of {self.name(k)} was not found in {programs} programs")

    def check_feedback(self, k, rho):
        """Refuse a slice on which the feedback leaves the range of the series."""
        if self.rule.feedback_limit is None:
            return
        feedback = largest_feedback(self.loop.gains[2 * self.slices[k]], self.shapes[k], rho)
        worst = np.argmax(feedback / self.rule.feedback_limit)
        limit = np.broadcast_to(self.rule.feedback_limit, feedback.shape)[worst]
        if feedback[worst] > limit:
            raise FunnelError(
                f"{self.name(k)} at rho = {rho:.4g} asks for a deviation {feedback[worst]:.4g} of control {worst + 1}, "
                f"more than the limit {limit:.4g}" + ("; the initial set is too large" if k == 0 else "")
            )

    def divergence(self, k, rho, first_level, limit):
        """What to say of a funnel that has no end."""
        wide = _half_widths(self.shapes[k], rho) / _half_widths(self.shapes[0], first_level)
        return (
            f"the funnel diverges: rho = {rho:.4g} exceeds {limit:g} at {self.name(k)}; state {np.argmax(wide) + 1} of "
            f"{len(wide)} has grown most, to {wide.max():.3g} times its deviation at the start"
        )

    def funnel(self, levels, outcomes):
        """The funnel of all stages."""
        certificates = [outcome.certificate for outcome in outcomes]
        verifications = tuple(outcome.verification for outcome in outcomes)
        return Funnel(
            slices=self.slices,
            shapes=self.shapes,
            rho=np.array(levels),
            polynomial_bound=np.array([certificate.safe_bound for certificate in certificates]),
            true_maximum=np.array([outcome.true_maximum for outcome in outcomes]),
            growth=np.array([outcome.growth for outcome in outcomes]),
            additive=self.additive,
            gap=np.array([certificate.gap for certificate in certificates]),
            residual=np.array([certificate.residual for certificate in certificates]),
            iterations=np.array([certificate.iterations for certificate in certificates]),
            programs=np.array([outcome.programs for outcome in outcomes]),
            status=tuple(certificate.status for certificate in certificates),
            verifications=() if all(value is None for value in verifications) else verifications,
        )


def _half_widths(shape, rho):
    """Largest deviation of every state in the slice."""
    return np.sqrt(2 * rho) * np.linalg.norm(np.linalg.inv(cholesky_factor(shape)), axis=0)


def _or_funnel_error(function, *arguments):
    """Call a function, of whose complaints about its arguments a funnel is the subject."""
    try:
        return function(*arguments)
    except ValueError as error:
        raise FunnelError(str(error)) from error
