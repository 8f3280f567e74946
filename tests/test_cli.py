"""The command `marsedl`: what it says, what it returns, and what it does not import."""

import json
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from marsedl import cli, overview
from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.claims.moved import Entry, Moved
from marsedl.replication.claims.printed import load_published
from marsedl.replication.pipeline.numerics import NUMERIC_ENVIRONMENT
from marsedl.replication.records import store
from marsedl.replication.universes.designs import Universe
from marsedl.replication.universes.table import Outcome, Row, table_of

ROOT = Path(__file__).parents[1]
HEAVY = ("numba", "casadi", "cvxpy", "matplotlib", "scipy", "h5py", "snakemake")


@pytest.fixture(autouse=True)
def process(monkeypatch):
    """A terminal so wide that nothing is cut, and numerics that stay as they are, as this process is up already."""
    monkeypatch.setenv("COLUMNS", "10000")
    monkeypatch.setattr("marsedl.replication.pipeline.numerics.pin_numerics", lambda root: None)


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


def said(capsys, *arguments) -> str:
    """Run a command that must succeed; returns what it says."""
    assert cli.main(list(arguments)) == 0
    return capsys.readouterr().out


def explained(capsys, *arguments) -> str:
    return said(capsys, "explain", *arguments)


def refused(capsys, *arguments) -> str:
    """Run a command that must be refused in one line; returns that line."""
    assert cli.main(list(arguments)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("marsedl: ")
    assert captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("list --size smok", "no such size; did you mean 'smoke'?"),
        ("list funels", "did you mean 'funnels'?"),
        ("explain powerd_descent fig07", "no paper 'powerd_descent'; did you mean 'powered_descent'?"),
        ("explain powered_descent fig7", "no figure, table, stage or claim 'fig7'; did you mean 'fig07'?"),
        ("explain powered_descent fig07 --reading corected", "no reading 'corected'; did you mean 'corrected'?"),
        ("explain powered_descent fig07 --configfile /none.yaml", "/none.yaml: cannot be read"),
        ("trial powered_descent corrected 12 --case closed_lop", "'closed_lop'; did you mean 'closed_loop'?"),
        ("trial powered_descent printed 12 --case closed_loop_large", "printed has no case 'closed_loop_large'"),
        ("trial powered_descent corrected 2000", "trial 2000: case closed_loop has the trials 0 to 1999"),
        ("trial powered_descent corrected -1", "trial -1: case closed_loop has the trials 0 to 1999"),
        ("trial powered_descent corected 1", "no reading 'corected'"),
        (
            "trial powered_descent corrected 1",
            "is not built yet; run 'snakemake data/cache/powered_descent/corrected/nominal.h5'",
        ),
    ],
)
def test_what_there_is_not_is_refused_with_the_nearest(bare_project, capsys, words, message):
    assert message in refused(capsys, *words.split())


def test_a_new_paper_cannot_take_the_name_of_another(project, capsys):
    assert "'funnels' is the name of a paper, rule or module already" in refused(capsys, "new-paper", "funnels")


def test_commands_outside_of_a_project_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert "is not inside a marsedl project" in refused(capsys, "explain", "powered_descent", "fig07")


# --------------------------------------------------------------------------------------------------------------- list


def test_list_counts_what_every_paper_has(project, capsys):
    output = said(capsys, "list")
    for slug in SLUGS:
        paper = catalogue(slug)
        assert f"{slug}\n  {paper.title}\n  {paper.authors}\n" in output
        assert f"{len(paper.figures)} figures, {len(paper.tables) + 1} tables" in output
    assert output.splitlines()[-1] == "targets: " + ", ".join([*cli.TARGETS, *SLUGS])
    assert len(output.splitlines()) < 40


@pytest.mark.parametrize("slug", ["powered_descent", "stochastic_entry"])
def test_list_shows_all_of_a_paper(project, capsys, slug):
    output = said(capsys, "list", slug)
    paper, inputs = catalogue(slug), input_model(slug)
    names = ["printed", "corrected", *paper.figures, *paper.tables, *paper.stages, *inputs.CASES]
    for name in [*names, *(claim.id for claim in load_published(ROOT / "data" / "published" / f"{slug}.yaml"))]:
        assert f"\n    {name} " in output


