"""What moves if a choice, or an input, is another: `corrected` and one other universe, in memory."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import yaml

from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.errors import InputError, nearest, shown
from marsedl.replication.inputs.choices import Choices
from marsedl.replication.pipeline.catalogue import entry_of, function_of
from marsedl.replication.pipeline.runner import Run
from marsedl.replication.universes.designs import ONE_AT_A_TIME, Universe
from marsedl.replication.universes.table import Evaluator, Numbers, components_of, size_of_change


@dataclass(frozen=True)
class Moved:
    """A number of a claim in `corrected` and in another universe; `size` is as `size_of_change` gives it."""

    claim: str
    component: str
    before: float
    after: float
    error: float
    verdict_before: str
    verdict_after: str
    size: float
    sentence: str = ""

    @property
    def turned(self) -> bool:
        """Whether the verdict changes."""
        return self.verdict_before != self.verdict_after

    @property
    def sigmas(self) -> float:
        """How many standard errors the two numbers are apart; NaN without any."""
        return abs(self.after - self.before) / self.error if self.error > 0.0 else math.nan

    @property
    def counts(self) -> bool:
        """Whether the verdict changes, or the number by more than its error."""
        return self.turned or self.size > 1.0


def moves_of(claim: PublishedClaim, before: Numbers, after: Numbers, *verdicts: str) -> Iterator[Moved]:
    """Yield all numbers of a claim, by component before and after, with both verdicts on the claim."""
    nothing = (math.nan, 0.0, math.nan)
    for label, _, half in components_of(claim):
        old, new = before.get(label, nothing), after.get(label, nothing)
        error, size = math.hypot(old[1], new[1]), size_of_change(old, new, half)
        yield Moved(claim.id, label, old[0], new[0], error, *verdicts, size)


def changes_of(texts: Iterable[str], choices: Choices) -> tuple[dict[str, object], dict[str, object]]:
    """Return values of choices, and inputs by "section.key", from texts such as "noise_unit=newton".

    Raises InputError for a text without a value, or one that names neither a choice nor an input.
    """
    assignment, inputs = {}, {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not value:
            raise InputError(f"{shown(text)}: write NAME=VALUE, such as {next(iter(choices.by_name), 'a.b')}=...")
        if "." in name:
            inputs[name] = yaml.safe_load(value)
        else:
            assignment[name] = value
    return choices.checked(assignment), inputs


def what_if(evaluator: Evaluator, assignment: Mapping[str, object], inputs: Mapping[str, object]) -> list[Moved]:
    """Return the numbers that move, those whose verdict changes first, then the largest.

    inputs: further ones by "section.key", as they are written in a configuration. Raises InputError for an unknown
    choice, value or input, and for inputs that do not fit together.
    """
    (before, after), moved = map(evaluator.outcomes, _runs(evaluator, assignment, inputs)), []
    for name, old in before.items():
        moved += moves_of(evaluator.published[name], old.numbers, after[name].numbers, old.verdict, after[name].verdict)
    counting = [replace(one, sentence=after[one.claim].sentence) for one in moved if one.counts]
    return sorted(counting, key=lambda one: (not one.turned, -np.nan_to_num(one.size)))


def _runs(evaluator: Evaluator, assignment: Mapping[str, object], inputs: Mapping[str, object]) -> tuple[Run, Run]:
    """The runs of `corrected` and of what is asked for.

    That is computed though it may contradict what is printed: no choice is drawn again.
    """
    corrected, changed = Universe(0, ONE_AT_A_TIME, {}), Universe(1, ONE_AT_A_TIME, dict(assignment), inputs=inputs)
    return evaluator.run(corrected, constrained=False), evaluator.run(changed, constrained=False)


def drawn(evaluator: Evaluator, stem: str, assignment: Mapping[str, object], inputs: Mapping[str, object]) -> dict:
    """Return a figure of `corrected` and one of the other universe, by title; raises InputError for an unknown one."""
    paper = evaluator.paper
    if stem not in paper.figures:
        raise InputError(f"{paper.slug} has no figure {shown(stem)}; {nearest(stem, paper.figures)}")
    function = function_of(entry_of(paper.slug, "figures", stem))
    titles = "corrected", ", ".join(f"{name} = {value}" for name, value in {**assignment, **inputs}.items())
    runs = _runs(evaluator, assignment, inputs)
    return {t: run.given().call(function, published=evaluator.published) for t, run in zip(titles, runs, strict=True)}
