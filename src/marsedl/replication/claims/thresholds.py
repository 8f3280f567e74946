"""What the words of a paper ask for, what counts as beyond sampling error, and what counts as equal.

A statement without a number is judged by a threshold, and the paper's word chooses it from the table below; the page
docs/verdicts.md shows the same table. A verdict that would change at half or at twice its threshold is undetermined.
"""

from dataclasses import dataclass

import numpy as np

SIGMAS = 3.0  # standard errors; more is beyond sampling error
CONFIDENCE = 0.9973  # of intervals of a binomial probability: the share of a normal distribution within SIGMAS
ROUNDING = 1e-6  # relative; closer than this is equal
WIDE = 0.1  # share of a printed number; a larger standard error of ours, if the paper's is smaller, decides nothing
THIN = 10.0  # standard errors, or limits: a verdict further than this from its limit could hardly be another


@dataclass(frozen=True, eq=False)
class Limit:
    """A limit with a fuzzy part: `1.0 + VISIBLE`, `0.1 * VISIBLE`, `VISIBLE * scale + error`.

    A verdict is undetermined if scaling `soft` by 0.5 or 2 changes it; `hard` is fixed.
    """

    soft: np.ndarray | float | None
    hard: np.ndarray | float = 0.0
    words: str = ""

    __array_ufunc__ = None  # so that arrays leave arithmetic to this class

    def at(self, factor: float) -> np.ndarray | float:
        """Return the limit with its threshold times a factor."""
        return self.hard if self.soft is None else self.hard + factor * self.soft

    def __mul__(self, scale):  # noqa: D105
        return Limit(self.soft * scale, self.hard * scale)

    def __add__(self, hard):  # noqa: D105
        return Limit(self.soft, self.hard + hard)

    def __sub__(self, hard):  # noqa: D105
        return self + -hard

    def __rsub__(self, hard):  # noqa: D105
        return self * -1.0 + hard

    __rmul__, __radd__ = __mul__, __add__


# The words of the papers, and what each asks for. Fixed for all papers before it was applied to any of them.
# "About half" is judged as half, "about".
NEARLY_EXACT = Limit(0.01, words="nearly exact, almost exactly, nearly constant")  # relative difference
CLOSE = Limit(0.05, words="close to, almost the same, approximately equal")  # relative difference
ABOUT = Limit(0.1, words="about, approximately, roughly (a number); met, steered to (a target)")  # relative difference
SIMILAR = Limit(
    0.25, words="similar, comparable, reasonably predicted, not too far off, not excessive"
)  # relative difference
SMALL = Limit(0.1, words="small, minor, slight, a little")  # at most this share of what it is small against
NEGLIGIBLE = Limit(0.05, words="negligible, almost zero, nulled")  # at most this share
VISIBLE = Limit(0.1, words="visible, noticeable, clear, to some extent")  # at least this share
MUCH = Limit(  # the smaller is at most this of the larger
    0.5, words="much, far, large, significantly, greatly, drastically"
)
MOST = Limit(1 / 3, words="most, mainly, typically")  # the rest is at most this share
STRONG = Limit(0.3, words="strongly correlated")  # what a correlation's magnitude lacks of one, at most
WEAK = Limit(0.3, words="uncorrelated")  # a correlation's magnitude, at most

WORDS = {name: limit for name, limit in list(globals().items()) if isinstance(limit, Limit)}  # the table above, by name
