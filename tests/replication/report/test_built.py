"""The pages of a whole build."""

import re

import pytest

from marsedl.papers import SLUGS, catalogue

pytestmark = pytest.mark.workflow
LARGEST = 15e6  # bytes of all pages with their pictures, and the zip
LARGEST_PAPER = 3e6  # bytes of a page with its pictures


def test_the_pages_are_small_and_hold_every_figure_and_section(copied):
    folder = copied.path("report")
    for slug in SLUGS:
        page = (folder / f"{slug}.html").read_text(encoding="utf-8")
        pictures = {path.stem: path.stat().st_size for path in (folder / "pictures" / slug).glob("*.png")}
        assert pictures.keys() == catalogue(slug).figures.keys()
        assert len(page.encode()) + sum(pictures.values()) < LARGEST_PAPER
        for part in ("short", "claims", "figures", "errata", "readings", "tables", "inputs", "rebuild"):
            assert f'id="{part}"' in page, f"{slug}: {part}"
        for stem in catalogue(slug).figures:
            assert f"snakemake figures/{slug}/{stem}.png" in page
        assert page.count('<figure class="closeup"') == len(catalogue(slug).closeups)
    parts = [
        *folder.glob("*.html"),
        *(folder / "assets").glob("*"),
        *folder.glob("pictures/*/*"),
        folder / "report.zip",
    ]
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
