"""Other machines: what is asked for, what is compared, and the table that is committed."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest

from marsedl import cli
from marsedl.papers import SLUGS, catalogue
from marsedl.replication import jobs, machines
from marsedl.replication.errors import InputError, MarsedlError
from marsedl.replication.machines import HEADER, MACHINES, Machine
from marsedl.replication.sizes import build_folder
from marsedl.replication.tables import read_table
from marsedl.replication.verification import Change, Comparison

ROOT = Path(__file__).parents[2]


def comparison(changes=(), margins=None, by_shape=()):
    return Comparison(list(changes), margins or {}, set(by_shape))


# -------------------------------------------------------------------------------------------------- what is asked for


def test_instruction_sets_are_set_and_others_of_the_caller_are_taken_away():
    environment = Machine("m", {"OPENBLAS_CORETYPE": "Prescott"}).environment
    assert environment["MARSEDL_UNPINNED"] == "1"
    assert environment["OPENBLAS_CORETYPE"] == "Prescott"
    assert {name for name, value in environment.items() if value is None} == {*jobs.INSTRUCTION_SETS} - {
        "OPENBLAS_CORETYPE"
    }


def test_another_python_runs_with_the_pinned_instruction_sets():
    assert Machine("m", python="bin/python").environment == {"MARSEDL_UNPINNED": None}


@pytest.mark.parametrize("machine", MACHINES.values(), ids=MACHINES)
def test_machines_change_instruction_sets_alone(machine):
    assert set(machine.instruction_sets) <= set(jobs.INSTRUCTION_SETS)
    assert all(name in machine.setting() for name in machine.instruction_sets)


def test_the_setting_of_another_python_is_its_versions():
    assert Machine("m").setting().startswith(f"Python {sys.version.split()[0]}, numpy ")


def test_a_python_without_the_libraries_is_refused_by_path(tmp_path):
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} -I -S "$@"\n')
    python.chmod(0o755)
    with pytest.raises(MarsedlError, match=rf"{python}: lacks some of the libraries; it says:\n(.*\n)*.*numpy"):
        Machine("m", python=str(python)).setting()


def test_all_machines_are_taken_unless_some_are_named(monkeypatch):
    monkeypatch.setattr(machines, "_has", lambda feature: True)
    named = f"older={sys.executable}"
    assert [machine.name for machine in machines.select([])] == list(MACHINES)
    assert [machine.name for machine in machines.select(["sse"])] == ["sse"]
    assert [machine.name for machine in machines.select([], [named])] == ["older"]
    assert [machine.name for machine in machines.select(["sse"], [named])] == ["sse", "older"]


def test_a_machine_beyond_this_processor_is_refused(monkeypatch):
    monkeypatch.setattr(machines, "_has", lambda feature: False)
    with pytest.raises(InputError, match="'avx512' cannot be run on a processor without avx512f; name others"):
        machines.select(["avx512"])
    assert machines.select(["sse"])


@pytest.mark.parametrize("text", ["older", "older=/nowhere", f"sse={sys.executable}", f"a b={sys.executable}", "=x"])
def test_libraries_are_named_once_and_exist(text):
    with pytest.raises(InputError, match=r"give a new name and a Python, as in older=build"):
        machines.select([], [text])


def test_an_unknown_machine_ends_in_a_message(capsys):
    assert cli.main(["machines", "sse2"]) == 2
    assert "there is no machine 'sse2'; did you mean 'sse'?" in capsys.readouterr().err


# --------------------------------------------------------------------------------------------------- what is compared


def test_rows_hold_the_worst_margin_of_every_artifact_over_readings():
    rows = machines.rows(
        "sse",
        "X=1",
        "p",
        comparison(
            [Change("c, printed", "holds", "fails", 2.0, verdict=True), Change("printed/gains/K", "1", "2", 30.0)],
            {
                "claims/c/printed": 2.0,
                "corrected/gains/K": 0.25,
                "printed/gains/K": 30.0,
                "printed/gains/S": 0.0,
                "corrected/nominal/mass": 0.0,
                "corrected/nominal/noise": 1e9,
            },
            ["corrected/nominal/noise"],
        ),
        verdicts=12,
    )
    assert [row[3:] for row in rows] == [
        ("verdicts", "12", "1", "", "c, printed"),
        ("claims", "1", "1", "2.0e+00", "c/printed"),
        ("gains", "3", "1", "3.0e+01", "printed/K"),
        ("nominal", "1", "0", "0.0e+00", ""),
    ]
    assert {row[:3] for row in rows} == {("sse", "X=1", "p")}


def test_a_number_that_one_build_lacks_is_beyond_tolerance():
    lost = Change("corrected/gains/K", "1", "–", float("inf"))
    rows = machines.rows("sse", "X=1", "p", comparison([lost], {"corrected/gains/S": 0.5}), verdicts=0)
    assert rows[1][3:] == ("gains", "2", "1", "inf", "corrected/K")


def test_stored_rows_replace_those_of_the_same_machine_and_paper(tmp_path):
    def row(machine, margin, paper="p"):
        return (machine, "X=1", paper, "gains", "1", "0", margin, "")

    (tmp_path / "data" / "reference").mkdir(parents=True)
    machines.store(tmp_path, [row("sse", "1"), row("sse", "5", "q"), row("older", "2")])
    machines.store(tmp_path, [row("sse", "3"), row("newer", "4")])
    with (tmp_path / machines.TABLE).open(encoding="utf-8") as file:
        stored = [tuple(line) for line in csv.reader(file)]
    assert stored == [HEADER, row("sse", "5", "q"), row("sse", "3"), row("older", "2"), row("newer", "4")]


@pytest.fixture
def builds(tmp_path, monkeypatch):
    """A project whose builds, which are recorded, hold what `numbers` says of each machine."""
    recorded, numbers = [], {"pinned": 1.0, "sse": 1.0}

    def snakemake(folder, *arguments, **settings):
        recorded.append((folder.name, arguments[0], settings["MARSEDL_UNPINNED"]))
        result = {"value": numbers[folder.name], "standard_error": None, "verdict": "holds", "evidence": ""}
        texts = ("paper", "id", "where", "quantity", "unit", "kind", "verdict", "reading", "reason")
        rows = [
            {
                **dict.fromkeys(texts, "c"),
                "printed": 1.0,
                "resolution": None,
                "trials": None,
                "readings": {"corrected": result},
            }
        ]
        build = build_folder(folder, "smoke")
        (build / "report" / "claims").mkdir(parents=True)
        (build / arguments[0]).write_text(json.dumps(rows), encoding="utf-8")
        return subprocess.CompletedProcess(arguments, numbers.get("code", 0), "why it failed", "")

    monkeypatch.setattr(machines, "snakemake", snakemake)
    (tmp_path / "configs").mkdir()
    (tmp_path / "Snakefile").touch()
    monkeypatch.chdir(tmp_path)
    return recorded, numbers


def test_the_pinned_build_comes_first_and_what_differs_is_told(builds, capsys):
    recorded, numbers = builds
    command = ["machines", "sse", "--paper", "powered_descent"]
    assert cli.main(command) == 0
    target = "report/claims/powered_descent.json"
    assert recorded == [("pinned", target, None), ("sse", target, "1")]
    assert [row[2:] for row in read_table(machines.TABLE)[1:]] == [
        ["powered_descent", "verdicts", "1", "0", "", ""],
        ["powered_descent", "claims", "1", "0", "0.0e+00", ""],
    ]
    numbers["sse"] = 1.001
    assert cli.main(command) == 1
    assert "c/corrected" in capsys.readouterr().out
    numbers["code"] = 1
    assert cli.main(command) == 2
    assert "failed:\nwhy it failed" in capsys.readouterr().err


# ------------------------------------------------------------------------------------------------ the committed table


@pytest.fixture(scope="module")
def committed():
    with (ROOT / machines.TABLE).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def explained():
    """The first cells of the rows of all tables in the page, without the marks of code."""
    text = (ROOT / "docs" / "reproducibility.md").read_text(encoding="utf-8")
    rows = [line.replace("`", "").strip("|").split("|") for line in text.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in row] for row in rows]


def test_the_committed_table_says_what_the_machines_are(committed):
    settings = {row["machine"]: row["setting"] for row in committed}
    assert "sse" in settings
    for name, setting in settings.items():
        assert setting == MACHINES[name].setting() if name in MACHINES else setting.startswith("Python 3.")


def test_the_committed_table_has_every_artifact_of_a_paper(committed):
    assert {row["paper"] for row in committed if row["machine"] == "sse"} == set(SLUGS)
    for machine, slug in {(row["machine"], row["paper"]) for row in committed}:
        mine = [row["artifact"] for row in committed if (row["machine"], row["paper"]) == (machine, slug)]
        stages = {"montecarlo" if stage.startswith("montecarlo") else stage for stage in catalogue(slug).stages}
        # Stages that came after the table was measured are missing until it is measured anew.
        assert (
            {"verdicts", "claims"} <= {artifact.split(".")[0] for artifact in mine} <= {"verdicts", "claims", *stages}
        )


def test_verdicts_change_on_another_machine_only_where_the_page_says_why(committed, explained):
    reasons = {row[0] for row in explained if len(row) == 2}
    verdicts = [row for row in committed if row["artifact"] == "verdicts"]
    assert all(int(row["numbers"]) > 50 for row in verdicts)
    changed_claims = {name for row in verdicts for name in row["worst"].split("; ") if name}
    assert sum(int(row["beyond"]) for row in verdicts) == sum(
        len(row["worst"].split("; ")) for row in verdicts if row["worst"]
    )
    assert changed_claims == reasons


def test_numbers_are_beyond_their_tolerance_only_where_the_page_says_why(committed, explained):
    reasons = {tuple(row[:2]) for row in explained if len(row) == 4}
    numbers = [row for row in committed if row["margin"]]
    assert all((float(row["margin"]) > 1) == (row["beyond"] != "0") for row in numbers)
    assert {(row["paper"], row["artifact"]) for row in numbers if row["beyond"] != "0"} == reasons


def test_other_instruction_sets_give_other_bits(committed):
    """Numbers that are the same to the last bit would mean that nothing was switched."""
    for machine in MACHINES.keys() & {row["machine"] for row in committed}:
        assert any(float(row["margin"] or 0) > 0 for row in committed if row["machine"] == machine)
