"""How far a figure looks as the paper's own one: by the verdicts on what the paper says of it."""

from collections.abc import Mapping
from dataclasses import replace

from marsedl.replication.claims.claim import COUNTED_VERDICTS, Claim
from marsedl.replication.pipeline.catalogue import Paper, Product

SAME, OTHER_SCALE, OTHER, NOT_COMPARABLE = "same shape", "same shape, other scale", "other shape", "not comparable"
LIKENESSES = (SAME, OTHER_SCALE, OTHER, NOT_COMPARABLE)


def likeness(product: Product, claims: Mapping[str, Claim]) -> tuple[str, str]:
    """Return the likeness of a figure, one of `LIKENESSES`, and why, in a sentence.

    The shape is another one if a claim about the figure's shape differs or fails, the scale if any other claim about it
    does. A figure of which nothing can be tested is not comparable; its text says why. claims: the paper's, by id.
    """
    if product.not_comparable:
        return NOT_COMPARABLE, product.not_comparable
    counted = [claims[n] for n in product.claims if n in claims and claims[n].verdict in COUNTED_VERDICTS]
    refuted = sorted((row for row in counted if row.is_refuted), key=lambda row: row.id not in product.shape)
    decided = [row for row in counted if row.verdict != "undetermined"]
    if not decided:
        return NOT_COMPARABLE, f"What the paper says of it {'is undetermined' if counted else 'cannot fail'}."
    said = f"{len(refuted)} of {len(decided)} claims on it {'does' if len(refuted) == 1 else 'do'} not stand"
    if refuted:
        first = refuted[0]
        return OTHER if first.id in product.shape else OTHER_SCALE, f"{said}: {first.plain or first.quantity}"
    if len(decided) == 1:
        return SAME, f"It stands: {decided[0].plain or decided[0].quantity}"
    return SAME, f"All {len(decided)} claims on it stand."


def with_likeness(paper: Paper, claims: Mapping[str, Claim]) -> Paper:
    """Return a catalogue in which the paper's figures say their likeness and why."""
    figures = {
        stem: one if one.beyond else replace(one, **dict(zip(("likeness", "why"), likeness(one, claims), strict=True)))
        for stem, one in paper.figures.items()
    }
    return replace(paper, figures=figures)
