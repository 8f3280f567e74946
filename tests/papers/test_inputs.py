"""Inputs that contradict each other are refused with one clear message, which names the key and the remedy."""

import pytest

from readings import reading_of, refusal

NODES = [0.0, 50.0, *(25.0 * k for k in range(3, 15)), 400.0]
REFUSED = {
    "powered_descent": [
        ({"maximum_thrust": 17000.0}, ["thrust_unit is 18000 N", "17000 N", "'other'"]),
        ({"thrust_unit": 1.0, "coefficient_unit": "acceleration"}, ["coefficient_unit 'acceleration'", "1500"]),
        ({"command_interval": 0.05}, ["command_interval (0.05 s)", "time_step (0.1 s)"]),
        ({"command_interval": 0.25}, ["command_interval (0.25 s)", "time_step (0.1 s)", "held for 0.2 s"]),
        # Flown with 0.0385 s, an Euler mean was 0.42 m off.
        (
            {"time_step": 0.04},
            ["time_step (0.04 s) does not fit the 0.5 s", "segment of 26 s: lower it to 0.0384615 s"],
        ),
        ({"segment_durations": [26.0, 15.02]}, ["time_step (0.1 s)", "segment of 15.02 s"]),
    ],
    "random_field": [
        ({"partition": [*NODES[:-1], 340.0]}, ["partition", "node 13 is 350 and node 14 is 340"]),
        ({"initial_control": 1.5}, ["guidance.initial_control", "vehicle.control_limits, -1 to 1"]),
        ({"initial_correlations": [0.9, 0.9, -0.9]}, ["initial_correlations", "belong to no covariance"]),
        (
            {"partition": [0.0, 51.2, 400.0]},
            ["mission.partition", "(51.2) is not a multiple of simulation.time_step (0.5)"],
        ),
        ({"output_interval": 1.0e-25}, ["simulation", "output_interval", "must not be below time_step"]),
        ({"time_step": 1.0e-6, "output_interval": 1.0e-6}, ["time_step", "integration steps, more than 100000"]),
        ({"control_limits": [1.0, -1.0]}, ["control_limits does not increase: 1, -1"]),
        (
            {"variance_growth_sign": -1, "correlation_length_km": 50.0},
            ["correlation_length", "50000 m makes no covariance"],
        ),
    ],
    "desensitized": [
        ({"final_time_bounds": [600.0, 100.0]}, ["final_time_bounds does not increase: 600, 100"]),
        ({"final_altitude": 1.0e8}, ["final_altitude", "is not below entry_altitude: exchange them"]),
        ({"guess_banks_deg": [10.0] * 15}, ["guess_banks", "give one less than there are banks"]),
        ({"guess_switch_times": [211.0, 61.0]}, ["guess_switch_times does not increase: 211, 61"]),
        (
            {"printed_weights": [0.001, 0.01, 0.1]},
            ["weight_rule is 'matched'", "matched_efforts has 4 values for 3 printed_weights"],
        ),
        ({"low_heights_km": [10.0, 2.0]}, ["low_heights does not increase: 10000, 2000"]),
        ({"initial_bank_rate_deg_s": -21.0}, ["initial_bank_rate lies beyond vehicle.bank_rate_bound"]),
        ({"scheme": "euler"}, ["scheme", "midpoint", "hermite_simpson"]),
        ({"roll_inerta": 0.0}, ["roll_inerta", "did you mean 'roll_inertia'"]),
    ],
    "funnels": [
        ({"bank_bounds_deg": [105.0, 15.0]}, ["bank_bounds does not increase", "write the smaller one first"]),
        ({"least_velocity": 1.0e6}, ["least_velocity", "lies above the first of final_velocity_bounds: lower it"]),
        ({"guess_final_time": 501.0}, ["guess_final_time: 501", "120 to 500"]),
        (
            {"steps_per_slice": 7},
            ["guidance.fine_steps (240) is not a multiple of recursion.steps_per_slice (7); give 6 or 8"],
        ),
        ({"fig4_coordinates": [4, 4]}, ["fig4_coordinates", "two different ones"]),
    ],
    "stochastic_entry": [
        ({"partition_interval": 2.5}, ["partition_interval", "must be multiples of"]),
        ({"partition_interval": 500.0}, ["partition_interval", "is longer than mission.time_limit"]),
        ({"altitude_limit_study_km": [0.5, 1.0, 1.0, 2.0, 2.5, 3.0]}, ["altitude_limit_study does not increase: 5"]),
        ({"highest_tabulated_altitude_km": 124.9}, ["highest_tabulated_altitude", "atmosphere_altitude"]),
        ({"density_grid_interval": 1.0e-10}, ["density_grid_interval", "altitudes from air.lowest_tabulated_altitude"]),
        ({"nominal_substeps": 7}, ["nominal_substeps (7)", "must be even", "write 8"]),
        ({"decay_factor": 3.0}, ["decay_factor (3)", "diffusion_factor (4)", "twice"]),
        ({"heading_alignment_velocity": 400.0}, ["heading_alignment_velocity (400", "mission.end_velocity (500"]),
        ({"apollo_covariance": "gains"}, ["apollo_covariance", "timed_gains"]),
        ({"deadband_times": [125.0, 105.0]}, ["deadband_times does not increase: 125, 105"]),
        ({"density_profile": "table"}, ["density_profile", "density_table", "write the name of its file"]),
        ({"density_profile": "table", "density_table": "mine.csv"}, ["mine.csv", "there is no such density table"]),
        ({"time_limit": 1.0e9}, ["time_limit", "guidance periods"]),
        ({"paper_trials": 1000000}, ["trials", "paper_trials"]),
    ],
}
ROWS = [(slug, *row) for slug, rows in REFUSED.items() for row in rows]


@pytest.mark.parametrize(("slug", "inputs", "fragments"), ROWS, ids=[f"{row[0]}:{','.join(row[1])}" for row in ROWS])
def test_inputs_that_contradict_are_refused(slug, inputs, fragments):
    message = refusal(slug, **inputs)
    assert not [fragment for fragment in fragments if fragment not in message], message


@pytest.mark.parametrize(
    "inputs",
    [
        {"maximum_thrust": 17000.0, "thrust_unit": 17000.0},
        {"command_interval": 0.3},
        {"time_step": 0.04, "output_interval": 1.0},
    ],
)
def test_inputs_that_fit_together_are_accepted(inputs):
    assert reading_of("powered_descent", **inputs).inputs
