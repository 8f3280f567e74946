"""Tables of the funnels paper: their cells are the numbers of artifacts, whatever these hold.

The artifacts are made up, of the declared shapes, so that no table can hide behind the values of one reading.
"""

import inspect
import typing
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.papers import catalogue
from marsedl.papers.funnels import PAPER, tables
from marsedl.papers.funnels.records import (
    CoarseFunnels,
    Discretization,
    Divergence,
    Dubins,
    DubinsStudy,
    FlightEnsemble,
    Funnel,
    Gains,
    LinearBounds,
    Optima,
    Proven,
    StageStudy,
)
from marsedl.replication.artifacts import quantities
from marsedl.replication.tables import read_table, write_table

DEGREE, RADIUS = np.pi / 180.0, 3389.5e3
DASH = "–"
SLICES, STAGES = 13, 12
STEPS = 5 * np.arange(SLICES)
# Extents of the dimensions that must fit together; any other has two.
EXTENTS = {"slices": SLICES, "stages": STAGES, "time": 61, "nodes": 61, "trials": 40, "observed": 3, "final": 8}
FUNNELS = np.array(["flow", "euler", "wind"])


def made_up(kind, seed=1, extents=None, **values):
    """An artifact of a type with random numbers in the fields that are not given."""
    sizes, generator = EXTENTS | (extents or {}), np.random.default_rng(seed)

    def values_of(declared):
        shape = tuple(extent if isinstance(extent, int) else sizes.get(extent, 2) for extent in declared.dims)
        if declared.dtype == "str":
            return np.full(shape, "words") if shape else "words"
        if declared.dtype == "bool":
            return generator.random(shape) < 0.5 if shape else True
        if declared.dtype.startswith("int"):
            return generator.integers(1, 9, shape)
        return generator.uniform(0.1, 9.0, shape)

    return kind(**{name: values_of(declared) for name, declared in quantities(kind).items()} | values)


def funnel(**values):
    given = {"step": STEPS, "tightness_stage": np.array([1, 12]), "outcome": "complete"}
    return made_up(Funnel, 1, **given | values)


def optima(**values):
    return made_up(Optima, 2, **{"starts": np.array([6, 9]), "start_bank": np.ones(21)} | values)


def linear_bounds(**values):
    return made_up(LinearBounds, 3, {"time": 61}, **values)


def ensemble(seed=4, **values):
    return made_up(FlightEnsemble, seed, {"repeats": 10}, **values)


def stage_study(**values):
    given = {"basis_rank": np.array([27, 0]), "product_rank": np.array([182, 0])}
    return made_up(StageStudy, 5, **given | values)


def discretization(**values):
    return made_up(Discretization, 6, **{"condition": np.array(["flow", "euler"])} | values)


def proven(**values):
    return made_up(Proven, 7, **{"step": STEPS} | values)


def dubins(**values):
    return made_up(Dubins, 8, {"funnels": 3}, **{"funnel": FUNNELS, "slice_step": STEPS} | values)


def dubins_study(**values):
    given = {"funnel": FUNNELS, "proven_funnel": FUNNELS[[0, 2]]}
    return made_up(DubinsStudy, 9, {"funnels": 3}, **given | values)


MAKERS = {
    "optima": optima,
    "gains": lambda: made_up(Gains, 10),
    "funnel": funnel,
    "linear_bounds": linear_bounds,
    "stage_study": stage_study,
    "discretization": discretization,
    "coarse_funnels": lambda: made_up(CoarseFunnels, 15, coarse_step=np.array([0, 8])),
    "divergence": lambda: made_up(Divergence, 16),
    "proven": proven,
    "dubins": dubins,
    "dubins_study": dubins_study,
    "constant": ensemble,
    "redrawn": lambda: ensemble(11),
    "adversarial": lambda: ensemble(12),
    "dubins_calm": lambda: ensemble(13),
    "dubins_wind": lambda: ensemble(14),
}


@pytest.fixture(scope="module")
def table(funnels):
    """The rows of a table, some artifacts replaced."""

    def rows(name, reading="corrected", **artifacts):
        needed = {need.split(".")[-1]: MAKERS[need.split(".")[-1]]() for need in funnels.paper.tables[name].needs}
        return funnels.product("tables", name, reading, needed | artifacts, published={})

    return rows


@pytest.fixture(scope="module")
def readings(funnels):
    """Rows of the summary over readings, by reading; some artifacts of `corrected` replaced."""

    def rows(**artifacts):
        items = {name: MAKERS[name]() for name in ("funnel", "constant", "redrawn", "adversarial")}
        made = {
            name: (funnels.all_inputs(name), SimpleNamespace(**items | (artifacts if name == "corrected" else {})))
            for name in funnels.study.readings
        }
        return tables.readings(made, {})

    return rows


