"""The pages of a whole build."""

import re

import pytest

from marsedl.papers import SLUGS, catalogue
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.inputs.choices import in_words

pytestmark = pytest.mark.workflow
LARGEST = 15e6  # bytes of all pages with their pictures, and the zip
LARGEST_PAPER = 3e6  # bytes of a page with its pictures
MOST_WORDS = 17_000  # of a paper's two pages; each of 80 claims says in how many universes it is true


def test_the_pages_are_small_and_hold_every_figure_and_section(copied):
    folder = copied.path("report")
    for slug in SLUGS:
        page, evidence = ((folder / f"{slug}{end}.html").read_text(encoding="utf-8") for end in ("", "_evidence"))
        words = len(re.sub(r"(?s)<(script|svg).*?</\1>|<[^>]*>", " ", page + evidence).split())
        assert words <= MOST_WORDS, slug
        pictures = {path.stem: path.stat().st_size for path in (folder / "pictures" / slug).glob("*.png")}
        assert pictures.keys() == {*catalogue(slug).figures, "headline"}
        assert len(page.encode()) + sum(pictures.values()) < LARGEST_PAPER
        for part in ("short", "figures", "tables"):
            assert f'id="{part}"' in page, f"{slug}: {part}"
        for part in ("claims", "errata", "readings", "inputs", "rebuild"):
            assert f'id="{part}"' in evidence, f"{slug}: {part}"
        for stem in catalogue(slug).figures:
            assert f"figures/{slug}/{stem}.png" in page + evidence or f"pictures/{slug}/{stem}.png" in page
        assert evidence.count('id="explorer"') == 1
    parts = [path for pattern in ("*.html", "assets/*", "pictures/*/*", "report.zip") for path in folder.glob(pattern)]
    assert sum(path.stat().st_size for path in parts) < LARGEST


def test_every_link_and_picture_of_a_page_is_there(copied):
    folder = copied.path("report")
    pages = {path.name: path.read_text(encoding="utf-8") for path in folder.glob("*.html")}
    ids = {name: set(re.findall(r' id="([^"]+)"', page)) for name, page in pages.items()}
    for name, page in pages.items():
        for link in re.findall(r' (?:href|src)="([^"]*)"', page):
            target, _, anchor = link.partition("#")
            if target.startswith("data:"):
                continue
            assert not target or (folder / target).is_file(), f"{name}: {link}"
            if anchor and "=" not in anchor and not anchor.startswith("sign-"):
                assert anchor in ids[target or name], f"{name}: {link}"


def test_every_page_says_the_cause_that_the_claims_have(copied):
    rows, said = read_claims(copied.path("report/claims.json")), 0
    for slug in SLUGS:
        page = copied.path(f"report/{slug}_evidence.html").read_text("utf-8")
        for row in (row for row in rows if row.paper == slug and row.is_refuted and row.universes):
            why = page.partition(f'id="{row.id}"')[2].partition('<span class="why">')[2].partition("</span>")[0]
            if row.universes.cause is None:
                assert why.startswith("No choice that we varied by itself explains it"), row.id
            else:
                assert why.lower().startswith(in_words(row.universes.cause.choice).lower()), row.id
            said += 1
    assert said
