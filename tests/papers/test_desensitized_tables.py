"""Tables of the desensitized-landing paper: their cells are the numbers of artifacts, whatever these hold.

The artifacts are made up, of the declared shapes, so that no table can hide behind the values of one reading.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from invented import invented
from marsedl.papers import catalogue
from marsedl.papers.desensitized import tables
from marsedl.papers.desensitized.records import (
    LAWS,
    SOLUTIONS,
    FlightEnsemble,
    Gains,
    MinimumFuel,
    Responses,
    Tradeoff,
)
from marsedl.replication.records.fields import quantities
from marsedl.replication.records.tables import csv_text, printed_cells

DEGREE = np.pi / 180.0
DASH = "–"
READINGS = ("printed", "corrected", "one_reversal", "single_weight", "mixed_units", "feedback_tuned")
PRINTED_WEIGHTS = np.array([0.0, 0.001, 0.01, 0.1, 1.0, np.nan, np.nan])
# Extents of the dimensions that must fit together; any other has three.
EXTENTS = {
    "rows": 7,
    "law": 6,
    "trials": 40,
    "time": 5,
    "node": 5,
    "intervals": 4,
    "solutions": 3,
    "points": 6,
}


def tradeoff(seed=1, **values):
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (7, 3))
    given = {
        "printed_weight": PRINTED_WEIGHTS,
        "weight": np.array([0.0, 0.03, 0.6, 5.0, 45.0, 1e6, 1e7]),
        "error": signs * np.random.default_rng(seed).uniform(10.0, 8000.0, (7, 3)),
        "branch": np.array(["2 reversals", "1 reversal"]),
        "row_branch": np.array([0, 0, 1, 1, 1, 1, 1]),
    }
    return invented(Tradeoff, EXTENTS, seed, **given | values)


def gains(**values):
    return invented(
        Gains, EXTENTS, 2, **{"law": np.array(LAWS), "ended": np.array([f"way {k}" for k in range(6)])} | values
    )


def responses(**values):
    given = {
        "law": np.array(LAWS),
        "drawn_error": np.array([200.0, 1000.0, 200.0]),
        "compared_error": np.array([1070.0, -930.0]),
    }
    return invented(Responses, EXTENTS, 3, **given | values)


def ensemble(**values):
    noise = np.random.default_rng(4).standard_normal((6, 40, 3))
    given = {"law": np.array(LAWS), "outcome": np.zeros((6, 40), np.int8), "final_error": 300.0 * noise}
    return invented(FlightEnsemble, EXTENTS, 4, **given | values)


def minimum_fuel(**values):
    return invented(MinimumFuel, EXTENTS | {"bound": 2, "solution": 3}, 9, **{"solution": np.array(SOLUTIONS)} | values)


ARTIFACTS = {
    "tradeoff": tradeoff,
    "gains": gains,
    "responses": responses,
    "entry_errors": ensemble,
    "minimum_fuel": minimum_fuel,
}


PAPER = catalogue("desensitized")


def taken(stem):
    """Names of the artifacts that a table is made from."""
    return [need.split(".")[-1] for need in PAPER.tables[stem].needs]


@pytest.fixture
def table(desensitized, desensitized_published):
    """Function that makes a table of a reading from artifacts that are made up unless given, and checks its form."""

    def make(stem, reading="corrected", changes=None, **artifacts):
        inputs = desensitized.inputs(reading, **changes or {})
        items = {name: artifacts.get(name) or ARTIFACTS[name]() for name in taken(stem)}
        published = {"published": desensitized_published} if PAPER.tables[stem].published else {}
        return well_formed(inputs.call(getattr(tables, stem), **items, **published))

    return make


def well_formed(rows):
    assert csv_text(rows) and len(rows)
    return rows


def column(rows, name):
    """The only column whose head begins with a name, as an array."""
    heads = [head for head in rows if head.startswith(name)]
    assert len(heads) == 1, (name, heads)
    return rows[heads[0]].to_numpy()


def printed_text(rows):
    """What readers see, by column."""
    heads, *cells = printed_cells(rows)
    return dict(zip(heads, map(list, zip(*cells, strict=True)), strict=True))


def near(values):
    return pytest.approx(values, rel=1e-12, nan_ok=True)


# ---- all tables ------------------------------------------------------------------------------------------------------


def unknown(artifact):
    """The artifact with NaN wherever that is allowed, but in what is not shown as it stands."""
    shown = ("printed_weight", "final_state", "observed_maximum")
    fields = {
        field: np.full_like(getattr(artifact, field), np.nan)[()]
        for field, declared in quantities(type(artifact)).items()
        if declared.allow_nan and field not in shown
    }
    return replace(artifact, **fields)


def test_every_table_can_be_made_and_shows_a_dash_for_what_is_not_known(table):
    for stem in PAPER.tables:
        for reading in READINGS:
            assert table(stem, reading) is not None
        artifacts = {name: unknown(ARTIFACTS[name]()) for name in taken(stem)}
        with np.errstate(all="raise"):
            cells = [cell for row in printed_cells(table(stem, **artifacts))[1:] for cell in row]
        assert not [cell for cell in cells if re.search(r"\bnan\b|\binf\b|-0\.0*$", cell)], stem


# ---- Tables 1 to 3 ---------------------------------------------------------------------------------------------------


FOUR = {"J0": "deg^2/s^3", "cumulative bank rate": "deg/s", "fuel": "kg", "final position error": "m"}


def test_table_3_has_the_printed_rows_beside_those_computed(table):
    path = tradeoff()
    rows = table("tab03", tradeoff=path)
    assert list(rows["c1"]) == [0.0, 0.001, 0.01, 0.1, 1.0, np.inf, np.inf]
    printed, here = (
        np.array([rows[f"{name} {side} ({unit})"] for name, unit in FOUR.items()]) for side in ("in the paper", "here")
    )
    assert tuple(printed[:, 3]) == (1.5603, 12.8236, 0.506, 6472.0)
    assert tuple(printed[:, 5]) == tuple(printed[:, 6]) == (586.8673, 166.928, 6.583, 5939.0)
    expected = path.effort, path.cumulative / DEGREE, path.propellant, np.linalg.norm(path.error, axis=1)
    np.testing.assert_allclose(here, expected, rtol=1e-12)
    ratios = [rows[f"{name} over the paper's"] for name in FOUR]
    np.testing.assert_allclose(ratios, here / printed, rtol=1e-12)
    cells = printed_text(rows)
    assert cells["J0 in the paper (deg^2/s^3)"][5] == "586.8673" and cells["c1"][5] == "∞"


@pytest.mark.parametrize(
    ("weights", "changes", "c1"),
    [
        ([0.001, 0.02, 0.1, 1.0], {}, np.nan),
        ([0.001, 0.01, 0.1, 1.0], {"matched_efforts": np.array([0.14, 0.4, 1.5603, 5.1812])}, np.nan),
        (
            [0.001, 0.02, 0.1, 1.0],
            {"weight_rule": "proportional", "printed_weights": np.array([0.001, 0.02, 0.1, 1.0])},
            0.02,
        ),
    ],
)
def test_rows_of_a_user_stand_beside_nothing_printed(table, weights, changes, c1):
    efforts = np.array([0.14, 0.14, 0.4, 1.5603, 5.1812, 600.0, 700.0])
    path = tradeoff(printed_weight=np.array([0.0, *weights, np.nan, np.nan]), effort=efforts)
    rows = table("tab03", changes=changes, tradeoff=path)
    assert rows["c1"][2] == near(c1)
    assert column(rows, "J0 here")[2] == 0.4
    is_printed = np.arange(7) != 2
    for name in FOUR:
        np.testing.assert_array_equal(np.isfinite(column(rows, f"{name} in the paper")), is_printed)
        np.testing.assert_array_equal(np.isfinite(column(rows, f"{name} over the paper's")), is_printed)


# ---- sensitivities, gains, dispersions -------------------------------------------------------------------------------


def test_dispersions_are_those_of_the_trials_that_came_down(table):
    flights = ensemble()
    flights.outcome[3, 7:9] = 1, 3
    flights.final_error[3, 7:9] = np.nan
    flights.outcome[4], flights.final_error[4] = 1, np.nan
    bound = 5.0 * DEGREE
    flights.observed_maximum[:, :, 1] = 0.5 * bound
    flights.observed_maximum[1, :, 1] = (1.0 + 1e-9) * bound  # a solver's rounding
    flights.observed_maximum[2, :10, 1] = 1.01 * bound
    flights.observed_maximum[2, 10, 1] = np.nan
    law = gains()
    rows = table("dispersions", gains=law, entry_errors=flights)
    assert list(rows["lost trials"]) == [0, 0, 0, 2, 40, 0]
    assert column(rows, "trials with a clipped") == near([0.0, 0.0, 27.5, 0.0, 0.0, 0.0])
    errors = np.delete(flights.final_error[3], [7, 8], axis=0)
    deviation, error = column(rows, "crossrange: deviation")[3], column(rows, "crossrange: standard error")[3]
    assert deviation == near(errors[:, 1].std(ddof=1))
    # For normal samples the standard error of a deviation is near sigma / sqrt(2 N).
    assert error == pytest.approx(deviation / np.sqrt(2.0 * len(errors)), rel=0.4)
    # The linear prediction as a sum over the drawn channels.
    predicted = np.sqrt(sum((law.final[0, 2, k] * s) ** 2 for k, s in enumerate((200.0, 1000.0, 200.0))))
    assert column(rows, "downrange: by linear")[0] == near(predicted)
    ratio = flights.final_error[0, :, 2].std(ddof=1) / predicted
    assert column(rows, "downrange: flown over")[0] == near(ratio)
    # Half of the trials lie below the median; a lost one is worse than any other.
    sizes = np.sort(np.linalg.norm(flights.final_error, axis=2), axis=1)
    assert column(rows, "median")[:4] == near(sizes[:4, 20])
    assert column(rows, "99th percentile")[0] == near(sizes[0, -1])
    cells = printed_text(rows)
    assert cells["99th percentile (m)"][3] == cells["crossrange: deviation (m)"][4] == DASH
    assert cells["median (m)"][4] == cells["mean propellant (kg)"][4] == DASH
    # 0.0394294 kg of propellant per deg/s.
    fuel = 0.0394294 * flights.final_state[0, :, 8].mean() / DEGREE
    assert column(rows, "mean propellant")[0] == pytest.approx(fuel, rel=1e-4)
