"""The smoke pipeline twice from nothing, in two folders, with all that must not matter different."""

import json
import os
import shutil

import pytest
from jsonschema import Draft202012Validator

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.checks.twice import PRODUCTS
from marsedl.replication.records.differences import digest_tree
from marsedl.replication.sizes import build_folder
from marsedl.schemas import claims_schema

pytestmark = pytest.mark.workflow


def test_two_builds_agree_in_every_product(built):
    assert built.agree, built.output
    kinds = {name.rsplit(".", 1)[1] for name in built.digests}
    assert {"h5", "png", "pdf", "csv", "md", "json", "html"} <= kinds
    for slug in SLUGS:
        ensembles = {f"data/cache/{slug}/corrected/montecarlo.{case}.h5" for case in input_model(slug).CASES}
        assert built.digests.keys() >= ensembles


def test_the_build_that_tests_share_is_as_it_was_built(built):
    """No test, nor an earlier run of them, has changed it."""
    assert digest_tree(build_folder(built.folder, "smoke"), PRODUCTS) == built.digests


def test_a_tree_is_restored_whatever_was_done_to_it(small, small_build):
    """Written in place, with its old time and size, moved, deleted, new: the next test must not see it."""

    def content():
        return {path.relative_to(small.folder): path.read_bytes() for path in small.folder.rglob("*") if path.is_file()}

    before, state = content(), small.state()
    figures = small.path("figures/hypersonic_glide")
    rewritten, forged, moved, lost = (figures / name for name in ("fig01.png", "fig01.pdf", "claims.csv", "claims.md"))
    rewritten.write_bytes(rewritten.read_bytes()[:100])
    times = forged.stat()
    forged.write_bytes(forged.read_bytes()[::-1])
    os.utime(forged, ns=(times.st_atime_ns, times.st_mtime_ns))
    moved.rename(figures / "moved.csv")
    lost.unlink()
    (figures / "new" / "folder").mkdir(parents=True)
    (figures / "new" / "folder" / "file").touch()
    shutil.rmtree(small.path("data/cache/hypersonic_glide/printed"))
    assert content().keys() != before.keys()
    small_build.restore()
    assert content() == before
    assert small.state() == state
    assert not (figures / "new").exists()


def test_every_product_of_the_catalogue_is_there_and_not_empty(copied):
    for slug in SLUGS:
        paper, folder = catalogue(slug), copied.path("figures") / slug
        names = [f"{stem}.{kind}" for stem in paper.figures for kind in ("png", "pdf")]
        tables = [*paper.tables, "claims"]
        names += ["headline.png", *(f"{stem}.{kind}" for stem in tables for kind in ("csv", "md"))]
        assert {path.name for path in folder.glob("*.*")} == set(names)
        assert all((folder / name).stat().st_size > 100 for name in names)


def test_the_claims_are_as_their_schema_says_and_stand_in_the_report(copied):
    rows = json.loads(copied.path("report/claims.json").read_text(encoding="utf-8"))
    assert not [error.message for error in Draft202012Validator(claims_schema()).iter_errors(rows)]
    assert {row["size"] for row in rows} == {"smoke"}
    for slug in SLUGS:
        page = "".join(copied.path(f"report/{slug}{end}.html").read_text("utf-8") for end in ("", "_evidence"))
        assert [row["id"] for row in rows if row["paper"] == slug and row["id"] not in page] == []
