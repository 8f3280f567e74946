"""Trajectories: altitudes and velocities of the right states."""

from types import SimpleNamespace

import numpy as np
import pytest

from marsedl.comparison import trajectories

TIME = np.linspace(0.0, 10.0, 5)


def history(trials, states):
    return np.random.default_rng(3).uniform(1.0, 2.0, (trials, len(TIME), states))


def test_speeds_are_norms_of_velocity_components():
    mean = np.column_stack([np.zeros(5), np.linspace(500.0, 50.0, 5), np.full(5, 3.0), np.full(5, -4.0)])
    histories = history(30, 5)
    record = trajectories.powered_descent(
        SimpleNamespace(time=TIME, mean=mean), SimpleNamespace(kept_history=histories)
    )
    assert record.velocity == pytest.approx(5.0)
    assert record.altitude[0] == 500.0
    assert record.flown_velocity == pytest.approx(np.sqrt(histories[:20, :, 2] ** 2 + histories[:20, :, 3] ** 2))
    state = np.column_stack([np.full(5, 1e4), np.zeros((5, 2)), np.tile([1.0, 2.0, -2.0], (5, 1)), np.zeros((5, 2))])
    histories = np.stack([history(30, 9)] * 2)
    record = trajectories.desensitized(SimpleNamespace(time=TIME, state=state), SimpleNamespace(kept_history=histories))
    assert record.velocity == pytest.approx(3.0)
    assert record.flown_altitude.shape == (trajectories.DRAWN, len(TIME))


def test_flights_of_the_funnels_are_deviations_from_the_reference_at_the_nodes():
    state = np.arange(9.0)[:, np.newaxis] + np.zeros(6)
    deviations = history(3, 6)
    record = trajectories.funnels(SimpleNamespace(time=TIME, state=state), SimpleNamespace(kept_history=deviations))
    assert record.altitude.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]
    assert record.flown_altitude - deviations[..., 0] == pytest.approx(np.tile(record.altitude, (3, 1)))
    assert record.flown_velocity - deviations[..., 3] == pytest.approx(np.tile(record.velocity, (3, 1)))


def test_the_last_law_of_the_random_field_is_flown():
    nominal = SimpleNamespace(time=TIME, altitude=np.full(5, 5e4), velocity=np.full(5, 6e3))
    histories = np.stack([history(4, 6), history(4, 6) + 10])
    record = trajectories.random_field(nominal, SimpleNamespace(kept_history=histories, count=np.zeros(2)))
    assert record.flown_altitude == pytest.approx(histories[1, :, :, 0])
    assert record.flights == "last iteration"
    alone = SimpleNamespace(kept_history=histories[:1], count=np.zeros(1))
    assert trajectories.random_field(nominal, alone).flights == "open loop"


def test_the_figure_leaves_the_descent_out_of_the_entries_and_the_table_has_both_ends():
    def path(top, bottom, fast):
        altitude, velocity = np.linspace(top, bottom, 5), np.linspace(fast, 0.0, 5)
        return trajectories.Trajectory(TIME, altitude, velocity, altitude[np.newaxis], velocity[np.newaxis], "one")

    record = {"powered_descent": path(500.0, 50.0, 60.0), "funnels": path(125e3, 10e3, 5800.0)}
    figure = trajectories.figure(record)
    entries, whole = figure.axes
    assert len([line for line in entries.lines if len(line.get_xdata())]) == 2, "nominal and flights of one paper"
    assert len([line for line in whole.lines if len(line.get_xdata())]) == 4
    assert whole.get_ylim()[0] < 50.0
    table = trajectories.table(record)
    assert table.loc[1].tolist() == ["funnels", 125.0, 5800.0, 10.0, 0.0, 10.0, 10.0]
