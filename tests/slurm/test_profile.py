"""The Slurm profile: what it asks for, of every rule, and what it was measured from. Needs no Slurm."""

import math
import re
import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from marsedl.papers import SLUGS
from marsedl.replication.verification import snakemake

ROOT = Path(__file__).parents[2]
PROFILE = ROOT / "profiles" / "slurm"
TARGETS = {"all", "claims", "comparison", "report", *SLUGS}  # which have no job of their own
SHARED = ("rerun-triggers", "rerun-incomplete", "max-checksum-file-size", "show-failed-logs", "keep-going", "scheduler")
measure = SimpleNamespace(**runpy.run_path(str(PROFILE / "measure.py")))


@pytest.fixture(scope="module")
def profile():
    return yaml.safe_load((PROFILE / "config.yaml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def rules():
    process = snakemake(ROOT, "--list-rules", "--nolock")
    assert process.returncode == 0, process.stdout
    return {line for line in process.stdout.splitlines() if re.fullmatch(r"[a-z]\w+", line)} - TARGETS


def amount(text, attempt):
    """What an expression of the profile asks for in an attempt; these are numbers times the attempt, no more."""
    number, _, name = text.partition(" * ")
    assert name == "attempt"
    return int(number) * attempt


def test_every_rule_has_resources_and_no_other(profile, rules):
    assert len(rules) > 60
    assert profile["set-resources"].keys() == rules


def test_resources_are_no_less_than_what_was_measured_and_grow_with_the_attempt(profile, rules):
    table = measure.read_table()
    assert table.keys() | measure.STATED.keys() == rules
    for rule, row in table.items():
        resources = profile["set-resources"][rule]
        memory, minutes = resources["mem_mb"], resources["runtime"]
        assert amount(memory, 1) >= measure.SNAKEMAKE_MB + measure.MEMORY_FACTOR * row["memory_mb"], rule
        assert amount(minutes, 1) >= measure.TIME_FACTOR * row["seconds"] / 60, rule
        assert amount(memory, 2) > amount(memory, 1), rule
        assert amount(minutes, 2) > amount(minutes, 1), rule


def test_the_largest_jobs_ask_for_the_most(profile):
    table = measure.read_table()
    longest = max(table, key=lambda rule: table[rule]["seconds"])
    largest = max(table, key=lambda rule: table[rule]["memory_mb"])
    resources = profile["set-resources"]
    assert amount(resources[longest]["runtime"], 1) == max(
        amount(entry["runtime"], 1) for rule, entry in resources.items() if rule in table
    )
    assert amount(resources[largest]["mem_mb"], 1) == max(
        amount(entry["mem_mb"], 1) for rule, entry in resources.items() if rule in table
    )


def test_the_section_is_what_the_committed_table_gives():
    text = (PROFILE / "config.yaml").read_text(encoding="utf-8")
    assert text.endswith(measure.sections(measure.read_table()))


def test_the_page_says_what_was_measured_and_is_asked_for():
    table = measure.read_table()
    page = (ROOT / "docs" / "scaling.md").read_text(encoding="utf-8")
    rows = re.findall(r"(?m)^\| `(\w+)` \| ([\d.]+) \| (\d+) \| (\d+) MB, (\d+) minutes \|$", page)
    assert len(rows) >= 5
    for rule, *numbers in rows:
        row = table[rule]
        expected = [row["seconds"], row["memory_mb"], *measure.resources(row).values()]
        assert [float(number) for number in numbers] == expected, rule


def test_a_build_is_measured_by_its_largest_jobs(tmp_path):
    rows = {
        "powered_descent/corrected/gains.tsv": (1.0, 100.0),
        "powered_descent/printed/gains.tsv": (3.0, 50.0),
        "powered_descent/corrected/montecarlo.open_loop.tsv": (2.0, "-"),
        "powered_descent/corrected/montecarlo.closed_loop_large.tsv": (1.5, 120.0),
        "powered_descent/corrected/montecarlo.closed_loop_large.0of2.tsv": (9.0, 150.0),
        "powered_descent/fig06a.tsv": (4.0, 220.0),
        "stochastic_entry/corrected/certificates.tsv": (100.0, 300.0),  # a stage; a table has the same name
        "stochastic_entry/certificates.tsv": (1.0, 180.0),
        "funnels/claims.tsv": (2.0, 200.0),
        "comparison/accuracy.tsv": (5.0, 210.0),
        "report.tsv": (6.0, 190.0),
        "claims.tsv": (0.1, 6.0),
    }
    for name, (seconds, memory) in rows.items():
        path = tmp_path / "benchmarks" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"s\tmax_rss\n{seconds}\t{memory}\n", encoding="utf-8")
    measured = {
        rule: (row["jobs"], row["seconds"], row["memory_mb"]) for rule, row in measure.measured(tmp_path).items()
    }
    assert measured == {
        "powered_descent_gains": (2, 3.0, 100.0),
        "powered_descent_montecarlo": (1, 2.0, 0.0),
        "powered_descent_montecarlo_gather": (1, 1.5, 120.0),
        "powered_descent_montecarlo_chunk": (1, 9.0, 150.0),
        "figure": (1, 4.0, 220.0),
        "stochastic_entry_certificates": (1, 100.0, 300.0),
        "stochastic_entry_table_certificates": (1, 1.0, 180.0),
        "funnels_claims": (1, 2.0, 200.0),
        "comparison_product": (1, 5.0, 210.0),
        "site": (1, 6.0, 190.0),
        "all_claims": (1, 0.1, 6.0),
    }
    assert measure.resources({"seconds": 100.0, "memory_mb": 300.0}) == {
        "mem_mb": math.ceil((500 + 1.5 * 300) / 100) * 100,
        "runtime": math.ceil(4 * 100 / 60),
    }


def test_what_decides_over_reruns_is_as_in_the_default_profile(profile):
    default = yaml.safe_load((ROOT / "profiles" / "default" / "config.yaml").read_text(encoding="utf-8"))
    assert {key: profile[key] for key in SHARED} == {key: default[key] for key in SHARED}
    assert default.keys() <= profile.keys()


def test_groups_hold_rules_that_are_there_and_no_flights(profile, rules):
    grouped = dict(entry.split("=") for entry in profile["groups"])
    assert grouped.keys() <= rules
    assert not [rule for rule in grouped if "montecarlo" in rule]
    components = dict(entry.split("=") for entry in profile["group-components"])
    assert components.keys() == set(grouped.values())
    longest = max(measure.read_table()[rule]["seconds"] for rule in grouped)
    assert longest < 60, "what takes longer is worth a job of its own"


def test_nothing_in_the_profile_is_of_one_cluster(profile):
    text = (PROFILE / "config.yaml").read_text(encoding="utf-8")
    assert not re.search(r"account=|partition=|slurm_account|slurm_partition|qos", text)
    assert "default-resources" not in profile, "which would hide those of a user's own profile"
