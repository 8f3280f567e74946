"""Bad input of the random-field paper: one clear message each, that names the key or the limit, and the remedy."""

import re
from pathlib import Path

import numpy as np
import pytest

from marsedl.papers.random_field.inputs import Inputs
from marsedl.replication.errors import InputError, MarsedlError
from marsedl.replication.inputs.readings import load_studies

ROOT = Path(__file__).parents[2]
NODES = [0.0, 50.0, *(25.0 * k for k in range(3, 15)), 400.0]


def reading_of(based_on="corrected", **inputs):
    """A user's own reading."""
    inputs_by_section = {}
    for name, value in inputs.items():
        section = next((section for section, of in Inputs.sections().items() if name in list(of.keys())), "air")
        inputs_by_section.setdefault(section, {})[name] = {"value": value, "source": "assumed: test"}
    own = {"random_field": {"readings": {"mine": {"based_on": based_on, **inputs_by_section}}}}
    return load_studies({"random_field": Inputs}, ROOT, own)["random_field"].readings["mine"]


def refused(**inputs):
    """The one line with which a reading is refused."""
    with pytest.raises(InputError) as error:
        reading_of(**inputs)
    message = str(error.value)
    assert message.startswith("--config: random_field.readings.mine") and "\n" not in message
    return message


@pytest.mark.parametrize(
    ("inputs", "fragments"),
    [
        ({"partition": [*NODES[:-1], 340.0]}, ["partition", "node 13 is 350 and node 14 is 340"]),
        ({"initial_control": 1.5}, ["guidance.initial_control", "vehicle.control_limits, -1 to 1"]),
        ({"initial_correlations": [0.9, 0.9, -0.9]}, ["initial_correlations", "belong to no covariance"]),
        (
            {"partition": [0.0, 51.2, 400.0]},
            ["mission.partition", "(51.2) is not a multiple of simulation.time_step (0.5)"],
        ),
        ({"time_step": 1.0e-6, "output_interval": 1.0e-6}, ["time_step", "integration steps, more than 100000"]),
        ({"control_limits": [1.0, -1.0]}, ["control_limits does not increase: 1, -1"]),
        (
            {"variance_growth_sign": -1, "correlation_length_km": 50.0},
            ["correlation_length", "50000 m makes no covariance"],
        ),
    ],
    ids=lambda value: ",".join(value) if isinstance(value, dict) else "",
)
def test_inputs_that_contradict_are_refused(inputs, fragments):
    message = refused(**inputs)
    for fragment in fragments:
        assert fragment in message


def test_the_printed_partition_is_reported_where_a_reading_asks_for_it(random_field):
    """Only then: the same nodes in any other reading are refused before anything is computed."""
    printed = random_field.study.readings["printed"].inputs.mission
    assert printed.invalid_partition == "report"
    message = refused(partition=list(printed.partition))
    assert "node 17 is 450 and node 18 is 400" in message
    mine = reading_of(invalid_partition="report", partition=list(printed.partition)).inputs.mission
    assert list(mine.partition) == list(printed.partition)


# --- refusals of the stages -------------------------------------------------------------------------------------------


def test_an_entry_angle_outside_of_the_bracket_is_refused(random_field):
    """Steeper than the solution at both ends; shallower at both; the misses are told in planet radii."""
    for bracket, sign in (((-14.0, -11.0), -1), ((-9.5, -8.5), 1)):
        with pytest.raises(MarsedlError) as error:
            random_field.nominal("corrected", entry_angle_bracket=np.radians(bracket))
        message = str(error.value)
        misses = re.search(r"missed by (\S+) and (\S+) planet radii", message)
        assert all(sign * float(text) > 0.0 for text in misses.groups())


def test_a_trajectory_that_leaves_the_density_table_is_refused(random_field):
    """At 500 s the vehicle is near 200 km."""
    changes = {"final_time": 500.0, "partition": random_field.inputs("tf_500").partition}
    with pytest.raises(
        MarsedlError, match=r"leaves the density table \(0 to 130 km\) at 4\d\d.*density_beyond_table"
    ) as error:
        random_field.nominal("jezero_2021", **changes)
    time, altitude = map(float, re.search(r"at (\S+) s, at (\S+) km", str(error.value)).groups())
    nominal = random_field.nominal("jezero_2021", density_beyond_table="continue", **changes)
    assert np.interp(time, nominal.time, nominal.altitude) == pytest.approx(1e3 * altitude, abs=1e3)
    assert random_field.nominal("tf_500").altitude[-1] == pytest.approx(200e3, abs=10e3)
