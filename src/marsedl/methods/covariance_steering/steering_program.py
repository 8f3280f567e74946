r"""What a chance-constrained covariance steering program consists of (random field, Eq. 56), checked; and its law.

    $x_{k+1} = A_k x_k + B_k u_k + c_k + w_k, \quad u_k = v_k + \sum_{l \le k} K_{kl} (x_l - \bar{x}_l)$

The disturbances are Gaussian with mean zero (a mean belongs to $c_k$) and correlated over time, so the feedback is of
the whole history of states. Nothing here is scaled: choose units in which typical deviations are of order one.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from marsedl.methods.checks import require_array
from marsedl.methods.covariance_steering.chance import upper_quantile
from marsedl.methods.linear_system import Covariances
from marsedl.models.correlations import correlations
from marsedl.summaries import summary

__all__ = [
    "BlockSystem",
    "HalfPlane",
    "Margin",
    "Percentile",
    "Stacked",
    "SteeringLaw",
    "SteeringProgram",
    "TrustRegion",
    "closed_loop",
    "diagonal_blocks",
    "margins",
    "present_gains",
    "stacked",
]


class BlockSystem(NamedTuple):
    """x_{k+1} = A_k x_k + B_k u_k + c_k + w_k over N intervals (random field, Eq. 23), statistics of x_0 and W."""

    transition: np.ndarray  # A_k, (N, n, n)
    control: np.ndarray  # B_k, (N, n, m)
    affine: np.ndarray  # c_k and the mean of w_k together, (N, n)
    initial_mean: np.ndarray  # (n,)
    initial_covariance: np.ndarray  # P_0, may be zero, (n, n)
    disturbance_covariance: np.ndarray  # Cov(W) of the stacked disturbances, (N n, N n)

    __repr__ = summary

    @classmethod
    def of(cls, system, initial_mean, initial_covariance):
        """The system with white disturbances: `LinearSystem`, (n,), (n, n)."""
        from scipy.linalg import block_diag

        disturbances = block_diag(*system.noise)
        return cls(system.transition, system.control, system.affine, initial_mean, initial_covariance, disturbances)


class Stacked(NamedTuple):
    """Matrices of X = A x_0 + B U + C + G W (random field, Eq. 30)."""

    transition: np.ndarray  # A, ((N + 1) n, n)
    control: np.ndarray  # B, ((N + 1) n, N m)
    disturbance: np.ndarray  # G, ((N + 1) n, N n)
    affine: np.ndarray  # C, ((N + 1) n,)

    __repr__ = summary


@dataclass(frozen=True, eq=False)
class HalfPlane:
    """Chance constraint P(normal' x_k >= bound) <= probability, of a state or a control (random field, Eqs. 9 and 10).

    Raises:
        ValueError: if the probability is not between 0 and 0.5, or normal or bound are not finite numbers.
    """

    step: int  # k
    normal: np.ndarray  # (n,) or (m,)
    bound: float
    probability: float  # of violation
    name: str = ""  # for messages

    __repr__ = summary

    def __post_init__(self):
        """Check the fields."""
        label = f"half plane {self.name!r}" if self.name else f"half plane at step {self.step}"
        _set_vector(self, label, "normal")
        if not np.any(self.normal):
            raise ValueError(f"{label}: normal must have an entry that is not zero")
        _set_number(self, label, "bound")
        _check_probability(self, label)


@dataclass(frozen=True, eq=False)
class Percentile:
    """The upper percentile gamma of a linear cost: P(offset + gradient' x_N > gamma) = probability (Eqs. 51 to 53).

    Raises:
        ValueError: if the probability is not between 0 and 0.5, or gradient or offset are not finite numbers.
    """

    gradient: np.ndarray  # xi, (n,)
    offset: float
    probability: float  # p_f

    __repr__ = summary

    def __post_init__(self):
        """Check the fields."""
        _set_vector(self, "percentile", "gradient")
        _set_number(self, "percentile", "offset")
        _check_probability(self, "percentile")


@dataclass(frozen=True, eq=False)
class TrustRegion:
    """|row' xbar_k - reference| <= radius (random field, Eq. 55, for a weight M = row row').

    Raises:
        ValueError: if the radius is negative, or a field is not finite.
    """

    step: int  # k
    row: np.ndarray  # (n,)
    reference: float
    radius: float

    __repr__ = summary

    def __post_init__(self):
        """Check the fields."""
        label = f"state trust region at step {self.step}"
        _set_vector(self, label, "row")
        _set_number(self, label, "reference")
        _set_number(self, label, "radius")
        if self.radius < 0:
            raise ValueError(f"{label}: radius must not be negative, but is {self.radius}")


@dataclass(frozen=True, eq=False)
class SteeringProgram:
    r"""Everything that Eq. 56 (random field) is made of; N intervals, n states, m controls.

        $\text{minimize} \quad \sum_{k < N} \left\{ \text{E}\left[ (x_k - x_k^\text{d})^\top Q_k (x_k - x_k^\text{d}) +
          \tilde{u}_k^\top R_k \tilde{u}_k \right] + v_k^\top \bar{R}_k v_k \right\} + \eta \max_i \gamma_i$

    `control_trust` limits every component of $v_k - \hat{u}_k$ alone (a maximum norm). Of one control that is Eq. 54;
    of m controls it lets a change be up to $\sqrt{m}$ times as long as the norm of Eq. 54 with a unit weight does.

    Raises:
        ValueError: naming the field, if a shape does not fit, a value is not finite, a step lies outside the program,
            or a covariance or weight is not symmetric positive semidefinite.
    """

    system: BlockSystem
    state_weight: np.ndarray  # Q_k, (N, n, n)
    control_weight: np.ndarray  # R_k of the control's deviation, (N, m, m)
    mean_control_weight: np.ndarray  # Rbar_k, (N, m, m)
    desired_state: np.ndarray | None = None  # x^d, (N + 1, n); None: the mean itself, so its cost vanishes
    state_constraints: tuple[HalfPlane, ...] = ()
    control_constraints: tuple[HalfPlane, ...] = ()
    final_mean: np.ndarray | None = None  # (n,); NaN: that component is free
    final_covariance: np.ndarray | None = None  # upper bound of P_N, (n, n)
    percentiles: tuple[Percentile, ...] = ()  # of the final state
    percentile_weight: float = 0.0  # eta
    control_reference: np.ndarray | None = None  # centre of the controls' trust region, (N, m); None: zero
    control_trust: float | None = None  # largest |v - reference|, every component
    state_trust: tuple[TrustRegion, ...] = ()

    __repr__ = summary

    def __post_init__(self):
        """Check the fields."""
        system = BlockSystem(*(np.asarray(field, dtype=float) for field in self.system))
        if system.control.ndim != 3:
            raise ValueError(f"system.control must have shape (N, n, m), not {system.control.shape}")
        intervals, n, m = system.control.shape
        if min(intervals, n, m) < 1:
            raise ValueError(f"system.control has shape {system.control.shape}: N, n and m must be at least 1")
        shapes = {
            "transition": (intervals, n, n),
            "control": (intervals, n, m),
            "affine": (intervals, n),
            "initial_mean": (n,),
            "initial_covariance": (n, n),
            "disturbance_covariance": (intervals * n, intervals * n),
        }
        for name, shape in shapes.items():
            require_array(f"system.{name}", getattr(system, name), shape)
        object.__setattr__(self, "system", system)
        stacked_shapes = {
            "state_weight": (intervals, n, n),
            "control_weight": (intervals, m, m),
            "mean_control_weight": (intervals, m, m),
            "desired_state": (intervals + 1, n),
            "final_mean": (n,),
            "final_covariance": (n, n),
            "control_reference": (intervals, m),
        }
        for name, shape in stacked_shapes.items():
            value = getattr(self, name)
            if value is None and name in ("desired_state", "final_mean", "final_covariance", "control_reference"):
                continue
            value = np.asarray(value, dtype=float)
            free = np.isnan(value) if name == "final_mean" else False
            require_array(name, np.where(free, 0.0, value), shape)
            object.__setattr__(self, name, value)
        for name in ("initial_covariance", "disturbance_covariance"):
            correlations(f"system.{name}", getattr(system, name))
        for name in ("state_weight", "control_weight", "mean_control_weight"):
            for k, weight in enumerate(getattr(self, name)):
                correlations(f"{name}[{k}]", weight)
        if self.final_covariance is not None:
            correlations("final_covariance", self.final_covariance, definite=True)  # Eq. 48 divides by its root
        _set_number(self, "steering program", "percentile_weight")
        if self.percentile_weight < 0:
            raise ValueError(f"percentile_weight must not be negative, but is {self.percentile_weight}")
        if self.percentile_weight > 0 and not self.percentiles:
            raise ValueError("percentile_weight is positive but there are no percentiles; give one or set it to zero")
        if self.control_trust is not None:
            _set_number(self, "steering program", "control_trust")
            if self.control_trust < 0:
                raise ValueError(f"control_trust must not be negative, but is {self.control_trust}")
        for name, kind, field, size, last in (
            ("state_constraints", HalfPlane, "normal", n, intervals),
            ("control_constraints", HalfPlane, "normal", m, intervals - 1),
            ("percentiles", Percentile, "gradient", n, None),
            ("state_trust", TrustRegion, "row", n, intervals),
        ):
            items = tuple(getattr(self, name))
            object.__setattr__(self, name, items)
            for i, item in enumerate(items):
                if not isinstance(item, kind):
                    raise ValueError(f"{name}[{i}] must be a {kind.__name__}, not {type(item).__name__}")
                require_array(f"{name}[{i}].{field}", getattr(item, field), (size,))
                if last is not None and not 0 <= item.step <= last:
                    raise ValueError(f"{name}[{i}].step is {item.step}, but must lie in 0 ... {last}")


class SteeringLaw(NamedTuple):
    """Solution of a `SteeringProgram`: u_k = control_k + sum_{l <= k} gain_kl (x_l - mean_l)."""

    control: np.ndarray  # v_k, (N, m)
    gain: np.ndarray  # K_kl, zero for l > k, (N, N + 1, m, n)
    mean: np.ndarray  # xbar_k, (N + 1, n)
    covariance: np.ndarray  # of the states, (N + 1, n, n)
    control_covariance: np.ndarray  # (N, m, m)
    objective: float  # quadratic_cost + percentile_weight * percentile
    quadratic_cost: float  # J_1 with its constants
    percentile: float  # J_2, largest of the percentiles with their offsets; nan without any
    status: str  # of CVXPY: "optimal", or "optimal_inaccurate" where the solver did not reach what it was asked for
    said: str  # the solver's own word for it
    accepted_by: str  # why the solution counts: see `conic.Outcome`
    attempt: int  # number of the solver's settings that gave it, from 1
    iterations: int  # of the solver
    solver: str
    duality_gap: float  # of the scaled cone program, relative, as the solver reports it
    primal_residual: float  # likewise
    dual_residual: float  # likewise
    innovations: int  # rank of the covariance of x_0 and W
    condition: float  # condition number of Cov(W), directions without innovation left out
    largest_gain: float  # largest |K_kl| in the program's units, without those on an initial state that is known

    __repr__ = summary


class Margin(NamedTuple):
    """How far a law is from one of its program's constraints."""

    kind: str  # "state constraints", "control constraints", "final mean", ...
    name: str
    quantity: str  # what is limited
    value: float  # of the quantity
    limit: float  # it must not exceed this
    excess: float  # (value - limit) over the size of the constraint: 0 if active, positive if violated


def stacked(system):
    r"""Stack the system over its intervals (random field, Eqs. 29 and 30).

        $X = A x_0 + B U + C + G W, \quad \text{block } k \text{ of } C \text{:} \quad A_{k-1} C_{k-1} + c_{k-1}$

    Eq. 29 prints $A_1 c_1$ as the third block of $C$; the recursion gives $A_1 c_0 + c_1$.

    Args:
        system: `BlockSystem`.

    Returns:
        `Stacked`.
    """
    intervals, n, m = np.shape(system.control)
    transition, control = np.zeros((intervals + 1, n, n)), np.zeros((intervals + 1, n, intervals, m))
    disturbance, affine = np.zeros((intervals + 1, n, intervals, n)), np.zeros((intervals + 1, n))
    transition[0] = np.eye(n)
    for k, across in enumerate(system.transition):
        transition[k + 1] = across @ transition[k]
        affine[k + 1] = across @ affine[k] + system.affine[k]
        control[k + 1] = np.tensordot(across, control[k], 1)
        control[k + 1, :, k] = system.control[k]
        disturbance[k + 1] = np.tensordot(across, disturbance[k], 1)
        disturbance[k + 1, :, k] = np.eye(n)
    rows = (intervals + 1) * n
    return Stacked(
        transition.reshape(rows, n), control.reshape(rows, -1), disturbance.reshape(rows, -1), affine.reshape(rows)
    )


def closed_loop(system, gain, disturbance_covariance=None):
    r"""Covariances under any feedback of the history (random field, Eqs. 34, 40 to 42).

        $P_X = (I - B K)^{-1} S (I - B K)^{-\top}, \quad P_U = K P_X K^\top, \quad S = A P_0 A^\top + G \, \text{Cov}(W)
          \, G^\top$

    Args:
        system: `BlockSystem`.
        gain: $K_{kl}$, (N, N + 1, m, n); blocks with $l > k$ must be zero.
        disturbance_covariance: $\text{Cov}(W)$ to use instead of the system's, for instance without the noise that a
            design added to it, (N n, N n).

    Returns:
        `Covariances`.

    Raises:
        ValueError: if a shape does not fit, or the gain is not causal.
    """
    intervals, n, m = np.shape(system.control)
    gain = np.asarray(gain, dtype=float)
    require_array("gain", gain, (intervals, intervals + 1, m, n))
    if any(gain[k, k + 1 :].any() for k in range(intervals)):
        raise ValueError("gain is not causal: K[k, l] must be zero for l > k")
    covariance = system.disturbance_covariance if disturbance_covariance is None else disturbance_covariance
    covariance = np.asarray(covariance, dtype=float)
    require_array("disturbance_covariance", covariance, (intervals * n, intervals * n))

    blocks = stacked(system)
    feedback = gain.transpose(0, 2, 1, 3).reshape(intervals * m, -1)
    response = np.linalg.inv(np.eye((intervals + 1) * n) - blocks.control @ feedback)
    initial, disturbed = response @ blocks.transition, response @ blocks.disturbance
    states = initial @ system.initial_covariance @ initial.T + disturbed @ covariance @ disturbed.T
    controls = feedback @ states @ feedback.T
    return Covariances(diagonal_blocks(states, n), diagonal_blocks(controls, m))


def margins(program, law):
    """Compare a law with every constraint of a program (random field, Eqs. 44 to 48, 54 and 55).

    Args:
        program: `SteeringProgram`.
        law: `SteeringLaw`, or anything with its control, mean, covariance and control_covariance.

    Returns:
        One `Margin` for every half plane, component of the final mean, the final covariance, and every trust region,
        in this order; the trust region of the controls counts as one.
    """
    rows = []
    for kind, symbol, items, means, covariances in (
        ("state", "x", program.state_constraints, law.mean, law.covariance),
        ("control", "u", program.control_constraints, law.control, law.control_covariance),
    ):
        for i, item in enumerate(items):
            deviation = np.sqrt(item.normal @ covariances[item.step] @ item.normal)
            middle = item.normal @ means[item.step]
            value = middle + upper_quantile(item.probability) * deviation
            size = max(abs(item.bound), abs(middle), value - middle)
            name = f"{kind} constraint {item.name or i} at step {item.step}"
            quantity = f"value of normal' {symbol} exceeded with probability {item.probability:g}"
            rows.append((f"{kind} constraints", name, quantity, value, item.bound, size))
    distance = "distance from the reference"
    if program.final_mean is not None:
        known = np.flatnonzero(~np.isnan(program.final_mean))
        size = max(np.abs(program.final_mean[known]).max(initial=0.0), np.abs(law.mean).max())
        for i in known:
            distance = abs(law.mean[-1, i] - program.final_mean[i])
            rows.append(("final mean", f"final mean of state {i}", "distance from it", distance, 0.0, size))
    if program.final_covariance is not None:
        root = np.linalg.cholesky(program.final_covariance)
        relative = np.linalg.solve(root, np.linalg.solve(root, law.covariance[-1]).T)
        quantity, value = "largest eigenvalue of P_f^-1/2 P_N P_f^-1/2", np.linalg.eigvalsh(relative)[-1]
        rows.append(("final covariance", "final covariance", quantity, value, 1.0, 1.0))
    if program.control_trust is not None:
        centre = 0.0 if program.control_reference is None else program.control_reference
        value, limit = np.abs(law.control - centre).max(axis=1), program.control_trust
        kind, size = (
            "control trust region",
            max(limit, np.abs(law.control).max(), np.sqrt(law.control_covariance.max())),
        )
        rows.append((kind, f"{kind} at step {np.argmax(value)}", distance, value.max(), limit, size))
    for item in program.state_trust:
        final_mean, limit = item.row @ law.mean[item.step], item.radius
        size = max(limit, abs(final_mean), abs(item.reference))
        name = f"state trust region at step {item.step}"
        rows.append(("state trust regions", name, distance, abs(final_mean - item.reference), limit, size))
    return tuple(
        Margin(kind, name, quantity, float(value), float(limit), float((value - limit) / (size or 1.0)))
        for kind, name, quantity, value, limit, size in rows
    )


def present_gains(system, law):
    r"""Gains on the present state alone that come nearest to a law of all past states.

        $K_k = \text{Cov}(u_k, x_k) \, P_k^{+}$

    is the regression of the control on the state. Where the disturbances are white, nothing else of the past counts and
    the law stays the same.

    Args:
        system: `BlockSystem` that the law is for.
        law: `SteeringLaw`.

    Returns:
        Gains, (N, m, n).
    """
    intervals, n, m = system.control.shape
    blocks = stacked(system)
    history = law.gain.transpose(0, 2, 1, 3).reshape(intervals * m, -1)
    response = np.linalg.inv(np.eye((intervals + 1) * n) - blocks.control @ history)
    initial, disturbed = response @ blocks.transition, response @ blocks.disturbance
    covariance = initial @ system.initial_covariance @ initial.T
    covariance += disturbed @ system.disturbance_covariance @ disturbed.T
    cross = (history @ covariance).reshape(intervals, m, intervals + 1, n)
    gains = []
    for k in range(intervals):
        deviation, scaled = correlations("covariance", law.covariance[k])
        gains.append(cross[k, :, k] / deviation @ np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) / deviation)
    return np.array(gains)


