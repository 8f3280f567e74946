"""Flights of every paper: they do not depend on how they are run, and a trial that is flown again is that one."""

from dataclasses import fields, replace

import numpy as np
import pytest

from marsedl.replication.pipeline.catalogue import Trial


@pytest.mark.parametrize(
    ("paper", "case"),
    [
        ("pipeline", "closed_loop"),
        ("entry", "apollo_velocity"),
        ("random_field", "aerocapture"),
        ("desensitized", "entry_errors"),
        ("funnels", "constant"),
        ("funnels", "adversarial"),
    ],
)
def test_a_case_is_its_chunks_and_each_of_its_trials(request, few_slices, paper, case):
    made, trial = request.getfixturevalue(paper), 33
    changes = few_slices if paper == "funnels" else {}
    sizes, gains = {"trials": 60, "block_size": 20}, made.gains("corrected", **changes)
    flown = [made.fly("corrected", gains, case, chunks=number, **sizes, **changes) for number in (1, 3)]
    needed = made.needed("montecarlo", "corrected", **changes)
    inputs = made.inputs("corrected", **changes)
    whole = made.whole(inputs, needed, case, **sizes)
    for other in flown:
        for field in fields(whole):
            np.testing.assert_array_equal(getattr(whole, field.name), getattr(other, field.name), err_msg=field.name)
    larger = made.fly("corrected", gains, case, trials=100, **changes)
    np.testing.assert_array_equal(larger.final_state[..., :60, :], whole.final_state)

    def replayed(ensemble):
        return inputs.replay(made.montecarlo, **needed, trial=Trial(case, trial, ensemble))

    report = replayed(whole)
    assert report.startswith(f"trial {trial}") and "the same to the last bit" in report and "DIFFERS" not in report
    assert f"{whole.final_state.reshape(-1, *whole.final_state.shape[-2:])[0, trial, 0]:18.12g}" in report
    assert "DIFFERS" in replayed(replace(whole, final_state=np.nextafter(whole.final_state, np.inf)))
    assert "bit" not in replayed(None)
