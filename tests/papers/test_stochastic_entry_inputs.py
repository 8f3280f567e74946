"""Bad input of the entry-guidance paper: one clear message each, that names the key or the limit, and the remedy."""

import re

import numpy as np
import pytest

from marsedl.papers.stochastic_entry import environment, nominal
from marsedl.papers.stochastic_entry.beyond import tradeoff
from marsedl.replication.errors import InfeasibleError, MarsedlError, SolverError
from marsedl.replication.pipeline.injection import Arguments
from readings import reading_of


def test_partitions_of_a_study_are_checked_by_its_stage(entry):
    """A reading that does not ask for the study need not fit it."""
    reading_of("stochastic_entry", coarse_interval=9.5)
    with pytest.raises(MarsedlError, match=r"design\.coarse_interval.*multiples of guidance\.guidance_period \(1 s\)"):
        needed = entry.needed("tradeoff", "corrected")
        entry.stage_inputs("corrected", "tradeoff", coarse_interval=9.5).call(tradeoff.compute, **needed)


def test_a_table_of_densities_may_reach_higher(entry):
    """Entry above the usual table's end, in a table that reaches there, starts in the density of its altitude."""
    higher = {"atmosphere_altitude": 130e3, "highest_tabulated_altitude": 131e3}
    base = entry.stage_inputs("corrected", "nominal", **higher)
    tabulated = environment.atmosphere(base.air)
    assert (tabulated.altitude[0], tabulated.altitude[-1]) == (-10e3, 131e3)
    flight = entry.nominal(**higher)
    assert flight.altitude[0] == pytest.approx(130e3, abs=1e-6)
    assert flight.density[0] == pytest.approx(np.exp(environment.profile(base.air)(np.array([130e3]))[0][0]), rel=1e-6)


def test_a_density_table_is_flown_as_its_numbers(entry, tmp_path):
    """A table of the reading's own density, on a fine grid, flies the same nominal."""
    base = entry.stage_inputs("corrected", "nominal")
    altitude = np.arange(-10e3, 127.1e3, 250.0)
    log_density = environment.profile(base)(altitude)[0]
    path = tmp_path / "mine.csv"
    rows = [f"{h:.1f},{density:.17e}" for h, density in zip(altitude, np.exp(log_density), strict=True)]
    path.write_text("altitude_m,density_kg_m3\n" + "\n".join(rows) + "\n", encoding="utf-8")
    mine = reading_of("stochastic_entry", density_profile="table", density_table=str(path))
    assert np.shape(mine.inputs.air.density_table) == (len(altitude), 2)  # the numbers, not the path
    trajectory = Arguments(mine.inputs.plain()).call(nominal.compute)
    assert trajectory.end_time == pytest.approx(entry.nominal().end_time, abs=1e-3)
    assert trajectory.downrange[-1] == pytest.approx(entry.nominal().downrange[-1], abs=1.0)


def test_a_target_behind_the_vehicle_is_refused(entry):
    with pytest.raises(MarsedlError, match=r"target_longitude: the target lies .* behind the entry point"):
        entry.nominal("corrected", target_longitude=np.radians(120.0))


def test_a_nominal_that_does_not_slow_down_is_refused(entry):
    with pytest.raises(MarsedlError, match=r"still has \d+ m/s after 150 s.* raise time_limit"):
        entry.nominal("corrected", time_limit=150.0)


@pytest.mark.parametrize(
    ("limits", "number", "unit"),
    [({"altitude_limit": 1.0}, 0, 1.0), ({"flight_path_angle_limit": np.radians(0.001)}, 1, np.radians(0.001))],
)
def test_a_limit_that_cannot_be_met_is_named_with_what_can(entry, limits, number, unit):
    with pytest.raises(InfeasibleError) as error:
        entry.gains("corrected", **limits)
    message = str(error.value)
    assert (error.value.iterate["control_limit"] > 0).all()
    # A standard deviation is a third of the limit; the least that can be attained is far more.
    least, limit = map(float, re.search(r"allow is (\S+), the limit (\S+);", message).groups())
    assert limit == pytest.approx(unit / 3.0, rel=1e-3)
    assert least > 10 * limit
    # And that is right: twice as much can be met.
    if number == 0:
        met = entry.gains("corrected", altitude_limit=2.0 * 3.0 * least)
        assert (met.final_ratio[:, 0] < 1 + 1e-4).all()


def test_limits_that_are_met_one_by_one_but_not_together_are_refused(entry):
    """A little above the least altitude error, with a path angle limit that it leaves no room for."""
    with pytest.raises(SolverError, match=r"final limit|not together"):
        entry.gains("corrected", altitude_limit=300.0, flight_path_angle_limit=np.radians(0.15))
