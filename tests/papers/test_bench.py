"""Benchmarks measure what agrees: the flights in C have the bits of the kernels, those in array code their numbers."""

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
        monkeypatch.setattr(module, "TRIALS", TRIALS)
        monkeypatch.setattr(module, "interleaved", lambda functions, repetitions=1: [1.0] * len(functions))
        monkeypatch.setattr(import_module("measuring"), "interleaved", module.interleaved)
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
    module.compare_flights(rows, module.run("powered_descent").record("gains"))
    assert f"speed of the kernel over strict C, {TRIALS} trials with outputs" in rows.quantities


def test_stochastic_entry(bench, rows, entry):
    """Array code is compared for the laws by velocity, C for those by time too."""
    module, case = bench("stochastic_entry"), "apollo_velocity"
    design = SimpleNamespace(record=lambda name: entry.stage(name, "corrected"))
    module.compare_flights(rows, design, case)
    assert f"speed of the kernel over strict C, {TRIALS} flights of {case} with outputs" in rows.quantities
    posed, options = module.problem(design, "stochastic_time", TRIALS)
    in_c = module.fly_c(module.compiled.library("stochastic_entry"), *posed, **options)
    module.same_bits(in_c, module.flight.fly(*posed, **options))
