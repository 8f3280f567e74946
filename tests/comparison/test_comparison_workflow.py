"""The comparisons in the workflow: built with all, made again for their reasons only, and `snakemake --report`."""

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


def test_the_report_of_snakemake_holds_all_figures_and_tables_by_paper(tree):
    tree.works("all", "--report", "of_snakemake.html")
    page = (tree.build / "of_snakemake.html").read_text(encoding="utf-8")
    categories = json.loads(re.search(r"var categories = (\{.*?\});\s*</script>", page, re.DOTALL).group(1))
    for slug in NAMES:
        shown = {name for names in categories[slug].values() for name in names}
        assert shown >= {f"figures/{slug}/{stem}.png" for stem in catalogue(slug).figures}
        assert shown >= {f"figures/{slug}/{stem}.csv" for stem in [*catalogue(slug).tables, "claims"]}
    shown = {name for names in categories["comparison"].values() for name in names}
    assert shown == {f"figures/comparison/{stem}.{ext}" for stem in COMPARISONS for ext in ("png", "csv")}