def test_list_shows_one_kind_of_one_paper_or_of_all(project, capsys):
    output = said(capsys, "list", "stochastic_entry", "--figures")
    assert output.startswith("stochastic_entry\n\n  figures (snakemake figures/stochastic_entry/NAME.png, or ")
    assert "\n    zf " not in output, "a table"
    output = said(capsys, "list", "stochastic_entry", "--tables")
    assert "\n    zf " in output
    assert "of Eq. 77, element by element\n" in output, "an abbreviation ends no sentence"
    output = said(capsys, "list", "--cases")
    assert re.search(r"\n    closed_loop +2,000 trials +input ensemble\.trials: \S", output)
    assert re.search(r"\n    aerocapture +[\d,]+ trials +input simulation\.trials: \S", output)


def test_list_shows_the_trials_of_a_size(project, capsys):
    output = said(capsys, "list", "powered_descent", "--cases", "--size", "smoke")
    assert re.search(r"\n    closed_loop +200 trials", output)
    assert "add --config size=smoke)" in output


def test_every_claim_has_its_own_words_in_a_line_that_fits(project, capsys):
    """Also of headlines, of which a build knows a finding; where nothing limits the width."""
    for slug in SLUGS:
        lines = said(capsys, "list", slug, "--claims").splitlines()
        lines = [line for line in lines if line.startswith("    ")]
        claims = load_published(ROOT / "data" / "published" / f"{slug}.yaml")
        assert [line.split()[0] for line in lines] == [one.id for one in claims]
        assert all(line.endswith(f"  {one.plain or one.quantity}") for line, one in zip(lines, claims, strict=True))


@pytest.mark.parametrize("width", [80, 100])
def test_tables_fit_the_terminal(project, capsys, monkeypatch, width):
    monkeypatch.setenv("COLUMNS", str(width))
    for arguments in (["list", "powered_descent"], ["list", "--claims"], ["explain", "powered_descent", "fig07"]):
        lines = said(capsys, *arguments).splitlines()
        rows = [line for line in lines if re.match(r" {4}\S+  +\S| {2}[a-z]+_[a-z_]+  +\S", line)]
        assert len(rows) > 20
        assert max(map(len, rows)) <= width


def test_list_imports_nothing_heavy():
    code = (
        "import sys; from marsedl.cli import main; main(['list'])\n"
        "assert not {'numpy', 'pydantic'} & sys.modules.keys()\n"  # numerics are pinned before; counting needs neither
        "main(['list', '--claims']); main(['explain', 'funnels'])\n"
        f"print('imported', [name for name in {HEAVY!r} if name in sys.modules])"
    )
    process = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert process.stdout.splitlines()[-1] == "imported []"


def test_results_and_claims_import_nothing_that_compiles_or_optimises():
    code = """
import pkgutil, sys
from importlib import import_module

from marsedl import results
from marsedl.papers import SLUGS

for slug in SLUGS:
    claims = import_module(f"marsedl.papers.{slug}.claims")
    for module in pkgutil.iter_modules(claims.__path__, f"{claims.__name__}."):
        import_module(module.name)
print("imported", {"numba", "casadi", "cvxpy"} & {*sys.modules})
"""
    process = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert process.stdout.splitlines()[-1] == "imported set()"


def test_a_closed_pipe_is_no_error():
    """As in `marsedl list | head -1`."""
    command = f"{sys.executable} -m marsedl.cli list | head -1; exit ${{PIPESTATUS[0]}}"
    process = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert process.stdout == "powered_descent\n"  # of a pipe, whose reader has gone before the second line
    assert process.returncode == 0
    assert process.stderr == ""


# ------------------------------------------------------------------------------------------------------------ explain


