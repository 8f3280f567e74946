"""Tables of the desensitized-landing paper: their cells are the numbers of artifacts, whatever these hold.

The artifacts are made up, of the declared shapes, so that no table can hide behind the values of one reading.
"""

import inspect
import re
import typing
from dataclasses import replace

import numpy as np
import pytest

from marsedl.papers import catalogue
from marsedl.papers.desensitized import tables
from marsedl.papers.desensitized.claims import Records
from marsedl.papers.desensitized.records import (
    CHANNELS,
    LAWS,
    LOST,
    PERTURBATIONS,
    SOLUTIONS,
    VARIANTS,
    Branches,
    Certificates,
    FlightEnsemble,
    FurtherPerturbations,
    Gains,
    GainStudy,
    MinimumFuel,
    Responses,
    Tradeoff,
)
from marsedl.replication.artifacts import quantities
from marsedl.replication.tables import read_table, write_table

DEGREE = np.pi / 180.0
DASH = "–"
READINGS = ("printed", "corrected", "one_reversal", "single_weight", "mixed_units", "feedback_tuned")
PRINTED_WEIGHTS = np.array([0.0, 0.001, 0.01, 0.1, 1.0, np.nan, np.nan])
# Extents of the dimensions that must fit together; any other has two.
EXTENTS = {
    "rows": 7,
    "laws": 6,
    "sets": 16,
    "trials": 40,
    "time": 5,
    "intervals": 4,
    "cases": 2,
    "schemes": 3,
    "meshes": 3,
    "variants": 3,
    "sizes": 4,
    "all_sizes": 4,
    "candidates": 5,
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
            return generator.integers(1, 9, shape)
        return generator.uniform(0.1, 9.0, shape)

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
    return made_up(Responses, 3, **{"law": np.array(LAWS), "drawn_error": np.array([200.0, 1000.0, 200.0])} | values)


def ensemble(**values):
    noise = np.random.default_rng(4).standard_normal((6, 40, 3))
    given = {"law": np.array(LAWS), "outcome": np.zeros((6, 40), np.int8), "final_error": 300.0 * noise}
    return made_up(FlightEnsemble, 4, **given | values)


def gain_study(**values):
    given = {
        "channel": np.array([0, 0, 1, 2, 2]),
        "rank": np.array([1, 0, 0, 0, 1]),
        "tuning_error": np.array([-1000.0, -200.0, 200.0, 1000.0]),
        "all_sizes": np.array([-1000.0, -200.0, 200.0, 1000.0]),
    }
    return made_up(GainStudy, 5, **given | values)


def branches(**values):
    choices = np.array([[bool(k & 8), bool(k & 4), bool(k & 2), bool(k & 1)] for k in range(16)])
    given = {
        "name": np.array(["1 reversal", "2 reversals", "360 deg roll"]),
        "nominal": 1,
        "set_fixed": choices,
        "curve_error": np.array([8168.0, 8100.0, 8010.0, 8008.0, 7999.0, 7980.0]),
        "fold_error": 8009.0,
        "row_weight": np.array([0.0, 0.001, 0.01, 0.1, 1.0]),
        "row_error": np.linspace(8000.0, 6000.0, 5),
        "row_effort": np.array([0.14, 0.15, 0.3, 1.5, 5.0]),
        "least_effort": np.array([0.05, 0.06, 0.3, 1.5, 4.0]),
        "least_solution": np.array([0, 0, -1, -1, 2]),
    }
    return made_up(Branches, 6, {"rows": 5}, **given | values)


def certificates(**values):
    weights = np.array([0.0, 0.03, 0.6, 5.0, 45.0, 1e6, 1e7])
    given = {
        "weight": np.array([0.0, 45.0]),
        "intervals": np.array([50, 100, 200]),
        "row_weight": weights,
        "slope_weight": weights[1:5],
        "slope_deviation": np.array([1e-6, -2e-6, 3e-6, -4e-6]),
        "variant": np.array(VARIANTS),
    }
    return made_up(Certificates, 7, **given | values)


def further(**values):
    given = {
        "perturbation": np.array(PERTURBATIONS),
        "size": np.array([0.05, 10.0, 0.05 * DEGREE, 1000.0, 1000.0, 1000.0]),
        "row_weight": np.array([0.0, 0.03, 0.6, 5.0, 45.0, 1e6, 1e7]),
        "design_weight": np.array([0.0, 10.0]),
        "design_branch": np.array([0, 1]),
        "density_error": np.array([0.01, -0.01]),
        "radius_error": np.array([200.0, -200.0]),
        "path_end": "at a weight",
    }
    return made_up(FurtherPerturbations, 8, {"laws": 5}, **given | values)


def minimum_fuel(**values):
    return made_up(MinimumFuel, 9, {"bounds": 2, "solutions": 3}, **{"solution": np.array(SOLUTIONS)} | values)


ARTIFACTS = {
    "tradeoff": tradeoff,
    "gains": gains,
    "responses": responses,
    "entry_errors": ensemble,
    "gain_study": gain_study,
    "branches": branches,
    "minimum_fuel": minimum_fuel,
    "certificates": certificates,
    "further_perturbations": further,
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
        found = {name: artifacts.get(name) or ARTIFACTS[name]() for name in taken(stem)}
        published = {"published": desensitized_published} if PAPER.tables[stem].published else {}
        return well_formed(inputs.call(getattr(tables, stem), **found, **published))

    return make


def well_formed(rows):
    assert {len(row) for row in rows} == {len(rows[0])}
    assert all(isinstance(cell, str) for row in rows for cell in row)
    assert len(set(rows[0])) == len(rows[0]), "a column has the name of another"
    return rows


def column(rows, name):
    """Cells below the only head that begins with a name."""
    numbers = [k for k, head in enumerate(rows[0]) if head.startswith(name)]
    assert len(numbers) == 1, (name, rows[0])
    return [row[numbers[0]] for row in rows[1:]]


def numbers(rows, name):
    return np.array([float(cell.replace(",", "")) for cell in column(rows, name)])


def near(values, digits):
    return pytest.approx(values, abs=0.5000001 * 10.0**-digits)


# ---- all tables ------------------------------------------------------------------------------------------------------


def test_every_table_and_summary_of_the_catalogue_has_its_function():
    made = {
        name
        for name, function in inspect.getmembers(tables, inspect.isfunction)
        if function.__module__ == tables.__name__ and not name.startswith("_")
    }
    assert made == set(PAPER.tables) | set(PAPER.summaries)
    assert not set(PAPER.figures) & made


@pytest.mark.parametrize("stem", PAPER.tables)
def test_tables_take_what_the_catalogue_gives_them(stem):
    hints = typing.get_type_hints(getattr(tables, stem))
    assert all(isinstance(ARTIFACTS[name](), hints[name]) for name in taken(stem))
    assert PAPER.tables[stem].caption.endswith(".")


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("stem", PAPER.tables)
def test_every_reading_has_every_table(table, stem, reading, tmp_path):
    rows = table(stem, reading)
    write_table(rows, tmp_path / "t.csv", tmp_path / "t.md")
    assert read_table(tmp_path / "t.csv") == [list(row) for row in rows]


UNITS = r"m|km|kg|s|deg|deg/s|deg/s\^2|deg\^2/s\^3|rad/s\^2|rad/s\^2 per scaled state|%|m per km"
WITHOUT_UNIT = re.compile(
    "c1|source|branch|bank reversals|solver|law|final error in|error at entry in|iterations|converged|how |against|"
    "rank|starts that|random starts|.*over |root mean square|lost trials|trials|reading|case|scheme|intervals|.*order|"
    "check|no-DOC|c = |solution|full rolls|used here|point|on the branch|sensitivity weighed|feedback|parameter|here|"
    "in the paper|unit|at the atmos|at parachute|bursts|contradiction|nominal's branch ends"
)


@pytest.mark.parametrize("stem", PAPER.tables)
def test_heads_name_their_units(table, stem):
    for head in table(stem)[0]:
        assert re.search(rf"\(({UNITS})\)$", head) or WITHOUT_UNIT.match(head), head


@pytest.mark.parametrize("stem", [stem for stem in PAPER.tables if taken(stem)])
def test_what_is_not_known_is_a_dash(table, stem):
    artifacts = {}
    for name in taken(stem):
        artifact = ARTIFACTS[name]()
        unknown = {
            field: np.full_like(getattr(artifact, field), np.nan)
            for field, declared in quantities(type(artifact)).items()
            if declared.allow_nan and field not in ("printed_weight", "final_state", "observed_maximum")
        }
        artifacts[name] = replace(artifact, **unknown)
    with np.errstate(all="raise"):
        cells = [cell for row in table(stem, **artifacts) for cell in row]
    assert not [cell for cell in cells if re.search(r"\bnan\b|\binf\b|-0\.0*$|-0\.0+\b(?!\d)", cell)]
    if any(declared.allow_nan for name in taken(stem) for declared in quantities(type(artifacts[name])).values()):
        assert DASH in " ".join(cells) or stem in ("tab03", "sensitivity_blocks", "dominance")


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (np.nan, ".1f", DASH),
        (np.inf, ".1f", DASH),
        (-0.04, ".1f", "0.0"),
        (-0.06, ".1f", "-0.1"),
        (-1e-9, "+.1e", "-1.0e-09"),
        (5.25e12, ".1f", "5.25e+12"),
        (99999.94, ".1f", "99999.9"),
    ],
)
def test_numbers_can_be_read(value, form, text):
    assert tables._number(value, form) == text


