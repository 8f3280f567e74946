"""Tables: columns of one type and unit, unrolled from records, written for analysts and for readers."""

import io
import math

import numpy as np
import pandas as pd
import pytest

from marsedl.replication.claims.claim import Claim, Result
from marsedl.replication.claims.rows import claims_table
from marsedl.replication.records.fields import Axis, quantity, record
from marsedl.replication.records.tables import (
    Column,
    csv_text,
    described,
    frame,
    printed_cells,
    read_markdown,
    table,
    write_table,
)

MOTION = Axis("motion", altitude="m", velocity="m/s")
LAW = Axis("law", "open_loop", "feedback")


@record
class Study:
    """A study that is made up."""

    step: np.ndarray = quantity("s", ("step",), "largest step", label="longest step")
    error: np.ndarray = quantity("1", (LAW, "step"), "relative error", allow_nan=True)
    spread: np.ndarray = quantity("1", (LAW, "step"), "standard error of it", label="its standard error")
    turned: np.ndarray = quantity("1", ("step", LAW), "the error again", allow_nan=True)
    runs: np.ndarray = quantity("1", ("step",), "runs", "int64")
    angle: float = quantity("rad", (), "angle at the start")
    end: np.ndarray = quantity(MOTION.unit, ("segments", MOTION), "final state")
    covariance: np.ndarray = quantity("SI", (MOTION, MOTION), "covariance")


STUDY = Study(
    step=np.array([0.1, 0.2, 0.4]),
    error=np.array([[1.0, 2.0, math.nan], [4.0, 5.0, 6.0]]),
    spread=np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]),
    turned=np.array([[1.0, 4.0], [2.0, 5.0], [math.nan, 6.0]]),
    runs=np.array([10, 20, 30]),
    angle=math.pi / 2,
    end=np.array([[1.0, 2.0], [3.0, 4.0]]),
    covariance=np.eye(2),
)
COLUMNS = {
    "reading": Column(),
    "mass": Column("kg", ".2f", "at the end", error="its error"),
    "its error": Column("kg"),
    "held": Column(),
    "trials": Column(),
    "angle": Column("deg", "+.1f"),
}
ROWS = [
    ("printed", math.inf, None, False, None, 1),
    ("corrected", 0.1 + 0.2, 1 / 3, True, 1500, -2.0),
    ("mine | yours", math.nan, 0.1, True, 3, None),
]


def test_a_written_table_is_read_back_with_its_types_and_all_digits(tmp_path):
    data = table(ROWS, COLUMNS)
    write_table(data, tmp_path / "t.csv", tmp_path / "t.md")
    back = pd.read_csv(tmp_path / "t.csv")
    kinds = {"reading": "str", "mass (kg)": "float64", "its error (kg)": "float64", "held": "bool"}
    assert dict(back.dtypes.astype(str)) == kinds | {"trials": "float64", "angle (deg)": "float64"}
    assert dict(data.dtypes.astype(str)) == kinds | {"trials": "Int64", "angle (deg)": "float64"}
    assert back["mass (kg)"].tolist()[:2] == [math.inf, 0.1 + 0.2]
    assert [line.split(",") for line in (tmp_path / "t.csv").read_text("utf-8").splitlines()[1:]] == [
        ["printed", "inf", "", "False", "", "1.0"],
        ["corrected", "0.30000000000000004", "0.3333333333333333", "True", "1500", "-2.0"],
        ["mine | yours", "", "0.1", "True", "3", ""],
    ]


