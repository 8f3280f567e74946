"""How far a figure looks as the paper's own one: by what the paper says of it, and by the numbers that both draw."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from marsedl.replication.claims.claim import Claim
from marsedl.replication.claims.names import COUNTED_VERDICTS
from marsedl.replication.claims.numbers import flatten, is_number
from marsedl.replication.pipeline.catalogue import Paper, Product
from marsedl.replication.report.pictures import printed_places

SAME, OTHER_SCALE, OTHER, NOT_COMPARABLE = "same shape", "same shape, other scale", "other shape", "not comparable"
LIKENESSES = (SAME, OTHER_SCALE, OTHER, NOT_COMPARABLE)
SEEN = 0.05  # of its axis, beyond which a number that is off gives a figure another scale
_NAMED = 3  # claims in a sentence

Places = Sequence[tuple[float, float]]  # numbers that a figure marks as printed, with the spans of their axes


def likeness(product: Product, claims: Mapping[str, Claim], places: Places = ()) -> tuple[str, str]:
    """Return the likeness of a figure, one of `LIKENESSES`, and why, in a sentence or two.

    The shape is another one if a claim about the figure's shape differs or fails, the scale if a number that the figure
    marks as printed is off by more than `SEEN` of its axis. A figure of which nothing can be tested is not comparable;
    its text says why. claims: the paper's, by id; places: the numbers that the figure marks as printed,
    with the spans of their axes.
    """
    if product.not_comparable:
        return NOT_COMPARABLE, product.not_comparable
    counted = [claims[n] for n in product.claims if n in claims and claims[n].verdict in COUNTED_VERDICTS]
    decided = [row for row in counted if row.verdict != "undetermined"]
    if not decided:
        return NOT_COMPARABLE, f"What the paper says of it {'is undetermined' if counted else 'cannot fail'}."
    refuted = [row for row in decided if row.is_refuted]
    of_shape = [row for row in refuted if row.id in product.shape]
    told = [*of_shape, *(row for row in refuted if row not in of_shape)] or decided
    named = "; ".join(f"“{(row.plain or row.quantity).rstrip('.')}”" for row in told[:_NAMED])
    named += f"; {len(told) - _NAMED} more" if len(told) > _NAMED else ""
    count = f"{len(refuted)} of {len(decided)}" if refuted else f"All {len(decided)}"
    which = f"{count} claims about it" if len(decided) > 1 else "The claim about it"
    verb = ("disagree" if refuted else "agree") + ("s" if len(told) == 1 else "")
    said = f"{which} {verb} with what we find: {named}."
    if not refuted or of_shape:
        return OTHER if of_shape else SAME, said
    if any(off_by(row, places) > SEEN for row in refuted):
        return OTHER_SCALE, f"{said} A printed number that it draws is off by more than {SEEN:.0%} of its axis."
    return SAME, f"{said} No printed number that it draws is off by more than {SEEN:.0%} of its axis."


def off_by(row: Claim, places: Places) -> float:
    """Return how far the numbers of a claim are from what is printed where a figure marks that: a share of an axis.

    That is the largest of all numbers; 0 if none of them is marked, infinite if there is none to compare with. A figure
    may mark a number with the other sign. places: the marked numbers with the spans of their axes.
    """
    printed, ours = flatten(row.printed), flatten(row.result.value)
    pairs = [(number, ours.get(at)) for at, number in printed.items() if is_number(number)]
    shares = [
        abs(found - number) / span if is_number(found) else math.inf
        for number, found in pairs
        for value, span in places
        if math.isclose(abs(value), abs(number), rel_tol=1e-6)
    ]
    return max(shares, default=0.0)


def with_likeness(paper: Paper, claims: Mapping[str, Claim], folder: Path) -> Paper:
    """Return a catalogue in which the paper's figures say their likeness and why; folder: that of its figures."""
    figures = dict(paper.figures)
    for stem, one in figures.items():
        if not one.beyond:
            found, why = likeness(one, claims, printed_places(folder / f"{stem}.png"))
            figures[stem] = replace(one, likeness=found, why=why)
    return replace(paper, figures=figures)
