"""Orbit after atmospheric flight and the impulses from it to a target orbit (random field, Eqs. 62-70).

The vehicle leaves the atmosphere of a planet at rest, coasts to its apoapsis, raises the periapsis there and corrects
the apoapsis at the new periapsis. Escape is not an error here: such a trial has an infinite apoapsis and NaN for every
velocity change, and the caller must count it, since leaving it out would flatter every percentile.

All functions broadcast, and take complex states so that `gradient` can differentiate them. Hence no modulus and no
function of the real part, other than to choose between formulas.
"""

from typing import NamedTuple

import numpy as np

from marsedl.summaries import summary

__all__ = [
    "Burns",
    "apoapsis_radius",
    "branch_of",
    "burns",
    "gradient",
    "total_delta_v",
]

_COMPLEX_STEP = 1e-30  # its square vanishes beside any number of ours, so the derivative has no truncation error


class Burns(NamedTuple):
    """Signed velocity changes of the two impulses (random field, Eqs. 66 and 69)."""

    periapsis_raise: np.ndarray  # Delta v_1 = v_a+ - v_a-, m/s
    apoapsis_change: np.ndarray  # v_p+ - v_p-, m/s, positive for an exit apoapsis below the target; Delta v_2 = |.|

    __repr__ = summary


def _energy_terms(radius, velocity, gravitational_parameter):
    """Return lambda = r v^2 / mu and the binding energy 2 - lambda = r / a in units of mu / (2 r), > 0 if captured."""
    energy_ratio = radius * velocity * velocity / gravitational_parameter
    return energy_ratio, 2.0 - energy_ratio


def apoapsis_radius(radius, velocity, flight_path_angle, gravitational_parameter):
    r"""Apoapsis radius of the orbit through a point (random field, Eq. 62).

        $r_\text{a} = a (1 + e), \quad e^2 = 1 - \frac{r^2 v^2 \, \cos^2\gamma}{\mu a} = (\lambda - 1)^2 \, \cos^2\gamma
          + \sin^2\gamma$

    with $\lambda = r v^2 / \mu$. The second form of $e^2$, a sum of squares, cannot become negative by rounding. The
    derivative does not exist for a circular orbit.

    Args:
        radius: r, m.
        velocity: v, inertial, m/s.
        flight_path_angle: $\gamma$, rad.
        gravitational_parameter: $\mu$, m^3/s^2.

    Returns:
        $r_\text{a}$, m; infinite for a parabola or hyperbola (not captured).
    """
    energy_ratio, binding = _energy_terms(radius, velocity, gravitational_parameter)
    tangential = (energy_ratio - 1.0) * np.cos(flight_path_angle)
    radial = np.sin(flight_path_angle)
    eccentricity = np.sqrt(tangential * tangential + radial * radial)
    escaped = np.real(binding) <= 0.0  # false for NaN, which thus stays NaN
    return np.where(escaped, np.inf, radius / np.where(escaped, 1.0, binding) * (1.0 + eccentricity))[()]


def _apsis_velocity(here, opposite, gravitational_parameter):
    """Velocity at one apsis of an ellipse: v^2 = 2 mu (1/here - 1/(here + opposite)), without the cancellation."""
    return np.sqrt(2.0 * gravitational_parameter * opposite / (here * (here + opposite)))


def burns(radius, velocity, flight_path_angle, target_apoapsis, target_periapsis, gravitational_parameter):
    r"""Impulses at the exit apoapsis and at the target periapsis (random field, Eqs. 64-69).

        $\Delta v_1 = v_\text{a}^+ - v_\text{a}^-, \quad v_\text{a}^- = \frac{r v \, \cos\gamma}{r_\text{a}}, \quad
          v_\text{a}^+ = \sqrt{2 \mu \left( \frac{1}{r_\text{a}} - \frac{1}{r_\text{a} + r_\text{p,targ}} \right)}$
        $v_\text{p}^+ - v_\text{p}^-, \quad v_\text{p} =
          \sqrt{2 \mu \left( \frac{1}{r_\text{p,targ}} - \frac{1}{r + r_\text{p,targ}} \right)} \text{ for } r =
          r_\text{a,targ} \text{ (+) and } r = r_\text{a} \text{ (-)}$

    $v_\text{a}^-$ is that of Eq. 64, by angular momentum instead of energy, which is less prone to rounding.

    Args:
        radius: r at atmospheric exit, m.
        velocity: v, inertial, m/s.
        flight_path_angle: $\gamma$, rad, within a right angle of the horizontal.
        target_apoapsis, target_periapsis: $r_\text{a,targ}$, $r_\text{p,targ}$, m.
        gravitational_parameter: $\mu$, m^3/s^2.

    Returns:
        `Burns`, m/s; NaN where the orbit is not captured.

    Raises:
        ValueError: unless 0 < target_periapsis <= target_apoapsis.
    """
    if not (np.greater(target_periapsis, 0.0) & np.less_equal(target_periapsis, target_apoapsis)).all():
        raise ValueError(
            f"target_periapsis must be positive and not above target_apoapsis, got {target_periapsis} and "
            f"{target_apoapsis}; give both as radii from the planet's centre"
        )
    apoapsis = apoapsis_radius(radius, velocity, flight_path_angle, gravitational_parameter)
    captured = np.isfinite(apoapsis)
    apoapsis = np.where(captured, apoapsis, target_apoapsis)  # any number, replaced below: no warnings on the way
    arrival = radius * velocity * np.cos(flight_path_angle) / apoapsis
    departure = _apsis_velocity(apoapsis, target_periapsis, gravitational_parameter)
    before = _apsis_velocity(target_periapsis, apoapsis, gravitational_parameter)
    after = _apsis_velocity(target_periapsis, target_apoapsis, gravitational_parameter)
    return Burns(*(np.where(captured, change, np.nan)[()] for change in (departure - arrival, after - before)))


