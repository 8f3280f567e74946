"""Cases of more trials than are kept one by one: whatever is made of them agrees with what all trials say."""

from dataclasses import fields
from importlib import import_module

import matplotlib.pyplot as plt
import numpy as np
import pytest

from marsedl.montecarlo import streaming
from marsedl.replication import artifacts
from marsedl.replication.tables import printed_cells

TRIALS, EXACT, BLOCK = 2000, 1200, 100
PAPERS = ("powered_descent", "stochastic_entry")


class Flown:
    """The cases of a paper flown twice with the same trials: each kept, and only the first of them kept."""

    def __init__(self, pipeline, published):
        self.pipeline, self.published, self.slug = pipeline, published, pipeline.paper.slug
        cases = [case for case, size in pipeline.model.CASES.items() if size.endswith(".trials")]
        made = {name: pipeline.stage(name, "corrected") for name in ("nominal", "linearization", "gains")}
        self.exact = made | {case: self.fly(case) for case in cases}
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(streaming, "EXACT_TRIALS", EXACT)
            self.streamed = made | {case: self.fly(case) for case in cases}
            self.first = cases[0]
            self.in_chunks = self.fly(self.first, chunks=3)

    def fly(self, case, chunks=1):
        gains = self.pipeline.gains()
        return self.pipeline.fly("corrected", gains, case, TRIALS, chunks, block_size=BLOCK)

    def product(self, kind, stem):
        return self.pipeline.product(kind, stem, "corrected", self.streamed, published=self.published)


@pytest.fixture(scope="module", params=PAPERS)
def flown(request):
    known = {"powered_descent": ("pipeline", "published"), "stochastic_entry": ("entry", "entry_published")}
    return Flown(*map(request.getfixturevalue, known[request.param]))


def test_results_do_not_depend_on_chunks(flown):
    whole = flown.streamed[flown.first]
    assert type(whole).__name__ == "StreamedFlightEnsemble" and whole.final_state.shape[0] == EXACT
    for field in fields(whole):
        np.testing.assert_array_equal(getattr(whole, field.name), getattr(flown.in_chunks, field.name), strict=True)


def test_artifacts_of_large_cases_are_loaded_in_the_place_of_others(flown, tmp_path):
    whole, path = flown.streamed[flown.first], tmp_path / "montecarlo.h5"
    artifacts.save(path, whole, paper=flown.slug, reading="mine", provenance={})
    records = import_module(f"marsedl.papers.{flown.slug}.records")
    loaded = artifacts.load(path, records.FlightEnsemble, paper=flown.slug, reading="mine")
    assert type(loaded) is type(whole)
    for field in fields(whole):
        np.testing.assert_array_equal(getattr(whole, field.name), getattr(loaded, field.name))


def test_percentiles_of_the_final_state_are_within_their_bound(flown):
    for case in (name for name in flown.exact if name in flown.pipeline.model.CASES):
        exact, streamed = flown.exact[case], flown.streamed[case]
        for component in range(exact.final_state.shape[1]):
            for level in (0.01, 0.5, 0.95):
                (found, error), (expected, known) = (
                    streaming.final_percentile(ensemble, component, level) for ensemble in (streamed, exact)
                )
                samples = exact.final_state[:, component] - streamed.centre[component]
                between = [np.quantile(samples, level, method=method) for method in ("lower", "higher")]
                bound = streaming.RELATIVE_ACCURACY * max(np.abs(between))
                assert abs(found - expected) <= bound + 1e-12 * abs(expected)
                assert error == pytest.approx(known, rel=0.02, abs=bound + 1e-6)
        # Bins are finest at the centre: where percentiles are asked for it is within the spread of the trials.
        spread = exact.final_state.std(axis=0)
        off = np.abs(exact.final_state.mean(axis=0) - streamed.centre[: len(spread)])
        assert (off <= 2 * spread + 1e-6).sum() >= len(spread) - 2  # all but counts


def test_claims_agree_with_those_of_all_trials(flown):
    exact, streamed = (flown.pipeline.evaluate("corrected", made) for made in (flown.exact, flown.streamed))
    assert exact.keys() == streamed.keys()
    compared = 0
    for name, expected in exact.items():
        found = streamed[name]
        if expected is None or expected.value is None:
            assert found is None or found.value is None
            continue
        assert found.trials == expected.trials, name
        if isinstance(expected.value, bool):
            assert found.value == expected.value, name
        elif expected.standard_error is None:
            np.testing.assert_allclose(found.value, expected.value, rtol=1e-9, atol=1e-12, err_msg=name)
        else:
            error = np.asarray(expected.standard_error)
            np.testing.assert_array_less(np.abs(np.subtract(found.value, expected.value)), 0.01 * error + 1e-12, name)
            # Those of a covariance come from the kept trials.
            np.testing.assert_allclose(found.standard_error, error, rtol=0.1, err_msg=name)
            compared += 1
    assert compared >= 4


def test_tables_and_figures_are_made_and_tell_all_trials(flown):
    paper, told = flown.pipeline.paper, ""
    for stem in (*paper.tables, *paper.figures):
        needs = [need.split(".")[-1] for need in paper.product(stem).needs]
        if not set(needs) <= flown.streamed.keys():
            continue
        if stem in paper.tables:
            told += "\n".join(" ".join(cells) for cells in printed_cells(flown.product("tables", stem)))
        else:
            plt.close(flown.product("figures", stem))
    assert "2,000" in told


def test_a_case_without_finite_trials_is_told_as_such(entry, entry_published, monkeypatch):
    """The stochastic law as printed has no gains; its claims, tables and figures say so of a large case too."""
    monkeypatch.setattr(streaming, "EXACT_TRIALS", EXACT // 10)
    cases = list(entry.model.CASES)
    made = {name: entry.stage(name, "printed") for name in ("nominal", "linearization", "gains")}
    gains = entry.gains("printed")
    made |= {case: entry.fly("printed", gains, case, trials=TRIALS // 10, block_size=BLOCK) for case in cases}
    lost = made["stochastic_velocity"]
    assert streaming.is_streamed(lost) and (lost.count, lost.excluded) == (0, TRIALS // 10)
    found = entry.evaluate("printed", made)
    assert np.isnan(found["tab4_downrange_stochastic_velocity"].value).all()
    assert "200 not finite" in found["tab4_downrange_stochastic_velocity"].evidence
    rows = entry.product("tables", "tab04", "printed", made, published=entry_published)
    assert set(rows["trials"][rows["law"] == "stochastic"]) == {0}
    ends = entry.product("tables", "endings", "printed", made).iloc[-1]
    assert (ends["trials"], ends["completed"], ends["not finite"]) == (200, 0, 200)
    split = entry.product("tables", "reversal_split", "printed", made).iloc[-1]
    assert (split["law"], split["trigger"], split["trials"]) == ("stochastic", "velocity", 0)
    for stem in ("reversals", "floor"):
        plt.close(entry.product("figures", stem, "printed", made))
