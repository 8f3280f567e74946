"""Deviation of a controlled system from its reference, and the flow of it (robust entry funnels, Sec. 3)."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from marsedl.methods.taylor import Series
from marsedl.summaries import summary

__all__ = ["ClosedLoop", "reference_on_half_steps"]


@dataclass(frozen=True)
class ClosedLoop:
    """System x' = f(x, u, w) under the feedback u = u* + K (x - x*) around a reference (robust entry funnels, Sec. 3).

    The reference and the gains are known on the half-step grid: at the n + 1 nodes of `time` and half-way between, as a
    Runge-Kutta step needs them. Index 2 k of that grid is node k. The control is not limited.

    Deviations, disturbances and additive inputs are sequences of components. A component may be a number, an array
    (one entry a sample), a truncated power series, a complex number or a Taylor model: anything that `rates` can
    compute with, as only sums and products are taken of it here.

    Args:
        rates: f, `rates(half_index, state, control, disturbance)`, which returns a tuple of nx rates from sequences of
            components, by operators and `np.*` only.
        time: fine grid, (n + 1,), s.
        states: x* on the half-step grid, (2 n + 1, nx).
        controls: u* on the half-step grid, (2 n + 1, nu).
        gains: K on the half-step grid, (2 n + 1, nu, nx).
        disturbances: number nw of components of w; the reference flies with w = 0.

    Raises:
        ValueError: if shapes do not fit, a value is not finite, or the time does not increase.
    """

    rates: Callable
    time: np.ndarray
    states: np.ndarray
    controls: np.ndarray
    gains: np.ndarray
    disturbances: int

    __repr__ = summary

    def __post_init__(self):
        """Check the fields."""
        for name in ("time", "states", "controls", "gains"):
            value = np.asarray(getattr(self, name), dtype=float)
            if not np.isfinite(value).all():
                raise ValueError(f"{name} of a closed loop must be finite")
            object.__setattr__(self, name, value)
        if self.time.ndim != 1 or len(self.time) < 2 or not (np.diff(self.time) > 0).all():
            raise ValueError(f"time must be a vector (n + 1,) that increases; its shape is {self.time.shape}")
        points = 2 * self.steps + 1
        for name, value in (("states", self.states), ("controls", self.controls)):
            if value.ndim != 2 or len(value) != points:
                raise ValueError(f"{name} must have shape ({points}, components), not {value.shape}")
        expected = (points, self.controls.shape[1], self.states.shape[1])
        if self.gains.shape != expected:
            raise ValueError(f"gains must have shape {expected}, not {self.gains.shape}")
        if self.disturbances < 0:
            raise ValueError(f"disturbances must be a number of components, not {self.disturbances}")

    @property
    def steps(self):
        """Number n of fine steps."""
        return len(self.time) - 1

    @property
    def dimension(self):
        """Number nx of states."""
        return self.states.shape[1]

    @cached_property
    def _reference(self):
        """State, control and gain at every half step in plain floats, which operate with components of any type."""
        return list(zip(self.states.tolist(), self.controls.tolist(), self.gains.tolist(), strict=True))

    @cached_property
    def reference_rates(self):
        """f(x*, u*, 0) on the half-step grid, a list of tuples."""
        still = [0.0] * self.disturbances
        rates = [tuple(self.rates(i, x, u, still)) for i, (x, u, _) in enumerate(self._reference)]
        if any(len(rate) != self.dimension for rate in rates):
            raise ValueError(f"rates returned {len(rates[0])} values for a state of {self.dimension} components")
        if not np.isfinite(np.array(rates, dtype=float)).all():
            raise ValueError("the rates of a closed loop are not finite along its reference")
        return [tuple(map(float, rate)) for rate in rates]

    def control_deviation(self, half_index, deviation):
        """Feedback K xb, a list of nu components (robust entry funnels, Sec. 3).

        Args:
            half_index: index of the half-step grid.
            deviation: xb, nx components.

        Returns:
            List of nu components, 0.0 where a row of K is zero.
        """
        feedback = []
        for row in self._reference[half_index][2]:
            # Zero gains are left out: a model or series would carry them along.
            terms = [gain * component for gain, component in zip(row, deviation, strict=True) if gain != 0.0]
            feedback.append(sum(terms[1:], terms[0]) if terms else 0.0)
        return feedback

    def error_rates(self, half_index, deviation, disturbance, additive=None):
        r"""Rate of the deviation from the reference (robust entry funnels, Eq. 22 and App. A).

            $\dot{\bar{x}} = f(x^* + \bar{x}, u^* + K \bar{x}, w) + a - f(x^*, u^*, 0)$

        Args:
            half_index: index of the half-step grid.
            deviation: $\bar{x}$, nx components.
            disturbance: w, nw components.
            additive: a, nx components in the units of the rates, or None for zero.

        Returns:
            Tuple of nx components.
        """
        states, controls, _ = self._reference[half_index]
        state = [x + component for x, component in zip(states, deviation, strict=True)]
        control = [u + v for u, v in zip(controls, self.control_deviation(half_index, deviation), strict=True)]
        rates = self.rates(half_index, state, control, disturbance)
        errors = tuple(f - g for f, g in zip(rates, self.reference_rates[half_index], strict=True))
        if additive is None:
            return errors
        return tuple(error + a for error, a in zip(errors, additive, strict=True))

    def flow(self, first, last, deviation, disturbance, additive=None):
        """Deviation at a later node, by the classical Runge-Kutta rule on the rate of the deviation.

        Disturbance and additive input are constant over the steps. The deviation is integrated itself, not as the
        difference of two flights, so that phi(0, 0) = 0 to the last bit and small deviations keep their digits.

        Args:
            first, last: nodes of the fine grid, first <= last.
            deviation: xb at the first node, nx components.
            disturbance: w, nw components.
            additive: a, nx components, or None for zero.

        Returns:
            Tuple phi of nx components.

        Raises:
            ValueError: if the nodes are not in order on the grid.
        """
        if not 0 <= first <= last <= self.steps:
            raise ValueError(f"a flow from node {first} to {last} is not on the grid of nodes 0 ... {self.steps}")
        deviation = tuple(deviation)
        for step in range(first, last):
            length = float(self.time[step + 1] - self.time[step])
            middle = 2 * step + 1
            one = self.error_rates(middle - 1, deviation, disturbance, additive)
            two = self.error_rates(middle, _step_along(deviation, one, length / 2), disturbance, additive)
            three = self.error_rates(middle, _step_along(deviation, two, length / 2), disturbance, additive)
            four = self.error_rates(middle + 1, _step_along(deviation, three, length), disturbance, additive)
            mean = [a + d + 2.0 * (b + c) for a, b, c, d in zip(one, two, three, four, strict=True)]
            deviation = _step_along(deviation, mean, length / 6)
        return deviation

    def flow_jacobians(self, first, last):
        """Derivatives of the flow at zero with respect to deviation, disturbance and additive input.

        They are exact: the flow is taken along every unit vector as a Taylor series of the first order.

        Args:
            first, last: nodes of the fine grid.

        Returns:
            Tuple of Phi (nx, nx), Gamma_w (nx, nw) and Gamma_a (nx, nx).
        """
        nx, nw = self.dimension, self.disturbances
        inputs = [Series.along(0.0, direction, 1) for direction in np.eye(2 * nx + nw)]
        flow = self.flow(first, last, inputs[:nx], inputs[nx : nx + nw], inputs[nx + nw :])
        return tuple(np.split(np.array([component.coefficients[1] for component in flow]), [nx, nx + nw], axis=1))


def _step_along(components, rates, length):
    """Components moved along their rates."""
    return tuple(x + length * rate for x, rate in zip(components, rates, strict=True))


def reference_on_half_steps(rates, time, control, initial_state):
    """Integrate a reference trajectory so that its states are known at nodes and half-way between.

    The classical Runge-Kutta rule with two steps in every fine step.

    Args:
        rates: `rates(state, control)`, which returns a tuple of nx rates from the sequences of nx and nu numbers.
        time: fine grid, (n + 1,), s.
        control: function of times (k,), s, that returns the controls (k, nu).
        initial_state: x*(time[0]), (nx,).

    Returns:
        Tuple of states (2 n + 1, nx) and controls (2 n + 1, nu) on the half-step grid.

    Raises:
        ValueError: if the time does not increase, the controls have another shape, or a state is not finite.
    """
    time = np.asarray(time, dtype=float)
    if time.ndim != 1 or len(time) < 2 or not (np.diff(time) > 0).all():
        raise ValueError(f"time must be a vector (n + 1,) that increases; its shape is {time.shape}")
    quarters = np.interp(np.arange(4 * (len(time) - 1) + 1) / 4, np.arange(len(time)), time)
    controls = np.asarray(control(quarters), dtype=float)
    if controls.ndim != 2 or len(controls) != len(quarters):
        raise ValueError(f"control must return shape ({len(quarters)}, nu), not {controls.shape}")
    states = [np.array(initial_state, dtype=float)]
    for k in range(0, len(quarters) - 1, 2):
        length, state = quarters[k + 2] - quarters[k], states[-1]
        one = np.array(rates(state, controls[k]))
        two = np.array(rates(state + length / 2 * one, controls[k + 1]))
        three = np.array(rates(state + length / 2 * two, controls[k + 1]))
        four = np.array(rates(state + length * three, controls[k + 2]))
        states.append(state + length / 6 * (one + 2.0 * (two + three) + four))
        if not np.isfinite(states[-1]).all():
            raise ValueError(f"the reference is no longer finite at {quarters[k + 2]:g} s")
    return np.array(states), controls[::2]
