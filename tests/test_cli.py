"""The command `marsedl`: what it says, what it returns, and what it does not import."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from marsedl import cli
from marsedl.papers import SLUGS, catalogue, input_model

ROOT = Path(__file__).parents[1]
HEAVY = ("numba", "casadi", "cvxpy", "matplotlib", "scipy", "h5py", "snakemake")


@pytest.fixture
def project(monkeypatch):
    monkeypatch.chdir(ROOT)


@pytest.fixture
def bare_project(tmp_path, monkeypatch):
    """A project in which nothing is built."""
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    for name in ("published", "atmosphere"):
        shutil.copytree(ROOT / "data" / name, tmp_path / "data" / name)
    (tmp_path / "Snakefile").touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(capsys, *arguments) -> str:
    """Run a command that must be refused in one line; returns that line."""
    assert cli.main(list(arguments)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("marsedl: ")
    assert captured.err.count("\n") == 1
    return captured.err


# --------------------------------------------------------------------------------------------------------------- list


def test_list_shows_all_there_is(project, capsys):
    assert cli.main(["list"]) == 0
    said = capsys.readouterr().out
    for slug in SLUGS:
        paper = catalogue(slug)
        for name in (slug, paper.title, "printed", "corrected", "based on corrected", *paper.figures):
            assert name in said
        for name in (*paper.tables, *paper.summaries, *paper.stages, *cli.TARGETS):
            assert name in said
    assert "density_blind_velocity_adjoint  Hypothesis" in said, "the longest name is apart from what follows"
    assert "  Eq. 77, element by element\n" in said, "an abbreviation ends no sentence"


def test_list_imports_nothing_heavy():
    """numpy alone comes with the checks of covariances."""
    code = (
        "import sys; from marsedl.cli import main; main(['list'])\n"
        f"print('imported', [name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "imported []"


def test_a_closed_pipe_is_no_error():
    """As in `marsedl list | head -1`."""
    command = f"{sys.executable} -m marsedl.cli list | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout == "powered_descent\n"
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
    assert "BrokenPipe" not in done.stderr


# ------------------------------------------------------------------------------------------------------------ explain


def explained(capsys, *arguments) -> str:
    assert cli.main(["explain", *arguments]) == 0
    return capsys.readouterr().out


def test_explain_a_figure(project, capsys):
    said = explained(capsys, "powered_descent", "fig07")
    assert "snakemake figures/powered_descent/fig07.png" in said
    order = [said.index(f"\n  {stage} ") for stage in ("nominal", "linearization", "gains", "montecarlo")]
    assert order == sorted(order)
    assert "assumed: descending; only then is the printed mean final mass met" in said
    assert "deg" in said  # the unit in which the angle is written
    assert "powered_descent_rates" in said or "figures:fig07" in said
    assert "ellipse_sigma" not in said, "fig07 draws no ellipse"


def test_explain_a_figure_of_another_paper(project, capsys):
    said = explained(capsys, "stochastic_entry", "fig12")
    assert "snakemake figures/stochastic_entry/fig12.png" in said
    order = [said.index(f"\n  {stage} ") for stage in ("nominal", "linearization", "gains", "montecarlo")]
    assert order == sorted(order)
    assert "entry_flight_path_angle_three_sigma_deg  0.5 " in said
    assert "assumed: the guidance period; the partition is not printed" in said
    assert "altitude_limit_study" not in said
    assert "stochastic_entry.figures:fig12" in said
    table = explained(capsys, "stochastic_entry", "tab04", "--reading", "marsgram_table")
    assert "data/atmosphere/mars_density.csv#marsgram_2021a_sample_daily_mean" in table


def test_explain_says_what_else_has_the_name(project, capsys):
    said = explained(capsys, "stochastic_entry", "error_budget")
    assert "snakemake figures/stochastic_entry/error_budget.png" in said
    assert "(also the name of a" in said
    assert " a stage)" in said


def test_explain_another_reading(project, capsys):
    said = explained(capsys, "powered_descent", "eq54", "--reading", "printed")
    assert "snakemake figures/powered_descent/printed/eq54.csv" in said
    assert "algorithm_1" in said


def test_explain_a_stage(project, capsys):
    said = explained(capsys, "powered_descent", "gains")
    assert "stage gains of powered_descent, reading corrected" in said
    assert "segment_durations" in said
    assert "ellipse_sigma" not in said


def test_explain_a_claim_with_and_without_a_verdict(bare_project, capsys):
    assert "no verdict yet: run 'snakemake claims'" in explained(capsys, "powered_descent", "prior_final_mass")
    result = {"value": 1349.4, "standard_error": None, "trials": None, "verdict": "differs", "evidence": "a sentence"}
    row = {"paper": "powered_descent", "id": "prior_final_mass", "verdict": "differs", "reading": "corrected"}
    row |= {
        "kind": "deterministic",
        "reason": "E10",
        "resolution": 1.0,
        "readings": {"corrected": {**result, "z": None}},
    }
    (bare_project / "report").mkdir()
    (bare_project / "report" / "claims.json").write_text(json.dumps([row]), encoding="utf-8")
    said = explained(capsys, "powered_descent", "prior_final_mass")
    assert "verdict: differs (reading corrected)" in said
    assert "a sentence" in said


def test_explain_an_own_reading(project, tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    entry = "gravity: {value: 3.9, source: 'assumed: mine'}"
    path.write_text(f"powered_descent: {{readings: {{mine: {{based_on: corrected, inputs: {{{entry}}}}}}}}}\n")
    said = explained(capsys, "powered_descent", "gains", "--reading", "mine", "--configfile", str(path))
    assert "3.9" in said
    assert "assumed: mine" in said


@pytest.mark.parametrize(
    ("arguments", "fragments"),
    [
        (["powerd_descent", "fig07"], ["no paper 'powerd_descent'", "did you mean 'powered_descent'?"]),
        (["powered_descent", "fig7"], ["no figure, table, stage or claim 'fig7'", "did you mean 'fig07'?"]),
        (["powered_descent", "fig07", "--reading", "corected"], ["no reading 'corected'", "'corrected'?"]),
        (["powered_descent", "fig07", "--configfile", "/none.yaml"], ["/none.yaml: cannot be read"]),
    ],
)
def test_explain_refuses_unknown_names(project, capsys, arguments, fragments):
    said = refused(capsys, "explain", *arguments)
    for fragment in fragments:
        assert fragment in said


def test_commands_outside_of_a_project_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert "is not inside a marsedl project" in refused(capsys, "explain", "powered_descent", "fig07")


def test_commands_work_in_a_folder_of_the_project(monkeypatch, capsys):
    monkeypatch.chdir(ROOT / "src" / "marsedl")
    for slug in SLUGS:
        assert "snakemake figures" in explained(capsys, slug, next(iter(catalogue(slug).figures)))
    assert Path.cwd() == ROOT / "src" / "marsedl"


def test_a_file_beside_the_working_directory_is_found(monkeypatch, tmp_path, capsys):
    """Its own path is relative to where the command is given, those in it to the project."""
    monkeypatch.chdir(ROOT / "docs")
    table = "data/atmosphere/mars_density.csv#jezero_2021"
    entries = f"density_profile: {{value: table, source: Fig. 1}}, density_table: {{value: '{table}', source: Fig. 1}}"
    path = tmp_path / "mine.yaml"
    path.write_text(f"stochastic_entry: {{readings: {{mine: {{based_on: corrected, inputs: {{{entries}}}}}}}}}\n")
    relative = os.path.relpath(path)
    said = explained(capsys, "stochastic_entry", "nominal", "--reading", "mine", "--configfile", relative)
    assert table in said


# --------------------------------------------------------------------------------------------------------------- diff


def test_diff_of_equal_and_different_tables(tmp_path, capsys):
    for name, value in (("a", "1.0"), ("b", "1.0"), ("c", "1.5")):
        (tmp_path / f"{name}.csv").write_text(f"quantity,value\nmass,{value}\n", encoding="utf-8")
    assert cli.main(["diff", str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]) == 0
    assert capsys.readouterr().out == "no difference\n"
    assert cli.main(["diff", str(tmp_path / "a.csv"), str(tmp_path / "c.csv")]) == 1
    said = capsys.readouterr().out
    assert "value" in said
    assert "at most 0.5" in said
    assert "there is no such file" in refused(capsys, "diff", str(tmp_path / "a.csv"), str(tmp_path / "none.csv"))


def test_diff_of_folders(tmp_path, capsys):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "same.csv").write_text("x\n1\n", encoding="utf-8")
    assert cli.main(["diff", str(tmp_path / "a"), str(tmp_path / "b")]) == 0
    (tmp_path / "a" / "more.csv").write_text("x\n1\n", encoding="utf-8")
    assert cli.main(["diff", str(tmp_path / "a"), str(tmp_path / "b")]) == 1
    assert "more.csv" in capsys.readouterr().out


# ---------------------------------------------------------------------------------------------------------- new paper


def test_a_new_paper_says_what_it_wrote_and_what_is_left(project, monkeypatch, capsys):
    written = []

    def write(root, *given):
        written.append(given)
        return [root / "configs" / "gravity_turn.yaml"]

    monkeypatch.setattr("marsedl.replication.scaffold.new_paper", write)
    assert cli.main(["new-paper", "gravity_turn", "--title", "Turns", "--authors", "A. Pilot"]) == 0
    assert cli.main(["new-paper", "gravity_turn"]) == 0
    assert written == [
        ("gravity_turn", "Turns", "A. Pilot"),
        ("gravity_turn", "Title to be given", "Authors to be named"),
    ]
    said = capsys.readouterr().out
    assert said.startswith("wrote configs/gravity_turn.yaml\n")
    assert "snakemake --config size=smoke gravity_turn claims" in said


def test_a_new_paper_cannot_take_the_name_of_another(project, capsys):
    said = refused(capsys, "new-paper", "funnels")
    assert "there is a paper 'funnels' already" in said


# -------------------------------------------------------------------------------------------------------------- trial


@pytest.mark.parametrize(
    ("arguments", "fragments"),
    [
        (["corrected", "12", "--case", "closed_lop"], ["no case 'closed_lop'", "did you mean 'closed_loop'?"]),
        (["printed", "12", "--case", "closed_loop_large"], ["reading printed has no case 'closed_loop_large'"]),
        (["corrected", "2000"], ["trial 2000", "0 to 1999"]),
        (["corrected", "-1"], ["trial -1", "0 to 1999"]),
        (["corected", "1"], ["no reading 'corected'"]),
        (["corrected", "1"], ["is not built yet; run 'snakemake data/cache/powered_descent/corrected/gains.h5'"]),
    ],
)  # fmt: skip
def test_trial_refuses_what_there_is_not(bare_project, capsys, monkeypatch, arguments, fragments):
    (bare_project / "src").mkdir()
    monkeypatch.setattr("marsedl.replication.jobs.pin_numerics", lambda root: None)  # this process is up already
    said = refused(capsys, "trial", "powered_descent", *arguments)
    for fragment in fragments:
        assert fragment in said


@pytest.mark.parametrize(
    ("arguments", "case"),
    [
        (["7"], "apollo_time"),
        (["apollo_velocity", "7"], "apollo_velocity"),
        (["7", "--case", "stochastic_time"], "stochastic_time"),
        (["--case", "stochastic_time", "7"], "stochastic_time"),
    ],
)
def test_trial_takes_the_case_as_a_word_or_an_option(project, monkeypatch, arguments, case):
    flown = []
    monkeypatch.setattr("marsedl.replication.jobs.pin_numerics", lambda root: None)
    monkeypatch.setattr("marsedl.replication.jobs.replay", lambda *given: flown.append(given[3:5]))
    assert cli.main(["trial", "stochastic_entry", "corrected", *arguments]) == 0
    assert flown == [(case, 7)]


def test_a_request_that_is_none_is_refused(capsys):
    for arguments in ([], ["lst"], ["trial", "powered_descent", "corrected", "twelve"]):
        with pytest.raises(SystemExit) as caught:
            cli.main(arguments)
        assert caught.value.code == 2
    assert "invalid int value: 'twelve'" in capsys.readouterr().err


# ------------------------------------------------------------------------------------------------ in the built project


@pytest.mark.workflow
def test_a_trial_of_the_built_tree_is_the_same_to_the_last_bit(tree):
    done = tree.marsedl("trial", "powered_descent", "corrected", "12")
    assert done.returncode == 0, done.stderr
    assert "trial 12 of closed_loop: completed" in done.stdout
    assert "the same to the last bit as in the stored ensemble" in done.stdout
    done = tree.marsedl("trial", "powered_descent", "printed", "12", "--case", "open_loop")
    assert "the same to the last bit as in the stored ensemble" in done.stdout, done.stderr


@pytest.mark.workflow
@pytest.mark.parametrize("case", input_model("stochastic_entry").CASES)
def test_an_entry_of_the_built_tree_is_the_same_to_the_last_bit(tree, case):
    done = tree.marsedl("trial", "stochastic_entry", "corrected", case, "7")
    assert f"trial 7 of {case}: completed" in done.stdout, done.stderr
    assert "bank reversals" in done.stdout
    assert "the same to the last bit as in the stored ensemble" in done.stdout


@pytest.mark.workflow
def test_a_trial_under_several_laws_is_the_same_under_each(tree):
    done = tree.marsedl("trial", "random_field", "corrected", "150")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("the same to the last bit as in the stored ensemble") == 4
    assert "trial 150, law of iteration 3: captured" in done.stdout


@pytest.mark.workflow
def test_a_trial_beyond_the_stored_ensemble_is_flown_without_comparison(tree):
    """The tree holds 200 trials, the reading has 2000."""
    done = tree.marsedl("trial", "powered_descent", "corrected", "1500")
    assert done.returncode == 0, done.stderr
    assert "trial 1500 of closed_loop: completed" in done.stdout
    assert "the same" not in done.stdout


@pytest.mark.workflow
def test_a_claim_of_the_built_tree_shows_its_verdict(tree):
    done = tree.marsedl("explain", "powered_descent", "prior_final_mass")
    assert "verdict: " in done.stdout, done.stderr
    assert os.linesep + "    printed " in done.stdout
    done = tree.marsedl("explain", "stochastic_entry", "tab4_downrange_apollo_time")
    assert "verdict: " in done.stdout, done.stderr
    assert os.linesep + "    marsgram_table  " in done.stdout
