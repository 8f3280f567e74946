"""What is said of claims, figures, tables and universes that are not as their job wrote them."""

import contextlib
from pathlib import Path

import numpy as np
import pytest

from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.errors import ArtifactError, StaleError
from marsedl.replication.inputs.readings import load_studies
from marsedl.replication.pipeline.products import Products
from marsedl.replication.pipeline.staleness import check, is_stale, reason
from marsedl.replication.records import fields, store
from marsedl.replication.records.recipes import write_record

ROOT = Path(__file__).parents[3]
SLUG = "powered_descent"
CLAIMS, MERGED, UNIVERSES = f"report/claims/{SLUG}.json", "report/claims.json", f"report/universes/{SLUG}.h5"
FIGURE, TABLE = f"figures/{SLUG}/fig07.png", f"figures/{SLUG}/claims.csv"


@fields.record
class Thing:
    """A test artifact."""

    value: np.ndarray = fields.quantity("m", (2,), "two numbers")


@pytest.fixture(scope="module")
def products():
    """All products."""
    papers = {slug: catalogue(slug) for slug in SLUGS}
    studies = load_studies({slug: input_model(slug) for slug in SLUGS}, ROOT)
    return Products(ROOT, papers, studies, comparisons())


def saved(folder, name, scale=1.0, paper=SLUG):
    """Save an artifact."""
    store.save(folder / name, Thing(scale * np.ones(2)), paper=paper, reading="x", provenance={})


def written(folder, products, *files):
    """Write products of a job, with the record that it leaves."""
    for name in files:
        if name.endswith(".h5"):
            saved(folder, name)
        else:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(f"what {name} holds", encoding="utf-8")
    record, digests = products.record(files[0])
    with contextlib.chdir(folder):
        write_record(record, digests, files)


@pytest.mark.parametrize("path", [CLAIMS, MERGED, FIGURE, TABLE, f"report/counterexamples/{SLUG}.json"])
def test_a_product_that_was_edited_is_no_result(products, tmp_path, path):
    written(tmp_path, products, path)
    assert reason(products, path, tmp_path) == ""
    content = (tmp_path / path).read_text(encoding="utf-8")
    (tmp_path / path).write_text(content.replace("holds", "hides"), encoding="utf-8")
    assert reason(products, path, tmp_path) == "was edited after its job wrote it"
    assert is_stale(products, path, tmp_path)


def test_verify_refuses_edited_claims_by_name(products, tmp_path, monkeypatch):
    """Of the merged file and of one that an older one was copied over: the true cause, and the command."""
    monkeypatch.setattr(Products, "behind", lambda self, targets: targets)
    for path in (MERGED, CLAIMS):
        written(tmp_path, products, path)
        check(products, [path], tmp_path, "snakemake all")
        (tmp_path / path).write_text("what an earlier build held", encoding="utf-8")
        said = rf"^{tmp_path / path} was edited after its job wrote it; the build is not .* run 'snakemake all'$"
        with pytest.raises(StaleError, match=said):
            check(products, [path], tmp_path, "snakemake all")


def test_what_verify_looks_at_includes_the_universes_of_all_papers(products):
    looked_at = set(products.behind([MERGED]))
    for slug in SLUGS:
        assert {f"report/universes/{slug}.h5", f"report/claims/{slug}.json"} <= looked_at


def test_another_papers_universes_are_refused_by_name(products, tmp_path):
    written(tmp_path, products, UNIVERSES)
    assert reason(products, UNIVERSES, tmp_path) == ""
    saved(tmp_path, UNIVERSES, paper="random_field")
    said = "was edited after its job wrote it: it is of the paper 'random_field'"
    assert reason(products, UNIVERSES, tmp_path) == said
    saved(tmp_path, UNIVERSES, scale=2.0)
    assert reason(products, UNIVERSES, tmp_path) == "was edited after its job wrote it"
    (tmp_path / UNIVERSES).write_bytes(b"not HDF5")
    with pytest.raises(ArtifactError, match=f"{UNIVERSES}: is truncated or damaged"):
        reason(products, UNIVERSES, tmp_path)


def test_all_products_of_a_job_are_looked_at_that_there_are(products, tmp_path):
    written(tmp_path, products, CLAIMS, TABLE)
    (tmp_path / TABLE).write_text("another", encoding="utf-8")
    assert reason(products, CLAIMS, tmp_path) == f"goes with {TABLE}, which was edited after its job wrote it"
    (tmp_path / TABLE).unlink()
    assert reason(products, CLAIMS, tmp_path) == "", "who copies a report need not copy the figures"
