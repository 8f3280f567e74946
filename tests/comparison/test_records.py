"""What a comparison is given: inputs and artifacts of every paper, by the names and types of its functions."""

import sys
import types
from dataclasses import dataclass

import numpy as np
import pytest

from marsedl.comparison.records import collect
from marsedl.replication.inputs.sections import Positive, Section, given
from marsedl.replication.records import store
from marsedl.replication.records.fields import quantity


@dataclass(frozen=True)
class Tiny:
    """Two numbers."""

    value: np.ndarray = quantity("m", ("two",), "numbers")


class Body(Section):
    """One input."""

    factor: Positive = given("1", "a factor")


def funnels(body: Body, nominal: Tiny, large: Tiny | None = None):
    return body.factor * nominal.value.sum(), large


@pytest.fixture
def comparison(monkeypatch):
    module = types.ModuleType("marsedl.comparison.tiny")
    module.funnels = funnels
    monkeypatch.setitem(sys.modules, "marsedl.comparison.tiny", module)


@pytest.fixture
def stored(tmp_path):
    path = tmp_path / "nominal.h5"
    store.save(path, Tiny(np.array([1.0, 2.0])), paper="funnels", reading="corrected", provenance={})
    return path


def load(path, kind):
    return store.load(path, kind, paper="funnels", reading="corrected")


def test_artifacts_and_inputs_reach_the_function_of_their_paper(comparison, stored):
    files = {"funnels": {"nominal": str(stored)}}
    assert collect("tiny", {"funnels": {"body.factor": 2.0}}, files, load) == {"funnels": (6.0, None)}
    files["funnels"]["large"] = str(stored)
    total, large = collect("tiny", {"funnels": {"body.factor": 1.0}}, files, load)["funnels"]
    assert (total, large.value.tolist()) == (3.0, [1.0, 2.0])
