"""Inputs of the funnels paper: what its readings are, and bad ones refused with one message that names the key."""

from pathlib import Path

import numpy as np
import pytest

from marsedl.papers.funnels.inputs import MODEL
from marsedl.replication.claims import load_published
from marsedl.replication.errors import InputError
from marsedl.replication.inputs import load_study

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "configs" / "funnels.yaml"


def stem(key):
    """The name of an input without the suffix of its unit."""
    return key.removesuffix("_deg").removesuffix("_km")


def reading_of(based_on="corrected", **inputs):
    """A user's own reading."""
    own = {}
    for key, value in inputs.items():
        section = next((name for name, of in MODEL.sections().items() if stem(key) in of.model_fields), "mission")
        own.setdefault(section, {})[key] = {"value": value, "source": "assumed: test"}
    overlay = {"readings": {"mine": {"based_on": based_on, **own}}}
    return load_study("funnels", MODEL, CONFIG, overlay=overlay, overlay_name="mine.yaml").readings["mine"]


@pytest.mark.parametrize(
    ("inputs", "fragments"),
    [
        ({"bank_bounds_deg": [105.0, 15.0]}, ["bank_bounds", "wrong way round"]),
        ({"final_velocity_bounds": [550.0, 550.0]}, ["final_velocity_bounds", "wrong way round"]),
        ({"final_time_bounds": [500.0, 120.0]}, ["final_time_bounds", "wrong way round"]),
        ({"final_altitude_km": 126.0}, ["final_altitude is not below entry_altitude"]),
        ({"least_velocity": 201.0}, ["least_velocity", "final_velocity_bounds"]),
        ({"guess_bank_deg": 10.0}, ["guess_bank", "outside of its bounds"]),
        ({"guess_final_time": 501.0}, ["guess_final_time: 501", "120 to 500"]),
        ({"start_banks_deg": [63.0, 106.0]}, ["start_banks", "outside of its bounds"]),
        ({"start_final_times": [100.0]}, ["start_final_times: 100", "120 to 500"]),
        ({"start_banks_deg": []}, ["start_banks"]),
        ({"studied_intervals": [100, 150]}, ["studied_intervals", "multiple"]),
        ({"steps_per_slice": 7}, ["guidance.fine_steps (240) is not a multiple of recursion.steps_per_slice (7)"]),
        ({"redraw_steps": 9}, ["guidance.fine_steps (240) is not a multiple of ensemble.redraw_steps (9)"]),
        (
            {"backward_steps_per_slice": 7},
            ["guidance.fine_steps (240) is not a multiple of studies.backward_steps_per_slice (7)"],
        ),
        ({"dubins_steps_per_slice": 7}, ["dubins_fine_steps (400) is not a multiple of dubins_steps_per_slice (7)"]),
        ({"fine_steps": 1}, ["fine_steps", "greater than or equal to 2"]),
        ({"initial_lengths_km": [0.15, 0.0, 0.25]}, ["initial_lengths", "greater than 0"]),
        ({"initial_lengths_km": [0.15, 0.25]}, ["initial_lengths"]),
        ({"initial_angles_deg": [0.015, -0.015]}, ["initial_angles", "greater than 0"]),
        ({"scale_bank_deg": 0.0}, ["scale_bank", "greater than 0"]),
        ({"terminal_weight": -1.0}, ["terminal_weight", "greater than 0"]),
        ({"dubins_state_weight": [1.0, -1.0, 1.0]}, ["dubins_state_weight", "greater than 0"]),
        ({"density_amplitude": -0.05}, ["density_amplitude", "greater than or equal to 0"]),
        ({"log_density_slope": 9.7e-5}, ["log_density_slope", "less than 0"]),
        ({"additive": 1}, ["additive", "boolean"]),
        ({"inflated": "yes"}, ["inflated", "boolean"]),
        ({"condition": "runge_kutta"}, ["condition", "flow", "euler"]),
        ({"sampling": "sphere"}, ["sampling", "whitened", "raw"]),
        ({"shape": "minkowski"}, ["shape", "value_matrix", "minimum_trace"]),
        ({"nominal_choice": "best"}, ["nominal_choice", "guess", "best_of_starts"]),
        ({"taylor_order": 4}, ["taylor_order", "less than or equal to 3"]),
        ({"exponent_d": -1}, ["exponent_d", "greater than or equal to 0"]),
        ({"largest_feedback_deg": 0.0}, ["largest_feedback", "greater than 0"]),
        ({"fig4_slice": 61}, ["fig4_slice: no stage begins at slice 61, as there are 61"]),
        ({"steps_per_slice": 240}, ["fig4_slice: no stage begins at slice 7, as there are 2"]),
        ({"fig4_coordinates": [1, 7]}, ["fig4_coordinates", "less than or equal to 6"]),
        ({"fig4_coordinates": [4, 4]}, ["fig4_coordinates", "two different ones"]),
        ({"ascent_polished": 2001}, ["ascent_polished (2001) is above ascent_starts (2000)"]),
        ({"trials": 0}, ["trials", "greater than 0"]),
        ({"guess_bank": 1.1}, ["needs its unit in its name", "guess_bank_deg"]),
        ({"initial_lengths_deg": [1.0, 1.0, 1.0]}, ["wrong unit suffix '_deg'"]),
        ({"entry_azimuth_deg": 90.0}, ["entry_azimuth_deg: unknown key"]),
    ],
    ids=lambda value: ",".join(value) if isinstance(value, dict) else "",
)
def test_inputs_that_contradict_are_refused(inputs, fragments):
    with pytest.raises(InputError) as error:
        reading_of(**inputs)
    said = str(error.value)
    assert said.startswith("mine.yaml: funnels.readings.mine") and "\n" not in said
    for fragment in fragments:
        assert fragment in said


