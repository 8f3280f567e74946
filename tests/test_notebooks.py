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


def test_linear_theory_predicts_the_flights_of_an_own_vehicle(run, capsys):
    names = run("an_own_vehicle")
    rows, budgets, law = pd.DataFrame(names["rows"]).T, names["budgets"], names["law"]
    np.testing.assert_allclose(rows["predicted (km)"], rows["flown (km)"], rtol=0.1)
    assert rows.loc["steered", "flown (km)"] < 0.2 * rows.loc["none", "flown (km)"] and law.outcome == "converged"
    distance = (rows["flown (km)"] - rows["predicted (km)"]) / rows["standard error (km)"]
    assert distance.abs().max() < 2.0
    told = capsys.readouterr().out  # as the page says: what can be reached at least, and where errors come from
    assert re.search(r"goal, covariance at 130 s fails by 0\.7\d* of the deviation, against limits\[0\]", told)
    shares = {name: budget.shares.groupby("kind")["share"].sum() for name, budget in budgets.items()}
    assert shares["none"]["start"] > 0.7 and shares["steered"]["noise"] > 0.999
    for name in ("none", "steered"):  # along the whole flight
        sampled = names["flights"][name].final["range"].std(ddof=1)
        np.testing.assert_allclose(budgets[name].deviation, sampled, rtol=0.1, atol=50.0)
