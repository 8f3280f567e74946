"""Linear systems of deviations for tests."""

import numpy as np

from marsedl.methods.linear_system import LinearSystem


def of_one_control(transition, control, noise):
    """A system of intervals of a second from its matrices; control: (N, n)."""
    affine, time = np.zeros(np.shape(control)), np.arange(len(control) + 1.0)
    return LinearSystem(np.asarray(transition), np.asarray(control)[..., np.newaxis], np.asarray(noise), affine, time)
