"""The flights through random fields: against plain numpy, their limits and ends, and steps."""

from functools import partial
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from equations import aerocapture
from marsedl.models import atmosphere, random_field
from marsedl.models.density_table import read_density_table
from marsedl.montecarlo.outcomes import COMPLETED, CRASHED, NON_FINITE
from marsedl.montecarlo.streams import normals
from marsedl.papers.random_field import components, flight
from marsedl.papers.random_field.environment import AirTables

TABLE = Path(__file__).parents[2] / "data" / "atmosphere" / "mars_density.csv"
RADIUS, MU = 3397e3, 4.2828e13
SEED = 7
STEP = 0.5
PARTITION = np.array([0.0, 50.0, *np.arange(75.0, 351.0, 25.0), 400.0])
ENTRY = np.array([RADIUS + 125e3, 6100.0, np.radians(-10.0264)])  # leaves again with zero lift control
STEEP = ENTRY - [0.0, 0.0, np.radians(4.0)]  # does not
SCALES = np.array([1e3, 100.0, 0.01])  # deviations that gains of order one turn into controls of order one

INPUTS = SimpleNamespace(
    gravitational_parameter=MU,
    planet_radius=RADIUS,
    ballistic_coefficient=150.0,
    lift_to_drag=0.2,
    density_floor=1e-3,
    control_limits=(-1.0, 1.0),
    dynamic_pressure_density="nominal",
)


def kernel(variance):
    lengths = {"upper_altitude": 120e3, "growth_length": 20e3, "correlation_length": 11.1e3}
    return partial(random_field.altitude_exponential, variance=variance, **lengths)


def make_air(profile, variance=0.148):
    coarse, fine = np.arange(-10e3, 300.5e3, 1e3), np.linspace(20e3, 260e3, 2401)
    log_density, slope, _ = profile(coarse)
    return AirTables(-10e3, 1e3, log_density, slope, fine, *random_field.markov(kernel(variance), fine))


def exponential_air(surface, scale_height):
    """An exponential atmosphere of a single cell without variations: smooth everywhere."""
    altitude = np.array([0.0, 200e3])
    fine = np.linspace(20e3, 260e3, 3)
    log_density = np.log(surface) - altitude / scale_height
    return AirTables(0.0, 200e3, log_density, np.full(2, -1.0 / scale_height), fine, np.zeros(2), np.zeros(2), 0.0)


def settings(air, inputs=INPUTS):
    sections = dict.fromkeys(("planet", "air", "vehicle", "simulation"), inputs)  # which has those of all
    return flight.settings(SimpleNamespace(**sections), air)


@pytest.fixture(scope="module")
def profile():
    return atmosphere.tabulated(read_density_table(TABLE, "marsgram_2021a_sample"))


@pytest.fixture(scope="module")
def air(profile):
    return make_air(profile)


@pytest.fixture(scope="module")
def law(air):
    """Feedback of all earlier nodes, strong enough to reach the limits, around the flight with zero control."""
    rng = np.random.default_rng(0)
    intervals = len(PARTITION) - 1
    _, reference = flight.propagate_nominal(
        settings(air), air, flight.open_loop(PARTITION, np.zeros(intervals)), ENTRY, time_step=STEP
    )
    gain = 0.3 * rng.standard_normal((intervals, intervals + 1, 3)) / SCALES
    control = 0.3 * rng.standard_normal(intervals)
    return flight.Law(PARTITION, control, gain, reference[np.round(PARTITION / STEP).astype(int)])


def fly(air, law, trials=100, initial=ENTRY, inputs=INPUTS, **options):
    states = np.broadcast_to(initial, (trials, 3)) if np.ndim(initial) == 1 else initial
    options = {"time_step": STEP, "seed": SEED, "every": 50} | options
    return flight.fly(settings(air, inputs), air, law, states, **options)


# ---- the oracle ------------------------------------------------------------------------------------------------------


def oracle_variations(air, trials):
    """Density variations at the nodes, (trials, nodes), drawn from the top down."""
    normal_numbers = normals(SEED, flight.FIELD_STREAM, range(trials), len(air.altitude))
    variations = np.empty((trials, len(air.altitude)))
    variations[:, -1] = air.top_deviation * normal_numbers[:, 0]
    for down, node in enumerate(reversed(range(len(air.altitude) - 1)), start=1):
        variations[:, node] = (
            air.retention[node] * variations[:, node + 1] + air.innovation_deviation[node] * normal_numbers[:, down]
        )
    return variations


def oracle_mean_density(air):
    """The mean density as a function of altitude, by scipy's interpolation."""
    nodes = air.bottom + air.spacing * np.arange(len(air.log_density))
    curve = CubicHermiteSpline(nodes, air.log_density, air.log_density_slope)

    def density(altitude):
        inside = np.clip(altitude, nodes[0], nodes[-1])
        return np.exp(curve(inside) + (altitude - inside) * curve(inside, 1))

    return density