# ---- Tables 1 to 3 ---------------------------------------------------------------------------------------------------


def test_vehicle_and_conditions_are_the_inputs(table):
    rows = table("tab01", changes={"ballistic_coefficient": 120.5, "roll_arm": 1.5})
    assert rows[2] == ("ballistic coefficient", "115", "120.5", "kg/m^2")
    assert rows[6] == ("roll moment arm", "1.25", "1.5", "m")
    untouched = [row for number, row in enumerate(rows[1:], start=1) if number not in (2, 6)]
    assert all(row[1] == row[2] for row in untouched)
    rows = {name: rest for name, *rest in table("tab02")}
    assert rows["altitude"] == ["126.1", "10", "km"]
    assert rows["velocity"] == ["6750", "503", "m/s"]
    assert rows["longitude"] == ["0", "12.2", "deg"]
    assert rows["flight path angle"] == ["-15.2", "not prescribed", "deg"]
    assert rows["bank rate (not in the paper)"] == ["0", "free", "deg/s"]
    rows = {name: rest for name, *rest in table("tab02", "printed", {"final_bank": 0.5})}
    assert rows["bank rate (not in the paper)"] == ["free", "free", "deg/s"]
    assert float(rows["bank angle (not in the paper)"][1]) == pytest.approx(0.5 / DEGREE, rel=1e-5)


