"""Cases of more trials than are kept one by one: whatever is made of them agrees with what all trials say."""

from dataclasses import fields
from importlib import import_module

import matplotlib.pyplot as plt
import numpy as np
import pytest

from marsedl.montecarlo import streaming
from marsedl.replication.records import store
from marsedl.replication.records.tables import printed_cells

TRIALS, EXACT, BLOCK = 2000, 1200, 100
PAPERS = ("powered_descent", "stochastic_entry")


class Flown:
    """The cases of a paper flown twice with the same trials: each kept, and only the first of them kept."""

    def __init__(self, pipeline, published):
        self.pipeline, self.published, self.slug = pipeline, published, pipeline.paper.slug
        cases = [case for case, size in pipeline.model.CASES.items() if size.endswith(".trials")]
        records = {name: pipeline.stage(name, "corrected") for name in ("nominal", "linearization", "gains")}
        self.exact = records | {case: self.fly(case) for case in cases}
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(streaming, "EXACT_TRIALS", EXACT)
            self.streamed = records | {case: self.fly(case) for case in cases}
            self.first = cases[0]
            self.in_chunks = self.fly(self.first, chunks=3)

    def fly(self, case, chunks=1):
        gains = self.pipeline.gains()
        return self.pipeline.fly("corrected", gains, case, TRIALS, chunks, block_size=BLOCK)

    def product(self, kind, stem):
        return self.pipeline.product(kind, stem, "corrected", self.streamed, published=self.published)


@pytest.fixture(scope="module", params=PAPERS)
def cases(request):
    fixtures = {"powered_descent": ("pipeline", "published"), "stochastic_entry": ("entry", "entry_published")}
    return Flown(*map(request.getfixturevalue, fixtures[request.param]))


def test_results_do_not_depend_on_chunks(cases):
    whole = cases.streamed[cases.first]
    assert type(whole).__name__ == "StreamedFlightEnsemble" and whole.final_state.shape[0] == EXACT
    for field in fields(whole):
        np.testing.assert_array_equal(getattr(whole, field.name), getattr(cases.in_chunks, field.name), strict=True)


def test_artifacts_of_large_cases_are_loaded_in_the_place_of_others(cases, tmp_path):
    whole, path = cases.streamed[cases.first], tmp_path / "montecarlo.h5"
    store.save(path, whole, paper=cases.slug, reading="mine", provenance={})
    records = import_module(f"marsedl.papers.{cases.slug}.records")
    loaded = store.load(path, records.FlightEnsemble, paper=cases.slug, reading="mine")
    assert type(loaded) is type(whole)
    for field in fields(whole):
        np.testing.assert_array_equal(getattr(whole, field.name), getattr(loaded, field.name))


def test_percentiles_of_the_final_state_are_within_their_bound(cases):
    for case in (name for name in cases.exact if name in cases.pipeline.model.CASES):
        exact, streamed = cases.exact[case], cases.streamed[case]
        for component in range(exact.final_state.shape[1]):
            for level in (0.01, 0.5, 0.95):
                (percentile, error), (expected, expected_error) = (
                    streaming.final_percentile(ensemble, component, level) for ensemble in (streamed, exact)
                )
                samples = exact.final_state[:, component] - streamed.centre[component]
                between = [np.quantile(samples, level, method=method) for method in ("lower", "higher")]
                bound = streaming.RELATIVE_ACCURACY * max(np.abs(between))
                assert abs(percentile - expected) <= bound + 1e-12 * abs(expected)
                assert error == pytest.approx(expected_error, rel=0.02, abs=bound + 1e-6)
        # Bins are finest at the centre: where percentiles are asked for it is within the spread of the trials.
        spread = exact.final_state.std(axis=0)
        off = np.abs(exact.final_state.mean(axis=0) - streamed.centre[: len(spread)])
        assert (off <= 2 * spread + 1e-6).sum() >= len(spread) - 2  # all but counts


def test_claims_agree_with_those_of_all_trials(cases):
    exact, streamed = (cases.pipeline.evaluate("corrected", records) for records in (cases.exact, cases.streamed))
    assert exact.keys() == streamed.keys()
    compared = 0
    for name, expected in exact.items():
        evaluation = streamed[name]
        if expected is None or expected.value is None:
            assert evaluation is None or evaluation.value is None
            continue
        assert evaluation.trials == expected.trials, name
        if isinstance(expected.value, bool):
            assert evaluation.value == expected.value, name
        elif expected.standard_error is None:
            np.testing.assert_allclose(evaluation.value, expected.value, rtol=1e-9, atol=1e-12, err_msg=name)
        else:
            error = np.asarray(expected.standard_error)
            np.testing.assert_array_less(
                np.abs(np.subtract(evaluation.value, expected.value)), 0.01 * error + 1e-12, name
            )
            # Those of a covariance come from the kept trials.
            np.testing.assert_allclose(evaluation.standard_error, error, rtol=0.1, err_msg=name)
            compared += 1
    assert compared >= 4


def test_tables_and_figures_are_made_and_tell_all_trials(cases):
    paper, text = cases.pipeline.paper, ""
    for stem in (*paper.tables, *paper.figures):
        needs = [need.split(".")[-1] for need in paper.product(stem).needs]
        if not set(needs) <= cases.streamed.keys():
            continue
        if stem in paper.tables:
            text += "\n".join(" ".join(cells) for cells in printed_cells(cases.product("tables", stem)))
        else:
            plt.close(cases.product("figures", stem))
    assert "2,000" in text


def test_a_case_without_finite_trials_is_told_as_such(entry, entry_published, monkeypatch):
    """The stochastic law as printed has no gains; its claims, tables and figures say so of a large case too."""
    monkeypatch.setattr(streaming, "EXACT_TRIALS", EXACT // 10)
    cases = list(entry.model.CASES)
    records = {name: entry.stage(name, "printed") for name in ("nominal", "linearization", "gains")}
    gains = entry.gains("printed")
    records |= {case: entry.fly("printed", gains, case, trials=TRIALS // 10, block_size=BLOCK) for case in cases}
    lost = records["stochastic_velocity"]
    assert streaming.is_streamed(lost) and (lost.count, lost.excluded) == (0, TRIALS // 10)
    evaluations = entry.evaluate("printed", records)
    assert np.isnan(evaluations["tab4_downrange_stochastic_velocity"].value).all()
    assert "200 not finite" in str(evaluations["tab4_downrange_stochastic_velocity"].evidence)
    rows = entry.product("tables", "tab04", "printed", records, published=entry_published)
    assert set(rows["trials"][rows["law"] == "stochastic"]) == {0}
    ends = entry.product("tables", "endings", "printed", records).iloc[-1]
    assert (ends["trials"], ends["completed"], ends["not finite"]) == (200, 0, 200)
    for stem in ("reversals", "floor"):
        plt.close(entry.product("figures", stem, "printed", records))
