"""Inputs of the powered-descent paper that belong together: one clear message names all of them, and the remedy."""

from pathlib import Path

import pytest

from marsedl.papers.powered_descent.inputs import Inputs
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.readings import load_studies

UNIT = {"noise__thrust_unit": 1.0}
ROOT = Path(__file__).parents[2]


def reading_of(based_on="corrected", **inputs):
    """A user's own reading; inputs: values by section and name, with two underscores between them."""
    mine = {"based_on": based_on}
    for name, value in inputs.items():
        section, _, key = name.partition("__")
        mine.setdefault(section, {})[key] = {"value": value, "source": "assumed: test"}
    own = {"powered_descent": {"readings": {"mine": mine}}}
    return load_studies({"powered_descent": Inputs}, ROOT, own)["powered_descent"].readings["mine"]


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
        (
            "corrected",
            {"simulation__command_interval": 0.25},
            ["command_interval (0.25 s)", "time_step (0.1 s)", "held for 0.2 s"],
        ),
        # Flown with 0.0385 s, an Euler mean was 0.42 m off.
        (
            "corrected",
            {"simulation__time_step": 0.04},
            ["time_step (0.04 s) does not fit the 0.5 s", "segment of 26 s: lower it to 0.0384615 s"],
        ),
        ("corrected", {"mission__segment_durations": [26.0, 15.02]}, ["time_step (0.1 s)", "segment of 15.02 s"]),
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
        {"simulation__command_interval": 0.3},
        {"simulation__time_step": 0.04, "simulation__output_interval": 1.0},
    ],
)
def test_inputs_that_fit_together_are_accepted(inputs):
    assert reading_of(**inputs).inputs
