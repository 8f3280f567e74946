"""The rates that fly are the rates that CasADi traces, of all models of the papers and of `marsedl.fly`."""

from functools import cache
from typing import NamedTuple

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marsedl.elementary import clip, select
from marsedl.fly import Entry, Lander, dynamics
from marsedl.methods.linearization import linearize, symbols_in_numpy
from marsedl.methods.taylor import Series
from marsedl.papers.desensitized import flight as desensitized
from marsedl.papers.powered_descent import flight as powered_descent
from marsedl.papers.random_field import flight as random_field
from marsedl.papers.stochastic_entry import flight as stochastic_entry

MU, RADIUS, TURN = 4.2828e13, 3.3962e6, 7.0882e-5  # m^3/s^2, m, rad/s
BANK, LOG_DENSITY, FACTOR = (-3.0, 3.0), (-25.0, -3.0), (0.0, 2.0)
ENTRY = {
    "altitude": (0.0, 130e3),
    "velocity": (300.0, 6000.0),
    "flight_path_angle": (-1.2, 1.2),
    "azimuth": (-3.0, 3.0),
    "latitude": (-1.2, 1.2),
    "longitude": (-3.0, 3.0),
}
LANDER = {
    "downrange": (-1e3, 1e3),
    "altitude": (0.0, 2e3),
    "downrange_velocity": (-90.0, 90.0),
    "vertical_velocity": (-90.0, 90.0),
    "mass": (500.0, 900.0),
}
CAPSULE = {  # of velocity components
    "altitude": (0.0, 150e3),
    "latitude": (-1.2, 1.2),
    "longitude": (-3.0, 3.0),
    "radial_velocity": (-3000.0, 1000.0),
    "north_velocity": (-300.0, 3000.0),
    "east_velocity": (400.0, 6000.0),
    "bank": BANK,
    "bank_rate": (-0.3, 0.3),
}


def settings_of(kind, **numbers):
    """Parameters of which a model reads some; the others are NaN, which would show."""
    return kind(**(dict.fromkeys(kind._fields, np.nan) | numbers))


