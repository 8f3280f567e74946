"""Phases of a mission: the end of one campaign starts the next, trial by trial."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from marsedl.fly.declared import Column, Declared
from marsedl.words import require

STREAMS = 16  # of random numbers in a phase: those of phase k are k x 16 and on, whatever the seeds are


@dataclass(frozen=True, eq=False)
class PhaseBefore:
    """How trials ended a phase, as the start of the next: trial i goes on where trial i ended."""

    given: Mapping[str, Any]  # start by name: numbers of the trials (trials,), a number, Normal or Uniform
    outcome: np.ndarray  # (trials,), of the phase before
    goes_on: np.ndarray  # (trials,), whether it ended as it should
    phase: int  # number of the phase that starts, from 1 on

    def declared(self, model) -> Declared:
        """The start. Raises ValueError as `declare`, and for numbers that are not one for each trial."""
        require(self.goes_on.any(), "start: no trial ended the phase before as it should; see its outcomes()")
        given = dict(self.given)
        own = {name: values for name, values in given.items() if isinstance(values, np.ndarray)}
        for name, values in own.items():
            require(
                values.shape == self.outcome.shape and values.dtype.kind in "biuf",
                f"start {name!r}: the phase before has {self.outcome.size:,} trials; give a number for each",
            )
            require(
                np.isfinite(values[self.goes_on]).all(),
                f"start {name!r} is not finite in trials that end as they should",
            )
            mean = float(values[self.goes_on].mean())  # others have it, and are no flights
            given[name] = Column(np.where(self.goes_on, values, mean), mean, "start {!r}: the end of trial")
        return model.declared_start(given)

    def outcomes(self, trials, outcome):
        """Outcomes of these trials, those being named that did not end the phase before as they should."""
        before = np.char.add("before: ", self.outcome[trials].astype(str))
        return np.where(self.goes_on[trials], outcome, before)

    def require_flown(self, trials):
        """Refuse trials that the phase before does not have."""
        count = self.outcome.size
        require(
            trials[-1] < count,
            f"trial {trials[-1]:,} has no start, as the phase before has {count:,} trials: extend that one first",
        )


def phase_before(flights, start) -> PhaseBefore:
    """See `Flights.as_start`."""
    if callable(start):
        given = start(dict(flights._known))
        require(
            isinstance(given, Mapping),
            f"as_start: the function returned {type(given).__name__}, not a mapping of names",
        )
        given = {name: np.asarray(value, float) if np.ndim(value) else value for name, value in given.items()}
    else:
        require(
            isinstance(start, Mapping),
            'as_start: give a mapping such as {"altitude": "altitude", "mass": 900.0}, or a function',
        )
        given = {name: flights.values(one) if isinstance(one, str) else one for name, one in start.items()}
    goes_on = flights.campaign.counts(flights.outcome)
    return PhaseBefore(given, flights.outcome, goes_on, flights.campaign.phase + 1)
