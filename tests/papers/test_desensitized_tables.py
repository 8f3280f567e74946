"""Tables of the desensitized-landing paper: their cells are the numbers of artifacts, whatever these hold.

The artifacts are made up, of the declared shapes, so that no table can hide behind the values of one reading.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from marsedl.papers import catalogue
from marsedl.papers.desensitized import tables
from marsedl.papers.desensitized.records import (
    CHANNELS,
    LAWS,
    SOLUTIONS,
    Branches,
    Certificates,
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
# Extents of the dimensions that must fit together; any other has two.
EXTENTS = {
    "rows": 7,
    "law": 6,
    "sets": 16,
    "trials": 40,
    "time": 5,
    "node": 5,
    "intervals": 4,
    "cases": 2,
    "scheme": 3,
    "meshes": 3,
    "solutions": 3,
    "points": 6,
}


def made_up(kind, seed=1, extents=None, **values):
    """An artifact of a type with random numbers in the fields that are not given."""
    sizes, generator = EXTENTS | (extents or {}), np.random.default_rng(seed)

    def values_of(declared):
        shape = tuple(extent if isinstance(extent, int) else sizes.get(extent, 2) for extent in declared.dims)
        if declared.dtype == "str":
            return np.full(shape, "words") if shape else "words"
        if declared.dtype == "bool":
            return generator.random(shape) < 0.5
        if declared.dtype.startswith("int"):
            return np.asarray(generator.integers(1, 9, shape))[()]
        return np.asarray(generator.uniform(0.1, 9.0, shape))[()]

    return kind(**{name: values_of(declared) for name, declared in quantities(kind).items()} | values)


def tradeoff(seed=1, **values):
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (7, 3))
    given = {
        "printed_weight": PRINTED_WEIGHTS,
        "weight": np.array([0.0, 0.03, 0.6, 5.0, 45.0, 1e6, 1e7]),
        "error": signs * np.random.default_rng(seed).uniform(10.0, 8000.0, (7, 3)),
        "branch": np.array(["2 reversals", "1 reversal"]),
        "row_branch": np.array([0, 0, 1, 1, 1, 1, 1]),
    }
    return made_up(Tradeoff, seed, **given | values)


def gains(**values):
    return made_up(Gains, 2, **{"law": np.array(LAWS), "ended": np.array([f"way {k}" for k in range(6)])} | values)


def responses(**values):
    given = {
        "law": np.array(LAWS),
        "drawn_error": np.array([200.0, 1000.0, 200.0]),
        "compared_error": np.array([1070.0, -930.0]),
    }
    return made_up(Responses, 3, **given | values)


def ensemble(**values):
    noise = np.random.default_rng(4).standard_normal((6, 40, 3))
    given = {"law": np.array(LAWS), "outcome": np.zeros((6, 40), np.int8), "final_error": 300.0 * noise}
    return made_up(FlightEnsemble, 4, **given | values)


def branches(**values):
    choices = np.array([[bool(k & 8), bool(k & 4), bool(k & 2), bool(k & 1)] for k in range(16)])
    given = {"set_fixed": choices}
    return made_up(Branches, 6, **given | values)


def certificates(**values):
    given = {"weight": np.array([0.0, 45.0]), "intervals": np.array([50, 100, 200])}
    return made_up(Certificates, 7, **given | values)


def minimum_fuel(**values):
    return made_up(MinimumFuel, 9, {"bound": 2, "solution": 3}, **{"solution": np.array(SOLUTIONS)} | values)


ARTIFACTS = {
    "tradeoff": tradeoff,
    "gains": gains,
    "responses": responses,
    "entry_errors": ensemble,
    "branches": branches,
    "minimum_fuel": minimum_fuel,
    "certificates": certificates,
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


# ---- other solutions -------------------------------------------------------------------------------------------------


def test_bank_conditions_begin_with_what_meets_the_paper(table):
    study = branches()
    study.set_effort[:], study.set_cumulative[:] = 1.0, 1.0
    study.set_effort[4], study.set_cumulative[4] = 0.1374 * 1.003, 5.1784 * DEGREE * 0.996  # initial rate only
    study.set_effort[9] = study.set_cumulative[9] = np.nan
    rows = table("bank_conditions", branches=study)
    angles = list(rows)[:4]
    assert rows[angles].iloc[0].to_numpy() == near([np.nan, 0.0, np.nan, np.nan])
    first = rows.iloc[0]
    assert (first["J0 over the paper's"], first["cumulative bank rate over the paper's"]) == near((1.003, 0.996))
    assert first["distance (%)"] == pytest.approx(0.5, rel=1e-9)
    assert list(rows["used here"]) == [True] + [False] * 15
    assert rows.iloc[-1, 4:10].isna().all()
    assert not table("bank_conditions", "printed", branches=study)["used here"][0]
    # A condition that is fixed elsewhere is shown there.
    angle = column(table("bank_conditions", changes={"initial_bank": -1.0}, branches=study), "initial bank angle")
    assert set(angle[np.isfinite(angle)]) == {-1.0 / DEGREE}


# ---- over all readings -----------------------------------------------------------------------------------------------


@pytest.fixture
def artifacts(desensitized):
    """Inputs and artifacts of all readings, made up; those of two readings are equal but for their gains."""
    of_readings = {}
    for number, name in enumerate(READINGS):
        path = tradeoff(1 if name == "feedback_tuned" else number)
        records = tables.Records(path, gains(), responses(), ensemble())
        of_readings[name] = (desensitized.all_inputs(name), records)
    return of_readings


def test_readings_are_told_apart_by_their_inputs(artifacts, desensitized_published):
    artifacts["printed"][1].gains.converged[:] = [True, True, False, False, True, True]
    artifacts["printed"][1].entry_errors.outcome[2, :5] = 1
    rows = well_formed(tables.readings(artifacts, desensitized_published)).set_index("reading")
    assert list(rows.index) == ["in the paper", *READINGS]
    paper = rows.loc["in the paper"]
    heads = [f"{name} ({unit})" for name, unit in FOUR.items()]
    assert tuple(paper[heads]) == (0.1374, 5.1784, 0.204, 8039.0)
    assert (paper["bank reversals"], paper["largest finite c1"]) == (2, 1.0)
    assert (paper["its final position error (m)"], paper["largest reduction (%)"]) == (6172.0, 26.1)
    differing = rows["inputs that differ"].fillna("")
    assert differing["corrected"] == ""
    assert differing["single_weight"] == "weight_factor 57.3, weight_rule proportional"
    assert differing["feedback_tuned"] == "gain_design tuned"
    assert "initial_bank_rate free" in differing["printed"] and "weight_path" in differing["printed"]
    assert "trials" not in " ".join(differing)
    unconverged = rows["gains that did not converge"]
    assert unconverged["printed"] == "gains against radius errors, gains against crossrange errors"
    lost = rows[[head for head in rows if head.startswith("lost trials: ")]]
    assert list(lost.loc["printed"]) == [0, 0, 5, 0, 0, 0] and not lost.loc["corrected"].any()
    path, flights = artifacts["mixed_units"][1].tradeoff, artifacts["mixed_units"][1].responses
    errors, row = np.linalg.norm(path.error, axis=1), rows.loc["mixed_units"]
    assert (row[heads[0]], row[heads[3]]) == near((path.effort[0], errors[0]))
    assert row["its final position error (m)"] == near(errors[4])
    assert row["largest reduction (%)"] == near(100.0 * (1.0 - errors.min() / errors[0]))
    for channel, (name, size) in enumerate(zip(CHANNELS, flights.drawn_error, strict=True)):
        assert row[f"{name} at entry (m)"] == size
        final = [row[f"{name}: {how} (m)"] for how in ("no feedback", "feedback")]
        assert final == near([np.linalg.norm(flights.error[law, channel, -1]) for law in (0, 2 + channel)])