def test_readers_see_printed_digits_errors_beside_values_and_what_failed(tmp_path):
    write_table(table(ROWS, COLUMNS), tmp_path / "t.csv", tmp_path / "t.md")
    cells = [
        ["reading", "mass (kg)", "held", "trials", "angle (deg)"],
        ["printed", "∞", "no", "–", "+1.0"],
        ["corrected", "0.30 ± 0.33", "yes", "1,500", "-2.0"],
        ["mine | yours", "–", "yes", "3", "–"],
    ]
    assert read_markdown(tmp_path / "t.md") == printed_cells(table(ROWS, COLUMNS)) == cells
    text = (tmp_path / "t.md").read_text(encoding="utf-8")
    assert text.splitlines()[1] == "| --- | ---: | --- | ---: | ---: |"
    assert "| mass (kg) | kg | number | at the end |\n| its error (kg) | kg | number |  |\n" in text
    assert "| held |  | True or False |  |" in text


def test_types_follow_from_what_a_column_is_and_not_from_its_values():
    columns = {"mass": Column("kg"), "ratio": Column("", ".2f"), "share": Column("%"), "trials": Column()}
    for rows in ([(1, 2, 3, 4)], [(1.5, 2.5, 3.5, 4)], [(None, 2, 3, 4)]):
        data = table(rows, columns)
        assert data.dtypes.astype(str).tolist() == ["float64"] * 3 + ["int64"]
        assert pd.read_csv(io.StringIO(csv_text(data))).dtypes.tolist() == data.dtypes.tolist()


@pytest.mark.parametrize(
    ("cells", "says"),
    [
        ([True, None], "holds bool and gaps"),
        ([1.0, "–"], "holds float, str"),
        ([True, 2], "holds bool, int"),
        ([(1, 2)], "holds tuple"),
        (["1", "2"], "read back from CSV it is int64"),
        (["None", "x"], "read back"),
    ],
)
def test_a_column_of_several_types_or_of_ambiguous_words_is_refused(cells, says):
    with pytest.raises(ValueError, match=rf"column 'x' .*{says}"):
        csv_text(table({"x": cells}, {"x": Column()}))


@pytest.mark.parametrize(
    ("data", "columns", "says"),
    [
        ([(1,)], {"a": Column(), "b": Column()}, "a row of 1 cells in a table of 2 columns"),
        ({"a": [1]}, {"a": Column(), "b": Column()}, "cells are given for a, but the columns are a, b"),
        ([(1, 2)], {"a": Column(), "b": Column(label="a")}, "two columns have the same head"),
        ([(1, 2)], {"a": Column(error="c"), "b": Column()}, "column 'a' has 'c' beside it"),
    ],
)
def test_cells_that_do_not_fit_the_columns_are_refused(data, columns, says):
    with pytest.raises(ValueError, match=says):
        table(data, columns)


def test_a_table_is_extended_and_its_columns_stay_described():
    data = table(ROWS, COLUMNS)
    longer = table({**data, "half": data["mass (kg)"] / 2}, {**described(data), "half": Column("kg", ".1f")})
    assert list(longer) == [*data, "half (kg)"]
    assert described(longer)["mass (kg)"] == described(data)["mass (kg)"]
    part = data[data["held"]]
    assert described(part)["angle (deg)"].digits == "+.1f" and csv_text(part).count("\n") == 3


def test_fields_are_unrolled_over_their_dimensions():
    data = frame(STUDY, "runs", error=Column("%", ".0f", error="spread"), spread=Column("%"))
    assert list(data) == ["law", "longest step (s)", "runs", "error (%)", "its standard error (%)"]
    assert data["law"].tolist() == ["open loop"] * 3 + ["feedback"] * 3
    assert data["longest step (s)"].tolist() == [0.1, 0.2, 0.4] * 2
    assert data["runs"].tolist() == [10, 20, 30] * 2  # repeated over the laws
    np.testing.assert_array_equal(data["error (%)"], 100 * STUDY.error.ravel())
    assert printed_cells(data)[1:4:2] == [["open loop", "0.1", "10", "100 ± 10"], ["open loop", "0.4", "30", "–"]]
    assert described(data)["error (%)"].meaning == "relative error"