def test_explain_a_figure(project, capsys):
    output = explained(capsys, "powered_descent", "fig05")
    assert "snakemake figures/powered_descent/fig05.png" in output
    order = [output.index(f"\n  {name} ") for name in ("nominal", "linearization", "gains", "montecarlo.closed_loop")]
    assert order == sorted(order)
    assert "assumed: descending; only then is the printed mean final mass met" in output
    assert "deg" in output  # the unit in which the angle is written
    assert "powered_descent.figures:fig05\n" in output
    assert "ellipse_sigma" not in output, "fig05 draws no ellipse"
    assert re.search(r"\n    trials +2000 ", output), "the number of trials of the case that it shows"
    assert "large_trials" not in output, "of another case"


def test_explain_shows_what_a_size_limits(project, capsys):
    output = explained(capsys, "powered_descent", "fig07", "--size", "smoke")
    assert re.search(r"\n    trials +2000 \(size smoke: 200\) ", output)
    assert re.search(r"\n    gravity +3.71  ", output)
    assert "\n  snakemake figures/powered_descent/fig07.png --config size=smoke\n" in output


def test_explain_a_paper_shows_inputs_that_readings_change_and_no_others(bare_project, capsys):
    output, paper = explained(capsys, "powered_descent"), catalogue("powered_descent")
    assert output.startswith(f"{paper.slug}: {paper.title}\n  {paper.authors}\n  snakemake {paper.slug}\n\nreadings\n")
    assert all(f"\n  {name} " in output for name in cli.Project().studies[paper.slug].readings)
    assert f"{len(paper.figures)} figures" in output
    assert re.search(r"\n  mission\.final_covariance +\[5.0, .*  target4 \[4.0, 0.25, 0.25, 0.25\]", output)
    assert "printed [5.0" not in output, "it has the same target"
    assert "specific_impulse" not in output, "no reading changes it"
    assert "none yet: run 'snakemake report/claims/powered_descent.json'" in output
    remedy = "none yet: run 'snakemake report/claims/powered_descent.json --config size=smoke'"
    assert remedy in explained(capsys, "powered_descent", "--size", "smoke")


def test_explain_a_paper_counts_verdicts_of_the_size_that_is_asked_for(bare_project, capsys):
    write_verdicts(bare_project, claim_row(id="a"), claim_row(id="b"), claim_row(id="c", verdict="reproduced"))
    write_verdicts(bare_project / "build" / "smoke", claim_row(id="a", verdict="close"))
    assert "\n  counted: 1 reproduced, 2 differs\n" in explained(capsys, "powered_descent")
    assert "\n  counted: 1 close\n" in explained(capsys, "powered_descent", "--size", "smoke")
    assert "\n  none yet: run 'snakemake report/claims/funnels.json'\n" in explained(capsys, "funnels")


def test_explain_reads_the_claims_of_a_paper_that_was_built_alone(bare_project, capsys):
    """Also those that are newer than the claims of all papers."""
    own = write_verdicts(bare_project, claim_row(id="a", verdict="close"), name="claims/powered_descent.json")
    assert "\n  counted: 1 close\n" in explained(capsys, "powered_descent")
    whole = write_verdicts(bare_project, claim_row(id="a"))
    for seconds, verdict in ((-10, "close"), (10, "differs")):
        os.utime(whole, (own.stat().st_mtime + seconds,) * 2)
        assert f"\n  counted: 1 {verdict}\n" in explained(capsys, "powered_descent")


def test_explain_says_what_else_has_the_name(project, capsys):
    output = explained(capsys, "stochastic_entry", "certificates")
    assert "snakemake figures/stochastic_entry/certificates.csv" in output
    assert "(also the name of a" in output
    assert " a stage)" in output


def claim_row(**values) -> dict:
    """A row of `report/claims.json`."""
    result = {"value": 1349.4, "standard_error": None, "trials": None, "verdict": "differs", "evidence": ["a sentence"]}
    row = {"paper": "powered_descent", "id": "prior_final_mass", "verdict": "differs", "reading": "corrected"}
    row |= {"where": "Sec. V", "quantity": "mass", "unit": "kg", "kind": "deterministic", "printed": 1346.0}
    return {**row, "reason": "E10", "resolution": 1.0, "readings": {"corrected": result}, **values}


