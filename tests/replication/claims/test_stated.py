"""Stated inputs: printed values that are inputs, in the unit in which they are printed."""

import numpy as np
import pytest

from marsedl.replication.claims.printed import PublishedClaim, stated_value
from marsedl.replication.claims.verdicts import Evaluation, judge
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.sections import Inputs, Section, given


class Mission(Section):
    """Of the toy paper."""

    altitude: float = given("m", "altitude")
    angle: float = given("rad", "angle")
    share: float = given("1", "share")
    limits: tuple = given("rad", "limits")


class ToyInputs(Inputs):
    """Of the toy paper."""

    mission: Mission


VALUES = {"mission.altitude": 125e3, "mission.angle": 0.2617993877991494, "mission.share": 0.9973}
VALUES["mission.limits"] = [0.2617993877991494, 0.5235987755982988]


def claim_of(name, printed, unit):
    named = {"paper": "toy", "id": "entry", "where": "Table 1", "quantity": "entry", "kind": "input"}
    return PublishedClaim(**named, printed=printed, unit=unit, input=name)


@pytest.mark.parametrize(
    ("name", "printed", "unit"),
    [
        ("mission.altitude", 125, "km"),
        ("mission.altitude", 125e3, "m"),
        ("mission.angle", 15, "deg"),
        ("mission.share", 99.73, "percent"),
        ("mission.share", 0.9973, "not given"),
        ("mission.limits", [15, 30], "deg"),
        ("mission.limits[1]", 30, "deg"),
        (["mission.altitude", "mission.angle"], [125, 15], "km, deg"),
    ],
)
def test_an_input_is_compared_in_the_printed_unit(name, printed, unit):
    claim = claim_of(name, printed, unit)
    assert judge(claim, Evaluation(stated_value(claim, VALUES, ToyInputs))).verdict == "as_stated"
    evaluations = {key: (1.01 * np.array(value)).tolist() for key, value in VALUES.items()}
    assert judge(claim, Evaluation(stated_value(claim, evaluations, ToyInputs))).verdict == "not_as_stated"


@pytest.mark.parametrize(
    ("name", "printed", "unit", "message"),
    [
        ("mission.altitud", 125, "km", "no input 'mission.altitud'.*mission.altitude"),
        ("altitude", 125, "km", "no input 'altitude'; did you mean 'mission.altitude'"),
        ("mission.altitude", 125, "deg", "printed in 'deg', but the input 'mission.altitude' is in 'm'"),
        ("mission.altitude", 125, "1", "printed in '1'"),  # a length needs its unit
        ("mission.limits[2]", 1, "deg", "no entry 2"),
        (["mission.altitude", "mission.angle"], [125, 15], "km, deg, s", "3 units for 2 inputs"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(name, printed, unit, message):
    with pytest.raises(InputError, match=f"data/published/toy.yaml: claim entry: key 'input': .*{message}"):
        stated_value(claim_of(name, printed, unit), VALUES, ToyInputs)
