"""The arena: laws flown in the same trials of a scenario, tuned with equal budgets, and compared."""

import hashlib
import json
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from marsedl.fly.flights import Flights
from marsedl.replication.errors import MarsedlError
from marsedl.scenarios import costs
from marsedl.scenarios.ranking import Estimate, paired, percentile, places, summary_of
from marsedl.scenarios.scenario import POOLS, Resident, Scenario

__all__ = ["Scores", "flown", "joined", "pairs", "table", "tuned", "tuned_again"]

BOTH = ("mean", "inside")  # by what laws have places
TUNING_FLIGHTS = 4_000  # of one law
LOST = 10.0  # times the largest miss in the box: what a lost flight counts in tuning
TUNING_TRIES = 8  # sets of numbers between which a law is chosen; the first one is that of its authors


class Scores(NamedTuple):
    """What is told of the trials of one law in one condition."""

    names: tuple[str, ...]
    values: np.ndarray  # (names, trials), SI
    outcome: np.ndarray  # (trials,), words

    def __getitem__(self, name):
        """The numbers of a name, (trials,)."""
        return self.values[self.names.index(name)]

    def digest(self) -> str:
        """Of all bits of all trials."""
        return shortened(self.values.tobytes() + " ".join(self.outcome).encode())


def shortened(content: bytes) -> str:
    """A digest of 16 characters."""
    return hashlib.sha256(content).hexdigest()[:16]


def flown(
    scenario: Scenario, law, condition: str, seed: int, first: int, count: int, progress=False, compiled=True
) -> Scores:
    """Fly consecutive trials of a law.

    Args:
        scenario: that flies. law: as `marsedl.fly.fly` takes it. condition: by name. seed: of the pool, see `POOLS`.
        first, count: which trials. progress, compiled: as of `marsedl.fly.fly`.

    Raises:
        ValueError: as `marsedl.fly.fly`; for a law that asks for the truth.
    """
    campaign = scenario.campaign(law, condition, seed)
    options = 1, progress, compiled
    numbers, outcome, _ = campaign.fly_all(first, first + count, *options)
    named = scenario.scores(Flights(campaign, numbers, outcome, None, options))
    return Scores((*named,), np.array([*named.values()]), outcome)


def joined(parts: list[Scores]) -> Scores:
    """Scores of chunks of trials, in their order."""
    values = np.concatenate([part.values for part in parts], axis=1)
    return Scores(parts[0].names, values, np.concatenate([part.outcome for part in parts]))


class Try(NamedTuple):
    """One set of numbers of a law, and what it gave on the pool for tuning."""

    numbers: dict[str, float]  # none: the law as its authors give it
    mean: float  # miss, m, with that of lost trials; NaN: it could not be designed
    saturated: float  # guidance periods with a limit in action, on average
    command: float = np.nan  # operations of a command, of the best try; see `costs`
    design: str = ""  # what its design solves and flies