def write_verdicts(folder, *rows, name="claims.json") -> Path:
    path = folder / "report" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(rows), encoding="utf-8")
    return path


def test_explain_a_claim_with_and_without_a_verdict(bare_project, capsys):
    assert "no verdict yet: run 'snakemake report/claims/powered_descent.json'" in explained(
        capsys, "powered_descent", "prior_final_mass"
    )
    write_verdicts(bare_project, claim_row())
    output = explained(capsys, "powered_descent", "prior_final_mass")
    assert "verdict: differs (reading corrected)" in output
    assert "a sentence" not in output
    assert "a sentence" in explained(capsys, "powered_descent", "prior_final_mass", "--evidence")


@pytest.mark.parametrize(
    ("arguments", "printed"),
    [
        (["powered_descent", "prior_final_mass"], "Sec. V, below Eq. 54; printed 1346 kg (deterministic)"),
        (["random_field", "dint_constraint_slopes"], "; printed [-0.5, 0.5] (deterministic)"),
        (["stochastic_entry", "ou_resembles_marsgram"], "; a statement (undetermined)"),
    ],
)
def test_explain_a_claim_says_what_is_printed(bare_project, capsys, arguments, printed):
    assert printed in explained(capsys, *arguments).splitlines()[1]


@pytest.mark.parametrize("content", ["", "{}"])
def test_explain_refuses_damaged_verdicts_with_a_remedy(bare_project, capsys, content):
    path = write_verdicts(bare_project)
    path.write_text(content, encoding="utf-8")
    message = refused(capsys, "explain", "powered_descent")
    assert message.startswith(f"marsedl: {path}: ")
    assert message.endswith("; delete the file and run 'snakemake claims'\n")


