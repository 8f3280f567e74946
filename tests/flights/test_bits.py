"""Flights have the bits that `digests.json` holds."""

import json
import runpy
from pathlib import Path

import pytest

CASES = runpy.run_path(str(Path(__file__).with_name("cases.py")))
HELD = json.loads(CASES["DIGESTS"].read_text(encoding="utf-8"))


def test_every_case_is_held():
    assert set(HELD) == set(CASES["CASES"])


@pytest.mark.parametrize("slug", ["stochastic_entry", "powered_descent", "desensitized", "random_field"])
def test_flights_have_the_bits_that_are_held(slug):
    differing = [
        f"{name}: {array}"
        for name, held in HELD.items()
        if name.startswith(f"{slug}/")
        for array, digest in CASES["digests"](name).items()
        if digest != held[array]
    ]
    assert differing == []
