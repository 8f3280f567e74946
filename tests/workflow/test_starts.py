"""Where and how Snakemake is started: as a module of another workflow, elsewhere, from Python, by another path."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.workflow
ROOT = Path(__file__).parents[2]
PROFILE = ("--workflow-profile", str(ROOT / "profiles" / "default"))
SNAKEFILE = f"""
configfile: "config/config.yaml"


module marsedl:
    snakefile: {str(ROOT / "Snakefile")!r}
    config: config


use rule * from marsedl as marsedl_*


rule my_summary:
    input:
        "figures/powered_descent/mine/fig03.png",
    output:
        "figures/mine/summary.txt",
    shell:
        "touch {{output}}"
"""
CONFIG = """
samples: [a, b]
powered_descent:
  readings:
    mine:
      based_on: corrected
      planet:
        gravity: {value: 3.7, source: "assumed: test"}
"""


def run(folder, *command):
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "check": False}
    return subprocess.run([*map(str, command)], cwd=folder, env=environment, **output)


@pytest.mark.parametrize("config", ["config: config", ""], ids=["with the outer configuration", "without"])
def test_a_module_leaves_keys_files_and_targets_to_the_outer_workflow(tmp_path, config):
    """Its claims read the printed ones of the project; everything is planned into the outer folder."""
    snakefile = SNAKEFILE.replace("config: config", config)
    (tmp_path / "Snakefile").write_text(snakefile if config else snakefile.replace("/mine/fig03", "/fig03"), "utf-8")
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "config.yaml").write_text(CONFIG, encoding="utf-8")
    targets = ("my_summary", "figures/mine/summary.txt", "marsedl_powered_descent")
    process = run(
        tmp_path, sys.executable, "-m", "snakemake", *targets, "-n", "--quiet", "host", "--cores", "1", *PROFILE
    )
    assert process.returncode == 0, process.stdout[-3000:]
    for line in ("rule my_summary:", "rule marsedl_paper_claims:", "report/claims/powered_descent.json"):
        assert line in process.stdout
    assert ("figures/powered_descent/mine/fig03.png" in process.stdout) == bool(config)


def test_another_folder_and_another_program_may_run_the_workflow(tmp_path):
    """As the Python interface does: the words of the program are its own, and jobs run the Python of Snakemake."""
    command = ["-s", str(ROOT / "Snakefile"), "verify", "-np", "--quiet", "host", "--cores", "1", *PROFILE]
    process = run(tmp_path, sys.executable, "-c", f"from snakemake.cli import main; main({command!r})", "gale")
    assert process.returncode == 0, process.stdout[-3000:]
    assert "paper_claims" in process.stdout
    assert f"{sys.executable} -m marsedl.cli verify" in process.stdout


@pytest.mark.parametrize("modifier", ["prefix: 'results'", "replace_prefix: {'data/': 'results/'}"])
def test_a_module_with_a_prefix_is_refused_in_one_line(tmp_path, modifier):
    """Its products would be where no recipe looks for them: nothing was made again, and no artifact was loaded."""
    text = SNAKEFILE.replace("config: config", f"config: config\n    {modifier}")
    (tmp_path / "Snakefile").write_text(text, encoding="utf-8")
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "config.yaml").write_text(CONFIG, encoding="utf-8")
    process = run(tmp_path, sys.executable, "-m", "snakemake", "my_summary", "-n", "--cores", "1", *PROFILE)
    assert process.returncode != 0
    (line,) = [line for line in process.stdout.splitlines() if line.startswith("marsedl: ")]
    assert "would be elsewhere, by a module's prefix" in line and "--directory FOLDER" in line
    assert "Traceback" not in process.stdout


@pytest.mark.parametrize("name", ["my study", "R&D", "it's"])
def test_a_path_that_bash_does_not_take_is_refused_in_one_line(tmp_path, name):
    """Snakemake does not quote the path of its Python; make can name no folder with a space."""
    folder = tmp_path / name
    folder.mkdir()
    (folder / ".venv").symlink_to(sys.prefix)
    python = folder / ".venv" / "bin" / "python"
    process = run(ROOT, python, "-m", "snakemake", "all", "-n", "--cores", "1")
    assert process.returncode != 0
    character = next(one for one in name if one in " &'")
    assert f"{python}: Snakemake runs no Python whose path has {character!r}; move the project" in process.stdout
    shutil.copy(ROOT / "Makefile", folder)
    process = run(folder, "make", "-n", "all")
    assert process.returncode != 0
    assert "has a character with which Snakemake runs no job: move the project" in process.stdout
