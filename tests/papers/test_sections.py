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
        "printed": "6ec4c9a8241f",
        "printed_eq46": "75806368205e",
        "corrected": "8d869f3353d1",
        "target4": "07706d18ff19",
        "plus_sign": "8c83e7bceb6e",
        "newton_noise": "2e17a500bc62",
    },
    "random_field": {
        "printed": "4524d687916a",
        "corrected": "0cf7525d1670",
        "sign_printed": "b59c89e7e8ee",
        "variance_printed": "57a2183e88f6",
        "literal_gains": "c7e16c2b0ac8",
        "pf_printed": "b8a3a94a60b1",
        "metres": "9c6587108ab8",
        "kink_undershoot": "09ed1a286fe6",
        "kink_overshoot": "9856910fb4c9",
        "both_branches": "732a984a014d",
        "tf_500": "9288f923e979",
        "angle_printed": "a8a54d1cca12",
        "reference_expansion": "09d50d6c4653",
        "metres_variance": "5b61d5fa58cc",
        "doc_fit": "f29e3af5d8c7",
        "doc_fit_correlated": "ec5abce2542b",
        "marsgram_daily_mean": "8598cf74d2e4",
        "jezero_2021": "86a88c9053bc",
        "exponential": "fad810d19c99",
        "cc_to_4": "e7d5dd4f6b80",
    },
    "desensitized": {
        "printed": "73f02600f097",
        "corrected": "7eb2b9e89a98",
        "one_reversal": "2957df97b4ff",
        "single_weight": "80cdba5de72d",
        "mixed_units": "7b246fb93519",
        "feedback_tuned": "e5c2572026ea",
        "trapezoid": "479628a869d6",
    },
    "funnels": {
        "printed": "f19a21b4686e",
        "corrected": "8c3fda00bac3",
        "euler": "24b1303e77fc",
        "additive": "fdc4feea288c",
        "minkowski_shape": "4a71e15a30fe",
        "terminal_weight": "c033ac2863b8",
    },
    "stochastic_entry": {
        "printed": "06e32fc8ae19",
        "corrected": "929afd6ae11b",
        "desensitized_density": "008c6bedee71",
        "printed_aero": "676ae99a249a",
        "printed_heading": "ef2888a7b2ba",
        "same_sign": "43d6422ef879",
        "timed_covariance": "11fe2a35b4df",
        "partition_24": "d7bde0ab7e30",
        "partition_20": "0f70021e956c",
        "density_blind": "248fdb70e057",
        "velocity_adjoint": "cf7027fb6e68",
        "density_blind_same_sign": "70081f61254b",
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