def test_explain_an_own_reading(project, own_reading, tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    path.write_text(own_reading("powered_descent", "mine", gravity="3.9"), encoding="utf-8")
    output = explained(capsys, "powered_descent", "gains", "--reading", "mine", "--configfile", str(path))
    assert "3.9" in output
    assert "assumed: test" in output
    explanation = explained(capsys, "powered_descent", "fig07", "--reading", "mine", "--configfile", str(path))
    assert f"\n  snakemake figures/powered_descent/mine/fig07.png --configfile {path}\n" in explanation


def test_a_file_beside_the_working_directory_is_found(monkeypatch, tmp_path, capsys):
    """Its own path is relative to where the command is given, those in it to the project."""
    monkeypatch.chdir(ROOT / "docs")
    table = "data/atmosphere/mars_density.csv#jezero_2021"
    entries = f"density_profile: {{value: table, source: Fig. 1}}, density_table: {{value: '{table}', source: Fig. 1}}"
    path = tmp_path / "mine.yaml"
    path.write_text(f"stochastic_entry: {{readings: {{mine: {{based_on: corrected, air: {{{entries}}}}}}}}}\n")
    relative = os.path.relpath(path)
    output = explained(capsys, "stochastic_entry", "nominal", "--reading", "mine", "--configfile", relative)
    assert table in output


# --------------------------------------------------------------------------------------------------------------- diff


def test_diff_of_equal_and_different_tables(tmp_path, capsys):
    for name, value in (("a", "1.0"), ("b", "1.0"), ("c", "1.5")):
        (tmp_path / f"{name}.csv").write_text(f"quantity,value\nmass,{value}\n", encoding="utf-8")
    assert said(capsys, "diff", str(tmp_path / "a.csv"), str(tmp_path / "b.csv")) == "no difference\n"
    assert cli.main(["diff", str(tmp_path / "a.csv"), str(tmp_path / "c.csv")]) == 1
    output = capsys.readouterr().out
    assert "value" in output
    assert "at most 0.5" in output
    assert "the file does not exist" in refused(capsys, "diff", str(tmp_path / "a.csv"), str(tmp_path / "none.csv"))


# -------------------------------------------------------------------------------------------------------------- trial


def test_the_remedy_of_a_trial_builds_the_size_and_the_readings_that_were_asked_for(bare_project, own_reading, capsys):
    path = bare_project / "my own.yaml"
    path.write_text(own_reading("powered_descent", "mine", gravity="3.9"), encoding="utf-8")
    arguments = ("powered_descent", "mine", "12", "--size", "smoke", "--configfile", str(path))
    message = refused(capsys, "trial", *arguments)
    target = "data/cache/powered_descent/mine/nominal.h5"
    assert f"{bare_project / 'build' / 'smoke' / target} is not built yet" in message
    assert f"run 'snakemake {target} --config size=smoke --configfile 'my own.yaml'' first" in message
    assert "trial 300: case closed_loop has the trials 0 to 199" in refused(
        capsys, "trial", "powered_descent", "mine", "300", *arguments[3:]
    )


def test_a_trial_of_a_paper_without_flights_is_refused(bare_project, capsys, monkeypatch):
    monkeypatch.setattr(input_model("funnels"), "CASES", {})
    config = bare_project / "configs" / "funnels.yaml"
    text, number = re.subn(r"(?m)^chunks: .*$", "chunks: {}", config.read_text(encoding="utf-8"))
    assert number == 1
    config.write_text(text, encoding="utf-8")
    monkeypatch.setitem(sys.modules, "marsedl.papers.funnels.montecarlo", None)  # which then cannot be imported
    message = refused(capsys, "trial", "funnels", "corrected", "1")
    assert message == "marsedl: funnels has no Monte Carlo flights; 'marsedl list --cases' shows which do\n"


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
    trials = []
    monkeypatch.setattr("marsedl.replication.pipeline.runner.replay", lambda *call: trials.append(call[4]))
    assert cli.main(["trial", "stochastic_entry", "corrected", *arguments]) == 0
    assert trials == [(case, 7)]


@pytest.mark.stages
@pytest.mark.parametrize(("words", "laws"), [("random_field both_branches 7", 4), ("powered_descent plus_sign 7", 1)])
def test_a_trial_of_a_reading_of_which_all_makes_no_files_is_computed_in_memory(bare_project, capsys, words, laws):
    output = said(capsys, "trial", *words.split())
    assert output.count("trial 7") == laws
    assert not (bare_project / "data" / "cache").exists()


# ------------------------------------------------------------------------------------------------------------ what-if


def test_a_number_that_there_is_not_is_null_in_json():
    turned = Moved(("a", ""), Entry(1.0, verdict="holds"), Entry(verdict="fails"), math.nan)
    (text,) = overview.moved(SimpleNamespace(moved=[turned]), [], as_json=True)
    (row,) = json.loads(text, parse_constant=pytest.fail)  # called for NaN, which is no JSON
    assert row["before"] == 1.0
    assert row["after"] is row["size"] is row["standard_errors"] is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--figure fig99", "no figure 'fig99'; did you mean"),
        ("--figure eq54", "no figure 'eq54'"),  # a table
        ("--reading corected", "no reading 'corected'; did you mean 'corrected'?"),
        ("--configfile /none.yaml", "/none.yaml: cannot be read"),
    ],
)
def test_what_if_refuses_a_request_before_anything_is_computed(project, monkeypatch, capsys, words, message):
    monkeypatch.setattr("marsedl.replication.pipeline.runner.computed", pytest.fail)
    assert message in refused(capsys, "what-if", "powered_descent", "noise_unit=newton", *words.split())


