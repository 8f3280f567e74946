"""Stated inputs: printed values that are inputs of the replication, as `data/published` names them."""

import re
from collections.abc import Mapping

import numpy as np

from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.verdicts import Evaluation
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.inputs.sections import SUFFIXES, Inputs

# Factors from printed units, where they are not the input's own SI unit, to it.
UNITS = {
    ("km", "m"): SUFFIXES["m"]["_km"],
    ("km/s", "m/s"): SUFFIXES["m/s"]["_km_s"],
    ("deg", "rad"): SUFFIXES["rad"]["_deg"],
    ("deg/s", "rad/s"): SUFFIXES["rad/s"]["_deg_s"],
    ("deg/s^2", "rad/s^2"): SUFFIXES["rad/s^2"]["_deg_s2"],
    ("percent", "1"): 0.01,
    ("%", "1"): 0.01,
    ("r_p", "1"): 1.0,  # in radii of the planet
    ("rad/s", "1/s"): 1.0,
}
NO_UNITS = ("1", "not given")  # of printed values that name none
WRITTEN = {si for _, si in UNITS} - {"1"}  # units that a printed value has to name
_NAME = re.compile(r"(\w+\.\w+)(?:\[(\d+)\])?")


def stated_value(claim: PublishedClaim, values: Mapping[str, object], model: type[Inputs]) -> Evaluation:
    """Return what a reading uses for a stated input, in the unit in which it is printed.

    Args:
        claim: the printed claim; its `input` is "section.name", "section.name[index]" or a list of these.
        values: all inputs of the reading as plain values by "section.name".
        model: the paper's inputs, which know the units.

    Raises:
        InputError: there is no such input or entry, or its unit is not the printed one; the message names the claim.

    """
    several = isinstance(claim.input, list)
    names = claim.input if several else [claim.input]
    units = [unit.strip() for unit in claim.unit.split(",")]
    if len(units) not in (1, len(names)):
        raise InputError(f"{_where(claim)}: {len(units)} units for {len(names)} inputs; give one, or one for each")
    units *= len(names) // len(units)
    numbers = [_in_unit(claim, name, unit, values, model) for name, unit in zip(names, units, strict=True)]
    return Evaluation(numbers if several else numbers[0])


def _in_unit(claim, name, unit, values, model):
    match = _NAME.fullmatch(name)
    if not match or match[1] not in values:
        raise InputError(f"{_where(claim)}: there is no input '{name}'; {nearest(name, model.names())}")
    value = values[match[1]]
    if match[2] is not None:
        if not isinstance(value, list) or int(match[2]) >= len(value):
            raise InputError(f"{_where(claim)}: the input '{match[1]}' has no entry {match[2]}; count from 0")
        value = value[int(match[2])]
    si = model.unit(match[1])
    if unit == si or (unit in NO_UNITS and si not in WRITTEN):
        return value
    if (unit, si) not in UNITS:
        raise InputError(
            f"{_where(claim)}: it is printed in '{unit}', but the input '{name}' is in '{si}'; correct the unit or the "
            "name, or write a function for the claim"
        )
    return (np.asarray(value) / UNITS[unit, si]).tolist()


def _where(claim: PublishedClaim) -> str:
    return f"data/published/{claim.paper}.yaml: claim {claim.id}: key 'input'"
