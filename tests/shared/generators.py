"""Random numbers of tests."""

import numpy as np


def generator(seed):
    return np.random.Generator(np.random.Philox(seed))
