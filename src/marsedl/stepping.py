"""The integrators' step for one trial, of whatever `rates` compute with: numbers, symbols, series."""


def runge_kutta_4(slope, state, step):
    """Classical Runge-Kutta step, with the order of sums of `montecarlo.integrators`: x + h/6 (k1 + 2 k2 + 2 k3 + k4).

    Args:
        slope: function (half steps since the start of the step: 0, 1 or 2; state) -> rates, a sequence.
        state: sequence of n components.
        step: h, s.

    Returns:
        Tuple of n components.
    """
    half, sixth = 0.5 * step, step / 6.0

    def moved(length, rates):
        return tuple(x + length * rate for x, rate in zip(state, rates, strict=True))

    first = slope(0, state)
    second = slope(1, moved(half, first))
    third = slope(1, moved(half, second))
    fourth = slope(2, moved(step, third))
    slopes = zip(state, first, second, third, fourth, strict=True)
    return tuple(x + sixth * (((a + 2.0 * b) + 2.0 * c) + d) for x, a, b, c, d in slopes)
