"""Inputs and readings: what is accepted means what is written, and anything else is one clear message."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from marsedl.papers import SLUGS, input_model
from marsedl.replication.errors import InputError
from marsedl.replication.inputs import RESERVED
from marsedl.replication.inputs.readings import load_studies, load_study
from marsedl.replication.inputs.sections import KNOWN_SUFFIXES, Inputs, Number, Positive, Section, vector
from marsedl.replication.inputs.sections import given as declared
from marsedl.replication.inputs.yaml_file import read_yaml

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "configs" / "powered_descent.yaml"
SOURCE = "assumed: test"
MODELS = {slug: input_model(slug) for slug in SLUGS}
MODEL = MODELS["powered_descent"]
INPUTS = [(slug, *name.split(".")) for slug, model in MODELS.items() for name in model.names()]


def standing_for_a_reading() -> list[str]:
    """The words of the rules' paths that stand where a reading's name may."""
    rules = "".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "workflow" / "rules").glob("*.smk")))
    found = re.findall(r"\"(?:figures|data/cache)/\{+paper\}+/(\w+)/", rules)
    assert "universes" in found
    return sorted({*found})


def entry(value) -> dict:
    """An input as it is written."""
    return {"value": value, "source": SOURCE}


def written(folder, sections, slug="powered_descent", name="mine") -> Path:
    """Write a user's file with one reading of a paper that sets some inputs, by section."""
    document = {slug: {"readings": {name: {"based_on": "corrected", **sections}}}}
    (folder / "mine.yaml").write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return folder / "mine.yaml"


def load(path, slug="powered_descent"):
    """Load the studies with a user's file, as `snakemake --configfile` and `marsedl --configfile` do."""
    return load_studies({slug: MODELS[slug]}, ROOT, config_files=[path])[slug]


def refused(path, *fragments, slug="powered_descent") -> str:
    """Load a user's file, which must be refused in one line that names the file and holds all fragments."""
    with pytest.raises(InputError) as caught:
        load(path, slug)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 1000
    for fragment in (str(path), *fragments):
        assert fragment in message
    return message


TRIALS = "    ensemble: {trials: 200, large_trials: 3000, drawn_trials: 20}\n"
SMOKE = "  smoke:\n    readings: [printed, "


def project(tmp_path, old, new):
    """A project with one edit in the paper's configuration."""
    text = CONFIG.read_text(encoding="utf-8")
    assert text.count(old) == 1
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs" / "powered_descent.yaml").write_text(text.replace(old, new), encoding="utf-8")
    return tmp_path


# ------------------------------------------------------------------------------------------------- what is accepted


def test_a_reading_is_its_base_plus_what_it_sets(tmp_path):
    study = load(written(tmp_path, {"noise": {"noise_coefficient": entry(0.03)}}))
    mine, base = study.readings["mine"], study.readings["corrected"]
    assert mine.inputs.noise.noise_coefficient == 0.03
    assert mine.inputs.plain() | {"noise.noise_coefficient": 0.02} == base.inputs.plain()
    assert [name for name in mine.sources if mine.sources[name].reading == "mine"] == ["noise.noise_coefficient"]
    assert mine.sources["planet.gravity"] == study.readings["printed"].sources["planet.gravity"]


def test_suffixes_convert_to_si(tmp_path):
    values = {"initial_velocity_angle_deg": 90, "initial_speed_km_s": 0.05, "initial_position_km": [0.25, 0.5]}
    path = written(tmp_path, {"entry": {key: entry(value) for key, value in values.items()}})
    read = load(path).readings["mine"].inputs
    assert read.entry.initial_velocity_angle == pytest.approx(math.pi / 2, rel=1e-15)
    assert read.entry.initial_speed == pytest.approx(50.0, rel=1e-15)
    assert read.entry.initial_position == pytest.approx((250.0, 500.0), rel=1e-15)


class Turn(Section):
    """Inputs in units that must be written with a suffix, one of which may be missing."""

    acceleration_bound: Positive = declared("rad/s^2", "a bound")
    acceleration_bounds: vector(2) = declared("rad/s^2", "two bounds")
    final_rate: Number | None = declared("rad/s", "a rate, or none")


class Turning(Inputs):
    """Inputs of one section."""

    turn: Turn


