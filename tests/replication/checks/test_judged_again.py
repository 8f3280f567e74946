"""Claims are judged again from artifacts, so that one which was edited and sealed again is found."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.replication.checks import judged_again
from marsedl.replication.claims.rows import write_claims
from marsedl.replication.claims.verdicts import Evaluation
from marsedl.replication.records import store
from marsedl.replication.records.fields import quantity

PRINTED = """claims:
- {id: scatter, where: Sec. 1, quantity: scatter, kind: deterministic, printed: 2.0, unit: m, resolution: 0.1}
"""
FLIGHTS = "data/cache/toy/corrected/montecarlo.closed_loop.h5"
GIVEN = {
    "inputs": {"corrected": {}},
    "artifacts": {"corrected": {"closed_loop": FLIGHTS}},
    "measured": "",
    "judged": {"require_reasons": False},
}


@dataclass(frozen=True)
class Flights:
    """Where flights end."""

    downrange: np.ndarray = quantity("m", ("trials",), "downrange")


def fly(root, scatter):
    flown = Flights(np.linspace(-1.0, 1.0, 101) * scatter * np.sqrt(3.0))
    store.save(root / FLIGHTS, flown, paper="toy", reading="corrected", provenance={})


def measured_again(asked, published, measured):
    return {"scatter": Evaluation(float(asked.artifact("closed_loop", Flights).downrange.std()))}


@pytest.fixture
def build(tmp_path, monkeypatch):
    """A build of one paper with one claim, which is measured from one ensemble."""
    own = SimpleNamespace(evaluate=measured_again, declarations={})
    monkeypatch.setattr(judged_again, "claims_of", lambda slug: own)
    for name, text in {"data/published/toy.yaml": PRINTED, "report/points/toy.json": "{}"}.items():
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    fly(tmp_path, 2.0)
    write_claims(judged_again.judged_again(tmp_path, tmp_path, "toy", GIVEN), tmp_path / "report/claims/toy.json")
    return tmp_path


def test_a_build_as_its_jobs_left_it_has_the_same_verdicts(build, capsys):
    assert judged_again.check_judged(build, build, {"toy": GIVEN})
    assert "toy: 1 claim judged again from artifacts: the same verdicts and numbers" in capsys.readouterr().out


def test_an_ensemble_that_is_edited_by_a_tenth_and_sealed_again_is_found(build, capsys):
    fly(build, 2.2)
    assert not judged_again.check_judged(build, build, {"toy": GIVEN})
    output = capsys.readouterr().out
    assert "others, so a file was changed by hand" in output
    assert "verdict of scatter, corrected" in output and "differs" in output
