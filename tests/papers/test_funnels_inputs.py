"""Inputs of the funnels paper: what its readings are, and bad ones refused with one message that names the key."""

from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.models.atmosphere import named_profile
from marsedl.papers.funnels import environment, nominal
from readings import reading_of as any_reading_of


def reading_of(**inputs):
    return any_reading_of("funnels", **inputs)


@pytest.mark.parametrize("inputs", [{"steps_per_slice": 6}, {"steps_per_slice": 3}, {"steps_per_slice": 20},
                                    {"fine_steps": 300}])  # fmt: skip
def test_other_numbers_of_slices_need_no_other_inputs(inputs):
    mine = reading_of(**inputs).inputs
    stages = mine.guidance.fine_steps // mine.recursion.steps_per_slice
    loop = SimpleNamespace(steps=mine.guidance.fine_steps)
    for share in (0.0, mine.studies.benchmark_slice, mine.studies.stationary_slice, 0.9999):
        number = environment.slice_at(loop, mine.recursion.steps_per_slice, share)
        assert 1 <= number <= stages and abs(number - 1 - share * stages) < 1.0
    for count in (1, mine.studies.coarse_stages, 10_000):
        assert mine.guidance.fine_steps % environment.spacing_of(loop, count) == 0


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
