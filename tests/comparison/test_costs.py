"""Sizes are counted from the artifacts, and times come from the committed benchmarks."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.comparison import costs
from marsedl.comparison.records import NAMES
from marsedl.replication.claims import load_measured
from marsedl.replication.errors import InputError

BENCHMARKS = Path(__file__).parents[2] / "data" / "reference" / "benchmarks.csv"
COLUMN = np.zeros((2, 11, 8))
COLUMN[:, 1:, :3] = 1.0  # three of eight sensitivities change
GAIN = np.zeros((2, 4, 5, 3))
GAIN[1, 0, 0] = 1.0
ARTIFACTS = {
    "powered_descent": {
        "nominal": SimpleNamespace(largest_change=np.zeros(8)),
        "gains": SimpleNamespace(mean_costate=np.zeros((2, 4))),
    },
    "random_field": {
        "gains": SimpleNamespace(
            control=np.zeros((2, 4)), gain=GAIN, objective=np.zeros(1), solver_iterations=np.array([9])
        )
    },
    "desensitized": {
        "nominal": SimpleNamespace(state=np.zeros((11, 8)), bank_acceleration=np.zeros(10), costate=np.zeros((10, 8))),
        "tradeoff": SimpleNamespace(column=COLUMN, solves=30),
    },
    "funnels": {
        "funnel": SimpleNamespace(samples=np.zeros((406, 8)), bound=np.zeros(6), iterations=np.full(6, 10)),
        "proven": SimpleNamespace(basis_size=53, samples=606, bound=np.zeros(6)),
        "stage_study": SimpleNamespace(samples=np.array([182, 406]), basis_size=np.array([27, 43])),
    },
    "stochastic_entry": {
        "gains": SimpleNamespace(
            control_multiplier=np.zeros((2, 24)), final_multiplier=np.zeros((2, 2)), iterations=np.array([40, 6])
        )
    },
}


def costs_of(slug):
    return getattr(costs, slug)(**ARTIFACTS[slug], measured=load_measured(BENCHMARKS, slug))


@pytest.fixture(scope="module")
def records():
    return {slug: costs_of(slug) for slug in NAMES}


@pytest.mark.parametrize(
    ("slug", "number", "unknowns", "conditions", "problems", "iterations"),
    [
        ("powered_descent", 0, 2 * (4 + 10), 2 * (4 + 10), 2, 8),
        ("random_field", 0, 4 + 3, 8, 1, 9),
        ("desensitized", 0, 11 * (8 + 3) + 10 + 1, 10 * (8 + 3), 30, None),
        ("funnels", 0, 43 * 44 // 2 + 1, 406, 6, 60),
        ("funnels", 1, 53 * 54 // 2 + 1, 606, 6, None),
        ("stochastic_entry", 0, 26, 26, 2, 46),
    ],
)
def test_sizes(records, slug, number, unknowns, conditions, problems, iterations):
    cost = records[slug][number]
    assert (cost.unknowns, cost.conditions, cost.problems, cost.iterations) == (
        unknowns, conditions, problems, iterations
    )  # fmt: skip


def test_times_are_those_of_the_committed_benchmarks(records):
    measured = load_measured(BENCHMARKS, "stochastic_entry")
    (cost,) = records["stochastic_entry"]
    assert cost.design == measured[cost.design_is]
    for slug in NAMES:
        everything = load_measured(BENCHMARKS, slug)[f"snakemake {slug}, full size, from nothing"]
        assert {cost.everything for cost in records[slug]} == {everything}
        assert all(1e-6 < time < 1e-2 for cost in records[slug] for time in cost.flight if time)
    (cost,) = records["powered_descent"]
    assert cost.flight.in_arrays > cost.flight.compiled


@pytest.mark.parametrize("slug", NAMES)
def test_a_time_that_was_not_measured_is_refused_with_a_remedy(slug):
    with pytest.raises(InputError, match=r"benchmarks.csv has no row '.*'; restore it, or run 'make bench'"):
        getattr(costs, slug)(**ARTIFACTS[slug], measured={})


def test_the_figure_shows_every_method_and_times_of_a_paper_once(records):
    sizes, design, flight, everything = costs.figure(records).axes
    methods = sum(map(len, records.values()))
    assert len(sizes.get_yticks()) == methods
    assert len([text for text in design.texts if text.get_text()]) == methods
    assert len(flight.texts) == len(everything.texts) == len(NAMES)


def test_the_table_says_what_is_counted_and_timed(records):
    table = costs.table(records)
    assert len(table) == sum(map(len, records.values()))
    words = table.select_dtypes("str")
    assert words.shape[1] == 5 and not words.isna().any(axis=None)
    assert table["iterations"].isna()[table["paper"] == "desensitized"].tolist() == [True]
