"""Sections: every input of every reading has the value that it had before there were any."""

import hashlib
import json
from pathlib import Path

import pytest

from marsedl.papers import input_model
from marsedl.replication.inputs.readings import load_study

ROOT = Path(__file__).parents[2]
# Of all inputs by their names without the section, numbers as floats. A new reading is entered, none is changed.
DIGESTS = json.loads(Path(__file__).with_name("input_digests.json").read_text(encoding="utf-8"))


def plain(value):
    if isinstance(value, list):
        return [plain(entry) for entry in value]
    return value if value is None or isinstance(value, bool | str) else float(value)


@pytest.mark.parametrize("slug", DIGESTS)
def test_no_input_changed_with_its_section(slug):
    study = load_study(slug, input_model(slug), ROOT)
    digests = {}
    for name, reading in study.readings.items():
        values = {key.partition(".")[2]: plain(value) for key, value in reading.inputs.plain().items()}
        assert len(values) == len(reading.inputs.names()), "two sections have an input of one name"
        digests[name] = hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]
    assert digests == DIGESTS[slug]
