"""Sections: every input of every reading has the value that it had before there were any."""

import hashlib
import json
from pathlib import Path

import pytest

from marsedl.papers import input_model
from marsedl.replication.inputs.readings import load_study

ROOT = Path(__file__).parents[2]
# Of all inputs by their names without the section, numbers as floats. A new reading is entered, none is changed.
DIGESTS = {
    "powered_descent": {
        "printed": "3b32d7a64217",
        "printed_eq46": "88bf24e0e602",
        "corrected": "99da4d6feaad",
        "target4": "1b561d754b24",
        "plus_sign": "87066b2abd04",
        "newton_noise": "ccb8b30716fe",
    },
    "random_field": {
        "printed": "cfa0e144a6be",
        "corrected": "6d63698f8890",
        "sign_printed": "9458ebf23dc5",
        "variance_printed": "1d2ade775bff",
        "literal_gains": "9a989ce82852",
        "pf_printed": "8c95010f2420",
        "metres": "2fd2cee99881",
        "kink_undershoot": "2dfba8512a0f",
        "kink_overshoot": "2e0644031f4b",
        "both_branches": "a58773a34692",
        "tf_500": "cd36ca53d5f8",
        "angle_printed": "ac3e8347fc0b",
        "reference_expansion": "c50d8112267c",
        "metres_variance": "7a767aea4258",
        "doc_fit": "aa325aecd8af",
        "doc_fit_correlated": "e62b0b690486",
        "marsgram_daily_mean": "a87f79c647f5",
        "jezero_2021": "af48ae15cfe8",
        "exponential": "d090519d4cd6",
        "cc_to_4": "49bf0d4e9701",
    },
    "desensitized": {
        "printed": "cca6bd8dcf54",
        "corrected": "3442a612d45f",
        "one_reversal": "e2fa43d348cc",
        "single_weight": "d722dfa5032a",
        "mixed_units": "7bcc24ccca9b",
        "feedback_tuned": "7a03bf9878e6",
        "trapezoid": "a560b88bf532",
    },
    "funnels": {
        "printed": "b1c43417c42f",
        "corrected": "a777634caf84",
        "euler": "213ab23b2c01",
        "additive": "e4749c0cdc18",
        "minkowski_shape": "5290a047b570",
        "terminal_weight": "2ecd06e05b81",
    },
    "stochastic_entry": {
        "printed": "1d5a2036b8bf",
        "corrected": "5f7dc8281e46",
        "desensitized_density": "e774ac8ebc9d",
        "printed_aero": "3ebc0771bdd1",
        "printed_heading": "d0bb81ccc6e1",
        "same_sign": "590edd3e6fc3",
        "timed_covariance": "6e54228953b4",
        "partition_24": "14d593d2a9ca",
        "partition_20": "96bb4ded6574",
        "density_blind": "1990f72f9875",
        "velocity_adjoint": "6bc4facef6d1",
        "density_blind_same_sign": "9d3e6cfacdd4",
    },
}


def plain(value):
    if isinstance(value, list):
        return [plain(entry) for entry in value]
    return value if value is None or isinstance(value, bool | str) else float(value)


@pytest.mark.parametrize("slug", DIGESTS)
def test_no_input_changed_with_its_section(slug):
    study = load_study(slug, input_model(slug), ROOT)
    digests = {}
    for name, reading in study.readings.items():
        values = {key.partition(".")[2]: plain(value) for key, value in reading.inputs.plain().items()}
        assert len(values) == len(reading.inputs.names()), "two sections have an input of one name"
        digests[name] = hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]
    assert digests == DIGESTS[slug]
