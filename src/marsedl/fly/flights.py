"""Flights that are flown: percentiles with intervals, outcomes, labelled arrays, replays, comparisons."""

import ast
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from marsedl.fly.budget import Budget, budget_of, moves, sources_of
from marsedl.fly.campaign import AT_ONCE, NOT_FINITE, Campaign
from marsedl.fly.declared import is_number, resolve
from marsedl.fly.phases import PhaseBefore, phase_before
from marsedl.fly.vehicles import END_TIME
from marsedl.montecarlo.statistics import TAIL, order_interval, paired_percentile_interval, paired_share_interval
from marsedl.words import missing, require

__all__ = ["Flights", "OneFlight", "order_interval"]

_GOAL = re.compile(r"p(\d+(?:\.\d+)?) of (\w+) within (\d+(?:\.\d+)?(?:e[+-]?\d+)?) ?(\S+)")
PREFIXES = {  # of names, and what numbers with them mean
    "": "{}",
    "nav_": "{}, as laws know it",
    "sensed_": "{}, as laws are told",
    "start_": "{}, at the start",
    "commanded_": "{}, as commanded",
}
_A_NUMBER = "{!r} is a number; give a condition, such as 'abs(range_km - 640) < 2'"


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


def _expression(text, value_of):
    """The value of an expression whose names are quantities. Raises ValueError for what is none."""
    import pandas as pd

    wrong = f"{text!r} is no expression in quantities, such as 'abs(range_km - 640) < 2'"
    require(isinstance(text, str), wrong)
    try:
        nodes = list(ast.walk(ast.parse(text.strip(), mode="eval")))
    except SyntaxError as error:
        raise ValueError(f"{wrong}: {error}") from None
    functions = {node.func.id for node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    names = {node.id for node in nodes if isinstance(node, ast.Name)} - functions
    values = {name: pd.Series(value_of(name)) for name in names}
    try:
        return pd.eval(text.strip(), engine="python", local_dict=values, global_dict={})
    except (ValueError, NotImplementedError, TypeError, AttributeError) as error:
        raise ValueError(f"{wrong}: {error}") from None


def _spread_of_pairs(first, second):
    """Deviation of the differences, and correlation; NaN where so few pairs, or constant numbers, have none."""
    varies = first.size > 1 and first.std() > 0 and second.std() > 0
    deviation = (first - second).std(ddof=1) if first.size > 1 else np.nan
    return deviation, np.corrcoef(first, second)[0, 1] if varies else np.nan


def _difference(first, second, confidence, percentile):
    """Difference of the shares of two conditions, of a percentile, or of the means; and its interval."""
    if first.size == 0:
        return np.nan, (np.nan, np.nan)
    if first.dtype == bool:
        return first.mean() - second.mean(), paired_share_interval(first, second, confidence)
    if percentile is None:
        return mean_interval(first - second, confidence)
    _needed(percentile)
    level = percentile / 100.0
    difference = np.quantile(first, level) - np.quantile(second, level)
    return difference, paired_percentile_interval(first, second, level, confidence)


def mean_interval(samples, confidence):
    """Mean and its interval by Student's t."""
    from scipy.special import stdtrit

    count = samples.size
    mean = samples.mean() if count else np.nan
    deviation = samples.std(ddof=1) if count > 1 else np.nan
    width = stdtrit(count - 1, 0.5 + 0.5 * confidence) * deviation / np.sqrt(count) if count > 1 else np.nan
    return mean, (mean - width, mean + width)


class Search(NamedTuple):
    """How `until` stopped: what was asked, whether it is reached, after how many looks, both half-widths, their unit.

    A goal that was reached at the first look took no choice, and its interval holds as often as it says.
    """

    goal: str
    reached: bool
    looks: int
    half_width: float
    wanted: float
    unit: str

    def __str__(self):
        """In words."""
        found = f"the half-width is {self.half_width:.3g} {self.unit}"
        looks = f"{self.looks:,} look{'s' * (self.looks > 1)}"
        return f"{self.goal!r} is {'' if self.reached else 'not '}reached after {looks}: {found}"


class OneFlight(NamedTuple):
    """One trial alone: what is stored at every step and the end, its final numbers, its outcome, what it drew."""

    trial: int
    history: Any
    final: dict[str, float]
    outcome: str
    drawn: dict[str, float]


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
    derived: Mapping[str, tuple] = field(default_factory=dict)  # name: (unit, expression or function)
    search: Search | None = None  # how `until` stopped, if it chose how many there are

    @classmethod
    def flown(cls, campaign: Campaign, trials, *how) -> "Flights":
        """Fly; says how many flights the model did not cover. Raises ValueError and KeyboardInterrupt as `fly`."""
        for name, number in (("trials", trials), ("processes", how[0])):
            _require_count(number, name)
        try:
            flown = campaign.fly_all(0, int(trials), *how)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                "interrupted: no flight is kept; fly fewer trials and add to them by `extended`, which keeps them"
            ) from None
        return cls(campaign, *flown, how)._told()

    def _told(self):
        """These flights; warns of those that the model did not cover."""
        sentences = []
        for outcome in (NOT_FINITE, AT_ONCE, *self.campaign.failures(self.numbers)):
            lost = np.flatnonzero(self.outcome == outcome)
            if lost.size:
                where = f"replay({lost[0]}) shows one"
                if outcome == NOT_FINITE:
                    where += f" and replay({lost[0]}, in_python=True) warns at the line where it began"
                sentences.append(
                    f"{lost.size:,} of {self.trials:,} flights: {outcome}; {where}, statistics leave them out"
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
        search = f"; {self.search}" if self.search else ""
        return f"Flights({self.trials:,}: {ended}{truth}{search})"

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

    @cached_property
    def drawn(self) -> dict[str, np.ndarray]:
        """Dispersed numbers of all flights by name, each (trials,), in SI units.

        Those of the start are `start_velocity` and the like, those of the vehicle have its names, constant errors of
        senses are `altitude_bias` and the like. What air and noise drew is not among them.
        """
        recorded = self.campaign.recorded
        return self._drawn(range(self.trials)) if recorded is None else recorded

    def _drawn(self, trials):
        """What some trials drew, by name."""
        campaign, senses = self.campaign, self.campaign.senses
        start, vehicle = campaign.drawn(trials)
        if campaign.before:
            start[:, ~campaign.before.goes_on[trials]] = np.nan
        dispersed = {*campaign.vehicle.dispersed(), *(senses.declared.dispersed() if senses.constants else ())}
        of_vehicle = zip((*campaign.vehicle.names, *senses.constants), vehicle, strict=True)
        return {
            **{f"start_{name}": start[campaign.start.names.index(name)] for name in campaign.start.dispersed()},
            **{name: values for name, values in of_vehicle if name in dispersed},
        }

    @cached_property
    def _known(self):
        """Numbers that questions may name: final, drawn, and those of one's own, in the order of their definition."""
        known = {**self.drawn, **self.final}
        for name, (_, definition) in self.derived.items():
            known[name] = self._evaluated(definition, known)
        return known

    def _evaluated(self, definition, known):
        """An expression, or a function of all numbers by name, as one value for each trial."""
        if callable(definition):
            values = np.asarray(definition(known))
        else:
            values = np.asarray(_expression(definition, lambda name: self._of(name, known)))
        require(
            values.shape == (self.trials,) and values.dtype.kind in "biuf",
            f"{definition!r} gives {values.dtype} of shape {values.shape}; it must give a number for each flight",
        )
        return values

    def with_quantity(self, name: str, definition: str | Callable, unit: str = "") -> "Flights":
        """These flights with a further quantity, of which all questions may be asked.

        Args:
            name: a new one. definition: expression in names and their suffixes, such as
                "sqrt((range_km - 640)**2 + crossrange_km**2)", or a function of a mapping from names to (trials,)
                in SI units. unit: in which it comes out.

        Raises:
            ValueError: for a name that is taken or no name, or a definition that gives no number for each flight.
        """
        require(
            isinstance(name, str) and name.isidentifier() and name not in self._known,
            f"quantity {name!r}: give a new name, of letters, digits and underscores",
        )
        self._evaluated(definition, self._known)  # refuses what gives no numbers
        return replace(self, derived={**self.derived, name: (unit, definition)})

    def values(self, name) -> np.ndarray:
        """A number of all flights, final, drawn or derived, in the unit of its suffix.

        Raises ValueError for an unknown one.
        """
        require(
            isinstance(name, str),
            f"quantity of type {type(name).__name__}: give a name; of numbers of your own, take numpy.quantile and "
            f"montecarlo.statistics.order_interval",
        )
        return self._of(name, self._known)

    def is_condition(self, what) -> bool:
        """Whether something that is asked for holds or not. Raises ValueError for what is no quantity, too."""
        return self._asked(what).dtype == bool

    def _asked(self, what, percentile=None):
        """A number of all flights, or whether a condition holds, which has no percentile.

        Raises ValueError for what is neither.
        """
        if not isinstance(what, str) or what.strip().isidentifier():
            return self.values(what)
        holds = self._evaluated(what, self._known)
        require(holds.dtype == bool, _A_NUMBER.format(what))
        require(
            percentile is None, f"{what!r} is a condition, which has a share and no percentile: leave percentile out"
        )
        return holds

    def _of(self, name, known):
        base, factor = resolve(name, {name: self._meaning(name)[0] for name in known}, "quantity")
        return known[base] / factor

    def _meaning(self, name):
        """Unit and meaning."""
        suffix = name.rpartition("_")[2]
        if name in self.derived:
            return self.derived[name][0], name
        if name not in self.final and suffix in ("km", "deg"):
            return suffix, name
        known = self.campaign.model.quantities | END_TIME
        for prefix, said in PREFIXES.items():
            if name.startswith(prefix) and (base := name.removeprefix(prefix)) in known:
                unit, meaning = known[base]
                return unit, said.format(meaning)
        if name.startswith("saturated_"):
            return "", f"guidance periods in which limits kept {name.removeprefix('saturated_')} from what is commanded"
        return "", name

    def _counted(self):
        """Flights that count in statistics: those that ended as they should. Says how many do not."""
        counted = self.campaign.counts(self.outcome)
        lost = {*self.outcome[~counted]}
        others = ", ".join(f"{count:,} {name}" for name, count in self.outcomes().items() if name in lost)
        left_out = f"{others} of {self.trials:,} flights left out" if others else ""
        looked = f"`until` looked {self.search.looks} times" if self.search and self.search.looks > 1 else ""
        return counted, "; ".join(filter(None, (left_out, looked)))

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
        if 0.5 <= (largest := np.max(levels, initial=0.0)) < 1.0:
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
        As it looks after each doubling and stops once the interval is narrow, intervals hold what they are of a little
        less often than they say, which their notes tell; flights that are `extended` to a number chosen beforehand do
        not have this fault.

        Returns:
            All flights that were flown. Their `search` says whether the goal is reached, and how closely; a warning,
            too, if it is not: by at_most flights, or as the percentile lies so near zero that at_most flights could not
            tell it within that percentage.

        Raises:
            ValueError: for a goal of another form, or of which at_most flights have no interval.
            KeyboardInterrupt: when it is interrupted; its `flights` are those of the last look.
        """
        match = _GOAL.fullmatch(goal.strip()) if isinstance(goal, str) else None
        require(match, f"goal {goal!r} is not of the form 'p99 of range within 5 %', or 'within 200 m'")
        level, name, width, unit = float(match[1]), match[2], float(match[3]), match[4]
        self.values(name)
        own = self._meaning(name)[0]
        require(unit in ("%", own), f"goal {goal!r}: {name} is in {own}; write '%' or '{own}'")
        _require_count(at_most, "at_most")
        flights, needed, looks = self, _needed(level), 0
        require(
            at_most >= needed,
            f"goal {goal!r}: an interval of p{level:g} takes {needed:,} flights; at_most is {at_most:,}",
        )
        while True:
            row, looks = flights.percentiles([name], [level]).iloc[0], looks + 1
            reached = 0.5 * (row["upper"] - row["lower"])
            wanted = width * (abs(row["value"]) / 100 if unit == "%" else 1)
            # An interval narrows by the root of the number of flights.
            farthest, narrowest = max(abs(row["lower"]), abs(row["upper"])), reached * (flights.trials / at_most) ** 0.5
            is_zero = unit == "%" and row["lower"] <= 0.0 <= row["upper"] and narrowest > width / 100 * farthest
            if reached <= wanted or is_zero or flights.trials >= at_most:
                break
            flights = flights.extended(min(2 * flights.trials, at_most))
        search = Search(goal.strip(), bool(reached <= wanted), looks, reached, wanted, own)
        if not search.reached:
            why = f"wanted {'is' if unit == '%' else 'are'} {wanted:.3g} {own}"
            if np.isnan(reached):
                why = f"an interval takes {needed:,} flights that end as they should"
            elif is_zero:
                why = f"about zero a percentage takes more than {at_most:,} flights: ask for a width in {own}"
            elif unit == "%":
                why += f"; of a value of {row['value']:.3g} {own} ask for a width in {own}"
            warnings.warn(f"{search}: {why}", stacklevel=2)
        return replace(flights, search=search)

    def extended(self, trials) -> "Flights":
        """The same flights and further ones, up to this number of trials.

        The last flight is flown again beside them, and must have the same bits as before.

        Raises:
            ValueError: for no more trials than now, or flights that are others now.
            KeyboardInterrupt: when it is interrupted; these flights stay, also as its `flights`.
        """
        _require_count(trials, "trials")
        require(
            trials > self.trials, f"extended takes more trials than the {self.trials:,} that are flown, got {trials:,}"
        )
        try:
            again, *outcome_and_histories = self.campaign.fly_all(self.trials - 1, int(trials), *self.how)
        except KeyboardInterrupt:
            interrupt = KeyboardInterrupt(
                f"interrupted: the {self.trials:,} flights before are kept; extend them again"
            )
            interrupt.flights = self
            raise interrupt from None
        require(
            np.array_equal(again[:, 0], self.numbers[:, -1], equal_nan=True),
            f"flight {self.trials - 1} has other numbers now: what flies it has changed, such as a package; fly all of "
            f"them again",
        )
        pairs = zip((self.numbers, self.outcome, self.histories), (again, *outcome_and_histories), strict=True)
        joined = (None if new is None else np.concatenate([old, new[..., 1:]], axis=-1) for old, new in pairs)
        return Flights(self.campaign, *joined, self.how, self.derived)._told()

    def against(self, other, names=None, confidence=0.95, percentile=None):
        """Differences to other flights of the same seed, trial by trial: both met the same start, air and noise.

        Args:
            other: `Flights` of as many trials. names: quantities, or conditions as of `probability`; by default all
                quantities that both have.
            confidence: of the intervals. Those of mean differences are by Student's t: the differences are to be
                normal, or many. They hold less often if few differences are skewed: those of a lognormal distribution
                (of deviation 1 of the logarithm) 82 % of the time with 5 flights, 88 % with 30, 93 % with 200, in
                place of 95 %. Tails that are heavy on both sides do no harm. Those of percentiles are between order
                statistics of the pairs (`statistics.paired_percentile_interval`), those of shares are by scores
                (`statistics.paired_share_interval`), whatever the distribution.
            percentile: per cent: then the difference is that of this percentile, not of the mean.

        Returns:
            Data frame with columns quantity, unit, difference (of the mean, percentile or share: these minus the
            other), lower, upper, deviation (of the differences of all flights), correlation, flights (that ended in
            both). An interval that so few flights do not have is NaN.

        Raises:
            ValueError: for flights of another seed or number, an unknown quantity, a condition with a percentile, or a
                level that is no percentage.
        """
        import pandas as pd

        _require_confidence(confidence)
        require(isinstance(other, Flights), f"against takes Flights, not {type(other).__name__}")
        mine, others = ((flights.trials, flights.campaign.seed) for flights in (self, other))
        require(
            mine == others,
            f"these are {mine[0]:,} flights of seed {mine[1]}, the others {others[0]:,} of seed {others[1]}: fly "
            f"both with the same seed and trials, so that they meet the same errors",
        )
        both, rows = self._counted()[0] & other._counted()[0], []
        names = [name for name in self.final if name in other.final] if names is None else names
        for name in [names] if isinstance(names, str) else names:
            first, second = self._asked(name, percentile)[both], other._asked(name)[both]
            deviation, correlation = _spread_of_pairs(first.astype(float), second.astype(float))
            difference, (lower, upper) = _difference(first, second, confidence, percentile)
            unit = "" if first.dtype == bool else self._meaning(name)[0]
            rows.append((name, unit, difference, lower, upper, deviation, correlation, first.size))
        columns = ["quantity", "unit", "difference", "lower", "upper", "deviation", "correlation", "flights"]
        return pd.DataFrame(rows, columns=columns)

    def worst(self, name, count=10, side="both"):
        """Data frame of the flights with the most extreme number, the worst first, with what they drew.

        Flights that are left out of statistics are not among them: see `left_out`.

        Args:
            name: quantity. count: how many flights. side: "high" for the largest, "low" for the smallest, "both" for
                those farthest from the median.

        Raises:
            ValueError: for an unknown quantity or side, or no positive count.
        """
        _require_count(count, "count")
        counted, _ = self._counted()
        samples = self.values(name)
        distances = {
            "both": lambda: np.abs(samples - np.median(samples[counted])) if counted.any() else samples,
            "high": lambda: samples,
            "low": lambda: -samples,
        }
        require(isinstance(side, str) and side in distances, f"side is {side!r}; give 'both', 'high' or 'low'")
        order = np.argsort(np.where(counted, -distances[side](), np.inf), kind="stable")
        return self.to_pandas().iloc[order[: min(count, int(counted.sum()))]]

    def as_start(self, start: Mapping | Callable) -> PhaseBefore:
        """The start of a next phase, fly(Lander(...), these.as_start(...)): trial i goes on where it ended here.

        Trials that did not end as they should here have the outcome "before: ..." there, no numbers, and count in no
        statistics. The phase has streams of random numbers of its own, whatever its seed; its time starts from 0.

        Args:
            start: mapping from the names of the next start to names of numbers here, both with their suffixes, or to
                a number, `Normal` or `Uniform`: {"altitude": "altitude", "downrange_km": "range_km", "mass": 900.0}.
                Or a function of a mapping from all names here to (trials,), which returns such a mapping to (trials,).

        Raises:
            ValueError: for an unknown quantity, or numbers that are not one for each trial.
        """
        return phase_before(self, start)

    def left_out(self):
        """Data frame of the flights that statistics leave out, with how they ended and what they drew."""
        return self.to_pandas().loc[~self._counted()[0]]

    def probability(self, condition, confidence=0.95):
        """Share of the flights for which a condition holds, with its exact interval (Clopper and Pearson 1934).

        Args:
            condition: in names and their suffixes, such as "abs(range_km - 640) < 2 and altitude_km > 6".
            confidence: of the interval.

        Returns:
            Series of numbers: value, lower, upper, flights (that count) and left_out. Its `attrs["note"]` says why they
            are left out.

        Raises:
            ValueError: for an unknown quantity, or what is no condition.
        """
        import pandas as pd
        from scipy.stats import binomtest

        _require_confidence(confidence)
        holds, (counted, left_out) = self._evaluated(condition, self._known), self._counted()
        require(holds.dtype == bool, _A_NUMBER.format(condition))
        flights, true = int(counted.sum()), int(holds[counted].sum())
        interval = binomtest(true, flights).proportion_ci(confidence) if flights else (np.nan, np.nan)
        numbers = {"value": true / flights if flights else np.nan, "lower": interval[0], "upper": interval[1]}
        share = pd.Series({**numbers, "flights": flights, "left_out": self.trials - flights}, name=condition)
        share.attrs["note"] = left_out
        return share

    def explains(self, what, percentile=None, confidence=0.95):
        """Which share of a variance each dispersed number explains by itself: where the spread of a result comes from.

        Args:
            what: a quantity, or a condition as of `probability`: then the variance is that of whether it holds.
            percentile: of the quantity, per cent: then the variance is that of whether a flight lies beyond it. The
                shares of a tail are not those of the whole spread.
            confidence: of the intervals.

        Returns:
            Data frame with columns drawn, share, lower, upper (`shares.explained_share`), flights and note, the
            largest share first. The last row, "all else", is what is left: air, noise, and what numbers do only
            together. Shares of numbers that are drawn with a correlation overlap.

        Raises:
            ValueError: for an unknown quantity, a condition with a percentile, or a level that is no percentage.
        """
        import pandas as pd

        from marsedl.fly.shares import FEWEST, explained_share

        _require_confidence(confidence)
        counted, left_out = self._counted()
        result = self._asked(what, percentile)[counted].astype(float)
        if percentile is not None:
            _needed(percentile)
            result = (result > np.quantile(result, percentile / 100.0)).astype(float)
        few = f"{result.size:,} flights; a share takes {FEWEST:,}" if result.size < FEWEST else ""
        note = "; ".join(filter(None, (few, left_out)))
        rows = [
            (name, *explained_share(values[counted], result, confidence), result.size, note)
            for name, values in self.drawn.items()
        ]
        rows.sort(key=lambda row: -np.nan_to_num(row[1]))
        rest = 1.0 - sum(row[1] for row in rows) if rows else 1.0
        rows.append(("all else", rest, np.nan, np.nan, result.size, note))
        return pd.DataFrame(rows, columns=["drawn", "share", "lower", "upper", "flights", "note"])

    def budget(self, quantity, tolerance=0.03) -> Budget:
        """Standard deviation of a quantity as its sources make it, by flights that move one normal number each.

        It is linear covariance analysis of the flights as they fly, with law, memory, limits and trigger: every
        independent normal number (of start, vehicle and senses, of each node of the air, of navigation and white noise
        in each period and step) is moved by a quarter of a deviation and by a whole one to both sides. The squares of
        the slopes over the quarter add up to the variance. A dispersed `Uniform` number counts as its deviation.

        Args:
            quantity: final, drawn or derived, with a suffix or without.
            tolerance: relative, of the deviation, by which linear covariance may fail before `notes` says so.

        Returns:
            `Budget`: deviation and shares, and in `notes` where it is not linear.

        Raises:
            ValueError: for an unknown quantity, a tolerance that is not positive, flights of which nothing is
                dispersed, or whose flight without errors does not end as it should.
        """
        require(
            is_number(tolerance) and tolerance > 0.0,
            f"tolerance is {tolerance!r}; give a positive share of the deviation, such as 0.03",
        )
        flown = self.values(quantity)[self._counted()[0]].astype(float)
        sources, perturbed = self._perturbed
        perturbed = replace(perturbed, derived=self.derived)
        values = np.where(perturbed._counted()[0], perturbed.values(quantity).astype(float), np.nan)
        return budget_of(quantity, self._meaning(quantity)[0], sources, values, flown, tolerance)

    @cached_property
    def _perturbed(self):
        """The independent normal numbers, and flights that are moved by each."""
        compiled = self.how[-1]
        sources = sources_of(self.campaign, in_python=not compiled)
        campaign = self.campaign.perturbed(moves(sources))
        flown = campaign.fly_all(0, campaign.only.shape[1], 1, False, compiled)
        flights = Flights(campaign, *flown, (1, False, compiled))
        require(
            flights._counted()[0][0],
            f"the flight without errors ends {str(flights.outcome[0])!r}: a budget takes one that ends as it should",
        )
        return sources, flights

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
        require(
            campaign.before is None or campaign.before.goes_on[trial],
            f"trial {trial} has no such flight; {self.outcome[trial]}",
        )
        step = campaign.period / campaign.substeps
        flown = campaign.fly(range(trial, trial + 1), step, in_python or not self.how[-1]).with_ends()
        length, parts = int(flown.length[0]), campaign.flight().parts
        index = pd.Index(campaign.schedule(step).times[:length], name="time")
        history = pd.DataFrame(flown.history[:length, :, 0], index, [*parts["stored"]._fields])
        final = dict(zip(self.final, flown.final_state[:, 0].tolist(), strict=True))
        if "end_time" in final:  # which may lie within a step
            history.loc[final["end_time"]] = flown.history[min(length, len(flown.history) - 1), :, 0]
        drawn = {name: float(one) for name, (one,) in self._drawn(range(trial, trial + 1)).items()}
        return OneFlight(trial, history, final, str(campaign.outcomes(flown)[0]), drawn)

    def save(self, path) -> None:
        """Keep these flights in an HDF5 file: all numbers, and the declaration, by which `load` goes on.

        The groups final, drawn and history hold a variable for each quantity, with units and meanings, which
        `xarray.open_dataset(path, group="final")` reads, too. The group declaration holds the arguments of `fly` and
        the source of the law with its helpers, for reading. Functions are found again by import, as those of pickle
        are. Quantities of your own are kept as expressions.

        Warns of quantities that are functions, which are left out. Raises OSError naming the file if it cannot be
        written; an earlier file is then unchanged.
        """
        from marsedl.fly.saved import save

        save(self, path)

    def to_pandas(self):
        """Data frame of what every flight drew, its numbers and its outcome, in SI units but for derived ones."""
        import pandas as pd

        index = pd.RangeIndex(self.trials, name="trial")
        return pd.DataFrame({**self._known, "outcome": self.outcome}, index=index)

    def to_xarray(self):
        """Data set of what was drawn, final numbers, outcome and, if stored, histories, with units and meanings.

        A history has the dimensions trial and time, and the name `altitude_history`. Its last number is the end of the
        flight, at the first time of the history from `end_time` on; then NaN follow.
        """
        try:
            import xarray
        except ModuleNotFoundError as error:
            raise missing(error, "results") from None

        def described(dimensions, values, name):
            unit, meaning = self._meaning(name)
            return (dimensions, values, {"units": unit, "long_name": meaning})

        variables = {name: described("trial", values, name) for name, values in self._known.items()}
        variables["outcome"] = ("trial", self.outcome, {"long_name": "how the flight ended"})
        coordinates = {"trial": np.arange(self.trials)}
        if self.histories is not None:
            times = self.campaign.schedule(self.campaign.history).times
            coordinates["time"] = ("time", times, {"units": "s", "long_name": "time"})
            for row, name in enumerate(self.campaign.flight().parts["stored"]._fields):
                variables[f"{name}_history"] = described(("time", "trial"), self.histories[:, row], name)
        attributes = {"seed": self.campaign.seed, "truth_told_to_the_law": ", ".join(self.truth)}
        return xarray.Dataset(variables, coordinates, attributes)