def models():
    """By name: rates, parts with bounds of each number, and what is fixed."""
    entry, lander = Entry(115.0, 0.24).model(), Lander(1e4, 220.0, smallest_thrust=2e3, dry_mass=600.0).model()
    yield (
        "entry",
        dynamics.entry_rates,
        {
            "state": (dynamics.EntryState, ENTRY),
            "found": (dynamics.Air, {"log_density": LOG_DENSITY, "factor": FACTOR}),
            "command": (dynamics.Bank, {"bank": BANK}),
            "vehicle": (dynamics.EntryVehicle, {"ballistic_coefficient": (90, 150), "lift_to_drag": (0.0, 0.4)}),
        },
        {"p": entry.p},
    )
    thrust, noise = {"thrust_downrange": (-9e3, 9e3), "thrust_vertical": (-9e3, 9e3)}, (-3.0, 3.0)
    yield (
        "lander",  # with masses below the dry one, and thrusts beyond both limits
        dynamics.lander_rates,
        {
            "state": (dynamics.LanderState, LANDER),
            "before": (dynamics.LanderState, LANDER),
            "command": (dynamics.Thrust, thrust),
            "noise": (dynamics.Disturbance, {"downrange": noise, "vertical": noise}),
        },
        {"p": lander.p, "vehicle": lander.vehicle, "step": 0.1},
    )
    place = {"radius": (RADIUS, RADIUS + 130e3), "velocity": ENTRY["velocity"], "path_angle": (-1.2, 1.2)}
    yield (
        "stochastic_entry",
        stochastic_entry.rates,
        {
            "state": (stochastic_entry.State, place | {n: ENTRY[n] for n in ("latitude", "longitude", "azimuth")}),
            "found": (stochastic_entry.Density, {"log_mean": LOG_DENSITY, "factor": FACTOR}),
            "command": (stochastic_entry.Bank, {"sine": (-1, 1), "cosine": (-1, 1)}),
            "vehicle": (stochastic_entry.Aerodynamics, {"drag_factor": (1e-3, 5e-3), "lift_factor": (1e-4, 2e-3)}),
        },
        {
            "p": settings_of(
                stochastic_entry.Parameters, gravitational_parameter=MU, rotation_rate=TURN, heading_sign=1.0
            )
        },
    )
    constants = {"gravitational_parameter": MU, "planet_radius": RADIUS}
    yield (
        "random_field, aerocapture",  # with densities below the floor
        random_field.rates,
        {
            "state": (random_field.State, place),
            "found": (random_field.Density, {"log_mean": LOG_DENSITY, "variation": (-1.5, 1.0)}),
            "command": (random_field.Bank, {"commanded": (-1, 1), "flown": (-1, 1)}),
        },
        {
            "p": settings_of(
                random_field.Parameters, **constants, drag_factor=3e-3, lift_factor=7e-4, density_floor=1e-3
            )
        },
    )
    yield (
        "random_field, double integrator",
        random_field.point_rates,
        {
            "state": (random_field.Point, {"position": (-1, 1), "rate": (-1, 1)}),
            "found": (random_field.Field, {"value": (-1, 1)}),
            "command": (random_field.Control, {"value": (-1, 1)}),
        },
        {},
    )
    thrust = {"downrange": (-9e3, 9e3), "vertical": (-9e3, 9e3)}
    held = {
        "state": (powered_descent.State, LANDER),
        "noise": (powered_descent.Thrust, {"downrange": noise, "vertical": noise}),
    }
    random = np.random.default_rng(1)
    tables = (random.normal(size=(5, 2, 4)), random.normal(size=(5, 4)), random.normal(size=(5, 2)))
    schedule = powered_descent.Schedule(0.1, 2, *tables)
    fixed = {"half_index": 3, "p": powered_descent.Parameters(schedule, powered_descent.Plant(3.71, 4.6e-4, 70.0))}
    commanded = held | {"command": (powered_descent.Thrust, thrust)}
    yield "powered_descent, held thrust", powered_descent.held_rates, commanded, fixed
    yield "powered_descent, continuous thrust", powered_descent.rates, held, fixed
    vehicle = {"ballistic_coefficient": 115.0, "lift_to_drag": 0.18, "bank_acceleration_bound": 0.05}
    both = CAPSULE | {"cumulative": (0.0, 1.0)} | {f"nominal_{name}": bounds for name, bounds in CAPSULE.items()}
    gain = desensitized.Gain(*[0.02 / (high - low) for low, high in CAPSULE.values()])
    yield (
        "desensitized",  # with commands beyond their bound
        desensitized.rates,
        {
            "state": (desensitized.State, both),
            "found": (desensitized.Density, {"log_mean": LOG_DENSITY, "nominal_log_mean": LOG_DENSITY}),
            "command": (desensitized.Control, {"nominal": (-0.05, 0.05)}),
            "vehicle": (desensitized.Air, {"factor": (0.8, 1.2)}),
        },
        {
            "p": desensitized.Parameters(
                settings_of(desensitized.Settings, **constants, **vehicle), np.zeros((3, 4)), gain, np.zeros(3)
            )
        },
    )


MODELS = {name: rest for name, *rest in models()}


@cache
def traced(name):
    """A model's rates as a CasADi function of all numbers of its parts, and sizes of the rates."""
    rates, parts, fixed = MODELS[name]
    symbols = {part: kind(*map(casadi.SX.sym, kind._fields)) for part, (kind, _) in parts.items()}
    with symbols_in_numpy(casadi):
        outputs = casadi.vertcat(*rates(**symbols, **fixed))
    numbers = casadi.vertcat(*(number for part in symbols.values() for number in part))
    random = np.random.default_rng(2)
    sizes = np.abs([in_python(name, random.uniform(size=numbers.numel())) for _ in range(100)]).max(axis=0)
    return casadi.Function("rates", [numbers], [outputs]), sizes


def numbers_of(name, shares):
    """Numbers within their bounds, by their shares of the way from the lower to the upper one."""
    _, parts, _ = MODELS[name]
    low, high = np.array([kind(**bounds)[row] for kind, bounds in parts.values() for row in range(len(bounds))]).T
    return [float(number) for number in low + np.asarray(shares) * (high - low)]


