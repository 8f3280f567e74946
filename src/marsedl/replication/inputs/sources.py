"""Where inputs come from: what readings and choices set, as it is written and in SI."""

from dataclasses import dataclass

from marsedl.replication.errors import InputError, shown
from marsedl.replication.inputs.messages import Keys, Place
from marsedl.replication.inputs.sections import Inputs


@dataclass(frozen=True)
class Source:
    """Where an input comes from: key, value and unit as written, the reading that sets it, and the value in SI."""

    key: str
    written: object
    unit: str
    source: str
    reading: str
    value: object


def inputs_set(model: type[Inputs], body: Keys, name: str, place: Place) -> dict[str, Source]:
    """Return the inputs that a reading or an alternative sets, by "section.name"; `name` is what sets them."""
    found: dict[str, Source] = {}
    for section, of in model.sections().items():
        for key, entry in getattr(body, section).items():
            (field, factor, unit), at = of.keys()[key], place / section / key
            if entry.unit not in ("", unit):
                raise InputError(f"{at / 'unit'}: is {shown(entry.unit)}, must be '{unit}'")
            source = Source(key, entry.value, unit, entry.source, name, in_si(entry.value, factor))
            if (other := found.setdefault(f"{section}.{field}", source)) is not source:
                raise InputError(f"{at}: '{field}' is set twice, also as '{other.key}'")
    return found


def in_si(value: object, factor: float) -> object:
    """Return a value in SI; what is no number is left to its section to refuse."""
    if isinstance(value, list):
        return [in_si(entry, factor) for entry in value]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return value * factor if is_number and factor != 1.0 else value
