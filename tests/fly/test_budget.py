"""The budget of a dispersion: linear covariance by perturbed flights, against a recursion, flights and closed forms."""

import re
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pytest

from marsedl.fly import Below, Entry, Error, Markov, Model, MultivariateNormal, Normal, Senses, Uniform, fly
from marsedl.montecarlo.flights import Flight


class Cart(NamedTuple):
    x: float
    v: float


class Push(NamedTuple):
    push: float


class Gust(NamedTuple):
    gust: float


class Wheels(NamedTuple):
    wind: float
    colour: float = 0.0


def rates(state, command: Push, vehicle, noise) -> Cart:
    return Cart(state.v, command.push + vehicle.wind + 0.3 * noise.gust)


def rolls(state, command: Push) -> Cart:
    return Cart(state.v, command.push)


def brake(x, v):
    return -0.1 * x - 0.5 * v


PERIODS, SUBSTEPS = 6, 2
UNITS = {"x": ("m", "place"), "v": ("m/s", "speed")}
SENSES = Senses(x=Error(bias=Normal(0.0, 2.0), noise=1.5, walk=0.5))
START = {"x": Uniform(90.0, 110.0), "v": Normal(0.0, 1.5)}
OPTIONS = {"law": brake, "end_time": float(PERIODS), "substeps": SUBSTEPS, "trials": 2, "compiled": False}


def cart(wind=Normal(0.1, 0.2), colour=Normal(5.0, 0.0), start=START, senses=SENSES, **options):  # noqa: B008
    model = Model(Flight(rates, noise=Gust), vehicle=Wheels(wind, colour), quantities=UNITS)
    return fly(model, start, senses=senses, **OPTIONS | options)


def variances(unit):
    """Variance of the place at the end from each source alone, by recursion of the covariance of x, v, wind and bias.

    The walk of what is sensed is a state, too; between bounds of periods the motion is a parabola.
    """
    h, gains = 1.0 / SUBSTEPS, np.array([[-0.1, -0.5, 0.0, -0.1, -0.1]])  # of x, v, wind, bias, walk
    place = {"start_x": 0, "start_v": 1, "wind": 2, "x_bias": 3}
    found = {}
    for source, deviation in unit.items():
        covariance, deviation = np.zeros((5, 5)), deviation**2
        if source in place:
            covariance[place[source], place[source]] = deviation
        for period in range(PERIODS):
            if source == "x_walk" and period > 0:  # it starts from zero
                covariance[4, 4] += deviation
            sensed = np.zeros((6, 6))
            sensed[:5, :5] = covariance
            sensed[5, 5] = deviation if source == "x_noise" else 0.0
            told = np.vstack([np.eye(6), np.append(gains, -0.1)])  # the command is held over the period
            held = told @ sensed @ told.T
            step = np.eye(7)
            step[0, [1, 2, 6]], step[1, [2, 6]] = (h, h**2 / 2, h**2 / 2), (h, h)
            gust = np.zeros((7, 1))
            gust[:2, 0] = (h**1.5 / 2, h**0.5) if source == "noise_gust" else 0.0
            for _ in range(SUBSTEPS):
                held = step @ held @ step.T + deviation * gust @ gust.T
            covariance = held[:5, :5]
        found[source] = covariance[0, 0]
    return found


def test_shares_of_a_linear_flight_are_those_of_its_covariance():
    unit = {"start_x": 20.0 / np.sqrt(12.0), "start_v": 1.5, "wind": 0.2, "x_bias": 2.0}
    theory = variances(unit | {"x_walk": 0.5, "x_noise": 1.5, "noise_gust": 0.3})
    budget = cart().budget("x")
    shares, total = budget.shares.set_index("source"), sum(theory.values())
    np.testing.assert_allclose(budget.deviation, np.sqrt(total), rtol=1e-9)
    for source, variance in theory.items():
        np.testing.assert_allclose(shares.loc[source, "share"], variance / total, rtol=1e-8)
        np.testing.assert_allclose(shares.loc[source, "deviation"], np.sqrt(variance), rtol=1e-8)
    assert shares.loc["colour", "share"] == 0.0, "it moves nothing"
    assert abs(shares["share"].sum() - 1.0) < 1e-12
    assert budget.linear and budget.unit == "m"
    assert budget.flights == 1 + 4 * (5 + 2 * PERIODS + PERIODS * SUBSTEPS)