def test_tables_are_those_of_the_catalogue():
    parameters = {
        name: list(inspect.signature(function).parameters)
        for name, function in vars(tables).items()
        if inspect.isfunction(function) and function.__module__ == tables.__name__ and not name.startswith("_")
    }
    assert set(parameters) == {*PAPER.tables, *PAPER.summaries}
    assert not set(PAPER.tables) & set(PAPER.figures)
    for name, product in catalogue("funnels").tables.items():
        needs = [need.split(".")[-1] for need in product.needs]
        assert set(needs) <= set(parameters[name]), name
        hints = typing.get_type_hints(getattr(tables, name))
        assert all(isinstance(MAKERS[need](), hints[need]) for need in needs), name


@pytest.mark.parametrize("name", PAPER.tables)
def test_tables_are_texts_and_can_be_written(table, name, tmp_path):
    rows = table(name)
    assert len({len(row) for row in rows}) == 1 and len(rows) > 2
    assert all(isinstance(cell, str) and "nan" not in cell for row in rows for cell in row)
    write_table(rows, tmp_path / "table.csv", tmp_path / "table.md")
    assert read_table(tmp_path / "table.csv") == [list(row) for row in rows]


def test_what_is_withheld_has_its_number_and_source(table):
    rows = {row[0]: row for row in table("withheld")}
    assert rows["its scale height"][1:3] == ("10.3324", "km")
    assert rows["weights of the regulator: equal deviations"][1] == "1, 2, 2; 30; 0.6, 0.6"
    assert rows["number of slices"][1] == "61" and rows["limit of the heat rate"][1:3] == ("61", "W/cm^2")
    assert all(row[3] for row in rows.values())


def test_optima_are_in_the_units_of_their_head(table):
    given = {"cost": np.array([10.0, 20.0]) * DEGREE**2, "peak_heat_rate": np.array([611579.0, 5e5])}
    first, second = table("optima", optima=optima(intervals=np.array([100, 200]), **given))[1:]
    assert first[:2] == ("100", "10.0000") and first[4] == "61.1579" and first[6] == "6 of 21"
    assert second[:2] == ("200", "20.0000") and second[6] == "9 of 21"


def test_levels_stand_at_their_slices(table):
    made, flown = funnel(), ensemble()
    rows = table("levels", funnel=made, constant=flown)
    assert [row[0] for row in rows[1:]] == [str(k + 1) for k in range(SLICES)]
    k = 7
    assert float(rows[k + 1][2]) == pytest.approx(made.level[k], rel=1e-4)
    assert float(rows[k + 1][6]) == pytest.approx(flown.maximum_over_trials[5 * k, 0], rel=1e-4)
    assert float(rows[k + 1][10]) == pytest.approx(made.level[k] / flown.maximum_over_trials[5 * k, 0], rel=1e-3)
    deviation = np.std(flown.repeat_maximum[:, 5 * k, 0], ddof=1)
    assert float(rows[k + 1][7]) == pytest.approx(deviation, rel=0.06)
    assert "40 flights" in rows[0][6]


def test_half_widths_are_lengths_on_the_ground(table):
    widths = np.zeros((SLICES, 6))
    widths[-1] = [1500.0, 2000.0 / RADIUS, 3000.0 / RADIUS, 4.0, 5.0 * DEGREE, 6.0 * DEGREE]
    made = funnel(half_width=widths, feedback=np.full(SLICES, 7.0 * DEGREE), level=np.arange(1.0, SLICES + 1))
    rows = table("half_widths", funnel=made)
    assert rows[-4][1:] == ("funnel", "1.5", "2", "3", "4", "5", "6", "7")
    flown = np.zeros((40, 8))
    flown[3, 0], flown[5, 0] = -2500.0, np.nan
    assert table("half_widths", funnel=made, constant=ensemble(final_state=flown))[-1][1:3] == ("40 flights", "2.5")


def test_a_stage_that_is_not_reached_is_a_dash(table):
    nothing = np.full(STAGES, np.nan)
    empty = dict.fromkeys(("bound", "growth", "gap", "residual", "true_maximum", "violation"), nothing)
    status = np.array(["optimal"] * 11 + ["not solved"])
    made = funnel(status=status, stage_sound=np.zeros(STAGES, bool), tightness=np.array([1e-6, np.nan]), **empty)
    rows = table("verification", funnel=made)
    assert rows[-1][2] == DASH and rows[-1][8] == "not solved" and rows[-1][13] == "no"
    assert rows[1][-1] == "1.0e-06" and rows[2][-1] == "" and rows[-1][-1] == DASH


