"""The words of a paper: what they become, and what is refused by file, line and key."""

from pathlib import Path

import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.claims.printed import load_published
from marsedl.replication.errors import InputError
from marsedl.replication.pipeline.catalogue import TEXTS, Paper
from marsedl.replication.report.texts import comparison_texts, with_texts

ROOT = Path(__file__).parents[3] / "src" / "marsedl"
WHOLE = """\
figures:
  fig01:
    caption: Altitude.
    shows: >-
      The altitude
      over time.
    claims: [altitude_falls]
  fig02:
    caption: Beyond it.
    beyond: true
tables:
  tab01:
    caption: Ends.
errata:
  E1:
    printed: 'Eq. 1: up'
    evidence: It descends.
    used: down
"""


def read(tmp_path, text):
    path = tmp_path / TEXTS
    path.write_text(text, encoding="utf-8")
    return with_texts(Paper("toy", "", "", ""), path)


def test_a_catalogue_has_the_figures_tables_and_errata_that_have_words(tmp_path):
    paper = read(tmp_path, WHOLE)
    assert list(paper.figures) == ["fig01", "fig02"] and paper.figures["fig02"].beyond
    assert paper.figures["fig01"].claims == ("altitude_falls",) and paper.figures["fig02"].claims == ()
    assert paper.described == {"fig01": "The altitude over time."}
    assert paper.tables["tab01"].caption == "Ends." and not paper.tables["tab01"].beyond
    (erratum,) = paper.errata
    assert (erratum.id, erratum.printed, erratum.used) == ("E1", "Eq. 1: up", "down")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("    shows: >-", "    show: >-", r"texts\.yaml:4: figures\.fig01\.show: unknown key.*'shows'"),
        ("    caption: Ends.", "    beyond: true", r"tables\.tab01: the key 'caption' is missing"),
        ("    used: down", "    used: 3", r"texts\.yaml:18: errata\.E1\.used: Input should be a valid string"),
        ("errata:", "erata:", r"erata: unknown key.*'errata'"),
        ("caption: Altitude.", "caption: ''", r"texts\.yaml:3: figures\.fig01\.caption: .*at least 1"),
        (
            "caption: Altitude.",
            "caption: 'rho_{k+}'",
            r"texts\.yaml:3: figures\.fig01\.caption: \{k\+\} names no claim",
        ),
    ],
)
def test_a_slip_is_named_with_its_line(tmp_path, old, new, message):
    assert old in WHOLE
    with pytest.raises(InputError, match=message):
        read(tmp_path, WHOLE.replace(old, new))


def test_a_comparison_needs_both_captions(tmp_path):
    path = tmp_path / TEXTS
    path.write_text("costs:\n  figure: Costs.\n  table: Costs of all.\n")
    assert comparison_texts(path) == {"costs": ("Costs.", "Costs of all.")}
    path.write_text("costs:\n  figure: '{cost:.1f}'\n  table: Costs of all.\n")
    with pytest.raises(InputError, match=r"costs\.figure: no numbers are quoted here"):
        comparison_texts(path)
    path.write_text("costs:\n  figure: Costs.\n")
    with pytest.raises(InputError, match=r"costs: the key 'table' is missing"):
        comparison_texts(path)


@pytest.mark.parametrize("slug", SLUGS)
def test_figures_name_claims_that_there_are(slug):
    claims = {claim.id for claim in load_published(ROOT.parents[1] / "data" / "published" / f"{slug}.yaml")}
    named = {name for figure in catalogue(slug).figures.values() for name in figure.claims}
    assert named and named <= claims


@pytest.mark.parametrize("slug", SLUGS)
def test_the_words_of_every_paper_are_sentences_without_slips_of_wrapping(slug):
    paper = catalogue(slug)
    texts = [product.caption for product in (*paper.figures.values(), *paper.tables.values())]
    texts += paper.described.values()
    assert all(text.endswith(".") for text in texts)
    assert not [text for text in texts if "  " in text or "\n" in text]