@pytest.mark.stages
@pytest.mark.xdist_group("powered_descent")
def test_what_if_says_first_what_is_set_and_flown_and_then_what_moves_in_words(project, own_reading, tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    path.write_text(own_reading("powered_descent", "mine", gravity="3.9"), encoding="utf-8")
    words = "powered_descent noise_unit=newton entry.initial_velocity_angle_deg=100 --trials 60"
    output = said(capsys, "what-if", *words.split(), "--reading", "mine", "--configfile", str(path))
    first = output.partition("\n\n")[0].splitlines()
    assert first[0] == "powered_descent: mine with other values"
    assert [re.split("  +", line.strip()) for line in first[1:3]] == [
        ["noise_unit", "maximum_thrust -> newton"],
        ["entry.initial_velocity_angle_deg", "110.0 -> 100"],
    ]
    assert re.fullmatch("  flights: closed_loop 60, .*", first[3])
    assert re.search(r"verdicts that change: \d+\n", output) and " standard errors" in output
    assert "stays invertible throughout the flight. (q_invertible_all_t)" in output


@pytest.mark.parametrize("number", ["100091", "1100198", "999"])
def test_a_universe_that_nothing_holds_is_refused(bare_project, capsys, number):
    message = refused(capsys, "universe", "powered_descent", number)
    assert message.startswith(
        f"marsedl: no table holds universe {number}, and no design has it: one at a time are 0 to "
    )


@pytest.mark.stages
@pytest.mark.xdist_group("powered_descent")
def test_a_universe_of_a_wave_is_computed_as_its_table_has_it_and_of_a_design_without_any(bare_project, capsys):
    choices = cli.Project().studies["powered_descent"].choices
    wave = Universe(100_091, "wave", {"noise_unit": "newton"}, seed=1, wave=2)
    table = table_of(SimpleNamespace(study=SimpleNamespace(choices=choices)), [Row(wave, {"a": Outcome("refused")})])
    path = bare_project / "report" / "universes" / "powered_descent.h5"
    path.parent.mkdir(parents=True)
    store.save(path, table, paper="powered_descent", reading="all", provenance={})
    found = json.loads(said(capsys, "universe", "powered_descent", "100091", "--json"))
    assert found["choices"] == choices.complete(wave.assignment)
    assert (found["design"], found["wave"], found["seed"]) == ("wave", 2, 1)
    assert found["from"] == "report/universes/powered_descent.h5"
    assert {verdict for _, verdict, _ in found["claims"]} > {"holds", "reproduced"}
    first, *lines = said(capsys, "universe", "powered_descent", "1").splitlines()
    assert first == "universe 1 of powered_descent, one at a time; from its design, as no table has it"
    assert re.fullmatch("  initial_descent +printed", lines[0])


# ------------------------------------------------------------------------------------------------ in the built project


@pytest.mark.workflow
@pytest.mark.parametrize(
    ("words", "laws", "said"),
    [
        ("powered_descent corrected 12", 1, "trial 12 of closed_loop: completed"),
        ("powered_descent printed 12 --case open_loop", 1, "trial 12 of open_loop: "),
        ("random_field corrected 150", 4, "trial 150, law of iteration 3: captured"),
    ],
)
def test_a_trial_of_the_built_tree_is_the_same_to_the_last_bit_under_each_law(tree, words, laws, said):
    process = tree.marsedl("trial", *words.split(), "--size", "smoke")
    assert process.returncode == 0, process.stderr
    assert said in process.stdout
    assert process.stdout.count("the same to the last bit as in the stored ensemble") == laws


@pytest.mark.parametrize(
    "words", ["what-if powered_descent a=1", "universe powered_descent 99", "trial funnels mine 1"]
)
def test_what_computes_pins_the_numeric_environment_before_numpy_is_imported(words):
    """The last bits of array code depend on it; it ends in a traceback otherwise."""
    shell = {name: value for name, value in os.environ.items() if name not in NUMERIC_ENVIRONMENT}
    command = [sys.executable, "-m", "marsedl.cli", *words.split()]
    process = subprocess.run(command, cwd=ROOT, env=shell, capture_output=True, text=True, check=False)
    assert process.returncode == 2 and process.stderr.startswith("marsedl: "), process.stderr


def test_commands_take_as_many_files_of_a_user_as_snakemake():
    for words in (["--configfile", "a.yaml", "b.yaml"], ["--configfile", "a.yaml", "--configfile", "b.yaml"]):
        assert cli.command_line().parse_args(["verify", *words]).configfile == [Path("a.yaml"), Path("b.yaml")]
    assert cli.command_line().parse_args(["verify"]).configfile == []