def test_table_3_has_the_printed_rows_beside_those_found(table):
    found = tradeoff()
    rows = table("tab03", tradeoff=found)
    by_source = {source: [row for row in rows[1:] if row[1] == source] for source in column(rows, "source")}
    printed, here, ratios = (by_source[name] for name in ("in the paper", "here", "here over the paper's"))
    assert [row[0] for row in printed] == ["0 (no-DOC)", "0.001", "0.01", "0.1", "1", "infinity"]
    assert printed[3][3:7] == ("1.5603", "12.8236", "0.506", "6472")
    assert printed[5][3:7] == ("586.8673", "166.928", "6.583", "5939")
    assert len(here) == len(ratios) == 7
    paper = [row[3:7] for row in (*printed, printed[-1])]  # the last row has two here
    error = np.linalg.norm(found.error, axis=1)
    for number, row in enumerate(here):
        values = found.effort[number], found.cumulative[number] / DEGREE, found.propellant[number], error[number]
        for cell, ratio, value, reference, digits in zip(
            row[3:7], ratios[number][3:7], values, paper[number], (4, 4, 3, 1), strict=True
        ):
            assert float(cell) == near(value, digits)
            assert float(ratio) == near(value / float(reference), 4)
        assert [float(cell) for cell in row[7:10]] == near(found.error[number], 1)
        assert float(row[2]) == found.weight[number]
        assert row[10] == ("1 (begins with 2 reversals)" if number < 2 else "2 (begins with 1 reversal)")
        assert row[11] == str(found.reversals[number])
        assert float(row[12]) == near(found.largest_bank_rate[number] / DEGREE, 3)
        assert float(row[13]) == near(found.largest_bank_acceleration[number] / DEGREE, 4)
        assert row[15] == f"words, {found.iterations[number]} iterations"


def test_rows_that_the_paper_does_not_have_stand_alone(table):
    own = replace(tradeoff(), printed_weight=np.array([0.0, 0.001, 0.02, 0.1, 1.0, np.nan, np.nan]))
    rows = table("tab03", tradeoff=own)
    assert [row[1] for row in rows[1:] if row[0] == "0.02"] == ["here"]
    assert [row[1] for row in rows[1:] if row[0] == "0.1"] == ["in the paper", "here", "here over the paper's"]


# ---- sensitivities, gains, dispersions -------------------------------------------------------------------------------