def tuned(
    scenario: Scenario, resident: Resident, condition="dispersed", flights=TUNING_FLIGHTS, most=TUNING_TRIES
) -> list[Try]:
    """Try a law with as many sets of numbers as every law has, the same flights for each; the best one is the first.

    The first try is the law as its authors give it; the others are points of a Sobol sequence between the bounds, on a
    logarithmic scale. Flights are those of the pool for tuning. One that is lost misses by `LOST` times the box. What
    the best one costs is counted.
    flights: of one law. most: tries.
    """
    from scipy.stats import qmc

    tries = [{}]
    if resident.tuned:
        bounds = np.log(np.array([*resident.tuned.values()])).T
        points = qmc.scale(qmc.Sobol(len(resident.tuned), scramble=False).random(TUNING_TRIES)[1:most], *bounds)
        tries += [dict(zip(resident.tuned, map(float, np.exp(row)), strict=True)) for row in points]
    found = []
    for numbers in tries:
        try:
            law = resident.design(scenario.onboard, **numbers)
        except (ValueError, MarsedlError):
            found.append(Try(numbers, np.nan, np.nan))
            continue
        scores = flown(scenario, law, condition, POOLS["tuning"], 0, max(flights // most, 1))
        misses = np.where(np.isfinite(scores["miss"]), scores["miss"], LOST * scenario.largest_miss)
        known = scores["saturated"][np.isfinite(scores["saturated"])]
        found.append(Try(numbers, float(misses.mean()), float(known.mean()) if known.size else np.nan))
    found.sort(key=lambda one: (np.isnan(one.mean), one.mean))
    if not np.isnan(found[0].mean):
        laws = []
        work = costs.design_of(lambda: laws.append(resident.design(scenario.onboard, **found[0].numbers)))
        operations = costs.command_of(scenario.campaign(laws[0], condition, POOLS["tuning"]))
        found[0] = found[0]._replace(command=operations, design=work)
    return found


def tuned_again(scenario: Scenario, known: Mapping[str, list[dict]]) -> str:
    """Tune one law once more, drawn by what is known of the tries of all laws; returns its name.

    Raises MarsedlError if its tries are not the same to the last bit.
    """
    drawn = [*known][int(shortened(json.dumps(known).encode()), 16) % len(known)]
    again = [one._asdict() for one in tuned(scenario, scenario.residents[drawn])]
    if json.dumps(again) != json.dumps(known[drawn]):
        raise MarsedlError(
            f"{scenario.name}: {drawn} is tuned otherwise than in the sealed table of the same code and inputs: do "
            f"libraries or machine differ?"
        )
    return drawn


def table(scores: Mapping[str, Scores], confidence=0.95, tails=()):
    """One row a law, those first that end most often inside of the box.

    They hold estimates with their intervals, medians of all else with theirs, and trials lost by cause.

    Args:
        scores: by law, all of the same trials. confidence: of each interval, and of all pairs at once.
        tails: names of what else the 99th percentile is told of.

    Returns:
        Data frame: law, best and worst place that intervals leave open (by the mean miss, and in the box), an
        `Estimate` each in three columns, such as mean, mean_lower and mean_upper (m), and lost by outcome.
    """
    import pandas as pd

    differences = pairs_of(scores, confidence)
    by_miss, in_box = (places(differences, what) if differences else dict.fromkeys(scores, (1, 1)) for what in BOTH)
    rows = []
    for law, one in scores.items():
        counted = one["miss"][np.isfinite(one["miss"])]
        row = {"law": law, "trials": one.outcome.size}
        for name, found in (("", by_miss), ("_in_box", in_box)):
            row |= {f"best_place{name}": found[law][0], f"worst_place{name}": found[law][1]}
        for name, estimate in summary_of(counted, one["inside"] > 0.5, confidence).items():
            row |= columns_of(name, estimate)
        others = [name for name in one.names if name not in ("miss", "inside")]
        for name in others:
            known = one[name][np.isfinite(one[name])]
            for prefix, level in (("median", 0.5), ("p99", 0.99))[: 1 + (name in tails)]:
                row |= columns_of(f"{prefix}_{name}", percentile(known, level, confidence))
        kinds, counts = np.unique(one.outcome[~np.isfinite(one["miss"])], return_counts=True)
        row["lost"] = "; ".join(f"{count} {kind}" for kind, count in zip(kinds, counts, strict=True))
        rows.append(row)
    return pd.DataFrame(rows).sort_values(["inside", "mean"], ascending=[False, True], ignore_index=True)


def columns_of(name: str, estimate: Estimate) -> dict[str, float]:
    """The number and its interval by the names of their columns."""
    return {name: estimate.value, f"{name}_lower": estimate.lower, f"{name}_upper": estimate.upper}


def pairs_of(scores: Mapping[str, Scores], confidence=0.95):
    """Differences of all pairs of laws, see `ranking.paired`."""
    misses = {law: one["miss"] for law, one in scores.items()}
    return paired(misses, {law: one["inside"] > 0.5 for law, one in scores.items()}, confidence)


def pairs(scores: Mapping[str, Scores], confidence=0.95):
    """The same as a data frame: first, second, the differences of mean miss (m) and share inside, and a verdict."""
    import pandas as pd

    rows = []
    for pair in pairs_of(scores, confidence):
        row = {"first": pair.first, "second": pair.second, "correlation": pair.correlation}
        for name in ("mean", "inside"):
            estimate: Estimate = getattr(pair, name)
            row |= columns_of(name, estimate)
        low, high = pair.mean.lower, pair.mean.upper
        row["misses_less"] = pair.first if high < 0.0 else pair.second if low > 0.0 else "tie"
        rows.append(row)
    return pd.DataFrame(rows)
