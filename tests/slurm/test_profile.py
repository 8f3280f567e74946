"""The Slurm profile fits the workflow. Needs no Slurm."""

import re
from pathlib import Path

import yaml

from marsedl.replication.checks.twice import snakemake

ROOT = Path(__file__).parents[2]
SHARED = ("rerun-triggers", "rerun-incomplete", "max-checksum-file-size", "show-failed-logs", "keep-going", "scheduler")


def profile(name):
    return yaml.safe_load((ROOT / "profiles" / name / "config.yaml").read_text(encoding="utf-8"))


def test_what_decides_over_reruns_is_as_in_the_default_profile():
    slurm, default = profile("slurm"), profile("default")
    assert {key: slurm[key] for key in SHARED} == {key: default[key] for key in SHARED}
    assert default.keys() <= slurm.keys()


def test_rules_that_the_profile_names_exist_and_grow_with_the_attempt():
    process = snakemake(ROOT, "--list-rules", "--nolock")
    assert process.returncode == 0, process.stdout
    slurm, rules = profile("slurm"), set(re.findall(r"(?m)^[a-z]\w+$", process.stdout))
    grouped = dict(entry.split("=") for entry in slurm["groups"])
    assert grouped.keys() | slurm["set-resources"].keys() <= rules
    assert not {"chunk", "flights"} & grouped.keys(), "scattered flights are worth jobs of their own"
    assert {entry.split("=")[0] for entry in slurm["group-components"]} <= set(grouped.values())
    for resources in (slurm["default-resources"], *slurm["set-resources"].values()):
        assert all(amount.endswith(" * attempt") for amount in resources.values())