def test_sensitivity_blocks_are_in_metres_per_kilometre(table):
    found = gains()
    rows = table("sensitivity_blocks", gains=found)
    assert len(rows) == 1 + 4 * len(LAWS)
    for number in range(len(LAWS)):
        block = rows[1 + 4 * number : 5 + 4 * number]
        assert [row[1] for row in block] == [*CHANNELS, "norm"]
        values = np.array([[float(cell) for cell in row[2:5]] for row in block])
        assert values[:3] == near(1e3 * found.final[number], 1)
        assert values[3] == near(np.sqrt((1e6 * found.final[number] ** 2).sum(axis=0)), 1)
        assert float(block[3][5]) == near(1e3 * np.sqrt((found.final[number] ** 2).sum()), 1)


def test_gain_sets_are_shown_with_their_own_channels(table):
    found, flown = gains(), responses()
    found.scaled_gain[:2] = 0.0
    rows = table("gain_sets", gains=found, responses=flown)
    laws = (
        [(0, k) for k in range(3)] + [(1, k) for k in range(3)] + [(2, 0), (3, 1), (4, 2)] + [(5, k) for k in range(3)]
    )
    assert [row[1] for row in rows[1:]] == [CHANNELS[channel] for _, channel in laws]
    shown = column(rows, "gains on altitude")
    assert shown[:6] == ["none"] * 6
    assert [float(value) for value in shown[7].split(", ")] == near(found.scaled_gain[3], 4)
    assert column(rows, "how the search ended") == [f"way {law}" for law, _ in laws]
    assert column(rows, "converged") == ["yes" if found.converged[law] else "no" for law, _ in laws]
    assert numbers(rows, "linear sensitivity") == near(
        [1e3 * np.linalg.norm(found.final[law, :, k]) for law, k in laws], 3
    )
    ends = [flown.error[law, k, -1] for law, k in laws]
    assert numbers(rows, "final error (m)") == near(np.linalg.norm(ends, axis=1), 1)
    for side, head in enumerate(("final error for +1000 m", "final error for -1000 m")):
        expected = [np.linalg.norm(flown.tabulated_error[law, k, side]) for law, k in laws]
        assert numbers(rows, head) == near(expected, 1)
    assert numbers(rows, "cumulative bank rate without") == near(
        [flown.nominal_cumulative[law] / DEGREE for law, _ in laws], 3
    )
    assert numbers(rows, "with the drawn error") == near([flown.cumulative[law, k] / DEGREE for law, k in laws], 3)
    assert numbers(rows, "drawn error at entry") == near([(200.0, 1000.0, 200.0)[k] for _, k in laws], 0)


def test_candidates_stand_in_the_order_of_their_ranks(table):
    norms = np.array([0.3, 0.2, 0.1, 0.4, LOST])
    study = gain_study(flown_norm=norms, all_tuned=False)
    rows = table("candidate_gains", gain_study=study)
    body = [row for row in rows[1:] if row[0] in CHANNELS]
    assert [row[:2] for row in body] == [
        *(("radius", "1"), ("radius", "2"), ("radius", DASH)),
        *(("crossrange", "1"), ("crossrange", DASH), ("downrange", "1"), ("downrange", "2"), ("downrange", DASH)),
    ]
    assert [row[-1] for row in body if row[1] != DASH] == ["0.2", "0.3", "0.1", "0.4", "lost"]
    assert float(body[0][7]) == near(study.flown_error[1, 0], 1)  # rank 0 of radius is candidate 1, at -1000 m
    assert float(body[0][6]) == near(1e3 * np.linalg.norm(study.linear_error[1]), 3)
    assert body[2][3] == f"{study.least_failed[0]} of {study.least_starts[0]}"
    together = [row for row in rows[1:] if row[0].startswith("all three")]
    assert len(together) == 6 and together[5][2] == "tuned to flown errors, not converged"
    assert [float(cell) for cell in together[4][7:11]] == near(study.all_flown_error[1, 1], 1)
    ratio = np.sqrt(np.mean((study.all_flown_error[1, 1] / study.all_sizes) ** 2))
    assert float(together[4][-1]) == pytest.approx(ratio, rel=1e-3)


def test_candidates_show_sizes_that_only_some_were_flown_at(table):
    rows = table("candidate_gains", gain_study=gain_study(tuning_error=np.array([-500.0, -200.0, 200.0, 1000.0])))
    sizes = [head for head in rows[0] if head.startswith("final error for")]
    assert [head.split()[3] for head in sizes] == ["-1000", "-500", "-200", "+200", "+1000"]
    cells = dict(zip(sizes, rows[1][7:12], strict=True))
    assert cells["final error for -1000 m (m)"] == "" and cells["final error for -500 m (m)"] != ""


