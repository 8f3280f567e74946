"""The study of combinations: it flies what the readings fly, and its table counts what the readings' claims count."""

import numpy as np
import pytest

from marsedl.papers.stochastic_entry.claims import measures
from marsedl.papers.stochastic_entry.records import CASES, DOWNRANGE, LEVELS
from marsedl.replication.claims.verdicts import judge

TRIALS = 300  # of the study in the tests


@pytest.fixture(scope="module")
def study(entry):
    return {combination.choices: combination.tails for combination in measures.combined(entry.combinations())}


# A reading, a case of it, and the combination that has to fly the same.
SAME = [
    ("corrected", "apollo_time", ("five_state", "time", 1.0, "opposite")),
    ("partition_24", "stochastic_velocity", ("five_state", "time", 10.0, "opposite")),
    ("density_blind_same_sign", "apollo_velocity", ("density_blind", "velocity", 1.0, "same")),
]


@pytest.mark.parametrize(("reading", "case", "choices"), SAME)
def test_a_combination_flies_what_its_reading_flies(entry, study, reading, case, choices):
    tails = measures.final_percentiles(entry.ensemble(reading, case, TRIALS))
    for state, (values, deviations) in tails.items():
        np.testing.assert_array_equal(study[choices][case][state][0], values)
        np.testing.assert_array_equal(study[choices][case][state][1], deviations)


def test_all_combinations_are_flown_and_differ(entry, study):
    assert len(study) == 3 * 2 * 3 * 3
    assert entry.combinations().trials == TRIALS
    ranges = {tails["apollo_velocity"][DOWNRANGE][0].tobytes() for tails in study.values()}
    assert len(ranges) == 3 * 3  # the adjoint of the fixed time and the partition are not Apollo's at the trigger
    ranges = {tails["stochastic_time"][DOWNRANGE][0].tobytes() for tails in study.values()}
    assert len(ranges) == 3 * 3


def test_without_aerodynamic_errors_every_vehicle_is_the_mean_one(entry):
    plain = entry.ensemble("corrected", "stochastic_time", TRIALS, lift_dispersion=0.0, drag_dispersion=0.0)
    index = list(entry.combinations().aerodynamic_errors).index("none")
    values = entry.combinations().stochastic[0, index, 0, DOWNRANGE]
    expected = np.quantile(plain.final_state[:, DOWNRANGE] - plain.nominal_final[DOWNRANGE], LEVELS)
    np.testing.assert_allclose(values, expected, rtol=1e-12)


def test_cells_are_counted_as_claims_judge_them(entry, entry_published):
    records = entry.artifacts("corrected")
    tails = {case: measures.final_percentiles(records[case]) for case in CASES}
    evaluations = entry.evaluate("corrected", records)
    cells = [f"tab4_{row[1]}_{case}" for row in measures.ROWS for case in CASES]
    counted = [name for name in cells if entry_published[name].kind == "monte_carlo"]
    verdicts = [judge(entry_published[name], evaluations[name]).verdict for name in counted]
    trials = dict.fromkeys(CASES, 2000)
    assert len(counted) == 14
    assert measures.reproduced_cells(entry_published, tails, trials) == verdicts.count("reproduced") > 0
    printed = {}
    for case in CASES:
        printed[case] = {}
        for state, name, factor, _ in measures.ROWS:
            values = np.array(entry_published[f"tab4_{name}_{case}"].printed) / factor
            printed[case][state] = values, np.zeros(2)
    assert measures.reproduced_cells(entry_published, printed, trials) == 14


def test_mirrored_percentiles_are_those_of_the_error_with_its_other_sign(entry):
    ensemble = entry.ensemble("corrected", "stochastic_velocity")
    error = ensemble.final_state[:, DOWNRANGE] - ensemble.nominal_final[DOWNRANGE]
    values, deviations = measures.mirrored(measures.final_percentiles(ensemble)[DOWNRANGE])
    np.testing.assert_allclose(values, np.quantile(-error, LEVELS), rtol=1e-12)
    assert (deviations > 0).all() and values[0] < values[1]


def test_the_covariance_of_the_apollo_law_is_that_of_the_reading(entry):
    """Eqs. 42, 45 and 50 alone make the bounds similar and the correlation positive; the flights are the same."""
    records = entry.artifacts("corrected")
    effective, timed = entry.evaluate("corrected", records), entry.evaluate("timed_covariance", records)
    for name, of_effective in (
        ("fig8_apollo_similar", False),
        ("fig8_more_aggressive", False),
        ("fig13_apollo_negative", True),
    ):
        assert (effective[name].value, timed[name].value) == (of_effective, not of_effective), name
    assert timed["tab4_downrange_apollo_time"].value == effective["tab4_downrange_apollo_time"].value