def runge_kutta(rates, x, h):
    k1 = rates(x)
    k2 = rates(x + h / 2 * k1)
    k3 = rates(x + h / 2 * k2)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + h * k3))


def commanded(law, k, states):
    """Eq. 8 by its definition: seen holds the states (trials, n) at the nodes 0 .. k."""
    return law.control[k] + sum(
        (x - xbar) @ gain for x, xbar, gain in zip(states, law.reference, law.gain[k], strict=False)
    )


class Oracle:
    """Aerocaptures by plain numpy, all trials at once, with everything stored at every step."""

    def __init__(self, air, law, initial, trials, inputs=INPUTS):
        self.air, self.inputs, self.variations = air, inputs, oracle_variations(air, trials)
        self.mean_density, self.trials = oracle_mean_density(air), np.arange(trials)
        x, states_at_nodes = np.array(np.broadcast_to(initial, (trials, 3))), []
        self.states, self.found, self.pressure, self.control = [x], [], [], []
        self.floored = np.zeros(trials)
        for k, (start, end) in enumerate(zip(law.start[:-1], law.start[1:], strict=True)):
            states_at_nodes.append(x)
            u = commanded(law, k, states_at_nodes)
            applied = np.clip(u, *inputs.control_limits)
            for _ in range(round((end - start) / STEP)):
                self.store(x, u)
                self.floored += 1 + self.found[-1] < inputs.density_floor
                x = runge_kutta(partial(self.rates, u=applied), x, STEP)
                self.states.append(x)
        self.store(x, u)

    def variation(self, altitude):
        """Linear between the nodes, held beyond."""
        grid, table = self.air.altitude, self.variations
        node = np.clip(np.searchsorted(grid, altitude, side="right") - 1, 0, len(grid) - 2)
        fraction = np.clip((altitude - grid[node]) / (grid[node + 1] - grid[node]), 0.0, 1.0)
        return (1.0 - fraction) * table[self.trials, node] + fraction * table[self.trials, node + 1]

    def rates(self, x, u):
        """Eqs. 71."""
        altitude = x[:, 0] - RADIUS
        density = self.mean_density(altitude) * np.maximum(1 + self.variation(altitude), self.inputs.density_floor)
        return aerocapture(x.T, u, density).T

    def store(self, x, u):
        altitude = x[:, 0] - RADIUS
        self.found.append(self.variation(altitude))
        self.pressure.append(0.5 * self.mean_density(altitude) * x[:, 1] ** 2)
        self.control.append(u)

    def history(self, every):
        states = np.array(self.states)[::every] - [RADIUS, 0.0, 0.0]
        stored = (np.array(part)[::every] for part in (self.found, self.pressure, self.control))
        return np.stack([*np.moveaxis(states, -1, 0), *stored], axis=1)


# ---- aerocapture: against the oracle ---------------------------------------------------------------------------------


