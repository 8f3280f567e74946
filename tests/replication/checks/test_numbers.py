"""The gate for a table of any results."""

import json

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
        ("range,4.5,km,0.25\nmass,1349.4,kg,", 0, "range: its standard error grew from 0.03 to 0.25"),
        ("range,3.95,km,0.31\nmass,1349.4,kg,", 1, "its error grew beyond 10 times"),
        ("range,4000,km,1e9\nmass,1349.4,kg,", 1, "its error grew beyond 10 times"),
        ("range,3.95,km,0.03\nmass,5000,kg,1e9", 1, "it was exact"),
        ("range,3.95,km,0.03\nmass,1349.4,kg,1e-9", 1, "it was exact"),
        ("range,3.95,km,\nmass,1349.4,kg,", 0, "0 differ"),  # an error that is gone widens nothing
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


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{}", "holds no numbers, so nothing would be compared"),
        ("[]", "holds no numbers, so nothing would be compared"),
        ('{"": "sha256 0123456789abcdef"}', "was edited after 'marsedl accept' wrote it"),
        ("", "is no reference of numbers"),
        ("[1]", "is no reference of numbers"),
    ],
)
def test_a_reference_that_guards_nothing_is_refused(gate, tmp_path, text, said):
    (tmp_path / "kept" / "reference.json").write_text(text, encoding="utf-8")
    status, found = gate(TABLE)
    assert (status, said in found) == (2, True), found
    assert found.count("\n") == 1


def test_an_edited_reference_is_no_reference(gate, tmp_path):
    """Another layout of the same entries is none of an edit; one without a digest is of an earlier version."""
    path = tmp_path / "kept" / "reference.json"
    text = path.read_text(encoding="utf-8")
    path.write_text(json.dumps(json.loads(text), indent=4), encoding="utf-8")
    assert gate(TABLE)[0] == 0
    for old, new in (("3.95", "3.96"), ('"standard_error": 0.03', '"standard_error": 3000.0'), ("range", "reach")):
        path.write_text(text.replace(old, new), encoding="utf-8")
        status, found = gate(TABLE)
        assert status == 2 and "was edited after 'marsedl accept' wrote it" in found
    entries = json.loads(text)
    del entries[""]
    path.write_text(json.dumps(entries), encoding="utf-8")
    assert gate(TABLE)[0] == 0
