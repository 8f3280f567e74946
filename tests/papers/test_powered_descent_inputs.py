"""Inputs of the powered-descent paper that belong together: one clear message names all of them, and the remedy."""

from pathlib import Path

import pytest

from marsedl.papers.powered_descent.inputs import MODEL
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.readings import load_studies, load_study

UNIT = {"noise__thrust_unit": 1.0}
ROOT = Path(__file__).parents[2]


def reading_of(based_on="corrected", **inputs):
    """A user's own reading; inputs: values by section and name, with two underscores between them."""
    mine = {"based_on": based_on}
    for name, value in inputs.items():
        section, _, key = name.partition("__")
        mine.setdefault(section, {})[key] = {"value": value, "source": "assumed: test"}
    own = {"powered_descent": {"readings": {"mine": mine}}}
    return load_studies({"powered_descent": MODEL}, ROOT, own)["powered_descent"].readings["mine"]


@pytest.mark.parametrize(
    ("based_on", "inputs", "fragments"),
    [
        ("corrected", {"vehicle__maximum_thrust": 17000.0}, ["thrust_unit is 18000 N", "17000 N", "'other'"]),
        ("corrected", UNIT | {"noise__coefficient_unit": "acceleration"}, ["coefficient_unit 'acceleration'", "1500"]),
        (
            "corrected",
            {"simulation__command_interval": 0.05},
            ["command_interval (0.05 s)", "time_step (0.1 s)"],
        ),
        ("corrected", {"studies__choice_steps": [0.02, 0.2]}, ["choice_command_intervals (0.1 s)", "choice_steps"]),
    ],
)
def test_inputs_that_do_not_fit_together_are_refused(based_on, inputs, fragments):
    with pytest.raises(InputError) as error:
        reading_of(based_on, **inputs)
    message = str(error.value)
    assert message.startswith("--config") and "\n" not in message
    for fragment in fragments:
        assert fragment in message


@pytest.mark.parametrize(
    "inputs",
    [
        {"vehicle__maximum_thrust": 17000.0, "noise__thrust_unit": 17000.0},
        {"simulation__command_interval": 0.25},
    ],
)
def test_inputs_that_fit_together_are_accepted(inputs):
    assert reading_of(**inputs).inputs


def test_readings_fly_equal_numbers_of_trials():
    readings = load_study("powered_descent", MODEL, ROOT).readings
    trials = {name: reading.inputs.ensemble.large_trials for name, reading in readings.items()}
    assert {trials.pop("printed"), trials.pop("printed_eq46")} == {0}  # frozen
    assert set(trials.values()) == {100_000}