def turning(tmp_path, **changes):
    """A reading of these inputs."""
    bounds = {"acceleration_bound_deg_s2": 5.0, "acceleration_bounds_deg_s2": [180.0, -90], "final_rate_deg_s": None}
    turn = {key: entry(value) for key, value in (bounds | changes).items()}
    (tmp_path / "configs").mkdir(exist_ok=True)
    text = yaml.safe_dump({"readings": {"mine": {"summary": "A test.", "turn": turn}}, "chunks": {}})
    (tmp_path / "configs" / "turning.yaml").write_text(text, encoding="utf-8")
    return load_study("turning", Turning, tmp_path).readings["mine"]


def test_angular_accelerations_are_written_in_degrees(tmp_path):
    read = turning(tmp_path).inputs.turn
    assert read.acceleration_bound == pytest.approx(math.pi / 36, rel=1e-15)
    assert read.acceleration_bounds == pytest.approx((math.pi, -math.pi / 2), rel=1e-15)
    with pytest.raises(InputError, match=r"turn\.acceleration_bound_deg_s2: .*number.*None"):
        turning(tmp_path, acceleration_bound_deg_s2=None)


def test_what_may_be_missing_is_null_under_any_suffix(tmp_path):
    mine = turning(tmp_path)
    assert mine.inputs.turn.final_rate is None and mine.sources["turn.final_rate"].key == "final_rate_deg_s"
    assert turning(tmp_path, final_rate_deg_s=180.0).inputs.turn.final_rate == pytest.approx(math.pi, rel=1e-15)


def test_a_covariance_may_be_whole_or_its_diagonal(tmp_path):
    whole = [[5.0, 0.5, 0.0, 0.0], [0.5, 0.25, 0.0, 0.0], [0.0, 0.0, 0.25, 0.1], [0.0, 0.0, 0.1, 0.25]]
    diagonal = {"initial_covariance": entry([4, 3, 2, 1])}
    path = written(tmp_path, {"mission": {"final_covariance": entry(whole)}, "entry": diagonal})
    read = load(path).readings["mine"].inputs
    np.testing.assert_array_equal(read.mission.final_covariance, whole)
    np.testing.assert_array_equal(read.entry.initial_covariance, np.diag([4.0, 3, 2, 1]))


def test_a_size_limits_numbers_and_leaves_smaller_ones_and_frozen_readings_alone():
    full, smoke = (load_study("powered_descent", MODEL, ROOT, size=size).readings for size in ("full", "smoke"))
    assert full["corrected"].inputs.ensemble.trials > smoke["corrected"].inputs.ensemble.trials == 200
    assert {size["printed"].inputs.ensemble.large_trials for size in (full, smoke)} == {0}
    for name in full:
        assert full[name].sources == smoke[name].sources
        assert full[name].inputs.planet.gravity == smoke[name].inputs.planet.gravity


def test_a_size_limits_every_number_of_a_list(tmp_path):
    root = project(tmp_path, "  smoke:\n", "  smoke:\n    mission: {final_mean: 0.5}\n")
    smoke, full = (load_study("powered_descent", MODEL, root, size).readings for size in ("smoke", "full"))
    expected = np.minimum(full["corrected"].inputs.mission.final_mean, 0.5)
    np.testing.assert_array_equal(smoke["corrected"].inputs.mission.final_mean, expected)
    assert expected.max() < full["corrected"].inputs.mission.final_mean.max()


def test_printed_corrected_and_a_users_readings_are_files_and_a_size_may_leave_out_points():
    mine = {"powered_descent": {"readings": {"mine": {"based_on": "corrected"}}}}
    full, smoke = (
        load_studies({"powered_descent": MODEL}, ROOT, {**mine, "size": size})["powered_descent"]
        for size in ("full", "smoke")
    )
    assert {"printed", "corrected", "mine"} == set(full.built) == set(smoke.built)
    assert set(full.readings) == set(smoke.readings) == {*full.built, *full.points}
    assert "plus_sign" in set(full.points) - set(smoke.points)


def test_a_user_may_add_a_choice_and_a_value_of_one():
    windy = {"asks": "How strong is gravity?", "because": "withheld"}
    moon = {"planet": {"gravity": {"value": 1.62, "source": "assumed: another planet"}}}
    mine = {"gravity": {**windy, "values": {"mars": {}, "moon": moon}}}
    thrust = {"source": "assumed: mine", "thrust_unit": {"value": 7.0}, "coefficient_unit": {"value": "other"}}
    mine["noise_unit"] = {"asks": "?", "because": "withheld", "values": {"mine": {"noise": thrust}}}
    study = load_study("powered_descent", MODEL, ROOT, choices=mine)
    assert {"newton", "mine"} <= set(study.choices.by_name["noise_unit"].alternatives)
    assert study.choices.by_name["noise_unit"].asks != "?"
    assert study.universe({"gravity": "moon"}).inputs.planet.gravity == 1.62
    assert study.universe({"noise_unit": "mine"}).inputs.noise.thrust_unit == 7.0