def test_dispersions_are_those_of_the_trials_that_came_down(table):
    flown = ensemble()
    flown.outcome[3, 7:9] = 1, 3
    flown.final_error[3, 7:9] = np.nan
    flown.outcome[4], flown.final_error[4] = 1, np.nan
    bound = 5.0 * DEGREE
    flown.observed_maximum[:, :, 1] = 0.5 * bound
    flown.observed_maximum[1, :, 1] = (1.0 + 1e-9) * bound  # a solver's rounding
    flown.observed_maximum[2, :10, 1] = 1.01 * bound
    flown.observed_maximum[2, 10, 1] = np.nan
    law = gains()
    rows = table("dispersions", gains=law, entry_errors=flown)
    assert column(rows, "lost trials") == ["0", "0", "0", "2", "40", "0"]
    assert column(rows, "trials with a clipped") == ["0.00", "0.00", "27.50", "0.00", "0.00", "0.00"]
    kept = np.delete(flown.final_error[3], [7, 8], axis=0)
    deviation, error = (float(part) for part in column(rows, "crossrange: deviation")[3].split(" ± "))
    assert deviation == near(kept[:, 1].std(ddof=1), 1)
    # For normal samples the standard error of a deviation is near sigma / sqrt(2 N).
    assert error == pytest.approx(deviation / np.sqrt(2.0 * len(kept)), rel=0.4)
    # The linear prediction as a sum over the drawn channels.
    predicted = np.sqrt(sum((law.final[0, 2, k] * s) ** 2 for k, s in enumerate((200.0, 1000.0, 200.0))))
    assert float(column(rows, "downrange: by linear")[0]) == near(predicted, 1)
    ratio = flown.final_error[0, :, 2].std(ddof=1) / predicted
    assert float(column(rows, "downrange: flown over")[0]) == pytest.approx(ratio, rel=1e-3)
    # Half of the trials lie below the median; a lost one is worse than any other.
    sizes = np.sort(np.linalg.norm(flown.final_error, axis=2), axis=1)
    assert [float(cell) for cell in column(rows, "final error: median")[:4]] == near(sizes[:4, 20], 1)
    assert float(column(rows, "99th percentile")[0]) == near(sizes[0, -1], 1)
    assert column(rows, "99th percentile")[3] == DASH
    assert column(rows, "final error: median")[4] == column(rows, "mean propellant")[4] == DASH
    # 0.0394294 kg of propellant per deg/s.
    fuel = 0.0394294 * flown.final_state[0, :, 8].mean() / DEGREE
    assert float(column(rows, "mean propellant")[0]) == pytest.approx(fuel, rel=1e-4)


def test_dispersions_without_errors_at_entry_are_zero(table):
    flown = ensemble(final_error=np.zeros((6, 40, 3)))
    with np.errstate(all="raise"):
        rows = table("dispersions", changes={"initial_deviations": np.zeros(3)}, entry_errors=flown)
    assert column(rows, "radius: deviation")[0] == "0.0 ± 0.0" and column(rows, "radius: flown over")[0] == DASH


# ---- other solutions -------------------------------------------------------------------------------------------------


def test_local_minima(table):
    found = branches(returned=np.array([1e-9, np.nan, 2.0]))
    rows = table("local_minima", branches=found)
    assert column(rows, "solution") == [
        "1 reversal",
        "2 reversals (the nominal)",
        "360 deg roll",
        "starts that led to none",
    ]
    assert column(rows, f"random starts that led there, of {found.starts}") == [
        *map(str, found.found),
        f"{found.failed_starts}",
    ]
    assert column(rows, "bank angle's largest change")[:3] == ["5.7e-08", DASH, "1.1e+02"]
    for number in range(3):
        assert float(column(rows, "cumulative")[number]) == near(found.cumulative[number] / DEGREE, 3)
        assert float(column(rows, "final position error")[number]) == near(np.linalg.norm(found.error[number]), 1)