def in_python(name, shares):
    rates, parts, fixed = MODELS[name]
    numbers = iter(numbers_of(name, shares))
    return rates(**{part: kind(*(next(numbers) for _ in bounds)) for part, (kind, bounds) in parts.items()}, **fixed)


@pytest.mark.parametrize("name", MODELS)
@given(data=st.data())
def test_casadi_gives_the_rates_of_python(name, data):
    function, sizes = traced(name)
    count = function.size1_in(0)
    shares = data.draw(st.lists(st.floats(0.0, 1.0), min_size=count, max_size=count))
    expected = np.array(in_python(name, shares))
    actual = function(numbers_of(name, shares)).full().ravel()
    # Rounding, relative to the largest rate of its kind: single rates are differences of larger terms.
    assert (np.abs(actual - expected) <= 1e-13 * np.maximum(np.abs(expected), sizes)).all()


@pytest.mark.parametrize("name", MODELS)
def test_series_have_the_derivatives_of_casadi(name):
    """Branches included: a series decides by its value."""
    function, sizes = traced(name)
    rates, parts, fixed = MODELS[name]
    jacobian = function.jacobian()
    for shares in np.random.default_rng(3).uniform(size=(5, function.size1_in(0))):
        numbers = numbers_of(name, shares)
        directions = np.eye(len(numbers))
        series = iter([Series.along(number, row, 1) for number, row in zip(numbers, directions, strict=True)])
        outputs = rates(
            **{part: kind(*(next(series) for _ in bounds)) for part, (kind, bounds) in parts.items()}, **fixed
        )
        actual = np.array([o.coefficients[1] if isinstance(o, Series) else 0.0 * directions[0] for o in outputs])
        expected = jacobian(numbers, np.zeros(len(sizes))).full()
        largest = np.maximum(np.abs(expected).max(axis=1, keepdims=True), 1e-300)
        np.testing.assert_allclose(actual / largest, expected / largest, rtol=0, atol=1e-12)


class Mass(NamedTuple):
    """A model with a branch that guards a division."""

    value: float


def guarded(state, flow):
    """The mass falls by a share a second, as long as there is any."""
    return Mass(-flow / select(state.value > 0.0, state.value, 1.0) * select(state.value > 0.0, 1.0, 0.0))


def unguarded(state, flow):
    return Mass(select(state.value > 0.0, -flow / state.value, 0.0))


def test_both_sides_of_a_choice_are_computed_so_what_goes_into_a_division_is_guarded():
    def model(rates, mass):
        linear = linearize(lambda value: rates(Mass(value), 3.0), [[mass]], np.zeros((1, 0)))
        return linear.state_matrix.item()

    assert guarded(Mass(2.0), 3.0) == unguarded(Mass(2.0), 3.0) == (-1.5,)
    assert model(guarded, 2.0) == model(unguarded, 2.0) == 0.75
    assert guarded(Mass(0.0), 3.0) == (0.0,) and model(guarded, 0.0) == 0.0
    with pytest.raises(ZeroDivisionError):
        unguarded(Mass(0.0), 3.0)
    assert model(unguarded, 0.0) == 0.0  # of the side that is taken


def branches(x):
    return (1.0 if x > 0.0 else -1.0,)


def indexes(x):
    return (np.arange(3.0)[int(x)],)


@pytest.mark.parametrize("rates", [branches, indexes, lambda x: (max(x, 0.0),)])
def test_what_cannot_be_traced_is_told_with_its_line_and_the_remedy(rates):
    line = rates.__code__.co_firstlineno + (rates.__name__ != "<lambda>")
    told = rf"test_one_function.py, line {line}, in .*{rates.__name__}.*asks a symbol.*select\(condition, a, b\)"
    with pytest.raises(TypeError, match=told):
        linearize(rates, [[1.0]], np.zeros((1, 0)))
    chosen = linearize(lambda x: (select(x > 0.0, x, -x) + clip(x, -1.0, 1.0),), [[2.0], [-3.0]], np.zeros((2, 0)))
    assert chosen.state_matrix.ravel().tolist() == [1.0, -1.0]