# ------------------------------------------------------------------------------------------- what is refused: values


@pytest.mark.parametrize(
    ("key", "value", "fragments"),
    [
        ("planet.gravty", "3.7", ["gravty: unknown key", "did you mean 'gravity'?"]),
        ("vehicle.wet_mass", "-1500.0", ["greater than 0", "-1500"]),
        ("mission.segment_durations", "[26.0]", ["2 items"]),
        ("planet.gravity", ".nan", ["finite"]),
        ("planet.gravity", "1e3", ["number", "as in 0.03 or 1.0e+5"]),
        ("ensemble.trials", "2000.0", ["integer"]),
        ("ensemble.large_trials", "-1", ["greater than or equal to 0"]),
        ("simulation.time_step", "1.0e-12", ["time_step", "steps in a segment"]),
        ("design.design_interval", "50.0", ["design_interval (50 s) is longer than a segment (15 s)", "lower it"]),
        ("vehicle.wet_mass", "1.0e+308", ["1e+308 is neither 0 nor between 1e-30 and 1e+30: check the number"]),
        ("ensemble.drawn_trials", "1000000000", ["drawn_trials", "at most 10000: a figure shows no more"]),
        ("simulation.integrator", "rk5", ["rk4", "euler_maruyama"]),
        ("mission.final_covariance", "[5.0, -0.25, 0.25, 0.25]", ["not positive definite", "-0.25"]),
        ("mission.final_covariance", "[[1, 0.1, 0, 0], [0.2, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
         ["not symmetric", "entry (1, 2) is 0.1", "entry (2, 1) is 0.2"]),
        ("mission.final_covariance", "[5.0, [0.25], 0.25, 0.25]", ["4 variances"]),
        ("entry.initial_velocity_angle", "70.0", ["needs its unit in its name", "initial_velocity_angle_deg"]),
        ("entry.initial_velocity_angle_rad", "1.2", ["wrong unit suffix '_rad'", "initial_velocity_angle_deg"]),
    ],
)  # fmt: skip
def test_malformed_values_are_refused(tmp_path, key, value, fragments):
    section, name = key.split(".")
    refused(written(tmp_path, {section: {name: entry(yaml.safe_load(value))}}), "readings.mine", section, *fragments)


@pytest.mark.parametrize(
    ("line", "fragments"),
    [
        ("gravity: 3.7", ["planet.gravity", "must be keys with values, not 3.7", "source, unit, value"]),
        ("gravity: {value: 3.7}", ["planet.gravity", "'source' is missing"]),
        ("gravity: {value: 3.7, sorce: Eq. 1}", ["sorce: unknown key", "did you mean 'source'?"]),
        ("gravity: {value: 3.7, source: 'assumed: '}", ["planet.gravity.source", "the reason"]),
        ("gravity: {value: 3.7, unit: ft/s^2, source: Eq. 1}", ["planet.gravity.unit", "'ft/s^2'", "'m/s^2'"]),
        ("? [a, b]\n        : {value: 3.7, source: Eq. 1}", ["a key must be a plain name"]),
    ],
)  # fmt: skip
def test_malformed_entries_are_refused(tmp_path, line, fragments):
    path = tmp_path / "mine.yaml"
    head = "powered_descent:\n  readings:\n    mine:\n      based_on: corrected\n      planet:\n        "
    path.write_text(f"{head}{line}\n", encoding="utf-8")
    refused(path, *fragments)


def test_one_input_under_two_keys_is_refused(tmp_path):
    path = written(tmp_path, {"entry": {"initial_speed": entry(50.0), "initial_speed_km_s": entry(0.05)}})
    refused(path, "'initial_speed' is set twice", "initial_speed_km_s")


# ----------------------------------------------------------------------------------------- what is refused: readings