def test_bank_conditions_begin_with_what_meets_the_paper(table):
    found = branches()
    found.set_effort[:], found.set_cumulative[:] = 1.0, 1.0
    found.set_effort[4], found.set_cumulative[4] = 0.1374 * 1.003, 5.1784 * DEGREE * 0.996  # initial rate only
    found.set_effort[9] = found.set_cumulative[9] = np.nan
    rows = table("bank_conditions", branches=found)
    assert rows[1][:4] == ("free", "0", "free", "free")
    assert rows[1][5] == "1.0030" and rows[1][7] == "0.9960" and rows[1][8] == "0.50" and rows[1][10] == "yes"
    assert column(rows, "used here").count("yes") == 1
    assert rows[-1][4:10] == (DASH,) * 6
    assert table("bank_conditions", "printed", branches=found)[1][10] == ""
    # A condition that is fixed elsewhere is shown there.
    rows = table("bank_conditions", changes={"initial_bank": -1.0}, branches=found)
    assert {row[0] for row in rows[1:]} == {"free", f"{-1.0 / DEGREE:g}"}


def test_the_fold_parts_the_branch(table):
    found = branches()
    rows = table("fold", branches=found, tradeoff=tradeoff())
    points = column(rows, "point")
    assert points[:7] == ["on the branch"] * 3 + ["fold, largest weight"] + ["beyond the fold"] * 3
    assert numbers(rows[:4], "final position error") == near(found.curve_error[:3], 2)
    assert rows[4][1] == "8009.00" and rows[4][2] == DASH
    assert len(points) == 7 + 2 * 2 and points[-1] == "path over the weight: first on the next branch"
    found = branches(fold_error=np.nan, fold_weight=np.nan)
    none = np.zeros((0, 2))
    path = tradeoff(fold_weight=none, fold_effort=none, fold_error=none)
    points = column(table("fold", branches=found, tradeoff=path), "point")
    assert points == ["on the branch"] * 6 + ["no fold"]


def test_dominated_rows_say_by_what(table):
    rows = table("dominance")
    assert column(rows, "c1") == ["0 (no-DOC)", "0.001", "0.01", "0.1", "1"]
    assert column(rows, "over the row's") == ["0.3571", "0.4000", "1.0000", "1.0000", "0.8000"]
    starts = column(rows, "on the branch")
    assert starts[0].startswith("1 reversal, J0 ")
    assert starts[2:4] == ["the row itself"] * 2 and starts[4].startswith("360 deg roll, J0 ")


def test_least_fuel_is_the_measure_of_its_bound(table):
    found = minimum_fuel(reversals=np.array([[2, 1, 1], [2, -1, -1]]))
    rows = table("least_fuel", minimum_fuel=found)
    assert column(rows, "solution") == [*SOLUTIONS, *SOLUTIONS]
    assert numbers(rows, "bound of the bank") == pytest.approx(np.repeat(found.bound / DEGREE, 3), rel=1e-5)
    assert numbers(rows, "cumulative") == near(found.cumulative.ravel() / DEGREE, 4)
    assert numbers(rows, "over the least") == near((found.cumulative / found.cumulative[:, [1]]).ravel(), 4)
    assert numbers(rows, "intervals without thrust") == near(100.0 * found.coasting.ravel(), 1)
    assert numbers(rows, "intervals at the bound") == near(100.0 * found.at_bound.ravel(), 1)
    assert numbers(rows, "final time") == near(found.time[:, :, -1].ravel(), 2)
    assert column(rows, "bank reversals") == ["2", "1", "1", "2", DASH, DASH]
    told = column(rows, "contradiction")
    assert [k for k, cell in enumerate(told) if cell] == [1, 4]
    assert float(told[4]) == pytest.approx(found.switching_violation[1], rel=0.06)


# ---- certificates, further perturbations -----------------------------------------------------------------------------


def test_discretisation_has_a_row_for_every_run_and_orders_from_the_second_mesh(table):
    found = certificates()
    rows = table("discretisation_errors", certificates=found)
    assert len(rows) == 1 + 2 * 3 * 3
    order = column(rows, "order of the miss")
    for line, run in enumerate(np.ndindex(2, 3, 3)):
        case, scheme, mesh = run
        cells = rows[1 + line]
        assert cells[0] == ("no-DOC", "c = 45")[case] and cells[2] == ("50", "100", "200")[mesh]
        assert float(cells[3]) == near(found.mesh_effort[run], 5)
        apart = np.linalg.norm(found.mesh_error[run] - found.mesh_flown_error[run])
        assert float(cells[8]) == pytest.approx(apart, rel=5e-3)
        assert float(cells[10]) == pytest.approx(np.linalg.norm(found.mesh_miss[run]), rel=5e-3)
        assert (
            order[line] == DASH
            if mesh == 0
            else float(order[line]) == near(found.miss_order[case, scheme, mesh - 1], 2)
        )


