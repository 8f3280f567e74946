"""Sections: every input of every reading has the value that it had before there were any."""

import hashlib
import json
from pathlib import Path

import pytest

from marsedl.papers import input_model
from marsedl.replication.inputs import load_study

ROOT = Path(__file__).parents[2]
# Of all inputs by their names without the section, numbers as floats. A new reading is entered, none is changed.
DIGESTS = {
    "powered_descent": {
        "printed": "c77081d48fc6",
        "printed_eq46": "ec617f385254",
        "corrected": "c54b06fd1a47",
        "target4": "a9e392eea8cd",
        "plus_sign": "0acd54b4a7a8",
        "euler": "245b51868ea6",
        "newton_noise": "32694755e6d9",
        "kilonewton_noise": "df17fd0df85c",
        "acceleration_noise": "809548f922f0",
        "mars_weight_noise": "252513e6b804",
        "earth_weight_noise": "2a333d96150a",
    },
    "random_field": {
        "printed": "2ad87f52639a",
        "corrected": "bb6b93e1ebdf",
        "sign_printed": "9b3e90482389",
        "variance_printed": "e8ad867c34a1",
        "literal_gains": "441f5846c914",
        "pf_printed": "711c4b6c16f5",
        "metres": "c1df44bca704",
        "metres_pf_printed": "63954793ccb1",
        "kink_undershoot": "ec5e1114f0bd",
        "kink_overshoot": "ca17f750b868",
        "both_branches": "b58ce227b11a",
        "end_step_25": "7d98cc27eac2",
        "tf_500": "a4f319c27e34",
        "angle_printed": "06385d2f7c03",
        "reference_expansion": "25e28a799140",
        "reference_propagated": "e03a9ded0124",
        "metres_variance": "3bfe312b46ae",
        "metres_growth": "a3a2494dd506",
        "correlated": "c6750eeb009e",
        "doc_fit_correlated": "d9183e8b4e15",
        "marsgram_daily_mean": "dbf08bf4dfa6",
        "jezero_2021": "60c3a94958b3",
        "cospar_nh_mean": "a874710a3b9b",
        "doc_fit": "d22dfe99a9e8",
        "exponential": "cd813631d2ff",
        "cc_to_4": "a195c26b054d",
        "slopes_printed": "9c6ce860b42c",
    },
    "desensitized": {
        "printed": "639bfa30c52b",
        "corrected": "cdc35eee444d",
        "one_reversal": "af8d6d92fc04",
        "single_weight": "c7c0e60029b0",
        "mixed_units": "f8d6ac926014",
        "feedback_tuned": "6727b2e3ec49",
        "trapezoid": "25d479449960",
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
        "printed": "453ce1a45da4",
        "corrected": "bde4894a3621",
        "desensitized_density": "5fa1715841aa",
        "marsgram_table": "82a490561564",
        "printed_aero": "6b18ccbf560f",
        "printed_heading": "94b22013f987",
        "printed_heading_sign": "8d51f70b4d5e",
        "same_sign": "51bd555a07f6",
        "short_positive": "f22936be6753",
        "timed_covariance": "72297fe9aab2",
        "partition_24": "0c381c16973d",
        "partition_20": "869d07d9e86c",
        "drag_form": "65a9b9197b4d",
        "density_blind": "b17d959f31df",
        "velocity_adjoint": "742fe303c3ca",
        "density_blind_velocity_adjoint": "b9f4c13c97a2",
        "density_blind_same_sign": "97bd64c1579c",
        "density_blind_same_sign_short": "6a77016e4216",
    },
}


def plain(value):
    if isinstance(value, list):
        return [plain(entry) for entry in value]
    return value if value is None or isinstance(value, bool | str) else float(value)


@pytest.mark.parametrize("slug", DIGESTS)
def test_no_input_changed_with_its_section(slug, monkeypatch):
    monkeypatch.chdir(ROOT)  # from where files named by inputs are read
    study = load_study(slug, input_model(slug), Path("configs") / f"{slug}.yaml")
    digests = {}
    for name, reading in study.readings.items():
        values = {key.partition(".")[2]: plain(value) for key, value in reading.inputs.plain().items()}
        assert len(values) == len(reading.inputs.names()), "two sections have an input of one name"
        digests[name] = hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]
    assert digests == DIGESTS[slug]