@pytest.mark.parametrize(
    ("text", "fragments"),
    [
        ("readings: {mine: {based_on: corected}}", ["mine.based_on", "'corected'", "did you mean 'corrected'?"]),
        ("readings: {a: {based_on: b}, b: {based_on: c}, c: {based_on: a}}", ["based_on", "itself"]),
        ("readings: {corrected: {based_on: printed}}", ["readings.corrected", "the name belongs to", "based_on"]),
        ("readings: {Mine: {based_on: corrected}}", ["readings.Mine", "lower case"]),
        ("readings: {mine: {based_on: corrected, summary: [a]}}", ["mine.summary", "valid string"]),
        ("readings: {mine: {based_on: corrected, seed: {value: 7, source: Eq. 1}}}",
         ["mine.seed: stands in the section 'ensemble'; write 'ensemble: {seed: ...}'"]),
        ("readings: {mine: {based_on: corrected, planet: {seed: {value: 7, source: Eq. 1}}}}",
         [":2: ", "mine.planet.seed: unknown key; it stands in the section 'ensemble'"]),
        ("readings: {mine: {based_on: corrected, planet: {source: '', gravity: {value: 3.7}}}}",
         ["mine.planet.gravity.source: say where"]),
    ],
)  # fmt: skip
def test_malformed_readings_are_refused(tmp_path, text, fragments):
    path = tmp_path / "mine.yaml"
    path.write_text(f"powered_descent:\n  {text}\n", encoding="utf-8")
    refused(path, *fragments)


@pytest.mark.parametrize("limits", ["planet.gravity, component: 1", "entry.initial_position"])
def test_a_range_of_what_is_no_number_is_refused(tmp_path, limits):
    path = tmp_path / "mine.yaml"
    limits = f"range: {{input: {limits}, between: [1.0, 2.0], source: '{SOURCE}'}}"
    path.write_text(f"powered_descent:\n  choices: {{doubt: {{asks: why, because: withheld, {limits}}}}}\n", "utf-8")
    with pytest.raises(InputError, match=r"choices\.doubt\.range: is of no number in .*component"):
        load(path)


def test_a_reading_without_a_base_is_told_what_is_missing_though_it_sets_a_range(tmp_path):
    path = tmp_path / "mine.yaml"
    doubt = "asks: why, because: withheld, range: {input: planet.gravity, factor: [0.5, 2.0], source: Eq. 1}"
    mine = "readings: {mine: {choices: {doubt: 1.5}}}"
    path.write_text(f"powered_descent:\n  choices: {{doubt: {{{doubt}}}}}\n  {mine}\n", "utf-8")
    refused(path, "readings.mine.planet: 'gravity' (m/s^2) is missing")


@pytest.mark.parametrize(
    ("text", "fragments"),
    [
        ("powerd_descent: {readings: {}}", ["powerd_descent: unknown key", "did you mean 'powered_descent'?"]),
        ("- powered_descent", ["keys with values"]),
        ("chunks: 0", ["chunks", "greater than or equal to 1"]),
        ("size: tiny", ["no such size", "smoke"]),
        ("powered_descent:\n  readings: {mine: {based_on: corrected}\n", ["not valid YAML"]),
        ("chunks: 1\nchunks: 2\n", ["line 2", "'chunks'", "twice"]),
        ("powered_descent: !!python/object/apply:os.getcwd []\n", ["line 1", "the tag"]),
    ],
)
def test_malformed_files_are_refused(tmp_path, text, fragments):
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    refused(path, *fragments)


def test_what_is_no_file_is_refused(tmp_path):
    refused(tmp_path / "none.yaml", "cannot be read (No such file or directory); check its path and permissions")
    refused(tmp_path, "cannot be read (Is a directory)")


def test_names_that_pandas_reads_as_missing_are_refused(tmp_path):
    from pandas._libs.parsers import STR_NA_VALUES

    names = [name for name in STR_NA_VALUES if re.fullmatch("[a-z][a-z0-9_]*", name)]
    assert {"nan", "null"} <= set(names)
    for name in names:
        path = written(tmp_path, {}, name=name)
        refused(path, f"readings.{name}: pandas reads the name '{name}' in a table as no value; rename it")


NOISE = "noise: {noise_coefficient: {value: %s, source: 'assumed: x'}}"
VALUE = "{asks: Which?, because: withheld, values: {mine: {noise: {noise_coefficient: {value: 1.0, source: x}}}}}"


def two_files(folder, kind, first, second, body):
    """Two files of a user, each with one reading or choice; returns their paths."""
    paths = [folder / "a.yaml", folder / "b.yaml"]
    for path, name in zip(paths, (first, second), strict=True):
        path.write_text(f"powered_descent:\n  {kind}:\n    {name}: {body}\n", encoding="utf-8")
    return paths