def test_identities_stand_below_their_rows(table):
    found = certificates()
    rows = {name: rest for name, *rest in table("identities", certificates=found)}
    assert rows["check"] == ["no-DOC", "c = 0.03", "c = 0.6", "c = 5", "c = 45", "c = 1e+06", "c = 1e+07"]
    adjoint = rows["adjoint against forward (m/m)"]
    assert [float(cell) for cell in adjoint] == pytest.approx(found.row_adjoint_deviation, rel=0.05)
    slope = rows["dJ0/d(norm) over minus the weight, less one"]
    assert slope == ["", "+1.0e-06", "-2.0e-06", "+3.0e-06", "-4.0e-06", "", ""]
    largest = rows["longitude column, largest over schemes and meshes (m/m)"]
    assert [k for k, cell in enumerate(largest) if cell] == [0, 4]
    assert float(largest[4]) == pytest.approx(found.mesh_longitude_deviation[1].max(), rel=0.05)
    ratio = rows[f"flown over linear final error for {found.radius_error[2]:+g} m of radius"]
    flown, linear = (np.linalg.norm(errors[0, 2]) for errors in (found.flown_error, found.linear_error))
    assert float(ratio[0]) == near(flown / linear, 5)
    approximated = rows["derivatives limited-memory: J0 over that of exact ones, less one"]
    change = found.variant_effort[1, 2] / found.variant_effort[1, 0] - 1.0
    assert float(approximated[4]) == pytest.approx(change, rel=0.06)


def test_what_was_not_solved_on_a_mesh_does_not_hide_the_rest(table):
    found = certificates()
    found.mesh_longitude_deviation[0, 1, 2] = np.nan
    rows = {name: rest for name, *rest in table("identities", certificates=found)}
    known = np.nanmax(found.mesh_longitude_deviation[0])
    cell = rows["longitude column, largest over schemes and meshes (m/m)"][0]
    assert float(cell) == pytest.approx(known, rel=0.05)


def test_other_perturbations_of_rows_and_of_designs(table):
    found, path = further(), tradeoff()
    rows = table("other_perturbations", further_perturbations=found, tradeoff=path)
    assert [head for head in rows[0] if head.endswith("by the sensitivity (m)")] == [
        f"{name}: final error by the sensitivity (m)"
        for name in (
            *("density 5 %", "velocity 10 m/s", "flight path angle 0.05 deg"),
            *("radius 1000 m", "crossrange 1000 m", "downrange 1000 m"),
        )
    ]
    names = column(rows, "sensitivity weighed")
    # The design without weight is the nominal, which is the first row already.
    assert names[0] == "radius: c1 = 0 (no-DOC)" and names[7:] == ["density", "density: the path ends at a weight"]
    assert float(column(rows, "J0")[2]) == near(path.effort[2], 4)
    assert float(column(rows, "J0")[7]) == near(found.design_effort[1], 4)
    linear = column(rows, "velocity 10 m/s: final error by")
    assert float(linear[3]) == near(np.linalg.norm(found.row_linear_error[3, 1]), 1)
    plus, minus = (float(part) for part in column(rows, "velocity 10 m/s: final error flown")[7].split(" / "))
    assert (plus, minus) == near(np.linalg.norm(found.design_flown_error[1, 1], axis=-1), 1)


def test_feedback_against_density(table):
    found = further(law=np.array(["no feedback", "a", "b", "c", "d"]))
    found.scaled_gain[0] = 0.0
    rows = table("density_feedback", further_perturbations=found)
    assert column(rows, "gains on")[0] == "none"
    assert float(column(rows, "density 5 %: by the sensitivity")[2]) == near(
        np.linalg.norm(found.law_linear_error[2, 0]), 1
    )
    assert float(column(rows, "density -1 %")[3]) == near(np.linalg.norm(found.density_flown_error[3, 1]), 1)
    assert float(column(rows, "radius +200 m")[4]) == near(np.linalg.norm(found.radius_flown_error[4, 0]), 1)


# ---- over all readings -----------------------------------------------------------------------------------------------


@pytest.fixture
def artifacts(desensitized):
    """Inputs and artifacts of all readings, made up; those of two readings are equal but for their gains."""
    found = {}
    for number, name in enumerate(READINGS):
        path = tradeoff(1 if name == "feedback_tuned" else number)
        records = Records(None, path, None, gains(), responses(), ensemble())
        found[name] = (desensitized.all_inputs(name), records)
    return found


