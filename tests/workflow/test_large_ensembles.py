"""More trials than are kept one by one, asked for by configuration alone."""

import re
from pathlib import Path

import pytest

from marsedl.montecarlo.streaming import final_percentile
from marsedl.papers.powered_descent.records import FlightEnsemble, StreamedFlightEnsemble
from marsedl.replication.records import store
from marsedl.replication.records.differences import digest

pytestmark = pytest.mark.workflow

PAGE = Path(__file__).parents[2] / "docs" / "scaling.md"

EXACT, TRIALS = 2000, 5345
TARGET = "data/cache/powered_descent/mine/montecarlo.closed_loop.h5"
MINE = """
powered_descent:
  readings:
    mine:
      based_on: corrected
      summary: More trials than are kept one by one.
      ensemble:
        trials: {value: %d, source: "assumed: many"}
"""


def test_a_large_case_is_the_same_for_any_chunks_and_keeps_its_first_trials(tree, tmp_path, monkeypatch):
    """In a project that keeps fewer of them one by one."""
    tree.edit("src/marsedl/montecarlo/streaming.py", "\nEXACT_TRIALS = 200_000", f"\nEXACT_TRIALS = {EXACT}")
    mine = tmp_path / "mine.yaml"
    mine.write_text(MINE % TRIALS, encoding="utf-8")
    digests = []
    for chunks in (5, 1):
        tree.config = [f"chunks={chunks}"]  # of the full size: the smoke size limits trials
        tree.path(TARGET).unlink(missing_ok=True)
        tree.works(TARGET, configfile=mine)
        digests.append(digest(tree.path(TARGET)))
    assert digests[0] == digests[1]

    ensemble = store.load(tree.path(TARGET), FlightEnsemble, paper="powered_descent", reading="mine")
    assert isinstance(ensemble, StreamedFlightEnsemble)
    assert ensemble.count + ensemble.excluded == ensemble.outcome_counts.sum() == TRIALS
    assert len(ensemble.final_state) == EXACT

    (example,) = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    monkeypatch.chdir(tree.folder)
    names = {}
    exec(compile(example, str(PAGE), "exec"), names)
    assert (names["value"], names["standard_error"]) == final_percentile(ensemble, 0, 0.999)
    altitude, error = final_percentile(ensemble, 1, 0.5)
    assert abs(altitude - 50.0) < 5 * error and error == pytest.approx(0.5 * (1.5708 / TRIALS) ** 0.5, rel=0.1)
