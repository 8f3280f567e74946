"""The examples of the documentation as they stand there: they run, and what is said of their results is so."""

import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from runpy import run_path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.methods.covariance_steering.block_program import closed_loop
from marsedl.methods.funnels import monte_carlo
from marsedl.methods.funnels.stage import spread_of
from marsedl.methods.sos.variety import Spheres
from marsedl.models import random_field
from marsedl.montecarlo.streams import normals
from pictures import drawn_as_shown

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
TRIALS = 4000


def examples(page):
    """The Python code of a page, as it stands there."""
    return re.findall(r"^```python\n(.*?)^```$", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def run(name, *pictures):
    """The names that the example of this page defines; it makes these pictures, which the page shows."""
    page = ROOT / "docs" / "examples" / f"{name}.md"
    (example,) = examples(page)
    names = {}
    with TemporaryDirectory() as folder, drawn_as_shown(folder, *pictures):
        exec(compile(example, str(page), "exec"), names)
    return names


@pytest.fixture(scope="module")
def field_example():
    return run("random_field")


def test_every_example_is_tested():
    tested = re.findall(r'run\("(\w+)".*\)', Path(__file__).read_text(encoding="utf-8"))
    # These read a build: tests/results/test_results.py, tests/replication/universes/test_on_a_paper.py.
    elsewhere = {"results": 6, "universes": 1, "formats": 1, "using": 1}
    expected = dict.fromkeys(tested, 1) | elsewhere | {"monte_carlo": 2, "one_dynamics": 5}
    expected |= {"guidance_law": 7, "own_equations": 3, "studies": 6}  # in tests/fly/test_pages.py
    assert {page.stem: len(examples(page)) for page in PAGES if examples(page)} == expected
    assert len(tested) == 5


def test_closed_form_example_meets_its_targets():
    steering = run("covariance_steering")["steering"]
    np.testing.assert_allclose(steering.mean[-1], 0.0, atol=1e-6)
    np.testing.assert_allclose(steering.covariance[-1], np.diag([1.0, 0.25]), atol=1e-6)


def test_steering_example_prints_what_its_page_shows():
    page = (ROOT / "docs/examples/steering.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"(?ms)^```text\n(.*?)^```$", page)
    with redirect_stdout(StringIO()) as out:
        names = run("steering", "steering")
    number = re.compile(r"-?\d+\.\d+")
    assert number.sub("", out.getvalue()).split() == number.sub("", shown).split()
    # A solver's last digits may turn a flight or two.
    np.testing.assert_allclose(
        *([float(one) for one in number.findall(text)] for text in (out.getvalue(), shown)), rtol=0.01, atol=2e-3
    )
    law, flown = names["law"], names["flown"]
    assert law.outcome == "converged" and (flown.limits["lower"] <= flown.limits["asked"]).all()
    np.testing.assert_allclose(flown.goal["deviation flown"], flown.goal["deviation asked"], rtol=0.03)


@pytest.fixture(scope="module")
def fields(field_example):
    """Positions and samples of the example's field there."""
    grid = np.linspace(-3.0, 12.0, 151)
    root = random_field.root(random_field.covariance_matrix(field_example["kernel"], grid))
    return grid, normals(1, 0, range(TRIALS), len(grid)) @ root.T


def fly(example, fields, gain):
    """States (trials, 9, 2) of carts that a sampled field in space pushes: in no way linearised."""
    (grid, values), trials = fields, np.arange(TRIALS)

    def rates(state, control):
        place = (state[:, 0] - grid[0]) / (grid[1] - grid[0])
        node = place.astype(int)
        push = values[trials, node] + (place - node) * (values[trials, node + 1] - values[trials, node])
        return np.column_stack([state[:, 1], control + push])

    law, system = example["law"], example["program"].system
    state = system.initial_mean + normals(1, 1, range(TRIALS), 2) * np.sqrt(np.diag(system.initial_covariance))
    states, step = [state], 0.05
    for k, control in enumerate(law.control[:, 0]):
        command = control + sum((x - law.mean[node]) @ gain[k, node, 0] for node, x in enumerate(states))
        for _ in range(20):
            middle = state + step / 2 * rates(state, command)
            state = state + step * rates(middle, command)
        states.append(state)
    return np.stack(states, axis=1)


def test_field_example_keeps_its_chance_constraint_in_sampled_fields(field_example, fields):
    law = field_example["law"]
    flight = fly(field_example, fields, law.gain)
    too_fast = np.mean(flight[:, :, 1] > 1.1, axis=0)
    assert (too_fast[1:] <= 0.01 + 3 * np.sqrt(0.01 * 0.99 / TRIALS)).all()
    assert too_fast[-1] >= 0.01 - 4 * np.sqrt(0.01 * 0.99 / TRIALS)  # the constraint is active there: 1 % it is
    free = fly(field_example, fields, np.zeros_like(law.gain))
    assert 0.2 < np.mean(free[:, -1, 1] > 1.1) < 0.3


def test_field_example_predicts_its_deviations(field_example, fields):
    law, system = field_example["law"], field_example["program"].system
    # The flights have no navigation errors, which only the design has.
    covariance, _ = closed_loop(system, law.gain, field_example["covariance"])
    predicted = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    flight = fly(field_example, fields, law.gain)
    np.testing.assert_allclose(flight.std(axis=0, ddof=1), predicted, rtol=4 / np.sqrt(2 * TRIALS))
    assert (np.abs(flight[:, -1].mean(axis=0) - [8.0, 1.0]) < 4 * predicted[-1] / np.sqrt(TRIALS)).all()
    assert (law.covariance[-1].diagonal() <= 0.05**2 * (1 + 1e-6)).all()


def fly_sled(reference, gain, drag):
    """Where the sled ends with another drag, m: the nominal's thrust, and feedback of the difference in speed."""
    state = np.zeros(4)  # position and speed, then those of the nominal

    def rates(_, state, thrust):
        _, speed, _, nominal = state
        return [speed, thrust + gain * (speed - nominal) - drag * speed**2, nominal, thrust - 0.02 * nominal**2]

    for thrust, *span in zip(reference.commands.thrust, reference.time[:-1], reference.time[1:], strict=True):
        state = solve_ivp(rates, span, state, args=(thrust,), rtol=1e-9, atol=1e-9).y[:, -1]
    return state[0]


def test_desensitized_example_does_what_its_page_says():
    names = run("desensitization", "optimal", "desensitize")
    plain, robust, table = names["least_thrust"], names["robust"].references[-1], names["robust"].table
    gain = names["robust"].gains[-1][0, 1]
    short = [100.0 - fly_sled(plain, 0.0, 0.022), 100.0 - fly_sled(robust, gain, 0.022)]
    np.testing.assert_allclose(short, [3.9, 0.65], rtol=0.03)
    np.testing.assert_allclose(-table["flown"].iloc[[0, -1]], short, rtol=0.03)  # there the feedback is held
    assert 1.0 < robust.objective / plain.objective < 1.001
    # What the sensitivity says of the miss, and what is flown, to first order.
    tenth = table["predicted"].iloc[-1] / 10.0
    np.testing.assert_allclose(fly_sled(robust, gain, 0.0202) - fly_sled(robust, gain, 0.02), tenth, rtol=0.02)


def test_one_function_is_optimised_linearised_flown_and_enclosed_as_its_page_says():
    names, page = {}, ROOT / "docs/examples/one_dynamics.md"
    exec(compile("\n".join(examples(page)), str(page), "exec"), names)
    optimum, flown, predicted = names["optimum"], names["flown"], np.sqrt(np.diag(names["predicted"]))
    np.testing.assert_allclose(optimum.states[-1], [*np.zeros(6), 816.0], atol=0.5)
    np.testing.assert_allclose(names["states"], optimum.states, atol=1e-2)  # by the integrator's own steps
    np.testing.assert_allclose(flown, predicted, rtol=3 / np.sqrt(2 * TRIALS))
    np.testing.assert_allclose(flown[:3], 32.0, rtol=0.05)
    places = np.random.default_rng(1).uniform(-1.0, 1.0, (TRIALS, 10))
    places[::2] = np.sign(places[::2])  # corners
    drawn = np.array([names["calm"](*row) for row in names["middle"] + np.array(names["widths"]) * places])
    largest, bounds = np.abs(drawn).max(axis=0), np.array([rate.bound for rate in names["enclosed"]])
    assert (largest <= bounds).all() and (bounds <= 1.01 * largest).all()


@pytest.fixture(scope="module")
def pendulum():
    """The funnel example, and starts on the boundary of its first slice."""
    names = run("funnel", "funnel")
    directions = Spheres((2,)).random_points(TRIALS, np.random.Generator(np.random.Philox(7)))
    names["starts"] = directions @ spread_of(names["proven"].shapes[0], names["proven"].levels[0]).T
    return names


def highest(pendulum, wind):
    """Largest V of flights at every node."""
    proven = pendulum["proven"]
    return monte_carlo.fly(proven.loop, proven.shapes, pendulum["starts"], wind).max(axis=1)


def swing(pendulum, start, wind):
    """Final angle and rate of the pendulum under the feedback, by an integrator and a reference of their own."""
    half, gains = np.linspace(0.0, 4.0, 401), pendulum["proven"].loop.gains[:, 0]

    def reference(time):
        turn = np.pi * time / 4.0
        return np.pi / 2 * (1.0 - np.cos(turn)), np.pi**2 / 8 * np.sin(turn)

    def rates(time, state):
        (angle, rate), (gain, damping) = reference(time), (np.interp(time, half, column) for column in gains.T)
        torque = pendulum["upwards"](np.array([time]))[0, 0] + gain * (state[0] - angle) + damping * (state[1] - rate)
        return [state[1], torque - 9.81 * np.sin(state[0]) + 0.3 * wind * np.cos(state[0])]

    return solve_ivp(rates, (0.0, 4.0), start, rtol=1e-9, atol=1e-9).y[:, -1] - reference(4.0)


def test_funnel_example_narrows_as_its_page_says(pendulum):
    np.testing.assert_allclose(np.degrees(pendulum["bounded"].half_widths[[0, -1], 0]), [23.77, 1.518], rtol=3e-4)


def test_flights_of_the_funnel_example_stay_within_proven_levels_only(pendulum):
    bounded, slices, proven = pendulum["bounded"].levels, pendulum["bounded"].slices, pendulum["proven"].levels
    random = np.random.Generator(np.random.Philox(8))
    steady = highest(pendulum, random.choice([-1.0, 1.0], (TRIALS, 1)))
    assert 0.97 < steady[-1] / bounded[-1] < 0.985
    assert 1e-6 < (steady[slices[1:]] / bounded[1:]).max() - 1.0 < 1e-5
    changing = highest(pendulum, random.choice([-1.0, 1.0], (len(slices) - 1, TRIALS, 1)))
    for flight in (steady, changing):
        assert (flight[1:] <= proven[1:]).all()
    flown = pendulum["flown"]
    assert flown and flown.left == 0 and 0.98 < flown.highest[-1] < 0.985
    excess = proven[slices[1:]] / bounded[1:] - 1.0
    assert excess.min() > 0.0
    assert 0.0008 < excess.max() < 0.0012


def test_funnel_example_bounds_the_pendulum_itself(pendulum):
    corner = pendulum["starts"][:6]
    ends = np.array([swing(pendulum, start, wind) for start, wind in zip(corner, [-1, 1] * 3, strict=True)])
    observed = []
    monte_carlo.fly(
        pendulum["proven"].loop,
        pendulum["proven"].shapes,
        corner,
        np.tile([[-1.0], [1.0]], (3, 1)),
        observer=lambda node, deviation, disturbance: observed.append(deviation),
    )
    np.testing.assert_allclose(ends, observed[-1].T, atol=1e-6)
    shape = pendulum["proven"].shapes[-1]
    assert (np.einsum("mi,ij,mj->m", ends, shape, ends) / 2 < pendulum["proven"].levels[-1]).all()


def test_funnels_have_as_many_samples_as_the_page_on_methods_says():
    page = (ROOT / "docs/examples/which_method.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d), (\d) \| ([\d,]+) \| ([\d,]+) \|$", page, re.MULTILINE)
    assert len(rows) == 5
    for row in rows:
        states, disturbances, bounded, proven = (int(number.replace(",", "")) for number in row)
        assert Spheres((states, disturbances)).sample_count(2) == bounded
        assert Spheres((states, disturbances + 1)).sample_count(2) == proven


def test_funnel_example_says_what_it_covers(pendulum):
    page = (ROOT / "docs/examples/funnel.md").read_text(encoding="utf-8")
    assert f"```text\n{pendulum['proven'].covers}\n```" in page


@pytest.fixture(scope="module")
def entries():
    """The names of the page on flights, whose blocks print what it shows below them."""
    names, page = {}, (ROOT / "docs/examples/monte_carlo.md").read_text(encoding="utf-8")
    for text, shown in re.findall(r"(?ms)^```python\n(.*?)^```\n```text\n(.*?)^```$", page):
        with redirect_stdout(StringIO()) as printed:
            exec(compile(text, "monte_carlo", "exec"), names)
        assert [line.rstrip() for line in printed.getvalue().splitlines()] == shown.splitlines()
    return names


def test_monte_carlo_example_halves_the_deviation_of_the_range(entries):
    guided, unguided = (entries[name].final["range"] / 1e3 for name in ("guided", "unguided"))
    np.testing.assert_allclose([unguided.std(), guided.std()], [4.2, 2.2], rtol=0.03)
    assert entries["guided"].outcomes() == {"ended: velocity below 480": 4000}
    middle = entries["percentiles"].query("quantity == 'range_km' and percentile == 50").iloc[0]
    assert middle["lower"] < np.median(guided) < middle["upper"]
    np.testing.assert_allclose(np.median(entries["unguided"].final["crossrange"]), 49e3, rtol=0.01)
    assert entries["one"].final["range"] == entries["guided"].final["range"][1234]


def test_the_lander_meets_its_targets():
    flights = run_path(str(ROOT / "docs/examples/lander.py"))["flights"]
    deviations = [flights.final[name].std(ddof=1) for name in list(flights.campaign.start.names)[:4]]
    # Thrust is held for a quarter of a second, which the design does not know.
    np.testing.assert_allclose(deviations, [3.0, 1.0, 0.5, 0.3], rtol=0.08)