def test_readings_are_told_apart_by_their_inputs(artifacts, desensitized_published):
    artifacts["printed"][1].gains.converged[:] = [True, True, False, False, True, True]
    artifacts["printed"][1].entry_errors.outcome[2, :5] = 1
    rows = well_formed(tables.readings(artifacts, desensitized_published))
    paper, *body = rows[1:]
    assert paper[2:7] == ("0.1374", "5.1784", "0.204", "8039", "2") and paper[8:10] == ("6172", "26.1")
    assert [row[0] for row in body] == list(READINGS)
    differing = dict(zip(READINGS, column(rows, "inputs that differ")[1:], strict=True))
    assert differing["corrected"] == ""
    assert differing["single_weight"] == "weight_factor 57.3, weight_rule proportional"
    assert differing["feedback_tuned"] == "gain_design tuned"
    assert "initial_bank_rate free" in differing["printed"] and "weight_path" in differing["printed"]
    assert "trials" not in " ".join(differing.values())
    unconverged = dict(zip(READINGS, column(rows, "gains that did not")[1:], strict=True))
    assert unconverged["printed"] == "gains against radius errors, gains against crossrange errors"
    lost = dict(zip(READINGS, column(rows, "trials lost")[1:], strict=True))
    assert lost["printed"] == "0, 0, 5, 0, 0, 0" and lost["corrected"] == "0, 0, 0, 0, 0, 0"
    path, flown = artifacts["mixed_units"][1].tradeoff, artifacts["mixed_units"][1].responses
    errors = np.linalg.norm(path.error, axis=1)
    row = body[READINGS.index("mixed_units")]
    assert float(row[2]) == near(path.effort[0], 4) and float(row[5]) == near(errors[0], 1)
    assert float(row[8]) == near(errors[4], 1)
    assert float(row[9]) == near(100.0 * (1.0 - errors.min() / errors[0]), 1)
    for channel, size in enumerate(flown.drawn_error):
        at_entry, *final = (float(part) for part in row[10 + channel].split(", "))
        assert at_entry == size
        assert final == near([np.linalg.norm(flown.error[law, channel, -1]) for law in (0, 2 + channel)], 1)


def test_weights_stand_row_by_row_and_share_lines(artifacts, desensitized_published):
    rows = well_formed(tables.weights(artifacts, desensitized_published))
    groups = {}
    for row in rows[1:]:
        groups.setdefault(row[0], []).append(row[1:])
    assert list(groups) == ["0 (no-DOC)", "0.001", "0.01", "0.1", "1", "infinity"]
    for lines in groups.values():
        assert lines[0][0] == "in the paper"
    lines = groups["0.1"]
    assert lines[0][5:9] == ("1.5603", "12.8236", "0.506", "6472")
    assert [line[0] for line in lines[1:]] == [
        *("printed", "single_weight", "corrected, feedback_tuned", "one_reversal", "mixed_units"),
    ]
    assert [line[1] for line in lines[1:]] == ["c = 1 c1", "c = 57.3 c1", *["at the printed J0"] * 3]
    assert lines[1][2] == "all, 0.001 km" and lines[3][2] == "radius, 3397 km" and lines[5][2] == "all, 1000 km"
    path = artifacts["one_reversal"][1].tradeoff
    assert float(lines[4][5]) == near(path.effort[3], 4) and lines[4][3:5] == ("5", "50")
    assert float(lines[4][8]) == near(np.linalg.norm(path.error[3]), 1)
    # Two weights stand for an infinite one, and nothing is in proportion to it.
    assert groups["infinity"][0][5] == "586.8673" and len(groups["infinity"]) == 1 + 2 * 5
    assert {line[1] for line in groups["infinity"][1:]} == {""}
    assert {line[2] for line in groups["0 (no-DOC)"][1:]} == {""}


def test_weights_of_an_own_reading_have_rows_of_their_own(artifacts, desensitized_published):
    inputs, records = artifacts["corrected"]
    own = replace(records.tradeoff, printed_weight=np.array([0.0, 0.001, 0.05, 0.1, 1.0, np.nan, np.nan]))
    rows = tables.weights(artifacts | {"mine": (inputs, replace(records, tradeoff=own))}, desensitized_published)
    lines = [row for row in rows[1:] if row[0] == "0.05"]
    assert [row[1] for row in lines] == ["in the paper", "mine"]
    assert lines[0][6:10] == (DASH,) * 4
