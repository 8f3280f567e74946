"""The comparisons in the workflow: built with all, made again for their reasons only, and `snakemake --report`."""

import html
import json
import re

import pandas as pd
import pytest

from marsedl.comparison import comparisons
from marsedl.comparison.records import NAMES
from marsedl.papers import catalogue

pytestmark = pytest.mark.workflow

COMPARISONS = comparisons()
PRODUCTS = {stem: {f"figures/comparison/{stem}.{ext}" for ext in ("png", "pdf", "csv", "md")} for stem in COMPARISONS}


def test_a_build_holds_all_comparisons(copied):
    for stem, files in PRODUCTS.items():
        assert all(copied.path(name).stat().st_size > 200 for name in files)
        assert copied.path(f"figures/comparison/{stem}.png").stat().st_size > 10_000
        papers = set(pd.read_csv(copied.path(f"figures/comparison/{stem}.csv")).iloc[:, 0])
        assert len(papers) == len(NAMES), "every paper is in every table"


def test_an_edited_comparison_is_made_again_alone(copied):
    copied.edit("src/marsedl/comparison/densities.py", 'xlabel="from its mean (%)"', 'xlabel="of its mean (%)"')
    copied.edit("src/marsedl/comparison/texts.yaml", "Density models of the papers. ", "Densities of the papers. ")
    copied.edit("src/marsedl/comparison/texts.yaml", "Altitude against velocity: ", "Altitude over velocity: ")
    plan = copied.plan("all")
    assert plan.outputs["compared"] == PRODUCTS["densities"], "a caption alone draws nothing again"
    assert plan.artifacts == set()
    assert plan.rules.isdisjoint({"figure", "table"})


def test_the_report_of_snakemake_holds_captions_categories_and_labels(tree):
    tree.works("all", "--report", "of_snakemake.html")
    page = (tree.build / "of_snakemake.html").read_text(encoding="utf-8")
    results, categories = embedded_data(page, "results"), embedded_data(page, "categories")
    for slug in NAMES:
        for stem, product in catalogue(slug).figures.items():
            name = f"figures/{slug}/{stem}.png"
            assert name in categories[slug]["corrected"]
            assert results[name]["labels"] == {"reading": "corrected", "item": stem, "kind": "figure"}
            assert re.fullmatch(filled(product.caption), plain(results[name]["caption"])), name
    for stem, comparison in COMPARISONS.items():
        for ext, caption in (("png", comparison.figure), ("csv", comparison.table)):
            name = f"figures/comparison/{stem}.{ext}"
            assert name in categories["comparison of the papers"]["corrected"]
            assert plain(results[name]["caption"]) == caption


def embedded_data(page, name):
    """What a page of Snakemake's report is given under a name."""
    return json.loads(re.search(rf"var {name} = (\{{.*?\}});\s*</script>", page, re.DOTALL).group(1))


def filled(caption):
    """The pattern of a caption in which numbers stand for what it quotes."""
    parts = re.split(r"(\{\{|\}\}|\{[^{}]*\})", " ".join(caption.split()))
    return "".join(
        re.escape(part[:1] if part in ("{{", "}}") else part) if k % 2 == 0 or part in ("{{", "}}") else ".+"
        for k, part in enumerate(parts)
    )


def plain(text):
    """The text of a piece of HTML."""
    return " ".join(html.unescape(re.sub(r"<[^>]+>", "", text)).split())
