"""Readings of a user, and the one line with which they are refused."""

from pathlib import Path

import pytest

from marsedl.papers import input_model
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.readings import load_studies

ROOT = Path(__file__).parents[2]


def reading_of(slug, based_on="corrected", **inputs):
    """A user's own reading; inputs: values by their keys without that of the section."""
    model, mine = input_model(slug), {"based_on": based_on}
    section_of = {key: name for name, section in model.sections().items() for key in list(section.keys())}
    for key, value in inputs.items():
        mine.setdefault(section_of.get(key, "vehicle"), {})[key] = {"value": value, "source": "assumed: test"}
    return load_studies({slug: model}, ROOT, {slug: {"readings": {"mine": mine}}})[slug].readings["mine"]


def refusal(slug, **inputs):
    """The line with which a reading is refused."""
    with pytest.raises(InputError) as error:
        reading_of(slug, **inputs)
    message = str(error.value)
    assert message.startswith(f"--config: {slug}.readings.mine") and "\n" not in message
    return message
