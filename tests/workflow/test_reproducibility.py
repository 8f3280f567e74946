"""The smoke pipeline twice from nothing, in two folders, with other cores, chunks and hash seeds."""

import pytest

from marsedl.papers import SLUGS, input_model

pytestmark = pytest.mark.workflow


def test_two_builds_agree_in_every_product(built):
    assert built.agree, built.said
    first, second = built.first.digests(), built.second.digests()
    assert first == second
    assert f"{len(first)} products in each of two builds, 0 differ" in built.said
    assert "cores 1, chunks 1, PYTHONHASHSEED 0" in built.said
    assert "cores 2, chunks 3, PYTHONHASHSEED 271828" in built.said
    kinds = {name.rsplit(".", 1)[1] for name in first}
    assert {"h5", "png", "pdf", "csv", "md", "json", "html"} <= kinds
    for slug in SLUGS:
        flown = {f"data/cache/{slug}/corrected/montecarlo.{case}.h5" for case in input_model(slug).CASES}
        assert first.keys() >= flown


def test_the_builds_scattered_their_trials_differently(built):
    name = "logs/powered_descent/corrected/montecarlo.closed_loop_large.2of3.log"
    assert built.second.path(name).exists()
    assert not built.first.path(name).exists()
    assert not list(built.second.folder.glob("data/cache/*/*/chunks/*.h5")), "chunks are temporary"


def test_a_changed_product_would_be_noticed(built, tree):
    """The comparison itself must be able to fail."""
    table = tree.path("figures/powered_descent/eq54.csv")
    table.write_text(table.read_text(encoding="utf-8").replace("0", "1", 1), encoding="utf-8")
    first, second = built.first.digests(), tree.digests()
    assert {name for name in first if first[name] != second[name]} == {"figures/powered_descent/eq54.csv"}
