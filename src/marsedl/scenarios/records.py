"""Flights of all laws in all conditions of a scenario, as a file."""

import numpy as np

from marsedl.replication.records.fields import quantity, record
from marsedl.scenarios.arena import Scores, flown, joined
from marsedl.scenarios.scenario import POOLS, Scenario

__all__ = ["ArenaFlights", "flown_chunk", "gathered", "of_scores", "scores_of"]


@record
class ArenaFlights:
    """What is told of consecutive trials of every law in every condition."""

    law: np.ndarray = quantity("1", ("law",), "names of the laws", str)
    condition: np.ndarray = quantity("1", ("condition",), "names of the conditions", str)
    column: np.ndarray = quantity("1", ("column",), "names of what is told", str)
    trial: np.ndarray = quantity("1", ("trial",), "numbers of the trials in the pool", int)
    value: np.ndarray = quantity(
        "SI", ("law", "condition", "column", "trial"), "what is told of each trial", allow_nan=True
    )
    ended: np.ndarray = quantity("1", ("law", "condition", "trial"), "place of its outcome among those", "int8")
    outcome: np.ndarray = quantity("1", ("outcome",), "outcomes", str)


def flown_chunk(scenario: Scenario, tuned, ranges, conditions=None) -> ArenaFlights:
    """Fly all laws of a scenario on the pool of proof; says how far it is.

    tuned: tries by law, the best first. ranges: first trial and number of trials of each part. conditions: all unless
    given.
    """
    scores = {}
    for law, tries in tuned.items():
        flies = scenario.law(law, **tries[0]["numbers"])
        scores[law] = {
            condition: joined([flown(scenario, flies, condition, POOLS["proof"], *trials) for trials in ranges])
            for condition in conditions or scenario.conditions
        }
        print(f"{scenario.name}: {law} is flown", flush=True)
    return of_scores(scores, np.concatenate([np.arange(first, first + count) for first, count in ranges]))


def of_scores(scores: dict[str, dict[str, Scores]], trials) -> ArenaFlights:
    """The record of scores by law and condition."""
    laws, conditions = [*scores], [*next(iter(scores.values()))]
    names = scores[laws[0]][conditions[0]].names
    outcomes = np.array(sorted({*(word for law in laws for one in scores[law].values() for word in one.outcome)}))
    ended = [[np.searchsorted(outcomes, scores[law][of].outcome) for of in conditions] for law in laws]
    return ArenaFlights(
        law=np.array(laws),
        condition=np.array(conditions),
        column=np.array(names),
        trial=np.array(trials),
        value=np.array([[scores[law][of].values for of in conditions] for law in laws]),
        ended=np.array(ended, "int8"),
        outcome=outcomes,
    )


def scores_of(flights: ArenaFlights) -> dict[str, dict[str, Scores]]:
    """Scores by law and condition."""
    names, outcomes = tuple(map(str, flights.column)), np.array([str(word) for word in flights.outcome])
    return {
        str(law): {
            str(condition): Scores(names, flights.value[row, column], outcomes[flights.ended[row, column]])
            for column, condition in enumerate(flights.condition)
        }
        for row, law in enumerate(flights.law)
    }


def gathered(chunks: list[ArenaFlights]) -> tuple[dict[str, dict[str, Scores]], np.ndarray]:
    """Scores of all chunks by law and condition, in the order of their trials, and these trials."""
    parts = [scores_of(chunk) for chunk in chunks]
    scores = {law: {of: joined([part[law][of] for part in parts]) for of in parts[0][law]} for law in parts[0]}
    return scores, np.concatenate([chunk.trial for chunk in chunks])
