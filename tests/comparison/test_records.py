"""What a comparison is given: inputs and artifacts of every paper, by the names and types of its functions."""

import sys
import types

from marsedl.comparison.records import collect
from marsedl.replication.inputs.sections import Positive, Section, given


class Tiny(tuple):
    """An artifact."""


class Body(Section):
    """One input."""

    factor: Positive = given("1", "a factor")


def funnels(body: Body, nominal: Tiny, large: Tiny | None = None):
    return body.factor * sum(nominal), large


def test_artifacts_and_inputs_reach_the_function_of_their_paper(monkeypatch):
    module = types.ModuleType("marsedl.comparison.tiny")
    module.funnels = funnels
    monkeypatch.setitem(sys.modules, "marsedl.comparison.tiny", module)
    stored = {("nominal.h5", Tiny): Tiny([1.0, 2.0]), ("large.h5", Tiny): Tiny([3.0])}

    def collected(factor, **files):
        return collect("tiny", {"funnels": {"body.factor": factor}}, {"funnels": files}, lambda *key: stored[key])

    assert collected(2.0, nominal="nominal.h5") == {"funnels": (6.0, None)}
    assert collected(1.0, nominal="nominal.h5", large="large.h5") == {"funnels": (3.0, Tiny([3.0]))}