def test_forms_are_compared_with_the_first(table):
    bound = np.array([1.25, 1.25 * (1 + 1e-6)])
    rows = table("forms", stage_study=stage_study(form_bound=bound, polynomial_maximum=1.25 * (1 - 2e-7)))
    assert [row[2] for row in rows[1:4]] == ["+0.0e+00", "+1.0e-06", "-2.0e-07"]


def test_ranks_that_are_not_computed_are_none(table):
    rows = table("counts")
    assert rows[1][4] == "27" and rows[1][8] == "182"
    assert rows[2][4] == rows[2][8] == "not computed"


def test_the_euler_step_is_judged_in_its_own_rows(table):
    made = discretization(least_excess=np.array([-0.0056, 0.01]), unsafe_share=np.array([0.35, 0.0]))
    rows = table("numbers_of_slices", discretization=made)
    assert [row[1] for row in rows[1:]] == ["flow", "euler"] * 2
    assert rows[1][5:] == ("",) * 5 and rows[2][5:7] == ("35.0", "0.560")


def test_proven_levels_stand_beside_those_by_samples(table):
    made = funnel()
    rows = table("proof", funnel=made, proven=proven(level=1.125 * made.level))
    assert {row[3] for row in rows[1:]} == {"1.12500"} and rows[-1][4:] == ("",) * 5


def test_levels_of_the_dubins_car_are_named(table):
    study, calm = dubins_study(), ensemble(13)
    rows = table("dubins_levels", dubins_study=study, dubins_calm=calm)
    assert [row[1] for row in rows[1:6]] == ["samples", "multipliers", "linear dynamics, exact", "40 runs", "proven"]
    assert rows[4][4] == f"{calm.maximum_over_trials[30, 0]:.5f}"
    assert float(rows[5][2]) == pytest.approx(study.proven_level[0, 0], abs=1e-5)
    assert [row[0] for row in rows[6:9]] == ["euler"] * 3


def test_readings_tell_what_differs_and_count_what_is_outside(readings):
    laws = {
        name: ensemble(seed, outside_at_slices=count, outside_between=0)
        for name, seed, count in (("constant", 4, 1), ("redrawn", 11, 2), ("adversarial", 12, 4))
    }
    growth = np.full(STAGES, 2.0)
    made = funnel(growth=growth, true_maximum=np.where(np.arange(STAGES) < 5, 2.5, 1.5), violation=growth / 100.0)
    rows = readings(funnel=made, **laws)
    by_name = {row[0]: dict(zip(rows[0], row, strict=True)) for row in rows[1:]}
    assert list(by_name)[:2] == ["printed", "corrected"] and len(by_name) == 7
    corrected = by_name["corrected"]
    assert corrected["inputs that differ from corrected (SI)"] == ""
    assert corrected["flights outside, of all kinds"] == "7" and corrected["flights"] == "120"
    assert corrected["stages beyond whose bound motion was found, additive disturbances apart"] == "5 of 12"
    assert corrected["by at most (%)"] == "2.000"
    assert by_name["euler"]["inputs that differ from corrected (SI)"] == "condition euler"
    assert "largest_feedback any" in by_name["printed"]["inputs that differ from corrected (SI)"]
    assert by_name["printed"]["samples on the slices"] == "no"


def test_a_reading_without_search_or_peaks_or_a_whole_funnel(readings):
    nothing = np.full(STAGES, np.nan)
    level = np.where(np.arange(SLICES) < 4, np.arange(1.0, SLICES + 1), np.nan)
    made = funnel(true_maximum=nothing, violation=nothing, level=level, outcome="the funnel diverges")
    rows = readings(funnel=made)
    row = next(dict(zip(rows[0], row, strict=True)) for row in rows[1:] if row[0] == "corrected")
    assert (
        row["stages beyond whose bound motion was found, additive disturbances apart"] == DASH
        and row["last rho"] == DASH
    )
    assert row["local maxima of rho (s)"] == "none" and row["largest rho"] == "4"
    assert row["outcome"] == "the funnel diverges"


def test_numbers_have_no_more_digits_than_can_be_read(funnels):
    assert tables._number(-0.0001, ".2f") == "0.00"
    assert tables._number(6.5e9, ".2f") == "6.5e+09" and tables._number(np.inf, ".2f") == DASH
    changed, default = (
        funnels.all_inputs("corrected", drawn_trials=number, nose_radius=radius)
        for number, radius in ((5, 1.0), (7, 2.0))
    )
    assert tables._differences(changed, default) == "nose_radius 1"
