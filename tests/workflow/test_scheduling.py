"""What Snakemake itself costs while jobs run."""

import re
from pathlib import Path

import pytest

from marsedl.replication.checks.twice import snakemake

pytestmark = pytest.mark.workflow

JOBS = 10
RULES = f"""
SIZE, say_why = "full", str

rule all:
    input: [f"made/{{number}}" for number in range({JOBS})]

rule one:
    output: "made/{{number}}"
    shell: "sleep 0.5; touch {{output}}"
"""


def test_a_finished_job_leads_to_one_look_for_free_ones(tmp_path):
    settings = re.search(r"\nonstart:\n(    [^\n]*\n)+", (Path(__file__).parents[2] / "Snakefile").read_text("utf-8"))
    (tmp_path / "Snakefile").write_text(RULES + settings.group(), encoding="utf-8")
    process = snakemake(tmp_path, "--cores", "1", "--scheduler", "greedy", "--verbose")
    assert process.returncode == 0, process.stdout[-3000:]
    assert JOBS <= process.stdout.count("Ready jobs: ") <= JOBS + 2