def test_the_order_of_the_dimensions_of_a_field_does_not_mix_values():
    data = frame(STUDY, "runs", "error", "turned")
    assert data["turned"].equals(data["error"].rename("turned"))
    assert frame(STUDY, "runs").columns.tolist() == ["longest step (s)", "runs"]


def test_components_of_different_units_are_columns_and_others_are_numbered_or_named():
    data = frame(STUDY, "end", angle=Column("deg", label="start"))
    assert list(data) == ["segment", "end: altitude (m)", "end: velocity (m/s)", "start (deg)"]
    assert data.to_numpy().tolist() == [[1, 1, 2, 90], [2, 3, 4, 90]]
    named = frame(STUDY, "end", coordinates={"segments": ("leg", ["first", "second"])})
    assert named["leg"].tolist() == ["first", "second"]


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"eror": ".1f"}, "Study has no field 'eror'; did you mean 'error'"),
        ({"covariance": ".1f"}, "'covariance' is in mixed units"),
        ({"runs": Column("km")}, "'runs' is in 1, which is not converted to km"),
        ({"runs": Column(label="error"), "error": ""}, "two columns have the same head: .*error, error"),
    ],
)
def test_fields_that_cannot_be_a_column_are_refused(fields, says):
    with pytest.raises(ValueError, match=says):
        frame(STUDY, **fields)


def claim(name, printed, unit, /, **readings):
    names = ("value", "standard_error", "verdict", "trials", "components")
    results = {reading: Result(**dict(zip(names, result, strict=False))) for reading, result in readings.items()}
    judged = {"kind": "deterministic", "verdict": "differs", "reading": "corrected"}
    return Claim(paper="p", id=name, printed=printed, unit=unit, readings=results, **judged)


def test_claims_are_a_long_table():
    components = ["reproduced", "differs"]
    mean = claim("mean", [100.1, 0.5], "m, m/s", corrected=([100.0, 0.25], [0.5, 0.1], "differs", 2000, components))
    data = claims_table(
        [
            mean,
            claim("limits", [[1, 2], [3, 4]], "1", corrected=([[1, 2], [3, 5]], None, "differs", None)),
            claim("stands", True, "1", corrected=(False, None, "fails", None), printed=(None, None, None, None)),
            claim("endless", "inf", "s", corrected=("inf", None, "as_stated", None)),
            claim("lost", 5.0, "m", corrected=([None, 1.0], None, "differs", 10)),
        ]
    )
    back = pd.read_csv(io.StringIO(csv_text(data)))
    assert [*back] == [
        *("paper", "claim", "component", "reading", "value", "standard_error", "printed", "verdict", "claim_verdict"),
        *("trials", "unit"),
    ]
    numbers = dict.fromkeys(("value", "standard_error", "printed", "trials"), "float64")
    assert dict(back.dtypes.astype(str)) == {**dict.fromkeys(back.columns, "str"), **numbers}
    rows = [tuple(row) for row in back.astype(object).where(back.notna(), None).itertuples(index=False)]
    assert rows[:2] == [
        ("p", "mean", "[1]", "corrected", 100.0, 0.5, 100.1, "reproduced", "differs", 2000, "m"),
        ("p", "mean", "[2]", "corrected", 0.25, 0.1, 0.5, "differs", "differs", 2000, "m/s"),
    ]
    assert [(row[2], row[4], row[6]) for row in rows[2:6]] == [
        *(("[1,1]", 1, 1), ("[1,2]", 2, 2), ("[2,1]", 3, 3), ("[2,2]", 5, 4))
    ]
    assert [row[2:10] for row in rows[6:8]] == [
        (None, "corrected", 0.0, None, 1.0, "fails", "fails", None),
        (None, "printed", None, None, 1.0, None, None, None),
    ]
    assert rows[8][4:7] == (math.inf, None, math.inf)
    assert [row[4:7] for row in rows[9:]] == [(None, None, 5.0), (1.0, None, 5.0)]
