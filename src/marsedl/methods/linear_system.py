"""The linear system that designs steer and covariances run through, and what such a covariance consists of."""

from typing import NamedTuple

import numpy as np

from marsedl.summaries import summary

__all__ = ["Covariances", "LinearSystem"]


class LinearSystem(NamedTuple):
    """x_{k+1} = A_k x_k + B_k u_k + c_k + w_k over N intervals, w_k white (stochastic entry guidance, Eq. 35)."""

    transition: np.ndarray  # A_k, (N, n, n)
    control: np.ndarray  # B_k, effect of the held control, (N, n, m)
    noise: np.ndarray  # covariance of w_k, (N, n, n)
    affine: np.ndarray  # c_k, (N, n); zero, if states and controls are deviations from a flight
    time: np.ndarray  # bounds of the intervals, (N + 1,), s

    __repr__ = summary


class Covariances(NamedTuple):
    """Covariances of a linear system under feedback."""

    covariance: np.ndarray  # of the states at the bounds of the intervals, (N + 1, n, n)
    control_covariance: np.ndarray  # of the controls in the intervals, (N, m, m)

    __repr__ = summary
