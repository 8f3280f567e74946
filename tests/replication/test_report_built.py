"""The page of a whole build."""

import pytest

from marsedl.papers import SLUGS, catalogue

pytestmark = pytest.mark.workflow
LARGEST = 15e6  # bytes that a page of all figures may have


def test_the_page_of_all_papers_is_small_and_holds_every_section(tree):
    page = tree.path("report/index.html").read_text(encoding="utf-8")
    assert len(page.encode()) < LARGEST
    for slug in SLUGS:
        for part in ("claims", "readings", "figures", "tables", "errata", "inputs", "runs"):
            assert f'id="{slug}-{part}"' in page
        for stem in catalogue(slug).figures:
            assert f"snakemake figures/{slug}/{stem}.png" in page
        assert page.count(f'<figure class="closeup" id="{slug}-closer-') == len(catalogue(slug).closeups)
