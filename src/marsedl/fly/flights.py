"""Flights that are flown: percentiles with intervals, outcomes, labelled arrays, replays, comparisons."""

import re
import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from marsedl.fly.campaign import AT_ONCE, NOT_FINITE, Campaign
from marsedl.fly.declared import is_number, resolve
from marsedl.fly.vehicles import END_TIME
from marsedl.montecarlo.statistics import TAIL, order_interval
from marsedl.words import missing, require

__all__ = ["Flights", "OneFlight", "order_interval"]

_GOAL = re.compile(r"p(\d+(?:\.\d+)?) of (\w+) within (\d+(?:\.\d+)?(?:e[+-]?\d+)?) ?(\S+)")


def _require_count(number, name):
    require(
        isinstance(number, int | np.integer) and number >= 1,
        f"{name} must be a whole number of at least 1, got {number!r}",
    )


def _require_confidence(confidence):
    require(
        is_number(confidence) and 0.0 < confidence < 1.0,
        f"confidence is {confidence!r}; give a share between 0 and 1, such as 0.95",
    )


def _needed(level):
    """Flights that an interval of this percentile takes. Raises ValueError for what is no percentage."""
    require(0.0 < level < 100.0, f"level {level:g} is no percentage between 0 and 100")
    share = level / 100.0
    return int(np.ceil(TAIL / min(share, 1.0 - share) - 1e-6))


class OneFlight(NamedTuple):
    """One trial alone: a data frame of what is stored at every integration step and the end, final numbers, outcome."""

    trial: int
    history: Any
    final: dict[str, float]
    outcome: str


