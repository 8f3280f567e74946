"""Bad input is refused in one message before any job, and nothing is built or changed."""

import re
from pathlib import Path

import pytest
import yaml

from marsedl.papers import SLUGS

pytestmark = pytest.mark.workflow

FACTS = {
    slug: yaml.safe_load((Path(__file__).parent / "facts" / f"{slug}.yaml").read_text(encoding="utf-8"))
    for slug in SLUGS
}
TARGET = "figures/powered_descent/mine/fig07.png"


def refused(tree, *arguments, configfile=None):
    """Run Snakemake, which must refuse without a traceback and leave everything as it is; returns what it says."""
    before = tree.state()
    done = tree.run(*arguments, configfile=configfile)
    assert done.returncode != 0
    assert "Traceback" not in done.stdout
    assert "Job stats" not in done.stdout
    assert tree.state() == before
    return done.stdout


@pytest.mark.parametrize(
    ("slug", "inputs", "fragments"),
    [(slug, case["inputs"], case["said"]) for slug in SLUGS for case in FACTS[slug]["refused"]],
)
def test_malformed_inputs_of_a_reading_of_the_user_are_refused(tree, tmp_path, slug, inputs, fragments):
    path = tmp_path / "mine.yaml"
    reading = f"{{mine: {{based_on: corrected, inputs: {{{inputs}}}}}}}"
    path.write_text(f"{slug}: {{readings: {reading}}}\n", encoding="utf-8")
    said = refused(tree, TARGET, configfile=path)
    for fragment in ("mine.yaml", *fragments):
        assert fragment in said


@pytest.mark.parametrize(
    ("content", "fragments"),
    [
        ("powered_descent: {readings: {a: {based_on: b}, b: {based_on: a}}}\n", ["based_on", "itself"]),
        ("powered_descent: {readings: {a: {based_on: corected}}}\n", ["based_on", "did you mean 'corrected'?"]),
        ("powerd_descent: {}\n", ["did you mean 'powered_descent'?"]),
        ("size: smoke\nsize: full\n", ["'size'", "twice"]),
        ("size: &anchor smoke\n", ["anchors"]),
        ("size: !!str smoke\n", ["the tag 'tag:yaml.org,2002:str'", "write the plain value"]),
        ("chunks: 1:30\n", ["'1:30' to base 60", "write a decimal"]),
    ],
)
def test_a_malformed_file_of_the_user_is_refused(tree, tmp_path, content, fragments):
    path = tmp_path / "mine.yaml"
    path.write_text(content, encoding="utf-8")
    said = refused(tree, TARGET, configfile=path)
    for fragment in ("mine.yaml", *fragments):
        assert fragment in said


@pytest.mark.parametrize(
    "content",
    [
        b"- a\n- list\n",
        b"powered_descent:\n\treadings: {}\n",
        b"powered_descent: {readings: {mine: \n",
        b"size: \xff\xfe\n",
        b"{a: " * 2000 + b"1" + b"}" * 2000,
        None,
    ],
    ids=["list", "tab", "cut off", "not UTF-8", "deep", "missing"],
)
def test_a_file_that_is_no_yaml_stops_snakemake_itself(tree, tmp_path, content):
    """Snakemake reads the file before any code of this project runs, so that the message is its own."""
    path = tmp_path / "mine.yaml"
    if content is not None:
        path.write_bytes(content)
    before = tree.state()
    done = tree.run(TARGET, configfile=path)
    assert done.returncode != 0
    assert tree.state() == before
    said = tree.marsedl("explain", "powered_descent", "fig07", "--configfile", str(path))
    assert said.returncode == 2
    assert said.stderr.startswith(f"marsedl: {path}: ")
    assert "Traceback" not in said.stderr


@pytest.mark.parametrize(
    ("setting", "fragments"),
    [
        ("size=tiny", ["size=tiny", "valid names: check, full, smoke"]),
        ("chunks=0", ["chunks", "whole number"]),
        ("chunk=3", ["unknown key 'chunk'", "did you mean 'chunks'?"]),
        ("powered_descent=3", ["powered_descent", "keys with values"]),
    ],
)
def test_a_malformed_setting_is_refused(tree, setting, fragments):
    tree.config = [setting]
    said = refused(tree, "all")
    for fragment in fragments:
        assert fragment in said


@pytest.mark.parametrize("slug", SLUGS)
def test_a_changed_frozen_reading_is_refused(tree, slug):
    config = tree.path(f"configs/{slug}.yaml")
    text = config.read_text(encoding="utf-8")
    first_number = re.compile(r"(?ms)(^  printed:\n.*?\{value: )(\d+\.[\de+-]+)")
    changed, number = first_number.subn(lambda found: f"{found[1]}{1.001 * float(found[2])}", text, count=1)
    assert number == 1
    config.write_text(changed, encoding="utf-8")
    said = refused(tree, "all")
    assert f"configs/{slug}.yaml: readings.printed: is frozen" in said
    assert "based_on: printed" in said
