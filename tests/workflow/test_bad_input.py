"""Bad input is refused in one message before any job, and nothing is built or changed."""

import pytest

pytestmark = pytest.mark.workflow

READING = "powered_descent: {readings: {mine: {based_on: corrected, inputs: {%s}}}}\n"
ENTRY = "stochastic_entry: {readings: {mine: {based_on: corrected, inputs: {%s}}}}\n"
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
    ("content", "fragments"),
    [
        (READING % "gravty: {value: 3.7, source: Eq. 1}", ["mine.inputs", "'gravty'", "did you mean 'gravity'?"]),
        (READING % "gravity: {value: 1e3, source: Eq. 1}", ["mine.inputs.gravity", "with a point"]),
        (READING % "final_covariance: {value: [1.0, -1.0, 1.0, 1.0], source: Eq. 1}", ["not positive definite"]),
        (READING % "time_step: {value: 1.0e-12, unit: s, source: Eq. 1}", ["time_step", "steps in a segment"]),
        (ENTRY % "density_profile: {value: table, source: Fig. 1}", ["density_table names none", "write its file"]),
        (
            ENTRY % "density_table: {value: data/atmosphere/mine.csv, source: Fig. 1}",
            ["mine.inputs.density_table", "data/atmosphere/mine.csv: there is no such density table"],
        ),
        (ENTRY % "partition_interval: {value: 1.5, source: Eq. 1}", ["multiples of guidance_period"]),
        (ENTRY % "control_limit: {value: -0.1, source: Eq. 1}", ["mine.inputs.control_limit", "greater than 0"]),
        ("powered_descent: {readings: {a: {based_on: b}, b: {based_on: a}}}\n", ["based_on", "itself"]),
        ("powered_descent: {readings: {a: {based_on: corected}}}\n", ["based_on", "did you mean 'corrected'?"]),
        ("powerd_descent: {}\n", ["did you mean 'powered_descent'?"]),
        ("size: smoke\nsize: full\n", ["'size'", "twice"]),
        ("size: &anchor smoke\n", ["anchors"]),
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
        ("size=tiny", ["size=tiny", "valid names: full, smoke"]),
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


@pytest.mark.parametrize(
    ("slug", "old", "new"),
    [
        ("powered_descent", "gravity: {value: 3.71", "gravity: {value: 3.72"),
        ("stochastic_entry", "mass: {value: 3200.0", "mass: {value: 3201.0"),
    ],
)
def test_a_changed_frozen_reading_is_refused(tree, slug, old, new):
    tree.edit(f"configs/{slug}.yaml", old, new)
    said = refused(tree, "all")
    assert f"configs/{slug}.yaml: readings.printed: is frozen" in said
    assert "based_on: printed" in said
