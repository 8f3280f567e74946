"""Tables of the funnels paper: their cells are the numbers of artifacts, whatever these hold.

The artifacts are made up, of the declared shapes, so that no table can hide behind the values of one reading.
"""

import numpy as np
import pytest

from invented import invented
from marsedl.papers import catalogue
from marsedl.papers.funnels.records import (
    CoarseFunnels,
    FlightEnsemble,
    Funnel,
    LinearBounds,
    Proven,
    StageStudy,
)
from marsedl.replication.records.tables import csv_text, write_table

PAPER = catalogue("funnels")

DEGREE, RADIUS = np.pi / 180.0, 3389.5e3
SLICES, STAGES = 13, 12
STEPS = 5 * np.arange(SLICES)
# Extents of the dimensions that must fit together; any other has three.
EXTENTS = {"slices": SLICES, "stages": STAGES, "time": 61, "nodes": 61, "trials": 40, "observed": 3, "final": 8}
EXTENTS |= {"studied": 2, "variety": 2, "coarse": 2, "repeats": 10}


def funnel(**values):
    given = {"step": STEPS, "tightness_stage": np.array([1, 12]), "outcome": "complete"}
    return invented(Funnel, EXTENTS, 1, **given | values)


def linear_bounds(**values):
    return invented(LinearBounds, EXTENTS, 3, **values)


def ensemble(seed=4, **values):
    return invented(FlightEnsemble, EXTENTS, seed, **values)


def stage_study(**values):
    given = {"basis_rank": np.array([27, 0]), "product_rank": np.array([182, 0])}
    return invented(StageStudy, EXTENTS, 5, **given | values)


def proven(**values):
    return invented(Proven, EXTENTS, 7, **{"step": STEPS} | values)


MAKERS = {
    "funnel": funnel,
    "linear_bounds": linear_bounds,
    "stage_study": stage_study,
    "coarse_funnels": lambda: invented(CoarseFunnels, EXTENTS, 15, coarse_step=np.array([0, 8])),
    "proven": proven,
    "constant": ensemble,
    "redrawn": lambda: ensemble(11),
    "adversarial": lambda: ensemble(12),
}


@pytest.fixture(scope="module")
def table(funnels):
    """A table, some artifacts replaced."""

    def rows(name, reading="corrected", **artifacts):
        needed = {need.split(".")[-1]: MAKERS[need.split(".")[-1]]() for need in funnels.paper.tables[name].needs}
        return funnels.product("tables", name, reading, needed | artifacts, published={})

    return rows


@pytest.mark.parametrize("name", PAPER.tables)
def test_tables_are_data_and_can_be_written(table, name, tmp_path):
    data = table(name)
    assert len(data) > 1 and csv_text(data)
    write_table(data, tmp_path / "table.csv", tmp_path / "table.md")


def row_of(data, **cells):
    """The row whose cells are these, by the heads of the columns."""
    [number] = np.flatnonzero(np.logical_and.reduce([data[head] == cell for head, cell in cells.items()]))
    return data.iloc[number]


def test_levels_stand_at_their_slices(table):
    slices, flights = funnel(), ensemble()
    data = table("levels", funnel=slices, constant=flights)
    assert list(data["k"]) == [k + 1 for k in range(SLICES)]
    k = 7
    largest_v = flights.maximum_over_trials[5 * k, 0]
    assert data["rho"][k] == slices.level[k]
    assert data["constant disturbance"][k] == largest_v
    assert data["rho over flights"][k] == pytest.approx(slices.level[k] / largest_v)
    deviation = np.std(flights.repeat_maximum[:, 5 * k, 0], ddof=1)
    assert data["its standard deviation"][k] == pytest.approx(deviation)


def test_half_widths_are_lengths_on_the_ground(table):
    widths = np.zeros((SLICES, 6))
    widths[-1] = [1500.0, 2000.0 / RADIUS, 3000.0 / RADIUS, 4.0, 5.0 * DEGREE, 6.0 * DEGREE]
    slices = funnel(half_width=widths, feedback=np.full(SLICES, 7.0 * DEGREE), level=np.arange(1.0, SLICES + 1))
    row = row_of(table("half_widths", funnel=slices), slice="last", of="funnel")
    np.testing.assert_allclose(row.iloc[3:].astype(float), [1.5, 2, 3, 4, 5, 6, 7])
    final = np.zeros((40, 8))
    final[3, 0], final[5, 0] = -2500.0, np.nan
    row = table("half_widths", funnel=slices, constant=ensemble(final_state=final)).iloc[-1]
    assert (row["of"], row["altitude (km)"]) == ("40 flights", 2.5)
    assert np.isnan(row["bank angle of the feedback (deg)"])


def test_a_stage_that_is_not_reached_has_no_value(table):
    nothing = np.full(STAGES, np.nan)
    empty = dict.fromkeys(("bound", "growth", "gap", "residual", "true_maximum", "violation"), nothing)
    status = np.array(["optimal"] * 11 + ["not solved"])
    slices = funnel(status=status, stage_sound=np.zeros(STAGES, bool), tightness=np.array([1e-6, np.nan]), **empty)
    data = table("verification", funnel=slices)
    assert data["bound over rho"].isna().all() and not data["sound"].any()
    assert data["solver"].iloc[-1] == "not solved"
    tight = data["polynomial below its bound"]
    assert tight[0] == 1e-6 and tight[1:].isna().all()
