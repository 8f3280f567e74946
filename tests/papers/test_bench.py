"""Benchmarks measure what agrees: flights in C have the bits of the kernels, those in array code their numbers."""

import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

BENCH = Path(__file__).parents[2] / "bench"
TRIALS = 70  # more than one group


@pytest.fixture
def bench(monkeypatch):
    """A function that imports a benchmark by its paper, with few trials and without repetitions."""
    modules = {path.stem for path in BENCH.glob("*.py")}
    monkeypatch.syspath_prepend(str(BENCH))

    def imported(slug):
        module = import_module(slug)
        monkeypatch.setattr(module, "TRIALS", TRIALS, raising=False)
        measuring = import_module("measuring")
        monkeypatch.setattr(measuring, "interleaved", lambda functions, repetitions=1: [1.0] * len(functions))
        return module

    yield imported
    for name in modules:
        sys.modules.pop(name, None)


@pytest.fixture
def rows():
    """The quantities of a benchmark's rows, and the function that takes them."""

    def row(quantity, value, unit, **limits):
        row.quantities.append(quantity)

    row.quantities = []
    return row


def test_powered_descent(bench, rows):
    module = bench("powered_descent")
    module.compare(rows, module.run("powered_descent").record("gains"))
    assert f"speed of the kernel over strict C, {TRIALS} trials with outputs" in rows.quantities
    assert "speed of the kernel over array code" in rows.quantities


def test_stochastic_entry(bench, rows, entry):
    module = bench("stochastic_entry")
    for case in module.CASES:
        module.compare(rows, SimpleNamespace(record=lambda name: entry.stage(name, "corrected")), case)
        assert f"speed of the kernel over strict C, {TRIALS} flights of {case} with outputs" in rows.quantities


def test_doors(bench, rows, monkeypatch):
    module = bench("doors")
    monkeypatch.setattr(module, "REPETITIONS", 1)
    module.trajectories(rows)
    assert "optimal and desensitize over the methods put together by hand" in rows.quantities