@dataclass(frozen=True, eq=False, repr=False)
class Flights:
    """Trials 0 to n - 1 of a campaign: `final` holds the numbers at the end of every flight by name.

    These are the true state, and what is sensed besides; where `sense` has another number under the name of a state,
    that one is `sensed_<name>`. What laws knew with errors, in the last guidance period, is `nav_<name>`.
    """

    campaign: Campaign
    numbers: np.ndarray  # (quantities, trials)
    outcome: np.ndarray  # (trials,), names
    histories: np.ndarray | None  # (times, quantities, trials)
    how: tuple  # processes, progress and whether compiled, for further ones

    @classmethod
    def flown(cls, campaign: Campaign, trials, *how) -> "Flights":
        """Fly; says how many flights the model did not cover. Raises ValueError as `fly`."""
        for name, number in (("trials", trials), ("processes", how[0])):
            _require_count(number, name)
        return cls(campaign, *campaign.fly_all(0, int(trials), *how), how)._told()

    def _told(self):
        """These flights; warns of those that the model did not cover."""
        sentences = []
        for outcome in (NOT_FINITE, AT_ONCE, *self.campaign.failures(self.numbers)):
            lost = np.flatnonzero(self.outcome == outcome)
            if lost.size:
                sentences.append(
                    f"{lost.size:,} of {self.trials:,} flights: {outcome}; replay({lost[0]}) shows one, statistics "
                    f"leave them out"
                )
        if self.campaign.model.warn:
            sentences += self.campaign.model.warn(self.campaign.p, self.final)
        for sentence in sentences:
            warnings.warn(sentence, stacklevel=4)
        return self

    def __repr__(self):
        """How many, and how they ended."""
        ended = ", ".join(f"{count:,} {name}" for name, count in self.outcomes().items())
        truth = f"; the law is told the truth: {', '.join(self.truth)}" if self.truth else ""
        return f"Flights({self.trials:,}: {ended}{truth})"

    @property
    def truth(self) -> tuple[str, ...]:
        """What the law is told of the truth of its trial by leave (`truth=True`), such as its vehicle."""
        return self.campaign.truth

    @property
    def trials(self) -> int:
        """How many flights there are."""
        return self.outcome.size

    @cached_property
    def final(self) -> dict[str, np.ndarray]:
        """Final numbers of all flights by name, each (trials,), in SI units."""
        return self.campaign.final(self.numbers)

    def outcomes(self) -> dict[str, int]:
        """How many flights ended in which way, the most frequent first."""
        names, counts = np.unique(self.outcome, return_counts=True)
        return {str(names[place]): int(counts[place]) for place in np.argsort(-counts, kind="stable")}

    def values(self, name) -> np.ndarray:
        """A final number of all flights, in the unit of its suffix. Raises ValueError for an unknown one."""
        require(
            isinstance(name, str),
            f"quantity of type {type(name).__name__}: give a name; of numbers of your own, take numpy.quantile and "
            f"montecarlo.statistics.order_interval",
        )
        base, factor = resolve(name, {name: self._meaning(name)[0] for name in self.final}, "quantity")
        return self.final[base] / factor

    def _meaning(self, name):
        """Unit and meaning."""
        suffix = name.rpartition("_")[2]
        if name not in self.final and suffix in ("km", "deg"):
            return suffix, name
        known, base = self.campaign.model.quantities | END_TIME, name.removeprefix("nav_").removeprefix("sensed_")
        if name not in known and base in known:
            return known[base][0], f"{known[base][1]}, as laws {'know it' if name.startswith('nav_') else 'are told'}"
        return known.get(name, ("", name))

    def _counted(self):
        """Flights that count in statistics: those that ended as they should. Says how many do not."""
        counted = self.campaign.counts(self.outcome)
        lost = {*self.outcome[~counted]}
        others = ", ".join(f"{count:,} {name}" for name, count in self.outcomes().items() if name in lost)
        return counted, f"{others} of {self.trials:,} flights left out" if others else ""

    def percentiles(self, names, levels=(1, 50, 99), confidence=0.95):
        """Percentiles of final numbers over all flights that ended, with distribution-free confidence intervals.

        Args:
            names: quantities, such as "range" or "range_km". levels: per cent, within (0, 100).
            confidence: of each interval, between order statistics, whatever the distribution.

        Returns:
            Data frame with columns quantity, unit, percentile, value, lower, upper, note. Where fewer than 10 flights
            lie beyond a level, the interval is NaN and the note says how many it takes.

        Raises:
            ValueError: for an unknown quantity, or a level that is no percentage.
        """
        import pandas as pd

        counted, left_out = self._counted()
        _require_confidence(confidence)
        require(
            all(map(is_number, np.atleast_1d(levels))), f"levels are {levels!r}; give numbers of per cent, such as 99"
        )
        if 0.5 <= (largest := np.max(levels)) < 1.0:
            warnings.warn(f"levels are per cent: for {largest:.0%} write {100.0 * largest:g}", stacklevel=2)
        rows = []
        for name in [names] if isinstance(names, str) else names:
            samples = self.values(name)[counted]
            for level in np.atleast_1d(levels):
                needed, share = _needed(level), level / 100.0
                lower, upper = order_interval(samples, share, confidence)
                few = f"{samples.size:,} flights; an interval takes {needed:,}" if samples.size < needed else ""
                value = np.quantile(samples, share) if samples.size else np.nan
                note = "; ".join(filter(None, (few, left_out)))
                rows.append((name, self._meaning(name)[0], float(level), value, lower, upper, note))
        return pd.DataFrame(rows, columns=["quantity", "unit", "percentile", "value", "lower", "upper", "note"])

    def until(self, goal, at_most=1_000_000) -> "Flights":
        """Fly further trials until a percentile is known well enough: until("p99 of range within 5 %").

        The half-width of its 95 % interval shall be at most this share of its value, or this much in its unit ("within
        200 m", "p1 of altitude_km within 0.1 km"). The number of flights doubles each time; the first ones are kept.
        As it looks after each doubling and stops once the interval is narrow, the interval holds the percentile a
        little less often than 95 % says; where that matters, look again with `extended`.

        Raises:
            ValueError: for a goal of another form, and for one that at_most flights do not reach; then the error's
                `flights` are those that were flown.
        """
        match = _GOAL.fullmatch(goal.strip()) if isinstance(goal, str) else None
        require(match, f"goal {goal!r} is not of the form 'p99 of range within 5 %', or 'within 200 m'")
        level, name, width, unit = float(match[1]), match[2], float(match[3]), match[4]
        self.values(name)
        own = self._meaning(name)[0]
        require(unit in ("%", own), f"goal {goal!r}: {name} is in {own}; write '%' or '{own}'")
        _require_count(at_most, "at_most")
        flights, needed = self, _needed(level)
        require(
            at_most >= needed,
            f"goal {goal!r}: an interval of p{level:g} takes {needed:,} flights; at_most is {at_most:,}",
        )
        while True:
            row = flights.percentiles([name], [level]).iloc[0]
            reached = 0.5 * (row["upper"] - row["lower"])
            wanted = width * (abs(row["value"]) / 100 if unit == "%" else 1)
            if reached <= wanted:
                return flights
            if flights.trials >= at_most:
                width = f"the half-width is {reached:.3g} {own}, wanted are {wanted:.3g} {own}"
                none = f"an interval takes {needed:,} flights that end as they should"
                near_zero = f"; of a value of {row['value']:.3g} {own} ask for a width in {own}" if unit == "%" else ""
                error = ValueError(
                    f"{goal!r} is not reached by {flights.trials:,} flights: "
                    f"{none if np.isnan(reached) else width + near_zero}; the error's `flights` holds them"
                )
                error.flights = flights
                raise error
            flights = flights.extended(min(2 * flights.trials, at_most))

    def extended(self, trials) -> "Flights":
        """The same flights and further ones, up to this number of trials. Raises ValueError for no more than now."""
        _require_count(trials, "trials")
        require(
            trials > self.trials, f"extended takes more trials than the {self.trials:,} that are flown, got {trials:,}"
        )
        more = self.campaign.fly_all(self.trials, trials, *self.how)
        pairs = zip((self.numbers, self.outcome, self.histories), more, strict=True)
        joined = (None if new is None else np.concatenate([old, new], axis=-1) for old, new in pairs)
        return Flights(self.campaign, *joined, self.how)._told()

    def against(self, other, names=None, confidence=0.95):
        """Mean differences to other flights of the same seed, trial by trial: both met the same start, air and noise.

        Args:
            other: `Flights` of as many trials. names: quantities; by default all that both have.
            confidence: of the intervals of the mean differences, by Student's t. The differences are to be normal,
                or many.

        Returns:
            Data frame with columns quantity, unit, difference (mean of these minus the other), lower, upper, deviation
            (of the differences), correlation, flights (that ended in both).

        Raises:
            ValueError: for flights of another seed or number, or an unknown quantity.
        """
        import pandas as pd
        from scipy.special import stdtrit

        _require_confidence(confidence)
        require(isinstance(other, Flights), f"against takes Flights, not {type(other).__name__}")
        mine, others = ((flights.trials, flights.campaign.seed) for flights in (self, other))
        require(
            mine == others,
            f"these are {mine[0]:,} flights of seed {mine[1]}, the others {others[0]:,} of seed {others[1]}: fly "
            f"both with the same seed and trials, so that they meet the same errors",
        )
        both, rows = self._counted()[0] & other._counted()[0], []
        for name in names if names is not None else [name for name in self.final if name in other.final]:
            first, second = self.values(name)[both], other.values(name)[both]
            difference, count = first - second, int(both.sum())
            deviation = difference.std(ddof=1) if count > 1 else np.nan
            width = stdtrit(count - 1, 0.5 + 0.5 * confidence) * deviation / np.sqrt(count) if count > 1 else np.nan
            mean = difference.mean() if count else np.nan
            varies = count > 1 and first.std() > 0 and second.std() > 0
            correlation = np.corrcoef(first, second)[0, 1] if varies else np.nan
            rows.append((name, self._meaning(name)[0], mean, mean - width, mean + width, deviation, correlation, count))
        columns = ["quantity", "unit", "difference", "lower", "upper", "deviation", "correlation", "flights"]
        return pd.DataFrame(rows, columns=columns)

    def worst(self, name, count=10):
        """Data frame of the flights whose final number lies farthest from the median, the farthest first."""
        _require_count(count, "count")
        counted, _ = self._counted()
        samples = self.values(name)
        distance = np.where(counted, np.abs(samples - np.median(samples[counted])), -1.0)
        return self.to_pandas().iloc[np.argsort(-distance, kind="stable")[: min(count, int(counted.sum()))]]

    def replay(self, trial, in_python=False) -> OneFlight:
        """Fly one trial again, alone, with all that is stored at every integration step: the same bits.

        Args:
            trial: its number. in_python: whether the functions fly as they are written, so that `print` and debuggers
                work in them; the bits are the same. Flights that were not compiled fly so.

        Raises:
            ValueError: for a number that is no trial's.
        """
        import pandas as pd

        require(
            isinstance(trial, int | np.integer) and 0 <= trial < self.trials,
            f"trial {trial!r} is not among those flown, 0 to {self.trials - 1:,}",
        )
        campaign, trial = self.campaign, int(trial)
        step = campaign.period / campaign.substeps
        flown = campaign.fly(range(trial, trial + 1), step, in_python or not self.how[-1])
        length, parts = int(flown.length[0]), campaign.flight().parts
        index = pd.Index(campaign.schedule(step).times[:length], name="time")
        history = pd.DataFrame(flown.history[:length, :, 0], index, [*parts["stored"]._fields])
        final = dict(zip(self.final, flown.final_state[:, 0].tolist(), strict=True))
        if "end_time" in final:  # of an end within a step; the command is held
            held = {name: history[name].iloc[-1] for name in parts["command"]._fields if name in history}
            history.loc[final["end_time"]] = [final.get(name, held.get(name, np.nan)) for name in history]
        return OneFlight(trial, history, final, str(campaign.outcomes(flown)[0]))

    def to_pandas(self):
        """Data frame of the final numbers and the outcome of every flight, in SI units."""
        import pandas as pd

        index = pd.RangeIndex(self.trials, name="trial")
        return pd.DataFrame({**self.final, "outcome": self.outcome}, index=index)

    def to_xarray(self):
        """Data set of final numbers, outcome and, if stored, histories, with units and meanings as attributes.

        A history has the dimensions trial and time, the name `altitude_history`, and NaN after the end of a flight.
        """
        try:
            import xarray
        except ModuleNotFoundError as error:
            raise missing(error, "results") from None

        def described(dimensions, values, name):
            unit, meaning = self._meaning(name)
            return (dimensions, values, {"units": unit, "long_name": meaning})

        variables = {name: described("trial", values, name) for name, values in self.final.items()}
        variables["outcome"] = ("trial", self.outcome, {"long_name": "how the flight ended"})
        coordinates = {"trial": np.arange(self.trials)}
        if self.histories is not None:
            times = self.campaign.schedule(self.campaign.history).times
            coordinates["time"] = ("time", times, {"units": "s", "long_name": "time"})
            for row, name in enumerate(self.campaign.flight().parts["stored"]._fields):
                variables[f"{name}_history"] = described(("time", "trial"), self.histories[:, row], name)
        attributes = {"seed": self.campaign.seed, "truth_told_to_the_law": ", ".join(self.truth)}
        return xarray.Dataset(variables, coordinates, attributes)
