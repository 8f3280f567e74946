"""The largest value of a curve, for stages and claims."""

import numpy as np


def peak(places, heights):
    """Place and height of the largest value, of the parabola through it and its neighbours; places are uniform."""
    k = min(max(int(np.argmax(heights)), 1), len(heights) - 2)
    before, middle, after = heights[k - 1 : k + 2]
    curvature = before - 2.0 * middle + after
    shift = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
    return float(places[k] + shift * (places[k + 1] - places[k])), float(middle - 0.25 * (before - after) * shift)