def total_delta_v(
    radius, velocity, flight_path_angle, target_apoapsis, target_periapsis, gravitational_parameter, branch=None
):
    r"""Velocity change of both impulses (random field, Eq. 70), or a smooth branch of it.

        $\Delta v = \Delta v_1 + \left| v_\text{p}^+ - v_\text{p}^- \right|, \quad \text{on a branch } s \text{:} \quad
          \Delta v_1 + s (v_\text{p}^+ - v_\text{p}^-)$

    The modulus has a kink where the exit apoapsis is the target. $\Delta v$ is the larger one of the branches +1 and
    -1, whose gradients differ there; branch 0 has their mean.

    Args:
        radius: r at atmospheric exit, m.
        velocity: v, inertial, m/s.
        flight_path_angle: $\gamma$, rad, within a right angle of the horizontal.
        target_apoapsis, target_periapsis: $r_\text{a,targ}$, $r_\text{p,targ}$, m.
        gravitational_parameter: $\mu$, m^3/s^2.
        branch: s: +1 undershoot (exit apoapsis below the target), -1 overshoot, 0 the periapsis raise alone, None for
            the modulus. For gradients near the kink name the branch (`branch_of`): that of the modulus is then decided
            by rounding.

    Returns:
        $\Delta v$, m/s; NaN where the orbit is not captured.

    Raises:
        ValueError: if the branch is not one of these, or the targets are not 0 < target_periapsis <= target_apoapsis.
    """
    if branch is not None and not np.isin(branch, (-1, 0, 1)).all():
        raise ValueError(f"branch must be -1 (overshoot), 0, +1 (undershoot) or None, got {branch}")
    raising, change = burns(
        radius, velocity, flight_path_angle, target_apoapsis, target_periapsis, gravitational_parameter
    )
    if branch is None:
        branch = np.where(np.real(change) < 0.0, -1.0, 1.0)
    return raising + branch * change


def branch_of(apoapsis, target_apoapsis, tolerance=1e-6):
    r"""Branch of the velocity change that holds for an exit apoapsis, the $s$ of `total_delta_v`.

        $s = \text{sign}(r_\text{a,targ} - r_\text{a}), \quad 0 \text{ for } \left| r_\text{a} / r_\text{a,targ} - 1
          \right| \le \text{tolerance}$

    Args:
        apoapsis: $r_\text{a}$, m; infinite if not captured, which is an overshoot.
        target_apoapsis: $r_\text{a,targ}$, m.
        tolerance: half-width of the kink, 1.

    Returns:
        +1 undershoot, -1 overshoot, 0 at the kink; integer.

    Raises:
        ValueError: if the apoapsis is NaN.
    """
    excess = np.divide(apoapsis, target_apoapsis) - 1.0
    if np.isnan(excess).any():
        raise ValueError("apoapsis is NaN, so it is on no branch; set trials that ended without an orbit aside first")
    return np.where(np.abs(excess) <= tolerance, 0, -np.sign(excess)).astype(int)[()]


def gradient(function, state):
    r"""Gradient of a scalar function of the exit state, by a complex step.

        $\frac{df}{dx_i} = \frac{\text{Im} \, f(x + \text{i} h e_i)}{h}, \quad \text{exact to rounding for an analytic }
          f$

    For instance `gradient(lambda r, v, gamma: apoapsis_radius(r, v, gamma, mu), state)`.

    Args:
        function: of radius, velocity and flight path angle; any function of this module with its constants bound.
        state: radius (m), velocity (m/s), flight path angle (rad), (3,).

    Returns:
        Derivatives by radius, velocity and flight path angle, in the unit of the function per m, m/s and rad, (3,).

    Raises:
        ValueError: if the state is not a triple, the function is not finite there (the orbit is not captured), or it
            does not return one complex number for complex arguments.
    """
    state = np.asarray(state, dtype=float)
    if state.shape != (3,):
        raise ValueError(f"state must be (radius, velocity, flight path angle), shape (3,), not {state.shape}")
    with np.errstate(invalid="ignore"):  # refused below, in words
        values = np.array([function(*point) for point in state + 1j * _COMPLEX_STEP * np.eye(3)])
    if values.shape != (3,) or not np.iscomplexobj(values):
        raise ValueError("function must return one number and carry complex arguments through; bind its constants")
    if not np.isfinite(values.real).all():
        raise ValueError(f"function is not finite at the state {state.tolist()}; is that orbit captured?")
    return values.imag / _COMPLEX_STEP
