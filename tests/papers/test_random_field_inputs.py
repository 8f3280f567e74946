"""Bad input of the random-field paper: one clear message each, that names the key or the limit, and the remedy."""

import re

import numpy as np
import pytest

from marsedl.replication.errors import MarsedlError
from readings import reading_of, refusal


def test_the_printed_partition_is_reported_where_a_reading_asks_for_it(random_field):
    """Only then: the same nodes in any other reading are refused before anything is computed."""
    printed = random_field.study.readings["printed"].inputs.mission
    assert printed.invalid_partition == "report"
    message = refusal("random_field", partition=list(printed.partition))
    assert "node 17 is 450 and node 18 is 400" in message
    mine = reading_of("random_field", invalid_partition="report", partition=list(printed.partition)).inputs.mission
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