def assert_as_the_oracle(trajectories, oracle, every):
    history = oracle.history(every)
    np.testing.assert_allclose(trajectories.history, history, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(trajectories.final_state[: components.FLOORED], history[-1, :3], rtol=1e-8, atol=1e-8)
    np.testing.assert_array_equal(trajectories.final_state[components.FLOORED], oracle.floored)
    np.testing.assert_array_equal(trajectories.observed[:, 0], trajectories.history[:, components.BANK_COSINE])
    np.testing.assert_array_equal(trajectories.observed[:, 1], np.abs(trajectories.observed[:, 0]))
    control = np.array(oracle.control)
    for maximum, expected in zip(trajectories.observed_maximum, (control, np.abs(control)), strict=True):
        np.testing.assert_allclose(maximum, expected.max(axis=0), rtol=1e-8, atol=1e-8)


def test_open_loop_flights_are_those_of_plain_numpy(air):
    law = flight.open_loop(PARTITION, 0.2 * np.sin(np.arange(14.0)))
    trajectories, oracle = fly(air, law, 130), Oracle(air, law, ENTRY, 130)
    assert_as_the_oracle(trajectories, oracle, 50)
    assert oracle.floored.sum() > 0  # the test sees the floor
    assert trajectories.history[-1, components.ALTITUDE].std() > 1e3  # and the field
    assert (trajectories.outcome == COMPLETED).all() and (trajectories.length == 17).all()


def test_closed_loop_flights_are_those_of_plain_numpy(air, law):
    spread = normals(SEED, flight.INITIAL_STREAM, range(130), 3) * [300.0, 1.0, 1e-4]
    trajectories = fly(air, law, initial=ENTRY + spread, every=10)
    assert_as_the_oracle(trajectories, Oracle(air, law, ENTRY + spread, 130), 10)
    saturated = np.abs(trajectories.observed[:, 0]) > 1.0
    assert 0.05 < saturated.mean() < 0.95  # both kinds of command occur


def test_dynamic_pressure_of_the_actual_density(air):
    law = flight.open_loop(PARTITION, np.zeros(14))
    nominal = fly(air, law).history
    actual = fly(air, law, inputs=SimpleNamespace(**vars(INPUTS) | {"dynamic_pressure_density": "actual"})).history
    ratio = np.maximum(1.0 + nominal[:, components.DENSITY_VARIATION], 1e-3)
    row = components.DYNAMIC_PRESSURE
    np.testing.assert_allclose(actual[:, row], nominal[:, row] * ratio, rtol=1e-13)
    np.testing.assert_array_equal(np.delete(actual, row, axis=1), np.delete(nominal, row, axis=1))


def test_flights_are_of_fourth_order_in_the_step():
    """In an exponential atmosphere, against an adaptive method of eighth order."""
    air = exponential_air(0.02, 9e3)
    partition, control = np.array([0.0, 80.0, 160.0, 240.0]), np.array([0.3, -0.5, 0.2])

    def rates(_, x, u):
        return aerocapture(x, u, 0.02 * np.exp(-(x[0] - RADIUS) / 9e3))

    exact = ENTRY
    for start, end, u in zip(partition[:-1], partition[1:], control, strict=True):
        exact = solve_ivp(rates, (start, end), exact, "DOP853", args=(u,), rtol=1e-13, atol=1e-13).y[:, -1]
    law = flight.open_loop(partition, control)
    error = {}
    for step in (4.0, 2.0, 1.0):
        trajectories = fly(air, law, 1, time_step=step, every=1)
        error[step] = np.abs(trajectories.final_state[: components.FLOORED, 0] - (exact - [RADIUS, 0.0, 0.0]))
    for coarse in (4.0, 2.0):
        np.testing.assert_allclose(np.log2(error[coarse] / error[coarse / 2]), 4.0, atol=0.3)


# ---- aerocapture: limits and bad ends --------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [1.0, 1e17])
def test_commands_are_flown_within_their_limits(air, law, factor):
    """Each trial once more without feedback, by the commands that it recorded, limited."""
    law = law._replace(gain=factor * law.gain)
    together = fly(air, law, 12, every=50)
    nodes = np.searchsorted(flight.outputs(law, 50, STEP), PARTITION[:-1])
    assert (together.outcome != NON_FINITE).all()
    for trial in range(12):
        control = np.clip(together.history[nodes, components.BANK_COSINE, trial], -1.0, 1.0)
        control[np.isnan(control)] = 0.0  # after a crash
        alone = fly(air, flight.open_loop(PARTITION, control), 1, first_trial=trial, every=50)
        np.testing.assert_array_equal(alone.history[:, :-1, 0], together.history[:, :-1, trial])
        np.testing.assert_array_equal(alone.final_state[:, 0], together.final_state[:, trial])
    if factor > 1.0:
        assert together.observed_maximum[1].min() > 1e10


def test_trials_end_below_the_ground_and_leave_the_others_alone(air, law):
    states = np.tile(ENTRY, (70, 1))
    steep = np.arange(70) % 3 == 1
    states[steep] = STEEP
    mixed, healthy = fly(air, law, initial=states, every=1), fly(air, law, 70, every=1)
    np.testing.assert_array_equal(mixed.outcome, np.where(steep, CRASHED, COMPLETED))
    for name in ("history", "observed", "observed_maximum", "final_state", "length"):
        np.testing.assert_array_equal(getattr(mixed, name)[..., ~steep], getattr(healthy, name)[..., ~steep])
    final = mixed.final_state[:, steep]
    assert (final[components.ALTITUDE] < 0.0).all() and np.isfinite(final).all()
    assert (mixed.length[steep] < 801).all() and np.isfinite(mixed.observed_maximum).all()
    trial = np.flatnonzero(steep)[0]
    length, stored = mixed.length[trial], mixed.history[:, :, trial]
    assert (stored[:length, components.ALTITUDE] >= 0.0).all()
    assert np.isfinite(stored[:length]).all() and np.isnan(stored[length:]).all()


# ---- double integrator -----------------------------------------------------------------------------------------------

GRID = np.linspace(-0.4, 1.4, 181)
NODES = np.arange(6.0)
SPREAD = np.array([0.05, 0.01]) / 3.0


@pytest.fixture(scope="module")
def root():
    shape = {"variance": 2e-6, "period": 0.35, "periodic_length": 0.8, "length": 1.0}
    return random_field.root(random_field.covariance_matrix(partial(random_field.locally_periodic, **shape), GRID))


@pytest.fixture(scope="module")
def point_law():
    rng = np.random.default_rng(1)
    coasting = np.column_stack([0.1 + 0.1 * NODES, np.full(6, 0.1)])
    gain = 0.1 * rng.standard_normal((5, 6, 2)) * [0.1, 1.0]
    return flight.Law(NODES, 1e-3 * rng.standard_normal(5), gain, coasting)


def fly_point(law, root, initial, grid=GRID, **options):
    options = {"time_step": 0.02, "seed": SEED, "every": 50} | options
    return flight.fly_double_integrator(law, grid, root, initial, **options)


def initial_points(trials):
    return np.array([0.1, 0.1]) + SPREAD * normals(SEED, flight.INITIAL_STREAM, range(trials), 2)


def point_oracle(law, root, initial, grid=GRID, step=0.02):
    """Positions, rates, fields and controls at every step by plain numpy, (times, 4, trials)."""
    trials = np.arange(len(initial))
    samples = normals(SEED, flight.FIELD_STREAM, trials, root.shape[1]) @ root.T
    slopes = np.gradient(samples, grid, axis=1)

    def field(r):
        r = np.clip(r, grid[0], grid[-1])
        k = np.clip(np.searchsorted(grid, r, side="right") - 1, 0, len(grid) - 2)
        h = grid[k + 1] - grid[k]
        t = (r - grid[k]) / h
        ends = (1 + 2 * t) * (1 - t) ** 2 * samples[trials, k] + t**2 * (3 - 2 * t) * samples[trials, k + 1]
        return ends + h * (t * (1 - t) ** 2 * slopes[trials, k] + t**2 * (t - 1) * slopes[trials, k + 1])

    x, states_at_nodes, stored = initial, [], []
    for k, (start, end) in enumerate(zip(law.start[:-1], law.start[1:], strict=True)):
        states_at_nodes.append(x)
        u = commanded(law, k, states_at_nodes)
        for _ in range(round((end - start) / step)):
            stored.append([*x.T, field(x[:, 0]), u])
            x = runge_kutta(lambda x, u=u: np.stack([x[:, 1], u + field(x[:, 0])], axis=1), x, step)
    return np.array([*stored, [*x.T, field(x[:, 0]), u]])


@pytest.mark.parametrize(("columns", "start"), [(30, 0.1), (181, GRID[-1])])
def test_points_are_those_of_plain_numpy(root, point_law, columns, start):
    root, initial = root[:, :columns], initial_points(300)
    initial[:, 0] += start - 0.1
    trajectories = fly_point(point_law, root, initial, every=5)
    expected = point_oracle(point_law, root, initial)[::5]
    np.testing.assert_allclose(trajectories.history, expected, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(trajectories.history, expected, rtol=0, atol=1e-12)  # fields are of order 1e-3
    np.testing.assert_array_equal(trajectories.final_state, trajectories.history[-1, :2])
    np.testing.assert_array_equal(trajectories.observed[:, 0], trajectories.history[:, components.CONTROL])
    np.testing.assert_array_equal(trajectories.observed_maximum, trajectories.observed.max(axis=0))
    np.testing.assert_array_equal(flight.outputs(point_law, 5, 0.02)[[0, 10, -1]], [0.0, 1.0, 5.0])


def test_points_are_of_fourth_order_in_the_step():
    """In a linear field, Psi = z (r - 0.5), the positions are hyperbolic or trigonometric functions of time."""
    grid, trials = np.linspace(-4.0, 4.0, 81), 64
    initial = np.tile([0.1, 0.1], (trials, 1))
    rate = np.sqrt(normals(SEED, flight.FIELD_STREAM, range(trials), 1)[:, 0].astype(complex))
    start, speed = -0.4, 0.1
    exact = np.array(
        [
            0.5 + (start * np.cosh(2 * rate) + speed / rate * np.sinh(2 * rate)).real,
            (start * rate * np.sinh(2 * rate) + speed * np.cosh(2 * rate)).real,
        ]
    )
    law = flight.open_loop(np.array([0.0, 2.0]), np.zeros(1), 2)
    error = []
    for step in (0.1, 0.05, 0.025):
        trajectories = fly_point(law, grid[:, np.newaxis] - 0.5, initial, grid, time_step=step, every=1)
        error.append(np.sqrt(np.mean((trajectories.final_state - exact) ** 2, axis=1)))
    for coarse, fine in pairwise(error):
        np.testing.assert_allclose(np.log2(coarse / fine), 4.0, atol=0.2)
    assert np.abs(trajectories.history[:, components.POSITION]).max() < 4.0