def test_numbers_that_are_drawn_together_are_one_source_and_derived_quantities_have_budgets():
    covariance = np.array([[4.0, 1.8], [1.8, 1.0]])
    start = {("x", "v"): MultivariateNormal(np.array([100.0, 0.0]), covariance)}
    flights = cart(start=start, senses=None, law=0.0, wind=Normal(0.1, 0.0)).with_quantity("double", "2 * x", "m")
    budget = flights.budget("double")
    ahead = np.array([1.0, PERIODS])
    row = budget.shares.set_index("source").loc["start_x and start_v"]
    np.testing.assert_allclose(row["deviation"], 2.0 * np.sqrt(ahead @ covariance @ ahead), rtol=1e-9)
    drawn = flights.budget("start_x").shares.set_index("source")["share"]
    assert drawn["start_x and start_v"] == 1.0 and drawn.sum() == 1.0


def test_what_is_not_linear_is_told_with_its_source():
    flights = cart(start={"x": Normal(0.0, 3.0), "v": 0.0}, senses=None, law=0.0, wind=Normal(0.0, 0.01))
    for definition, told in (
        ("x**2", "with its curvature, it would be .* most of all by start_x"),
        ("x + x**3 / 20", "moved by whole deviations, it would be .* most of all by start_x$"),
    ):
        budget = flights.with_quantity("far", definition).budget("far")
        assert not budget.linear
        assert any(re.search(told, note) for note in budget.notes)


def test_a_trigger_that_is_not_met_is_told():
    options = {"start": {"x": 20.0, "v": Normal(-4.0, 1.0)}, "senses": None, "law": 0.0, "wind": 0.0}
    budget = cart(**options, trigger=Below("x", 0.0)).budget("v")
    assert not budget.linear
    assert budget.notes == ("of the flights that start_v moves, 1 do not end as they should",)
    with pytest.raises(ValueError, match="without errors ends 'out of time': a budget takes one that ends as it sho"):
        cart(**options, trigger=Below("x", -100.0)).budget("v")


def test_misuses_are_told():
    with pytest.raises(ValueError, match="quantity 'y' is unknown; There are"):
        cart().budget("y")
    with pytest.raises(ValueError, match="tolerance is 0; give a positive share"):
        cart().budget("x", tolerance=0)
    calm = fly(Model(Flight(rolls)), {"x": 1.0, "v": 0.0}, **OPTIONS | {"law": 0.0})
    with pytest.raises(ValueError, match="nothing is dispersed in these flights"):
        calm.budget("x")


def test_deviations_of_an_entry_are_those_of_its_flights():
    """The capsule of docs/examples/monte_carlo.md, with feedback: law, air and trigger are in it."""

    def law(velocity, drag):
        return 1.2 - 0.01 * (drag - 60.0 * (velocity / 4000.0) ** 2)

    start = {"altitude_km": 125.0, "velocity": Normal(5500.0, 3.0), "flight_path_angle_deg": Normal(-14.2, 0.03)}
    capsule = Entry(ballistic_coefficient=Normal(115.0, 2.0), lift_to_drag=0.24, variation=Markov(0.06, 5e3))
    flights = fly(capsule, start, law=law, trigger=Below("velocity", 480.0), end_time=420.0, trials=4000, seed=7)
    for quantity in ("range_km", "altitude", "end_time"):
        budget = flights.budget(quantity)
        assert budget.linear and abs(budget.deviation / flights.values(quantity).std() - 1.0) < 0.03
        assert abs(budget.shares["share"].sum() - 1.0) < 1e-12
        explained = flights.explains(quantity).set_index("drawn")
        shares = budget.shares.set_index("source")["share"]
        for name in flights.drawn:
            assert explained.loc[name, "lower"] - 0.01 < shares[name] < explained.loc[name, "upper"] + 0.01
    assert flights.budget("velocity").deviation == 0.0, "the trigger ends all at the same"
    assert not flights.budget("max_load").linear, "a largest number of many"
    axes = budget.plot()
    assert [text.get_text() for text in axes.get_yticklabels()] == [*budget.shares["source"]][::-1]
    plt.close(axes.figure)
