"""Flights have the bits that `digests.json` holds, compiled and as the functions are written."""

import json
import runpy
from dataclasses import replace
from functools import wraps
from pathlib import Path

import pytest

from marsedl.montecarlo.flights import Flight

FLIGHTS = runpy.run_path(str(Path(__file__).with_name("cases.py")))
CASES, HELD = FLIGHTS["CASES"], json.loads(FLIGHTS["DIGESTS"].read_text(encoding="utf-8"))


def differing(names):
    own = {name: FLIGHTS["digests"](name) for name in names}
    return [f"{name}: {array}" for name in own for array in HELD[name] if own[name][array] != HELD[name][array]]


@pytest.mark.parametrize("slug", ["stochastic_entry", "powered_descent", "desensitized", "random_field"])
def test_flights_have_the_bits_that_are_held(slug):
    assert HELD.keys() == CASES.keys()
    assert differing(name for name in CASES if name.startswith(f"{slug}/")) == []


def test_single_flights_have_the_same_bits_in_plain_python(monkeypatch):
    """Those of one trial, of every paper and integrator, to the ground and with commands beyond their limits, too."""

    @wraps(Flight.fly)  # whose arguments `fly_in_python` has
    def in_python(model, *arguments, **options):
        into = options.pop("into", None)
        flown = model.fly_in_python(*arguments, trial=options.get("first_trial", 0), **options)
        if into is None:
            return flown
        history, observed = (table[..., :1] for table in into)
        history[:], observed[:] = flown.history, flown.observed
        return replace(flown, history=history, observed=observed)

    monkeypatch.setattr(Flight, "fly", in_python)
    alone = [name for name in CASES if (CASES[name].get("trials"), CASES[name].get("first")) == (1, 77)]
    assert len(alone) > 15 and differing(alone) == []
