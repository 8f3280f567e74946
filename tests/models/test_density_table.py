from pathlib import Path

import numpy as np
import pytest

from marsedl.models.density_table import read_density_table

SHIPPED = Path(__file__).parents[2] / "data" / "atmosphere" / "mars_density.csv"
HEADER = "altitude_km,density_kg_m3\n"


@pytest.fixture
def write(tmp_path):
    def _write(text):
        path = tmp_path / "table.csv"
        path.write_text(text, encoding="utf-8")
        return path

    return _write


@pytest.mark.parametrize(
    ("source", "rows", "first", "last"),
    [
        ("marsgram_2021a_sample", 76, 1.664e-2, 1.148e-10),
        ("marsgram_2021a_sample_daily_mean", 76, 1.311e-2, 8.891e-11),
        ("cospar_nh_mean", 17, 1.550e-2, 4.730e-10),
        ("jezero_2021", 27, 1.466e-2, 7.281e-10),
    ],
)
def test_shipped_tables(source, rows, first, last):
    table = read_density_table(f"{SHIPPED}#{source}")
    assert table.shape == (rows, 2)
    assert table[0].tolist() == [0.0, first]
    assert table[-1, 1] == last
    np.testing.assert_array_equal(table, read_density_table(SHIPPED, source))


def test_own_table_with_comments_metres_and_other_columns(write):
    path = write("# my run\n\nwind , density_kg_m3, altitude_m\n# 1 row\n3,1e-2,0\n4, 5e-3 ,5000\n\n5,2e-3,10000\n")
    np.testing.assert_array_equal(read_density_table(path), [[0, 1e-2], [5000, 5e-3], [10000, 2e-3]])


def test_a_single_source_need_not_be_chosen(write):
    path = write("source,altitude_km,density_kg_m3\na,0,3\na,1,2\na,2,1\n")
    assert read_density_table(path).shape == (3, 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "columns must be density_kg_m3 and one of altitude_km, altitude_m .*found none"),
        (HEADER + "0,1\n1\n2,0.3\n", "table.csv, line 3: 1 values for 2 columns"),
        ("# note\n" + HEADER + "0,1\n1,thin\n2,0.3\n", "line 4: density_kg_m3 is not a number: 'thin'; write it"),
        (HEADER + "0,1\n1,nan\n2,0.3\n", "line 3: altitude 1000.0 m, density nan kg/m\\^3: not finite"),
        (HEADER + "0,1\n2,0.5\n1,0.3\n", "line 4: non-monotone density table: altitude 1000 m follows 2000 m; sort"),
        ("source,altitude_km,density_kg_m3\nb,0,1\na,0,1\n", "several sources; choose one by .*: a, b$"),
    ],
)
def test_bad_tables(write, text, message):
    with pytest.raises(ValueError, match=message):
        read_density_table(write(text))


def test_bad_choices_of_source(write):
    with pytest.raises(ValueError, match="no source 'jezero'; choose one of cospar_nh_mean, jezero_2021, marsgram"):
        read_density_table(f"{SHIPPED}#jezero")


def test_unreadable_files(tmp_path):
    with pytest.raises(ValueError, match=r"nowhere\.csv: there is no such density table"):
        read_density_table(tmp_path / "nowhere.csv")


@pytest.mark.parametrize(
    ("column", "other", "unit"), [("altitude_m", "altitude_km", 1), ("altitude_km", "altitude_m", 1e3)]
)
def test_altitudes_in_the_other_unit_are_asked_about(write, column, other, unit):
    path = write(f"{column},density_kg_m3\n0,1e-2\n{60 * unit},5e-5\n{125 * unit},2e-8\n")
    with pytest.raises(
        ValueError, match=rf"table\.csv: column {column}: the density falls .* name the column {other}$"
    ):
        read_density_table(path)
