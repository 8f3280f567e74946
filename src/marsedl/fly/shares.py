"""Which share of the variance of a result what was drawn explains, from the flights as they were flown."""

import numpy as np

FEWEST = 400  # flights
IN_A_PIECE, MOST_PIECES = 50, 40  # flights in a piece of the fit over a number that was drawn, and how many pieces
GROUPS = 20  # of trials, of which each is left out once


def explained_share(drawn, result, confidence=0.95):
    """Share of the variance of a result that a drawn number explains by itself, and its confidence interval.

    It is the correlation ratio Var(E[result | drawn]) / Var(result), the first-order index of Sobol (1993), estimated
    from given data: the result is fitted over the drawn number by straight lines in pieces of equally many trials.
    What a fit of noise explains is subtracted, so that the share of a number that does nothing is zero on average. The
    interval is that of the jackknife over groups of trials, by Student's t; it takes no account of that within a piece
    the result may be curved.

    Args:
        drawn, result: (trials,); a result may be of zeros and ones.
        confidence: of the interval.

    Returns:
        Share, lower and upper end; NaN of fewer than 400 trials or of a result that does not vary. The share and the
        ends may lie below 0 by what is left to chance.
    """
    from scipy.special import stdtrit

    if result.size < FEWEST or not result.std() > 0.0:
        return np.nan, np.nan, np.nan
    whole = _share(drawn, result)
    group = np.arange(result.size) % GROUPS
    shares = np.array([_share(drawn[group != k], result[group != k]) for k in range(GROUPS)])
    deviation = np.sqrt((GROUPS - 1) * np.mean((shares - shares.mean()) ** 2))
    width = stdtrit(GROUPS - 1, 0.5 + 0.5 * confidence) * deviation
    return whole, whole - width, whole + width


def _share(drawn, result):
    residual, coefficients = 0.0, 0
    pieces = min(result.size // IN_A_PIECE, MOST_PIECES)
    for piece in np.array_split(np.argsort(drawn, kind="stable"), pieces):
        x, y = drawn[piece] - drawn[piece].mean(), result[piece] - result[piece].mean()
        squares = x @ x
        slope = x @ y / squares if squares > 0.0 else 0.0
        residual += np.sum((y - slope * x) ** 2)
        coefficients += 2 if squares > 0.0 else 1
    return 1.0 - (residual / (result.size - coefficients)) / result.var(ddof=1)
