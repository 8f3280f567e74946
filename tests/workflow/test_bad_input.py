"""Bad input ends in one message before any job, and nothing is built.

What is refused, and with which words, is tested without Snakemake, whose starts take seconds: here by the facts of each
paper, else beside `replication.inputs` and `replication.command_line`. A few starts show that both are asked.
"""

import re
from pathlib import Path

import pytest
import yaml

from marsedl.papers import SLUGS, input_model
from marsedl.replication.command_line import check_target
from marsedl.replication.errors import InputError
from marsedl.replication.inputs import SETTINGS, load_studies, read_own_file

pytestmark = pytest.mark.workflow

CONFIGS = Path(__file__).parents[2] / "configs"
MODELS = {slug: input_model(slug) for slug in SLUGS}
FACTS = {
    slug: yaml.safe_load((Path(__file__).parent / "facts" / f"{slug}.yaml").read_text(encoding="utf-8"))
    for slug in SLUGS
}
TARGET = "figures/powered_descent/mine/fig07.png"


@pytest.mark.parametrize(
    ("slug", "inputs", "fragments"),
    [(slug, case["inputs"], case["said"]) for slug in SLUGS for case in FACTS[slug]["refused"]],
)
def test_malformed_inputs_of_a_reading_of_the_user_are_refused(tmp_path, slug, inputs, fragments):
    path = tmp_path / "mine.yaml"
    reading = f"{{mine: {{based_on: corrected, {inputs}}}}}"
    path.write_text(f"{slug}: {{readings: {reading}}}\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_studies(MODELS, CONFIGS, read_own_file(path, (*SLUGS, *SETTINGS)), [path])
    for fragment in ("mine.yaml", *fragments):
        assert fragment in str(caught.value)


@pytest.mark.parametrize("slug", SLUGS)
def test_a_changed_frozen_reading_is_refused(tmp_path, slug):
    text = (CONFIGS / f"{slug}.yaml").read_text(encoding="utf-8")
    first_number = re.compile(r"(?ms)(^  printed:\n.*?\{value: )(\d+\.[\de+-]+)")
    edited, number = first_number.subn(lambda match: f"{match[1]}{1.001 * float(match[2])}", text, count=1)
    assert number == 1
    (tmp_path / f"{slug}.yaml").write_text(edited, encoding="utf-8")
    with pytest.raises(InputError, match=rf"{slug}.yaml:\d+: readings.printed: is frozen.*based_on: printed"):
        load_studies({slug: MODELS[slug]}, tmp_path, {})


def refused(project, *arguments, configfile=None) -> str:
    """Run Snakemake, which must end with one message of ours, no traceback and nothing built; returns the message."""
    process = project.run(*arguments, configfile=configfile)
    assert process.returncode != 0
    assert "Traceback" not in process.stdout
    assert "Job stats" not in process.stdout
    assert not project.state()
    (message,) = [line for line in process.stdout.splitlines() if line.startswith("marsedl: ")]
    return message


def test_what_is_wrong_in_a_users_file_is_the_last_word(project, tmp_path):
    path = tmp_path / "mine.yaml"
    body = "{based_on: corrected, planet: {gravty: {value: 3.7, source: Eq. 1}}}"
    path.write_text(f"powered_descent: {{readings: {{mine: {body}}}}}\n", encoding="utf-8")
    message = refused(project, TARGET, configfile=path)
    assert (
        message
        == f"marsedl: {path}:1: powered_descent.readings.mine.planet.gravty: unknown key; did you mean 'gravity'?"
    )


@pytest.mark.parametrize("profile", ["default", "slurm"])
def test_a_file_that_is_missing_stops_no_snakemake_in_a_traceback(project, tmp_path, profile):
    path = tmp_path / "mine.yaml"
    message = refused(project, TARGET, "--workflow-profile", f"profiles/{profile}", configfile=path)
    assert message.startswith(f"marsedl: {path}: cannot be read (No such file or directory); check its path")
    explained = project.marsedl("explain", "powered_descent", "fig07", "--configfile", str(path))
    assert explained.returncode == 2
    assert explained.stderr == f"{message}\n"


def test_a_users_file_is_not_run_as_code(project, tmp_path):
    """Snakemake runs what stands under `__definitions__`."""
    path, trace = tmp_path / "mine.yaml", tmp_path / "trace"
    path.write_text(f"__use_yte__: true\n__definitions__:\n  - open({str(trace)!r}, 'w')\n", encoding="utf-8")
    assert "__use_yte__: unknown key" in refused(project, TARGET, configfile=path)
    assert not trace.exists()


def test_a_malformed_setting_is_refused(project):
    project.config = ["size=tiny"]
    assert "size=tiny: configs/powered_descent.yaml defines no such size; valid names: " in refused(project, "all")


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("figures/powered_descent/fig7.png", "there is no figure or table 'fig7'; did you mean 'fig07'?"),
        ("powerd_descent", "there is no target 'powerd_descent'; did you mean 'powered_descent'?"),
    ],
)
def test_a_target_that_nothing_makes_is_refused(project, target, message):
    assert refused(project, target).endswith(message)


def test_folders_that_cannot_be_written_are_refused(project):
    project.config = []
    project.path("logs").write_text("")
    assert "logs: is not a folder, but a folder of this name is needed; move it away" in refused(project, "all")


def test_everything_that_is_made_may_be_asked_for(project):
    """Every file that a job of `all` writes passes the check of targets, chunks included."""
    from marsedl.comparison import comparisons
    from marsedl.papers import catalogue

    project.config = ["chunks=2"]
    studies = load_studies(MODELS, CONFIGS, {"chunks": 2})
    papers = {slug: catalogue(slug) for slug in SLUGS}
    files = project.plan("all").files
    assert len(files) > 500
    assert any("/chunks/" in path for path in files)
    for path in files:
        check_target(path, "full", papers, studies, comparisons())
