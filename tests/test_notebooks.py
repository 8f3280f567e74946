"""The notebooks of the documentation: they run, and what they say of their results is so."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from marsedl import results
from marsedl.replication.claims.counts import counted
from marsedl.replication.claims.rows import read_claims

NOTEBOOKS = Path(__file__).parents[1] / "docs" / "notebooks"


@pytest.fixture
def run(monkeypatch):
    """A function that runs the cells of a notebook one after the other and returns the names that they define."""
    import matplotlib.pyplot as plt

    def run_cells(name, build=None):
        if build is not None:
            monkeypatch.setenv("MARSEDL_BUILD", str(build))
        text, names = (NOTEBOOKS / f"{name}.md").read_text(encoding="utf-8"), {"__name__": "__main__"}
        for cell in re.findall(r"(?ms)^```\{code-cell\}\n(.*?)^```$", text):
            exec(compile(cell, name, "exec"), names)
        return names

    monkeypatch.setenv("MPLBACKEND", "agg")
    yield run_cells
    plt.close("all")


@pytest.mark.workflow
def test_verdicts_as_data_counts_what_the_build_counts(run, tree):
    names = run("verdicts_as_data", tree.build)
    rows = read_claims(tree.build / "report" / "claims.json")
    assert names["counted"]["verdict"].value_counts().to_dict() == {
        verdict: count for verdict, count in counted(rows).verdicts["counted"].items() if count
    }
    verdicts = {(row.paper, row.id): row for row in rows}
    assert len(names["moved"]) > 10
    for _, change in names["moved"].iterrows():
        readings = verdicts[change["paper"], change["claim"]].readings
        assert readings[change["reading"]].verdict == change["here"] != readings["corrected"].verdict
    assert names["margins"]["distance"].is_monotonic_increasing
    assert set(names["margins"]["distance_in"]) <= {"standard errors", "limits", "values"}
    assert (names["turned"]["to"] != names["turned"]["verdict"]).sum() > 0.9 * len(names["turned"]) > 0


@pytest.mark.workflow
def test_an_ensemble_is_known_better_flight_by_flight(run, tree):
    names = run("an_ensemble", tree.build)
    first, second, difference = (names[name] for name in ("first", "second", "difference"))
    assert difference.var() < 0.7 * (first.var() + second.var())
    flights = results.ensemble("stochastic_entry", "stochastic_velocity", build=tree.build)["final_state"]
    worst = second.idxmax()
    ends = names["ends"]["stochastic"]
    assert ends.loc[worst, "altitude (km)"] * 1e3 == pytest.approx(float(flights.sel(final="altitude")[worst]))
    shares = pd.DataFrame(names["shares"])
    assert (shares.loc["from (%)"] < shares.loc["good (%)"]).all()
    assert (shares.loc["good (%)"] < shares.loc["to (%)"]).all()


def test_linear_theory_predicts_the_flights_of_an_own_vehicle(run):
    names = run("an_own_vehicle")
    rows = pd.DataFrame(names["rows"]).T
    np.testing.assert_allclose(rows["predicted (km)"], rows["flown (km)"], rtol=0.1)
    assert rows.loc["Apollo", "flown (km)"] < 0.1 * rows.loc["none", "flown (km)"]
    distance = (rows["flown (km)"] - rows["predicted (km)"]) / rows["standard error (km)"]
    assert distance["Apollo"] > 3.0 and distance.drop("Apollo").abs().max() < 2.0  # as the page explains
    assert 30.0 < rows.loc["Apollo", "cut (%)"] < 40.0 and rows.loc["Apollo, half the errors", "cut (%)"] < 5.0
    for name in ("none", "Apollo"):  # along the whole flight, as the figure shows
        sampled = names["flown"][name]["range_history"].std("trial", ddof=1)
        predicted = np.sqrt(names["predicted"][name].covariance[:, 3, 3])
        np.testing.assert_allclose(predicted, sampled, rtol=0.1, atol=50.0)