def diagonal_blocks(matrix, size):
    """Blocks on the diagonal of a square matrix, symmetric to the last bit.

    Args:
        matrix: symmetric up to rounding, (k size, k size).
        size: of a block.

    Returns:
        Array (k, size, size).
    """
    count = len(matrix) // size
    blocks = matrix.reshape(count, size, count, size)[np.arange(count), :, np.arange(count)]
    return (blocks + blocks.swapaxes(1, 2)) / 2


def _check_probability(item, label):
    """ValueError unless 0 < probability < 0.5."""
    _set_number(item, label, "probability")
    if not 0 < item.probability < 0.5:
        raise ValueError(
            f"{label}: probability must lie strictly between 0 and 0.5, where the constraint is convex, "
            f"but is {item.probability}"
        )


def _set_number(item, label, field):
    """Make a field of a frozen dataclass a finite float."""
    value = np.asarray(getattr(item, field), dtype=float)
    if value.ndim or not np.isfinite(value):
        raise ValueError(f"{label}: {field} must be one finite number, not {getattr(item, field)!r}")
    object.__setattr__(item, field, float(value))


def _set_vector(item, label, field):
    """Make a field of a frozen dataclass a finite vector."""
    value = np.asarray(getattr(item, field), dtype=float)
    if value.ndim != 1 or not np.isfinite(value).all():
        raise ValueError(f"{label}: {field} must be a vector of finite numbers")
    object.__setattr__(item, field, value)
