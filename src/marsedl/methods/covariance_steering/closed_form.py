r"""Covariance steering of a linear system without iteration (Ridderhof and Tsiotras, powered descent; Secs. II, III).

The paper steers mean and covariance of

    $dx = A x \, dt + B u \, dt + c \, dt + G B \, dw \qquad \text{(Eq. 5)}$

from (x0, S0) to (xT, ST) at least E int u'u dt (Eq. 10), with u = -B' Lambda x + B' lambda (Eq. 24). It finds
Lambda(0) by iteration (Algorithm 1), Lambda(t) and lambda(t) by integration (Algorithm 2). All of it has a closed form
in the open-loop quantities Phi(t,0) (Eq. 47), N(t) = int_0^t Phi(0,s) B B' Phi(0,s)' ds and int_0^t Phi(t,s) c ds. With
x = Phi(t,0) z the drift A disappears, Eq. 21 becomes d(L^-1)/dt = -b b' with b = Phi(0,t) B, and therefore

    $R(t) = I - N(t) \Lambda(0)$
    $\Lambda(t) = \Phi(0,t)^\top \Lambda(0) R(t)^{-1} \Phi(0,t), \quad \Theta(t,0) = \Phi(t,0) R(t)$

and Sigma(T) = ST is a quadratic matrix equation in Z = N(T)^-1 - Lambda(0), whose positive root is the one that keeps
R(t) invertible on [0, T]. Time is counted from the first node; the units are those of the caller.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from marsedl.summaries import summary

__all__ = [
    "Steering",
    "SteeringError",
    "SteeringProblem",
    "equivalent_squared_noise_density",
    "escape_margin",
    "predicted_covariance",
    "riccati_initial",
    "steer",
]


class SteeringError(ValueError):
    """A steering problem that is not well posed, or whose feedback does not exist on the whole interval."""


@dataclass(frozen=True, eq=False)
class SteeringProblem:
    """What is to be steered: the open-loop quantities of a linear model and both end conditions.

    The fields hold k nodes in time, n states and m controls.

    Raises:
        SteeringError: naming the field, if a shape does not fit, a value is not finite, time does not increase, a
            covariance or the final Gramian is not symmetric positive definite, or an open-loop quantity does not start
            from its initial value (transition I, Gramian and affine response 0).
    """

    time: np.ndarray  # (k,), s
    transition: np.ndarray  # Phi(t, 0) (Eq. 47), (k, n, n)
    gramian: np.ndarray  # N(t) = int_0^t Phi(0,s) B B' Phi(0,s)' ds, (k, n, n)
    affine_response: np.ndarray  # int_0^t Phi(t,s) c ds, (k, n)
    control_matrix: np.ndarray  # B(t), (k, n, m)
    initial_mean: np.ndarray  # (n,)
    final_mean: np.ndarray  # (n,)
    initial_covariance: np.ndarray  # (n, n)
    final_covariance: np.ndarray  # (n, n)
    noise_density: float  # G, control unit times sqrt(s)

    __repr__ = summary

    def __post_init__(self):
        """Check the fields."""
        for name in self.__dataclass_fields__:
            value = np.asarray(getattr(self, name), dtype=float)
            if not np.isfinite(value).all():
                raise SteeringError(f"{name} has entries that are not finite")
            object.__setattr__(self, name, float(value) if name == "noise_density" and value.ndim == 0 else value)
        if np.ndim(self.noise_density) or self.noise_density < 0:
            raise SteeringError("noise_density must be one number that is not negative")
        if self.time.ndim != 1 or len(self.time) < 2 or not (np.diff(self.time) > 0).all():
            raise SteeringError("time must be one-dimensional and strictly increasing, with two nodes at least")
        if self.control_matrix.ndim != 3:
            raise SteeringError(f"control_matrix has shape {self.control_matrix.shape}, expected (k, n, m)")
        k, (n, m) = len(self.time), self.control_matrix.shape[1:]
        shapes = {
            "transition": (k, n, n),
            "gramian": (k, n, n),
            "affine_response": (k, n),
            "control_matrix": (k, n, m),
            "initial_mean": (n,),
            "final_mean": (n,),
            "initial_covariance": (n, n),
            "final_covariance": (n, n),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise SteeringError(f"{name} has shape {getattr(self, name).shape}, expected {shape}")
        for name, start in {"transition": np.eye(n), "gramian": 0.0, "affine_response": 0.0}.items():
            if not np.array_equal(getattr(self, name)[0], np.broadcast_to(start, shapes[name][1:])):
                raise SteeringError(f"{name} must be {'the identity' if name == 'transition' else 'zero'} at the start")
        for name in ("initial_covariance", "final_covariance"):
            _require_positive_definite(name, getattr(self, name))
        _require_positive_definite("gramian at the final time (the model is not controllable)", self.gramian[-1])

    @classmethod
    def from_linear_model(
        cls,
        time,
        model,
        *,
        initial_mean,
        final_mean,
        initial_covariance,
        final_covariance,
        noise_density,
        transition=None,
    ):
        """Problem of the linear model x' = A x + B u + c given at the nodes of a time grid (Eqs. 4, 5, 47, 48).

        The transition is exact (matrix exponential) for constant A; else it is the fourth-order Magnus step on a cubic
        spline of A. Gramian and affine response are integrals of cubic splines. Both are of fourth order in the cells.

        Args:
            time: nodes, (k,), s; k >= 4. The model must be smooth in between (begin a new segment at every jump).
            model: A(t), (k, n, n); B(t), (k, n, m); c(t), (k, n); each constant without the first axis.
            initial_mean, final_mean: (n,).
            initial_covariance, final_covariance: (n, n), symmetric positive definite.
            noise_density: G, control unit times sqrt(s).
            transition: Phi(t, 0) if it is known already, (k, n, n); it is the most expensive part otherwise.

        Returns:
            `SteeringProblem`.

        Raises:
            SteeringError: naming the field that does not fit.
        """
        state_matrix, control_matrix, affine = model
        time, control_matrix = np.asarray(time, dtype=float), np.asarray(control_matrix, dtype=float)
        if time.ndim != 1 or len(time) < 4 or not (np.diff(time) > 0).all():
            raise SteeringError("time must be one-dimensional and strictly increasing, with four nodes at least")
        if control_matrix.ndim not in (2, 3):
            shape = control_matrix.shape
            raise SteeringError(f"control_matrix has shape {shape}, expected ({len(time)}, n, m) or (n, m)")
        n, m = control_matrix.shape[-2:]
        control_matrix = _along(time, control_matrix, (n, m), "control_matrix")
        state_matrix = _along(time, state_matrix, (n, n), "state_matrix")
        affine = _along(time, affine, (n,), "affine")
        for name, value in (("control_matrix", control_matrix), ("state_matrix", state_matrix), ("affine", affine)):
            if not np.isfinite(value).all():
                raise SteeringError(f"{name} has entries that are not finite")
        transition = _transition(time, state_matrix) if transition is None else np.asarray(transition, dtype=float)
        if transition.shape != state_matrix.shape:
            raise SteeringError(f"transition has shape {transition.shape}, expected {state_matrix.shape}")
        backward = np.linalg.inv(transition)
        control_effect = backward @ control_matrix  # Phi(0,s) B(s)
        gramian = _integral(time, control_effect @ control_effect.swapaxes(1, 2))
        affine_response = np.einsum(
            "kij,kj->ki", transition, _integral(time, np.einsum("kij,kj->ki", backward, affine))
        )
        return cls(
            time,
            transition,
            gramian,
            affine_response,
            control_matrix,
            initial_mean,
            final_mean,
            initial_covariance,
            final_covariance,
            noise_density,
        )


class Steering(NamedTuple):
    """The optimal control u = feedforward - gain (x - mean), and what it makes of mean and covariance.

    It is identical with Eq. 24: lambda(t) = p(t) + Lambda(t) mean(t), feedforward = B' p.
    """

    time: np.ndarray  # (k,), s
    gain: np.ndarray  # K = B' Lambda, (k, m, n)
    feedforward: np.ndarray  # mean control B' p, (k, m)
    mean: np.ndarray  # (k, n)
    covariance: np.ndarray  # Sigma(t), (k, n, n)
    riccati: np.ndarray  # Lambda(t) (Eq. 21), (k, n, n)
    mean_costate: np.ndarray  # p(0), (n,)
    mean_cost: float  # int |mean control|^2 dt = p0' N(T) p0, control unit^2 s
    covariance_cost: float  # int tr(K Sigma K') dt, control unit^2 s
    escape_margin: np.ndarray  # smallest eigenvalue of R(t), (k,); positive: Lambda exists up to t

    __repr__ = summary


def steer(problem, root=-1):
    r"""Optimal steering of mean and covariance in closed form (Eqs. 21 to 48 without iteration or integration).

        $p_0 = N(T)^{-1} \left[ \Phi(0,T) \left( x_T - \tilde{c}(T) \right) - x_0 \right], \quad p(t) = \Phi(0,t)^\top
          p_0, \quad \tilde{c}(t) = \int_0^t \Phi(t,s) c \, ds$
        $\text{mean}(t) = \Phi(t,0) \left( x_0 + N(t) p_0 \right) + \tilde{c}(t), \quad \text{feedforward} = B^\top p$
        $\Lambda(t) = \Phi(0,t)^\top \Lambda(0) R(t)^{-1} \Phi(0,t), \quad R(t) = I - N(t) \Lambda(0), \quad K = B^\top
          \Lambda$
        $\int \text{tr}(K \Sigma K^\top) \, dt = \text{tr}(\Lambda(0) S_0) - \text{tr}(\Lambda(T) \Sigma(T)) - G^2 \,
          \log \det R(T)$

    (the last by Eqs. 21 and 40, and $\text{tr}(\Lambda B B^\top) = -\frac{d}{dt} \log \det R$). `riccati_initial` gives
    $\Lambda(0)$, `predicted_covariance` $\Sigma(t)$.

    Args:
        problem: `SteeringProblem`.
        root: -1 for the solution; +1 for the other root of the boundary condition, which always fails.

    Returns:
        `Steering`.

    Raises:
        SteeringError: if $\Lambda(t)$ does not exist on the whole interval (finite escape).
    """
    lambda_0 = riccati_initial(problem, root)
    margin = escape_margin(problem, lambda_0)
    if not (margin > 0).all():
        first = np.argmax(~(margin > 0))
        raise SteeringError(
            f"the Riccati solution escapes before t = {problem.time[first]:.6g} s "
            f"(smallest eigenvalue of R(t) {margin[first]:.3g}); both boundary conditions alone do not exclude this"
        )
    phi, gramian, b = problem.transition, problem.gramian, problem.control_matrix
    backward = np.linalg.inv(phi)
    r = np.eye(phi.shape[1]) - gramian @ lambda_0

    target = backward[-1] @ (problem.final_mean - problem.affine_response[-1])
    p_0 = np.linalg.solve(gramian[-1], target - problem.initial_mean)
    mean = np.einsum("kij,kj->ki", phi, problem.initial_mean + gramian @ p_0) + problem.affine_response
    feedforward = np.einsum("kji,kj->ki", b, np.einsum("kji,j->ki", backward, p_0))

    riccati = _symmetric(backward.swapaxes(1, 2) @ (lambda_0 @ np.linalg.inv(r)) @ backward)
    covariance = predicted_covariance(problem, lambda_0, problem.noise_density, problem.initial_covariance)
    covariance_cost = (
        np.trace(lambda_0 @ problem.initial_covariance)
        - np.trace(riccati[-1] @ covariance[-1])
        - problem.noise_density**2 * np.linalg.slogdet(r[-1])[1]
    )
    return Steering(
        time=problem.time,
        gain=b.swapaxes(1, 2) @ riccati,
        feedforward=feedforward,
        mean=mean,
        covariance=covariance,
        riccati=riccati,
        mean_costate=p_0,
        mean_cost=float(p_0 @ gramian[-1] @ p_0),
        covariance_cost=float(covariance_cost),
        escape_margin=margin,
    )


def riccati_initial(problem, root=-1):
    r"""$\Lambda(0)$ that steers the covariance from $S_0$ to $S_T$; replaces Algorithm 1.

        $\Lambda(0) = \frac{G^2}{2} S_0^{-1} + N^{-1} \mp S_0^{-1/2} \left[ \frac{G^4}{4} I + S_0^{1/2} Y S_0^{1/2}
          \right]^{1/2} S_0^{-1/2}$
        $Y = N^{-1} \Phi^{-1} S_T \Phi^{-\top} N^{-1}, \quad N = N(T), \quad \Phi = \Phi(T,0)$

    It is the root of $Y = Z S_0 Z + G^2 Z$ with $Z = N^{-1} - \Lambda(0)$. The minus sign makes $Z$ positive definite;
    then $N(t)^{-1} - \Lambda(0) \succeq Z$ is too, and $R(t)$ is invertible on $[0, T]$. With the plus sign $Z$ is
    negative definite, and $R(t)$ becomes singular on the way.

    Args:
        problem: `SteeringProblem`.
        root: -1 (the solution) or +1 (meets both boundary conditions, but escapes in between).

    Returns:
        $\Lambda(0)$, symmetric, (n, n).

    Raises:
        SteeringError: if root is neither -1 nor +1.
    """
    if root not in (-1, 1):
        raise SteeringError(f"root must be -1 or +1, not {root!r}")
    gramian_inverse = np.linalg.inv(problem.gramian[-1])
    scale = gramian_inverse @ np.linalg.inv(problem.transition[-1])
    y = scale @ problem.final_covariance @ scale.T
    half, half_inverse = _square_roots(problem.initial_covariance)
    values, vectors = np.linalg.eigh(_symmetric(half @ y @ half))
    half_noise = problem.noise_density**2 / 2
    larger = np.sqrt(half_noise**2 + values) + half_noise
    # The difference of square root and half_noise, written so that large noise does not cancel it.
    z = values / larger if root == -1 else -larger
    return _symmetric(gramian_inverse - half_inverse @ (vectors * z) @ vectors.T @ half_inverse)


def escape_margin(problem, riccati_initial):
    """Certificate that the Riccati solution exists: smallest eigenvalue of R(t) = I - N(t) Lambda(0).

    The eigenvalues of R(t) are real and one at the start. Lambda(t) exists on [0, T] if and only if none reaches zero.

    Args:
        problem: `SteeringProblem`.
        riccati_initial: Lambda(0), (n, n).

    Returns:
        Smallest real part of the eigenvalues, (k,).
    """
    r = np.eye(len(riccati_initial)) - problem.gramian @ riccati_initial
    return np.linalg.eigvals(r).real.min(axis=1)


def predicted_covariance(problem, riccati_initial, plant_noise_density, initial_covariance):
    r"""Covariance under the feedback of $\Lambda(0)$, for any noise and start covariance of the plant (solves Eq. 40).

        $\Sigma(t) = \Theta S \Theta^\top + G_\text{p}^2 \Phi \left[ N - N \Lambda(0) N \right] \Phi^\top, \quad
          \Theta(t,0) = \Phi(t,0) \left( I - N(t) \Lambda(0) \right)$

    Args:
        problem: `SteeringProblem`; only its model is used.
        riccati_initial: $\Lambda(0)$ of the design, (n, n).
        plant_noise_density: $G_\text{p}$, control unit times sqrt(s).
        initial_covariance: S, (n, n).

    Returns:
        $\Sigma(t)$, (k, n, n).
    """
    phi, gramian = problem.transition, problem.gramian
    r = np.eye(len(riccati_initial)) - gramian @ riccati_initial
    moments = r @ initial_covariance @ r.swapaxes(1, 2) + plant_noise_density**2 * (r @ gramian)
    return _symmetric(phi @ moments @ phi.swapaxes(1, 2))


def equivalent_squared_noise_density(noise_density, control_unit=1.0, boundary="corrected"):
    r"""Squared noise density whose correct design is the fixed point of a printed boundary condition.

        $\text{corrected:} \quad \gamma^2 U^2$
        $\text{algorithm_1:} \quad U^2 / \gamma$
        $\text{eq_46:} \quad U^2 / \gamma^2$

    Args:
        noise_density: $\gamma$, in units of U sqrt(s).
        control_unit: U, caller's unit of control (N).
        boundary: "corrected", "algorithm_1" or "eq_46".

    Returns:
        $G^2$, squared unit of control times s (N^2 s).
    """
    power = {"corrected": 2, "algorithm_1": -1, "eq_46": -2}[boundary]
    return noise_density**power * control_unit**2


def _along(time, value, shape, name):
    """The array `value` repeated along the nodes if it is constant."""
    value = np.asarray(value, dtype=float)
    if value.shape not in (shape, (len(time), *shape)):
        raise SteeringError(f"{name} has shape {value.shape}, expected {(len(time), *shape)} or {shape}")
    return np.broadcast_to(value, (len(time), *shape))


def _transition(time, state_matrix):
    """Phi(t, 0) at the nodes (Eq. 47): the product of the cells."""
    from scipy.linalg import expm  # here, as jobs that only use a problem need not wait for it

    step = np.diff(time)
    if (state_matrix == state_matrix[0]).all():
        uniform = np.allclose(step, step.mean(), rtol=1e-9, atol=0.0)
        cells = expm(state_matrix[0] * (step.mean(keepdims=True) if uniform else step)[:, None, None])
        cells = np.broadcast_to(cells, (len(step), *cells.shape[1:]))
    else:
        from scipy.interpolate import CubicSpline

        spline, middle = CubicSpline(time, state_matrix), (time[1:] + time[:-1]) / 2
        offset, step = step * np.sqrt(3) / 6, step[:, None, None]
        early, late = spline(middle - offset), spline(middle + offset)
        cells = expm(step / 2 * (early + late) + np.sqrt(3) / 12 * step**2 * (late @ early - early @ late))
    transition = np.empty(state_matrix.shape)
    transition[0] = np.eye(state_matrix.shape[1])
    for i, cell in enumerate(cells):
        transition[i + 1] = cell @ transition[i]
    return transition


def _integral(time, values):
    """Integral from the first node to every node."""
    from scipy.interpolate import CubicSpline

    integral = CubicSpline(time, values).antiderivative()(time)
    return integral - integral[0]


def _symmetric(matrix):
    return (matrix + matrix.swapaxes(-1, -2)) / 2


def _square_roots(matrix):
    """Symmetric square root and its inverse."""
    values, vectors = np.linalg.eigh(matrix)
    root = np.sqrt(values)
    return (vectors * root) @ vectors.T, (vectors / root) @ vectors.T


def _require_positive_definite(name, matrix):
    if not np.allclose(matrix, matrix.T, rtol=1e-10, atol=1e-12 * np.abs(matrix).max()):
        raise SteeringError(f"{name} is not symmetric")
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        raise SteeringError(f"{name} is not positive definite") from None
