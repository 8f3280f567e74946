"""Stated inputs: printed values that are inputs of the replication, as `data/published` names them."""

import re
from collections.abc import Mapping

import numpy as np

from marsedl.replication.claims.printed import PublishedClaim
from marsedl.replication.claims.verdicts import Evaluation
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.inputs.sections import SUFFIXES, Inputs

# Factors from printed units to the input's own SI unit, beside those of its suffixes.
_FACTORS = {("percent", "1"): 0.01, ("%", "1"): 0.01, ("r_p", "1"): 1.0, ("rad/s", "1/s"): 1.0}
_NO_UNITS = ("1", "not given")  # of printed values that name none
_NAME = re.compile(r"(\w+\.\w+)(?:\[(\d+)\])?")


def stated_value(claim: PublishedClaim, values: Mapping[str, object], model: type[Inputs]) -> Evaluation:
    """Return what a reading uses for a stated input, in the unit in which it is printed.

    values: all inputs of the reading as plain values by "section.name". Raises InputError, which names the claim, if
    there is no such input or entry, or if its unit is not the printed one.
    """
    names = claim.input if isinstance(claim.input, list) else [claim.input]
    units = [unit.strip() for unit in claim.unit.split(",")]
    try:
        if len(units) not in (1, len(names)):
            raise ValueError(f"{len(units)} units for {len(names)} inputs; give one, or one for each")
        units *= len(names) // len(units)
        numbers = [_in_unit(name, unit, values, model) for name, unit in zip(names, units, strict=True)]
    except ValueError as error:
        raise InputError(f"data/published/{claim.paper}.yaml: claim {claim.id}: key 'input': {error}") from None
    return Evaluation(numbers if isinstance(claim.input, list) else numbers[0])


def _in_unit(name: str, unit: str, values: Mapping[str, object], model: type[Inputs]) -> object:
    match = _NAME.fullmatch(name)
    if not match or match[1] not in values:
        raise ValueError(f"there is no input '{name}'; {nearest(name, model.names())}")
    value, si = values[match[1]], model.unit(match[1])
    if match[2] is not None:
        if not isinstance(value, list) or int(match[2]) >= len(value):
            raise ValueError(f"the input '{match[1]}' has no entry {match[2]}; count from 0")
        value = value[int(match[2])]
    # A printed value without a unit is that of an input whose unit has no other spelling.
    if unit == si or (unit in _NO_UNITS and si not in (*SUFFIXES, "1/s")):
        return value
    suffix = "_" + unit.replace("/", "_").replace("^", "")  # km/s is _km_s
    factor = SUFFIXES.get(si, {}).get(suffix) or _FACTORS.get((unit, si))
    if factor is None:
        raise ValueError(
            f"it is printed in '{unit}', but the input '{name}' is in '{si}'; correct the unit or the name, or write a"
            " function for the claim"
        )
    return (np.asarray(value) / factor).tolist()
