"""What is asked of Snakemake: what something makes is accepted, anything else is one message with the nearest name."""

from contextlib import nullcontext
from pathlib import Path

import pytest

from marsedl.comparison import comparisons
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.readings import load_studies
from marsedl.replication.pipeline.products import Products
from marsedl.replication.pipeline.targets import check_targets

ROOT = Path(__file__).parents[3]
RULES = ["all", "claims", "verify", *SLUGS]


@pytest.fixture(scope="module")
def products():
    """All products."""
    papers = {slug: catalogue(slug) for slug in SLUGS}
    studies = load_studies({slug: input_model(slug) for slug in SLUGS}, ROOT)
    return Products(ROOT, papers, studies, comparisons())


@pytest.mark.parametrize(
    "words",
    [
        ["all", "verify", "--cores", "all"],
        ["-n", "--until", "figure", "my_target"],  # behind an option, it is left to Snakemake
        ["figures/powered_descent/fig07.png", "./figures/powered_descent//printed/fig07.pdf"],
        ["figures/powered_descent/claims.csv", "figures/comparison/densities.md", "logs/anything.log"],
        ["data/cache/powered_descent/printed/nominal.h5", "data/cache/funnels/corrected/chunks/any.0of2.h5"],
        ["data/cache/powered_descent/corrected/montecarlo.closed_loop.h5", "figures/mine.txt/../../own/x.txt"],
    ],
)
def test_what_is_made_or_is_not_ours_may_be_asked_for(products, words):
    check_targets(["bin/snakemake", *words], RULES, products)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("powerd_descent", "there is no target 'powerd_descent'; did you mean 'powered_descent'?"),
        ("fig07.png", "there is no target 'fig07.png'; valid names: all, arena"),
        ("", "there is no target ''"),
        ("figures/powered_descent/fig7.png", "did you mean 'figures/powered_descent/fig07.png'?"),
        ("figures/powerd_descent/fig07.png", "did you mean 'figures/powered_descent/fig07.png'?"),
        ("figures/powered_descent/prnted/fig07.png", "did you mean 'figures/powered_descent/printed/fig07.png'?"),
        ("figures/funnels/fig07.png", "nothing makes 'figures/funnels/fig07.png'"),
        ("data/cache/powered_descent/corrected/nominl.h5", "corrected/nominal.h5'?"),
        ("data/cache/powered_descent/printed/montecarlo.closed_loop_large.h5", "did you mean"),  # it flies no trials
        ("figures/qqq/qqqqqqqqq.png", "'marsedl list' shows what there is"),
        ("data/cache/funnels/euler/nominal.h5", "the reading shares data/cache/funnels/corrected/nominal.h5"),
    ],
)
def test_what_nothing_makes_is_refused_with_the_nearest(products, word, message):
    with pytest.raises(InputError) as caught:
        check_targets(["bin/snakemake", word, "--cores", "2"], RULES, products)
    assert message in str(caught.value)


@pytest.mark.parametrize(("program", "checked"), [("x/snakemake/__main__.py", True), ("api.py", False)])
def test_words_of_other_programs_are_their_own(products, program, checked):
    with pytest.raises(InputError) if checked else nullcontext():
        check_targets([program, "gale"], RULES, products)
