"""Inputs of the funnels paper: what its readings are, and bad ones refused with one message that names the key."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.models.atmosphere import named_profile
from marsedl.papers.funnels import environment, nominal
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
    inputs_by_section = {}
    for key, value in inputs.items():
        section = next((name for name, of in MODEL.sections().items() if stem(key) in of.model_fields), "mission")
        inputs_by_section.setdefault(section, {})[key] = {"value": value, "source": "assumed: test"}
    overlay = {"readings": {"mine": {"based_on": based_on, **inputs_by_section}}}
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
        ({"start_banks_deg": []}, ["start_banks"]),
        ({"studied_intervals": [100, 150]}, ["studied_intervals", "multiple"]),
        (
            {"steps_per_slice": 7},
            ["guidance.fine_steps (240) is not a multiple of recursion.steps_per_slice (7); give 6 or 8"],
        ),
        ({"density_profile": "table"}, ["density_profile is 'table', but density_table is empty"]),
        ({"density_window_km": [60.0, 10.0]}, ["density_window", "wrong way round"]),
        ({"density_disturbance": "bilinear"}, ["density_disturbance", "parametric", "additive"]),
        ({"benchmark_slice": 26}, ["benchmark_slice"]),
        ({"studied_slices": [0.2, 1.0]}, ["studied_slices", "less than 1"]),
        ({"dubins_start": [0.0, 0.0]}, ["dubins_start"]),
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
    message = str(error.value)
    assert message.startswith("mine.yaml: funnels.readings.mine") and "\n" not in message
    for fragment in fragments:
        assert fragment in message


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
        "terminal_weight": {"guidance.terminal_weight"},
    }
    unchanged_inputs = {
        name: {key for key in differences[name] if reading.inputs.get(key) == base.inputs.get(key)}
        for name, reading in readings.items()
        if reading.based_on and (base := readings[reading.based_on])
    }
    assert not any(unchanged_inputs.values())  # nothing is set to what it was


def test_the_size_smoke_is_a_valid_reading_too():
    for reading in load_study("funnels", MODEL, CONFIG, size="smoke").readings.values():
        limited = MODEL.model_validate(reading.inputs.model_dump(mode="json"))
        sizes = limited.ensemble.trials, limited.recursion.steps_per_slice, limited.guidance.fine_steps
        assert sizes == (200, 4, 64)
        assert list(limited.studies.studied_stages) == [8, 8, 8] and limited.studies.coarse_stages == 8


@pytest.mark.parametrize("inputs", [{"steps_per_slice": 6}, {"steps_per_slice": 3}, {"steps_per_slice": 20},
                                    {"fine_steps": 300}])  # fmt: skip
def test_other_numbers_of_slices_need_no_other_inputs(inputs):
    mine = reading_of(**inputs).inputs
    stages = mine.guidance.fine_steps // mine.recursion.steps_per_slice
    loop = SimpleNamespace(steps=mine.guidance.fine_steps)
    for share in (0.0, *mine.studies.studied_slices, mine.studies.stationary_slice, 0.9999):
        number = environment.slice_at(loop, mine.recursion.steps_per_slice, share)
        assert 1 <= number <= stages and abs(number - 1 - share * stages) < 1.0
    for count in (1, *mine.studies.studied_stages, mine.studies.coarse_stages, 10_000):
        assert mine.guidance.fine_steps % environment.spacing_of(loop, count) == 0


def test_shares_of_the_flight_are_the_slices_of_the_configuration():
    studies, loop = reading_of().inputs.studies, SimpleNamespace(steps=240)
    assert [environment.slice_at(loop, 4, share) for share in studies.studied_slices] == [16, 26, 41]
    assert [environment.slice_at(loop, 4, share) for share in (studies.benchmark_slice, studies.stationary_slice)] == [
        26,
        29,
    ]
    assert [environment.spacing_of(loop, count) for count in (*studies.studied_stages, studies.coarse_stages)] == [
        16,
        8,
        4,
        8,
    ]


def test_starts_out_of_bounds_are_drawn_into_them():
    mine = reading_of(bank_bounds_deg=[50.0, 80.0], start_final_times=[100.0, 240.0]).inputs
    starts = np.array(nominal.starts(mine.mission, mine.guidance))
    assert starts[0] == pytest.approx([np.radians(63.0), 240.0])
    assert np.degrees(starts[:, 0].min()) == pytest.approx(50.0) and starts[:, 1].min() == 120.0


def test_another_profile_is_a_line_through_its_logarithm_in_a_window():
    given = environment.undisturbed_air(reading_of().inputs.planet)
    # The line that is written in the configuration is this one, of 201 altitudes.
    fitted = environment.undisturbed_air(reading_of(density_profile="temperature_pressure_fit").inputs.planet)
    assert fitted[:2] == pytest.approx(given[:2], rel=1e-9)
    upper = environment.undisturbed_air(
        reading_of(density_profile="two_exponential", density_window_km=[40.0, 60.0]).inputs.planet
    )
    lower = environment.undisturbed_air(
        reading_of(density_profile="two_exponential", density_window_km=[10.0, 20.0]).inputs.planet
    )
    altitude = np.array([10e3, 15e3, 20e3])
    profile = named_profile("two_exponential")
    np.testing.assert_allclose(environment.log_density(lower, altitude), profile(altitude)[0], rtol=1e-9)
    assert upper[1] != pytest.approx(lower[1], rel=1e-3)
    table = [[altitude, float(np.exp(-4.0 - 1e-4 * altitude))] for altitude in (0.0, 5e4, 1e5)]
    tabled = environment.undisturbed_air(reading_of(density_profile="table", density_table=table).inputs.planet)
    assert tabled[:2] == pytest.approx([-4.0, -1e-4], rel=1e-9)


def test_disturbances_enter_the_exponent_or_the_density():
    parametric, additive = (
        environment.disturbed_air(mine.planet, mine.uncertainty)
        for mine in (reading_of().inputs, reading_of(density_disturbance="additive").inputs)
    )
    altitude, w = np.array([2e4, 8e4]), np.array([0.6, -0.8])
    mean = environment.density(parametric, altitude)
    share = 0.05 * 0.6 - 1e-6 * 0.8 * altitude
    np.testing.assert_allclose(environment.density(parametric, altitude, w), mean * np.exp(share), rtol=1e-12)
    np.testing.assert_allclose(environment.density(additive, altitude, w), mean * (1.0 + share), rtol=1e-12)
    angle = np.linspace(0.0, 2.0 * np.pi, 2001)
    disc = np.array([np.cos(angle), np.sin(angle)])
    for air in (parametric, additive):
        worst = environment.densest(air, altitude)
        for k in range(2):
            among = environment.density(air, altitude[k], disc)
            for side, best in ((1.0, among.max()), (-1.0, among.min())):
                assert environment.density(air, altitude[k], side * worst[:, k]) == pytest.approx(best, rel=1e-7)


def test_stated_inputs_are_those_of_the_claims():
    claims = {claim.id: claim for claim in load_published(ROOT / "data" / "published" / "funnels.yaml")}
    printed = load_study("funnels", MODEL, CONFIG).readings["printed"].inputs
    assert len(claims) == 51
    assert claims["mc_trajectories"].printed == printed.ensemble.trials
    assert claims["exponent_d"].printed == printed.recursion.exponent_d
    assert claims["fig4_step"].printed == printed.studies.fig4_slice
    assert claims["stop_altitude"].printed == printed.mission.final_altitude / 1e3
