"""The gate for a table of any results."""

import pytest

from marsedl import cli

HEAD = "name,value,unit,standard_error\n"
TABLE = f"{HEAD}range,3.95,km,0.03\nmass,1349.4,kg,\n"


@pytest.fixture
def gate(tmp_path, monkeypatch, capsys):
    """A function that compares a table with the accepted one; returns the exit status and what was said."""
    monkeypatch.chdir(tmp_path)
    table = tmp_path / "results.csv"
    table.write_text(TABLE, encoding="utf-8")
    files = ["--numbers", "results.csv", "--reference", "kept/reference.json"]
    assert cli.main(["accept", *files]) == 0
    assert "2 numbers" in capsys.readouterr().out
    assert cli.main(["accept", *files[:3], "kept"]) == 2 and "kept is a folder" in capsys.readouterr().err

    def compared(text, *more):
        table.write_text(text, encoding="utf-8")
        status = cli.main(["verify", *files, *more])
        captured = capsys.readouterr()
        return status, captured.out + captured.err

    return compared


@pytest.mark.parametrize(
    ("rows", "status", "said"),
    [
        ("range,4.07,km,0.03\nmass,1349.4001,kg,", 0, "0 differ"),  # 2.8 errors of the difference; rounding
        ("range,4.08,km,0.03\nmass,1349.4,kg,", 1, "3.06 standard errors apart"),
        ("range,3.95,km,0.03\nmass,1349.5,kg,", 1, "it has no standard error"),
        ("range,3.95,m,0.03\nmass,1349.4,kg,", 1, "another unit"),
        ("range,3.95,km,0.03", 1, "it is gone"),
        ("range,3.95,km,0.03\nmass,1349.4,kg,\nfuel,1,kg,", 0, "fuel: new, not guarded"),
        ("range,5,km,1\nmass,1349.4,kg,", 0, "range: its standard error grew from 0.03 to 1"),
    ],
)
def test_a_number_may_move_by_its_error_and_nothing_goes_unsaid(gate, rows, status, said):
    found, text = gate(f"{HEAD}{rows}\n")
    assert (found, said in text) == (status, True), text


def test_the_tolerance_is_the_callers(gate):
    text = f"{HEAD}range,4.05,km,0.03\nmass,1349.4,kg,\n"
    assert [gate(text, "--tolerance", errors)[0] for errors in ("2se", "3se", "2", "3")] == [1, 0, 1, 0]
    assert gate(text, "--tolerance", "3 %")[0] == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name,value\na,1\n", "no column unit, standard_error"),
        (f'{HEAD}a,"0,03",km,\n', "line 2: a: value must be a number with a decimal point, not '0,03'"),
        (f"{HEAD}a,nan,km,\n", "must be finite"),
        (f"{HEAD}a,1,km,-1\n", "the error not negative"),
        (f"{HEAD}a,1,km,\na,2,km,\n", "line 3: a stands there twice"),
        (f"{HEAD}a,1,km\n", "line 2: must have 4 cells"),
        (f"{HEAD}a,1,km,0.1,2\n", "line 2: must have 4 cells"),
        (HEAD, "holds no numbers"),
    ],
)
def test_a_malformed_table_is_refused_in_one_line(gate, text, said):
    status, found = gate(text)
    assert status == 2
    assert found.startswith("marsedl: results.csv")
    assert said in found
    assert found.count("\n") == 1
