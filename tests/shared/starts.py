"""Random starts of searches for largest values."""

import numpy as np

from marsedl.methods.funnels.ascent import maximize


def maximize_from_random_starts(function, dimensions, seed, full_ball=None, starts=1500, **options):
    """The largest value found from so many uniform points of spheres and, where they are full, balls."""
    generator = np.random.Generator(np.random.Philox(seed))
    ends = np.cumsum(dimensions)
    points = generator.standard_normal((starts, ends[-1]))
    for size, end, full in zip(dimensions, ends, full_ball or (False,) * len(dimensions), strict=True):
        block = points[:, end - size : end]
        block /= np.linalg.norm(block, axis=1, keepdims=True)
        if full:
            block *= generator.random((starts, 1)) ** (1 / size)
    return maximize(function, dimensions, points, full_ball, **options)