READING = f"{{based_on: corrected, {NOISE % 0.03}}}"


@pytest.mark.parametrize(("kind", "body"), [("readings", READING), ("choices", VALUE)])
def test_a_name_that_stands_in_two_files_is_refused_and_names_both(tmp_path, kind, body):
    paths = two_files(tmp_path, kind, "noise_unit", "noise_unit", body)
    with pytest.raises(InputError) as caught:
        load_studies({"powered_descent": MODEL}, ROOT, config_files=paths)
    first, second = (f"{path}:3: powered_descent.{kind}.noise_unit" for path in paths)
    assert str(caught.value) == f"{second}: stands in {first} too; give one of them another name"


def test_of_several_files_every_reading_is_there_and_a_fault_names_its_own(tmp_path):
    paths = two_files(tmp_path, "readings", "one", "two", READING)
    study = load_studies({"powered_descent": MODEL}, ROOT, config_files=paths)["powered_descent"]
    assert study.own_readings == {"one", "two"}
    assert "one" not in study.without_own_readings().readings and not study.without_own_readings().own_readings
    paths[1].write_text(paths[1].read_text("utf-8").replace("corrected", "three"), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_studies({"powered_descent": MODEL}, ROOT, config_files=paths)
    assert str(caught.value).startswith(f"{paths[1]}:3: powered_descent.readings.two.based_on: there is no reading")


def test_what_stands_in_a_file_is_not_changed_by_the_command_line(tmp_path):
    path = two_files(tmp_path, "readings", "one", "two", READING)[0]
    config = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert load_studies({"powered_descent": MODEL}, ROOT, config, [path])["powered_descent"].own_readings == {"one"}
    config["powered_descent"]["readings"]["one"]["summary"] = "Of both."
    with pytest.raises(InputError, match=r"a.yaml:3: powered_descent.readings.one: --config changes it; write"):
        load_studies({"powered_descent": MODEL}, ROOT, config, [path])


@pytest.mark.parametrize("name", [*RESERVED, *standing_for_a_reading()])
def test_a_reading_named_as_a_folder_among_those_of_readings_is_refused(tmp_path, name):
    refused(written(tmp_path, {}, name=name), f"readings.{name}: '{name}' is the name of a folder", "rename it")


@pytest.mark.parametrize("key", ["null", "true", "1.5"])
def test_a_name_that_yaml_does_not_read_as_text_is_to_be_quoted(tmp_path, key):
    path, value = tmp_path / "mine.yaml", yaml.safe_load(key)
    path.write_text(f"powered_descent: {{readings: {{{key}: {{based_on: corrected}}}}}}\n", encoding="utf-8")
    refused(path, f"YAML reads it as {value!r}: write it in quotes")
    path.write_text(f"powered_descent: {{choices: {{noise_unit: {{values: {{{key}: {{}}}}}}}}}}\n", encoding="utf-8")
    with pytest.raises(InputError, match="write it in quotes"):
        load(path)


def test_a_false_value_of_a_choice_is_to_be_quoted(tmp_path):
    refused(written(tmp_path, {"choices": {"noise_unit": False}}), "YAML reads it as False: write it in quotes")


@pytest.mark.parametrize(
    ("choice", "problem"),
    [
        ("{asks: x, because: withheld, values: {a: {}}}", "a choice needs at least two values"),
        ("{asks: x, because: withheld, only_if: {noise_unit: [newtn]}, values: {a: {}, b: {}}}", "'newton'"),
        ("{asks: x, because: withheld, range: {input: noise.noise, between: [1, 2], source: x}}", "noise.noise_"),
        (
            "{asks: x, because: withheld, range: {input: mission.segment_durations, between: [1.0, 2.0], source: x}}",
            "is of no number",
        ),
    ],
)
def test_a_malformed_choice_of_a_user_is_told_at_their_file(tmp_path, choice, problem):
    path = tmp_path / "mine.yaml"
    path.write_text(f"powered_descent:\n  choices:\n    mine: {choice}\n", encoding="utf-8")
    refused(path, f"{path}:3: powered_descent.choices.mine", problem)


def test_one_fault_of_a_file_hides_no_other_though_it_is_in_the_same_line(tmp_path):
    path, fault = tmp_path / "mine.yaml", "noise: {noise_coefficient: {value: 0.03, source: assumed}}"
    other = "based_on: corrected, mission: {segment_durations: {value: [1.0, 2.0]}}"
    path.write_text(f"powered_descent: {{readings: {{mine: {{{fault}, {other}}}}}}}\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(path)
    lines = str(caught.value).splitlines()
    assert len(lines) == 2
    assert any("write 'assumed: ' and the reason" in line for line in lines)
    assert any("the key 'source' is missing" in line for line in lines)


# -------------------------------------------------------------------------------------- what is refused: the project's


@pytest.mark.parametrize(
    ("old", "new", "fragments"),
    [
        ("gravity: {value: 3.71", "gravity: {value: 3.72", ["readings.printed", "is frozen", "based_on: printed"]),
        ("chunks: {closed_loop: 1", "chunks: {closed_loop: 0", ["chunks.closed_loop", "greater than or equal to 1"]),
        ("chunks: {closed_loop: 1", "chunks: {closed_lop: 1", ["chunks.closed_lop: unknown key; did you mean"]),
        ("chunks: {closed_loop: 1, ", "chunks: {", ["chunks", "'closed_loop' is missing"]),
        (TRIALS, TRIALS.replace("200", "few", 1), ["sizes.smoke.ensemble.trials", "valid number", "few"]),
        (TRIALS, TRIALS.replace("200", "0.5", 1), ["sizes.smoke.ensemble.trials", "valid integer", "0.5"]),
        (SMOKE, SMOKE.replace("printed, ", ""), ["sizes.smoke.readings", "with printed and corrected"]),
        (SMOKE, SMOKE + "prnted, ", ["sizes.smoke.readings", "did you mean 'printed'?"]),
    ],
)  # fmt: skip
def test_a_malformed_file_of_the_project_is_refused(tmp_path, old, new, fragments):
    with pytest.raises(InputError) as caught:
        load_study("powered_descent", MODEL, project(tmp_path, old, new), size="smoke")
    for fragment in ("configs/powered_descent.yaml", *fragments):
        assert fragment in str(caught.value)


def test_a_section_may_name_the_source_of_inputs_that_name_none(tmp_path):
    vehicle = {"source": "Eq. 9", "wet_mass": {"value": 3.0}, "specific_impulse": {"value": 4.0, "source": "Eq. 8"}}
    path = written(tmp_path, {"vehicle": vehicle})
    sources = load(path).readings["mine"].sources
    assert sources["vehicle.wet_mass"].source == "Eq. 9"
    assert sources["vehicle.specific_impulse"].source == "Eq. 8"
    path = written(tmp_path, {"vehicle": {"wet_mass": {"value": 3.0}}})
    refused(path, f"{path}:6: ", "vehicle.wet_mass: the key 'source' is missing; add it")


# ---------------------------------------------------------------------------- what is refused: slips in every paper


def test_all_faults_of_a_file_are_told_at_once_and_a_decimal_comma_by_its_name(tmp_path):
    path = written(tmp_path, {"mission": {"velocityy": {"value": 1.0}}, "vehicl": {}, "frozen": "x"})
    with pytest.raises(InputError) as caught:
        load(path)
    lines = str(caught.value).splitlines()
    assert len(lines) == len({*lines}) == 3 and all(line.startswith(f"{path}:") for line in lines)
    path.write_text("noise: {value: 0,5}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"line 1: the comma before 5 begins another key; write .* a decimal point"):
        read_yaml(path)


@settings(max_examples=30, deadline=None)
@given(of=st.sampled_from(INPUTS), slip=st.sampled_from(["kind", "nan", "unit", "suffix", "misspelt", "source"]))
def test_a_slip_is_refused(tmp_path_factory, of, slip):
    slug, section, name = of
    ways = [key for key, way in MODELS[slug].sections()[section].keys().items() if way[0] == name]
    key = ways[0]
    body = entry(1.0)
    if slip in ("kind", "nan"):
        body["value"] = {"a": 1} if slip == "kind" else [float("nan")]
    elif slip == "unit":
        body["unit"] = "furlong"
    elif slip == "suffix":
        key = next(name + suffix for suffix in reversed(KNOWN_SUFFIXES) if name + suffix not in ways)
    elif slip == "misspelt":
        key = f"{key}q"
    else:
        body.pop("source")
    path = written(tmp_path_factory.mktemp("slip"), {section: {key: body}}, slug)
    refused(path, f"readings.mine.{section}.{key}", slug=slug)