def test_units_are_turned_into_si():
    mine = reading_of(guess_bank_deg=90.0, final_downrange_km=600.0, scale_lengths_km=[1.0, 2.0, 3.0]).inputs
    assert mine.guidance.guess_bank == pytest.approx(np.pi / 2, rel=1e-15)
    assert mine.mission.final_downrange == 6e5 and mine.guidance.scale_lengths.tolist() == [1e3, 2e3, 3e3]
    assert mine.mission.entry_flight_path_angle == pytest.approx(np.radians(-15.5), rel=1e-15)


def test_readings_differ_from_each_other_where_they_should():
    readings = load_study("funnels", MODEL, CONFIG).readings
    differences = {name: set(reading.differences()) for name, reading in readings.items()}
    assert differences.pop("printed") == set(MODEL.names())
    assert differences == {
        "corrected": {
            f"recursion.{name}" for name in ("condition", "sampling", "exponent_d", "largest_level", "largest_feedback")
        },
        "euler": {"recursion.condition"},
        "best_nominal": {"guidance.nominal_choice"},
        "inflated": {"recursion.inflated"},
        "additive": {"uncertainty.additive"},
        "minkowski_shape": {"recursion.shape"},
    }
    changed = {
        name: {key for key in differences[name] if reading.inputs.get(key) == base.inputs.get(key)}
        for name, reading in readings.items()
        if reading.based_on and (base := readings[reading.based_on])
    }
    assert not any(changed.values())  # nothing is set to what it was


def test_the_size_smoke_is_a_valid_reading_too():
    for reading in load_study("funnels", MODEL, CONFIG, size="smoke").readings.values():
        limited = MODEL.model_validate(reading.inputs.model_dump(mode="json"))
        sizes = limited.ensemble.trials, limited.recursion.steps_per_slice, limited.guidance.fine_steps
        assert sizes == (200, 4, 64)
        assert list(limited.studies.studied_slices) == [15, 15, 15]


def test_stated_inputs_are_those_of_the_claims():
    claims = {claim.id: claim for claim in load_published(ROOT / "data" / "published" / "funnels.yaml")}
    printed = load_study("funnels", MODEL, CONFIG).readings["printed"].inputs
    assert len(claims) == 49
    assert claims["mc_trajectories"].printed == printed.ensemble.trials
    assert claims["exponent_d"].printed == printed.recursion.exponent_d
    assert claims["fig4_step"].printed == printed.studies.fig4_slice
    assert claims["stop_altitude"].printed == printed.mission.final_altitude / 1e3
