"""Slips in readings of every paper are refused with file, line and key; `test_inputs` has each class by hand."""

from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from marsedl.papers import SLUGS, input_model
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.readings import load_studies
from marsedl.replication.inputs.sections import KNOWN_SUFFIXES
from marsedl.replication.inputs.yaml_file import read_yaml

ROOT = Path(__file__).parents[3]
MODELS = {slug: input_model(slug) for slug in SLUGS}
INPUTS = [(slug, *name.split(".")) for slug, model in MODELS.items() for name in model.names()]
SOURCE = "assumed: test"


def refusal(path, slug, section, body) -> str:
    """The message with which a reading that sets some inputs of a section is refused."""
    reading = {"based_on": "corrected", section: body}
    path.write_text(yaml.safe_dump({slug: {"readings": {"mine": reading}}}), encoding="utf-8")
    models = {slug: MODELS[slug]}
    with pytest.raises(InputError) as caught:
        load_studies(models, ROOT, config_files=[path])
    message = str(caught.value)
    assert message.startswith(f"{path}:")
    assert "readings.mine" in message
    assert "\n" not in message
    return message


def test_all_faults_of_a_file_are_told_at_once_and_a_decimal_comma_by_its_name(tmp_path):
    path = tmp_path / "mine.yaml"
    reading = {"based_on": "corrected", "mission": {"velocityy": {"value": 1.0}}, "vehicl": {}, "frozen": "x"}
    path.write_text(yaml.safe_dump({"powered_descent": {"readings": {"mine": reading}}}), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_studies({"powered_descent": MODELS["powered_descent"]}, ROOT, config_files=[path])
    lines = str(caught.value).splitlines()
    assert len(lines) == len({*lines}) == 3 and all(line.startswith(f"{path}:") for line in lines)
    path.write_text("noise: {value: 0,5}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"line 1: the comma before 5 begins another key; write .* a decimal point"):
        read_yaml(path)


@settings(max_examples=30, deadline=None)
@given(of=st.sampled_from(INPUTS), slip=st.sampled_from(["kind", "nan", "unit", "suffix", "misspelt", "source"]))
def test_a_slip_is_refused(tmp_path_factory, of, slip):
    slug, section, name = of
    ways = {key: way for key, way in MODELS[slug].sections()[section].keys().items() if way[0] == name}
    key = next(iter(ways))
    entry = {"value": 1.0, "source": SOURCE}
    if slip in ("kind", "nan"):
        entry["value"] = {"a": 1} if slip == "kind" else [float("nan")]
    elif slip == "unit":
        entry["unit"] = "furlong"
    elif slip == "suffix":
        key = next(name + suffix for suffix in reversed(KNOWN_SUFFIXES) if name + suffix not in ways)
    elif slip == "misspelt":
        key = f"{key}q"
    else:
        entry.pop("source")
    message = refusal(tmp_path_factory.mktemp("slip") / "mine.yaml", slug, section, {key: entry})
    assert f"readings.mine.{section}.{key}" in message


@pytest.mark.parametrize(
    ("slug", "name", "value", "problem"),
    [
        ("stochastic_entry", "density_grid_interval", 1e-10, "altitudes from air.lowest_tabulated_altitude"),
        ("stochastic_entry", "partition_interval", 500.0, "is longer than mission.time_limit"),
        ("random_field", "output_interval", 1e-25, "must not be below time_step"),
        ("desensitized", "final_altitude", 1e8, "is not below entry_altitude: exchange them"),
        ("desensitized", "guess_banks", [10.0] * 15, "give one less than there are banks"),
        ("funnels", "least_velocity", 1e6, "lies above the first of final_velocity_bounds: lower it"),
        ("funnels", "fig4_coordinates", [2, 2], "two different ones span a plane"),
    ],
)
def test_inputs_that_do_not_go_together_are_refused(tmp_path, slug, name, value, problem):
    (section,) = (section for of, section, field in INPUTS if (of, field) == (slug, name))
    keys = MODELS[slug].sections()[section].keys()
    key = next(key for key, way in keys.items() if way[0] == name)
    assert problem in refusal(tmp_path / "mine.yaml", slug, section, {key: {"value": value, "source": SOURCE}})
