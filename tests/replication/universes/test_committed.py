"""The committed runs of universes: what fewer universes say of them, and indices by plain loops."""

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from marsedl.papers import input_model
from marsedl.replication.universes.designs import DESIGNS, ONE_AT_A_TIME, SPACE_FILLING
from marsedl.replication.universes.judging import COMMITTED, Judge, committed_judge
from marsedl.replication.universes.table import selected

ROOT = Path(__file__).parents[3]
COMMITTED_RUNS = sorted(path.stem for path in (ROOT / COMMITTED).glob("*.h5"))


def judges(slug: str, *sizes: int) -> list[Judge]:
    """What judges by the first universes of the space-filling design, as many as asked for."""
    judge = committed_judge(slug, input_model(slug), ROOT)
    table = judge.table
    single = table.design == DESIGNS.index(ONE_AT_A_TIME)
    filling = np.flatnonzero((table.design == DESIGNS.index(SPACE_FILLING)) & (table.seed == 0))
    filling = filling[np.argsort(table.number[filling])]
    return [judge.over(selected(table, single | np.isin(np.arange(len(single)), filling[:size]))) for size in sizes]


@pytest.mark.parametrize("slug", COMMITTED_RUNS)
def test_a_quarter_of_the_universes_gives_the_same_shares(slug):
    """Of intervals at 95 %, nine of ten hold what four times as many universes give."""
    few, many = judges(slug, 32, 128)
    shares = [(few.judged(name).over_all, many.judged(name).over_all) for name in few.of]
    inside = [part.low <= whole.value <= part.high for part, whole in shares if part.of and whole.of]
    assert len(inside) > 20
    assert np.mean(inside) > 0.9


def test_indices_are_those_of_plain_loops():
    (judge,) = judges("powered_descent", 512)
    compared = 0
    for claim in (one for one in judge.published.values() if one.headline):
        numbers = judge.of[claim.id].numbers[0][:, judge.of[claim.id].deciding]
        found = {one.choice: one.ratio for one in judge.judged(claim.id).indices}
        if not found:
            continue
        use = (judge.table.design == DESIGNS.index(SPACE_FILLING)) & np.isfinite(numbers)
        values = numbers[use].tolist()
        ranks = [sum(other < value for other in set(values)) for value in values]
        mean = sum(ranks) / len(ranks)
        total = sum((rank - mean) ** 2 for rank in ranks)
        for at, choice in enumerate(judge.choices):
            if choice.range or choice.name not in found:
                continue
            of_value = defaultdict(list)
            for rank, value in zip(ranks, judge.table.assignment[use, at].tolist(), strict=True):
                of_value["unasked" if np.isnan(value) else value].append(rank)
            between = sum(len(group) * (sum(group) / len(group) - mean) ** 2 for group in of_value.values())
            assert found[choice.name] == pytest.approx(between / total, abs=1e-9)
            compared += 1
    assert compared > 10
