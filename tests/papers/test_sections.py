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
        "printed": "634af196f7bd",
        "printed_eq46": "9e7ee5487f6a",
        "corrected": "8d2f0be61593",
        "target4": "889487704727",
        "plus_sign": "3807555bc037",
        "euler": "8463f7d92c22",
        "newton_noise": "9594d08eb6d8",
        "kilonewton_noise": "cec88677b043",
        "acceleration_noise": "6f1076edf88c",
        "mars_weight_noise": "30666c710836",
        "earth_weight_noise": "cd58ddaa2749",
    },
    "random_field": {
        "printed": "7abd236d0ee1",
        "corrected": "cc5ea8e22f81",
        "sign_printed": "9a2441af3395",
        "variance_printed": "ae07c7164202",
        "literal_gains": "8c8a9547f95c",
        "pf_printed": "4da4e92cb7ef",
        "metres": "28f756b577d3",
        "metres_pf_printed": "f2b9f2e1f685",
        "kink_undershoot": "628e08527f98",
        "kink_overshoot": "a5ebb183f37c",
        "both_branches": "77a2b1e1c381",
        "end_step_25": "c20e943ca8c8",
        "tf_500": "3b96132fd0bb",
        "marsgram_daily_mean": "6b79fda138aa",
        "jezero_2021": "81a928473496",
        "cospar_nh_mean": "7cfff25919d0",
        "doc_fit": "761cb931ce29",
        "exponential": "88f6938e55ad",
        "cc_to_4": "7ddc7ef20f42",
    },
    "desensitized": {
        "printed": "a4e0ff85a038",
        "corrected": "1e310c334ec0",
        "one_reversal": "57bdf551fd93",
        "single_weight": "854e6673a66a",
        "mixed_units": "edacdc7c33cc",
        "feedback_tuned": "58ce8d0967df",
    },
    "funnels": {
        "printed": "e4a6b3695e3b",
        "corrected": "530c8f44796c",
        "euler": "d48ccba80ac5",
        "best_nominal": "5bf63a387279",
        "inflated": "41bb70dbfedb",
        "additive": "6540e21a774a",
        "minkowski_shape": "8352613fd8d7",
    },
    "stochastic_entry": {
        "printed": "79e3f6d3d355",
        "corrected": "bda6018b2aaf",
        "desensitized_density": "78e5a9a2f020",
        "marsgram_table": "d321bb16876a",
        "printed_aero": "e3048b9fb6ea",
        "printed_heading": "de78e02b3292",
        "printed_heading_sign": "92e4e7909dd7",
        "partition_24": "70e285243179",
        "partition_20": "d760c2cb00bc",
        "drag_form": "f55bf90fe73f",
        "density_blind": "b943c16bfc5c",
        "velocity_adjoint": "84914b6839a5",
        "density_blind_velocity_adjoint": "68976c1c9b63",
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
    found = {}
    for name, reading in study.readings.items():
        values = {key.partition(".")[2]: plain(value) for key, value in reading.inputs.plain().items()}
        assert len(values) == len(reading.inputs.names()), "two sections have an input of one name"
        found[name] = hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]
    assert found == DIGESTS[slug]
