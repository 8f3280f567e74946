"""The entry design: nominal flight, linear model, gains of both laws, certificates, trade-off.

Expected numbers are those of an independent study of the paper, to the digits given; a tolerance of half the last digit
is meant where no other reason is stated.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from marsedl.methods.covariance_steering.chance import chance_factor
from marsedl.methods.covariance_steering.lqg_dual import solve
from marsedl.methods.guidance.apollo import adjoint_gains
from marsedl.papers.stochastic_entry import dispersions, environment, flight, gains, records
from marsedl.papers.stochastic_entry.gains import STATE_SCALE, problem
from marsedl.papers.stochastic_entry.records import TRIGGERS

RADIUS, GRAVITATIONAL_PARAMETER = 3397e3, 4.2828e13
DRAG_FACTOR = 1 / (2 * 135.0)  # A C_D / (2 m) = 1 / (2 BC)
LIFT_FACTOR = 0.24 * DRAG_FACTOR
DESIGNED = ("corrected", "partition_24")


def three_sigma(covariance):
    """Altitude (km), velocity (m/s), path angle (deg), downrange (km)."""
    deviation = 3 * np.sqrt(np.diagonal(covariance))
    return deviation[0] / 1e3, deviation[1], np.degrees(deviation[2]), deviation[3] / 1e3


def correlation(covariance, i, j):
    return covariance[i, j] / np.sqrt(covariance[i, i] * covariance[j, j])


# --- nominal flight ---------------------------------------------------------------------------------------------------

NOMINAL = {  # value and half of its last digit
    "corrected": {
        "end_time": (237.70, 0.006),
        "to_go_km": (10.02, 0.006),
        "altitude_km": (12.47, 0.006),
        "path_angle_deg": (-13.86, 0.006),
        "entry_crossrange_km": (0.543, 0.0006),
        "crossrange_m": (-2.0, 0.6),
        "largest_velocity": (5828.5, 0.06),
        "largest_velocity_time": (39.0, 0.6),
        "largest_pressure_kpa": (14.46, 0.006),
        "largest_pressure_time": (85.0, 0.6),
        "largest_drag": (107.0, 0.6),
        "largest_path_angle_deg": (1.12, 0.006),
        "climb": ((119.0, 162.0), 1.0),
        "alignment_time": (145.0, 0.0),
        "reversals": ((71.0, 92.0, 118.0), 0.0),
        "through_zero": ((75.0, 95.0, 121.0), 0.6),
        "margin_m": (200.0, 5.0),
    },
}


def facts_of(nominal):
    pressure = 0.5 * nominal.density * nominal.velocity**2
    climbing = nominal.time[nominal.flight_path_angle > 0]
    bank = nominal.bank
    # The direction of the bank changes while it is rolled through zero.
    crossing = nominal.time[1:][(np.sign(bank[1:]) != np.sign(bank[:-1])) & (nominal.time[1:] < nominal.alignment_time)]
    return {
        "end_time": nominal.end_time,
        "to_go_km": -nominal.downrange[-1] / 1e3,
        "altitude_km": nominal.altitude[-1] / 1e3,
        "path_angle_deg": np.degrees(nominal.flight_path_angle[-1]),
        "entry_crossrange_km": nominal.crossrange[0] / 1e3,
        "crossrange_m": nominal.crossrange[-1],
        "largest_velocity": nominal.velocity.max(),
        "largest_velocity_time": nominal.time[nominal.velocity.argmax()],
        "largest_pressure_kpa": pressure.max() / 1e3,
        "largest_pressure_time": nominal.time[pressure.argmax()],
        "largest_drag": nominal.drag.max(),
        "largest_path_angle_deg": np.degrees(nominal.flight_path_angle.max()),
        "climb": climbing[[0, -1]],
        "alignment_time": nominal.alignment_time,
        "reversals": nominal.reversal_time,
        "through_zero": crossing,
        "margin_m": nominal.deadband_margin,
    }


@pytest.mark.parametrize("reading", NOMINAL)
def test_nominal_numbers(entry, reading):
    facts = facts_of(entry.nominal(reading))
    for name, (expected, tolerance) in NOMINAL[reading].items():
        np.testing.assert_allclose(facts[name], expected, rtol=0, atol=tolerance, err_msg=name)


NOMINAL_ROWS = [  # s: km, m/s, deg, deg, km to go, km of crossrange
    (0, 125.00, 5800.0, -15.50, -75.0, 653.78, 0.543),
    (45, 61.72, 5824.6, -12.46, -75.0, 406.47, 0.321),
    (90, 19.75, 3492.1, -6.35, 56.0, 180.58, 4.786),
    (120, 16.12, 1621.4, 0.22, -0.0, 109.95, -3.515),
    (165, 16.83, 880.3, -0.16, -12.8, 57.51, 0.257),
    (237, 12.55, 502.4, -13.67, 0.6, 10.36, -0.002),
]


@pytest.mark.parametrize("expected", NOMINAL_ROWS, ids=lambda row: f"{row[0]} s")
def test_nominal_over_time(entry, expected):
    nominal = entry.nominal()
    k = np.flatnonzero(np.abs(nominal.time - expected[0]) < 1e-9)[0]
    values = (
        nominal.altitude[k] / 1e3,
        nominal.velocity[k],
        np.degrees(nominal.flight_path_angle[k]),
        np.degrees(nominal.bank[k]),
        -nominal.downrange[k] / 1e3,
        nominal.crossrange[k] / 1e3,
    )
    digits = np.array([0.0051, 0.051, 0.0051, 0.051, 0.0051, 0.00051])
    np.testing.assert_array_less(np.abs(np.subtract(values, expected[1:])), digits)


@pytest.mark.parametrize("reading", ["corrected", "desensitized_density"])
def test_no_reversal_of_the_nominal_is_marginal(entry, reading):
    """A margin of centimetres would let a right program fly one reversal more."""
    nominal = entry.nominal(reading)
    assert nominal.deadband_margin >= 110.0
    # The margin, from crossrange and deadband at the commands before the heading alignment.
    guided = nominal.guidance_time < nominal.alignment_time
    crossrange = np.interp(nominal.guidance_time[guided], nominal.time, nominal.crossrange)
    direction = -np.ones(len(crossrange))
    for reversal in nominal.reversal_time:
        direction[nominal.guidance_time[guided] > reversal] *= -1
    margin = np.abs(direction * crossrange - nominal.deadband[guided]).min()
    assert nominal.deadband_margin == pytest.approx(margin, abs=1e-6)
    # The reversals follow Eq. 57: beyond the deadband on the growing side, and only then.
    beyond = nominal.guidance_time[guided][direction * crossrange > nominal.deadband[guided]]
    np.testing.assert_array_equal(beyond, nominal.reversal_time)


def test_nominal_does_not_depend_on_its_steps(entry):
    base, finer = entry.nominal(), entry.nominal(nominal_substeps=40)
    assert finer.end_time == pytest.approx(base.end_time, abs=1e-4)
    assert finer.downrange[-1] == pytest.approx(base.downrange[-1], abs=0.1)
    np.testing.assert_array_equal(finer.reversal_time, base.reversal_time)


@pytest.mark.parametrize("reading", ["corrected", "printed"])
def test_longitude_and_latitude_of_the_nominal_place_the_target_where_it_is_stored(entry, reading):
    """By vectors in space: the arc to the target, and its angle from the plane of the inertial velocity."""
    nominal, inputs = entry.nominal(reading), entry.stage_inputs(reading, "nominal")
    mission, planet = inputs.mission, inputs.planet

    def direction(longitude, latitude):
        return np.stack(
            [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)], axis=-1
        )

    here, target = (
        direction(nominal.longitude, nominal.latitude),
        direction(mission.target_longitude, mission.target_latitude),
    )
    east = np.cross([0.0, 0.0, 1.0], here)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(here, east)
    rotation = planet.rotation_rate * (planet.planet_radius + nominal.altitude) * np.cos(nominal.latitude)
    horizontal = nominal.velocity * np.cos(nominal.flight_path_angle)
    velocity = (
        (horizontal * np.sin(nominal.azimuth) + rotation)[:, np.newaxis] * east
        + (horizontal * np.cos(nominal.azimuth))[:, np.newaxis] * north
    )  # fmt: skip
    normal = np.cross(here, velocity)
    arc = np.arctan2(np.linalg.norm(np.cross(here, target), axis=1), here @ target)
    across = np.arcsin(normal @ target / np.linalg.norm(normal, axis=1))
    np.testing.assert_allclose(-planet.planet_radius * arc, nominal.downrange, rtol=0, atol=1e-6)
    np.testing.assert_allclose(planet.planet_radius * across, nominal.crossrange, rtol=0, atol=1e-6)
    entered = [nominal.longitude[0], nominal.latitude[0], nominal.azimuth[0]]
    assert entered == [mission.entry_longitude, mission.entry_latitude, mission.entry_azimuth]


# --- linear model -----------------------------------------------------------------------------------------------------


def longitudinal_rates(profile, decay_factor, state, cosine):
    """Eqs. 27 and the density's drift, written down once more; state (5,)."""
    radius, velocity, path_angle, _, density = state
    log_density, slope, _ = profile(radius - RADIUS)
    gravity, sink = GRAVITATIONAL_PARAMETER / radius**2, -velocity * np.sin(path_angle)
    decay = -decay_factor * slope
    return np.array(
        [
            -sink,
            -DRAG_FACTOR * density * velocity**2 - gravity * np.sin(path_angle),
            LIFT_FACTOR * density * velocity * cosine
            - (gravity - velocity**2 / radius) * np.cos(path_angle) / velocity,
            velocity * np.cos(path_angle),
            ((-slope - decay) * density + decay * np.exp(log_density)) * sink,
        ]
    )


def test_matrices_are_the_derivatives_of_a_second_of_flight(entry):
    """Deviations d' = f(nominal + d, u + v) - f(nominal, u) over a guidance period, by central differences."""
    inputs = entry.stage_inputs("corrected", "linearization")
    nominal, model = entry.nominal(), entry.linearization()
    profile = inputs.call(environment.profile)
    states = np.column_stack(
        [
            nominal.altitude + RADIUS,
            nominal.velocity,
            nominal.flight_path_angle,
            nominal.downrange,
            nominal.density,
        ]
    )
    smooth = CubicSpline(nominal.time, states)
    ends = np.cos(np.radians([45.0, 75.0]))

    def deviation(t, d, v):
        reference = smooth(t)
        cosine = np.interp(reference[1], [2500.0, 5500.0], ends)
        moved = longitudinal_rates(profile, 2.0, reference + d, cosine + v)
        return moved - longitudinal_rates(profile, 2.0, reference, cosine)

    def after(k, d, v=0.0):
        span = model.time[k], model.time[k + 1]
        return solve_ivp(deviation, span, d, args=(v,), rtol=1e-10, atol=1e-12 * STATE_SCALE).y[:, -1]

    for k in (5, 50, 65, 80, 95, 110, 130):
        small = 1e-4 * STATE_SCALE
        columns = [(after(k, small * e) - after(k, -small * e)) / (2 * small[j]) for j, e in enumerate(np.eye(5))]
        derivatives = np.column_stack(columns)
        scaled = (derivatives - model.transition[k]) * STATE_SCALE / STATE_SCALE[:, np.newaxis]
        # Midpoint rule with steps of 0.1 s: (0.1 s)^2 of the rates' own time scales of several seconds.
        assert np.abs(scaled).max() < 2e-4, k
        control = (after(k, np.zeros(5), 1e-4) - after(k, np.zeros(5), -1e-4)) / 2e-4
        size = np.abs(model.control[k] / STATE_SCALE).max()
        assert np.abs((control - model.control[k]) / STATE_SCALE).max() < 1e-3 * size, k


def test_matrices_are_those_of_the_flight_itself(entry):
    """Small deviations at entry, flown in three dimensions with a prescribed bank cosine, against products of A and B.

    The flight has the planet's rotation and ranges on the surface (r_p / r), which the longitudinal model leaves out.
    """
    inputs = entry.stage_inputs("corrected", "montecarlo", flight_substeps=20)
    model, air = entry.linearization(), environment.undisturbed(inputs.call(environment.atmosphere))
    constants = inputs.call(flight.settings, air)
    seconds = 65  # before the first reversal
    mean = inputs.call(dispersions.entry_mean)

    def history(deviation, cosine_change=0.0, second=0):
        cosine = model.bank_cosine.copy()
        cosine[second] += cosine_change
        zero = np.zeros((len(cosine), flight.FEATURES))
        law = flight.Law(flight.BY_TIME, np.zeros(2), zero, zero, cosine, 0.0)
        factors = (np.array([factor]) for factor in dispersions.factors(inputs.call(dispersions.body_of)))
        trajectories = flight.fly(
            constants,
            air,
            law,
            flight.Vehicles((mean + deviation)[np.newaxis], *factors),
            trigger="time",
            end_time=float(seconds),
            substeps=20,
            seed=1,
        )
        return trajectories.history[-1, :5, 0]

    products = [np.eye(5)]
    for k in range(seconds):
        products.append(model.transition[k] @ products[-1])
    steps = {dispersions.SPEED: (1, 0.5), dispersions.PATH_ANGLE: (2, 1e-4)}
    for component, (column, size) in steps.items():
        deviation = np.zeros(6)
        deviation[component] = size
        derivative = (history(deviation) - history(-deviation)) / (2 * size)
        expected = np.array(products)[:, :, column].T
        np.testing.assert_allclose(derivative[[0, 1, 2, 4]], expected[[0, 1, 2, 4], -1], rtol=0.03)
        # On the surface: R' = (r_p / r) V cos(gamma), of which Eq. 27d has V cos(gamma) only.
        radius, velocity, angle = model.state[: seconds + 1, :3].T
        rate = expected[1] * np.cos(angle) - velocity * np.sin(angle) * expected[2]
        rate -= velocity * np.cos(angle) * expected[0] / radius
        on_surface = np.sum((RADIUS / radius * rate)[1:] + (RADIUS / radius * rate)[:-1]) / 2
        assert derivative[3] == pytest.approx(on_surface, rel=0.02)
    second, change = 55, 0.01
    derivative = (history(np.zeros(6), change, second) - history(np.zeros(6), -change, second)) / (2 * change)
    expected = model.control[second]
    for k in range(second + 1, seconds):
        expected = model.transition[k] @ expected
    np.testing.assert_allclose(derivative[[0, 1, 2, 4]], expected[[0, 1, 2, 4]], rtol=0.02)


def test_control_has_no_effect_from_the_heading_alignment_on(entry):
    model = entry.linearization()
    effective = model.control.any(axis=1)
    np.testing.assert_array_equal(effective, model.time[:-1] < entry.nominal().alignment_time)
    assert model.time[-1] == entry.nominal().end_time  # the last interval is shorter
    np.testing.assert_allclose(np.diff(model.time)[:-1], 1.0)
    assert 0 < np.diff(model.time)[-1] < 1


def test_density_noise_is_that_of_the_sink_rate_and_none_while_climbing(entry):
    model, nominal = entry.linearization(), entry.nominal()
    climbing = (model.time[:-1] > 120) & (model.time[1:] < 161)
    assert not model.noise[climbing].any()
    for k in (20, 60, 90):
        middle = model.time[k] + 0.5
        altitude, velocity, angle, density = (
            np.interp(middle, nominal.time, getattr(nominal, name))
            for name in ("altitude", "velocity", "flight_path_angle", "density")
        )
        variance = 0.148 * np.exp((min(altitude, 120e3) - 120e3) / 20e3)
        slope = entry.stage_inputs("corrected", "linearization").call(environment.profile)(altitude)[1]
        intensity = density**2 * 4 * variance * -slope * -velocity * np.sin(angle)  # per second, Eqs. 11, 24
        # What came earlier in the second has grown with the density since.
        assert model.noise[k, 4, 4] == pytest.approx(intensity, rel=0.3)
        assert model.noise[k, 4, 4] > 0


@pytest.mark.parametrize(
    ("reading", "column", "final_rate"),
    [
        ("corrected", (-35.28, 0.0, -0.00146, 142.97, 1.564e-5), -3.395),
        ("desensitized_density", (-33.46, 0.0, -0.001442, 141.01, 1.518e-5), -3.450),
    ],
)
def test_trigger_projection_numbers(entry, reading, column, final_rate):
    model = entry.linearization(reading)
    velocity_column = model.trigger_projection[:, 1]
    np.testing.assert_array_less(np.abs(velocity_column - column), [0.0051, 1e-12, 5.1e-6, 0.0051, 5.1e-9])
    assert model.final_rates[1] == pytest.approx(final_rate, abs=5.1e-4)
    # Z_f says how state and time exchange: its column is -rates / deceleration.
    np.testing.assert_allclose(velocity_column[[0, 2, 3, 4]], -(model.final_rates / model.final_rates[1])[[0, 2, 3, 4]])


# --- the stochastic law -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reading", DESIGNED)
@pytest.mark.parametrize("trigger", range(2), ids=TRIGGERS)
def test_the_law_is_a_certified_optimum(entry, reading, trigger):
    laws = entry.gains(reading)
    assert laws.status[trigger] == "optimal"
    assert abs(laws.gap[trigger]) < 1e-6 and abs(laws.gap_above_floor[trigger]) < 1e-4
    # Where the floor is nearly all of the cost, rounding hides what a limit costs: up to 1e-5 over it.
    assert laws.control_ratio[trigger].max() <= 1 + 2e-5 and laws.final_ratio[trigger].max() <= 1 + 2e-5
    assert (laws.control_multiplier[trigger] >= 0).all() and (laws.final_multiplier[trigger] >= 0).all()
    assert laws.complementarity[trigger] < 1e-8
    # What has a price is at its limit.
    active = laws.control_multiplier[trigger] * laws.control_limit**2 > 1e-6 * laws.cost[trigger]
    np.testing.assert_allclose(laws.control_ratio[trigger][active], 1.0, atol=1e-5)
    np.testing.assert_allclose(laws.final_ratio[trigger][laws.final_multiplier[trigger] > 1e-9], 1.0, atol=1e-5)
    # No law is better than the noise after the last control.
    assert laws.cost[trigger] >= laws.noise_floor[trigger] * (1 - 1e-12)


def riccati(model, weight, control_weight):
    """Eq. 55 with the inverse and Eq. 55b as printed, in scaled states."""
    scale = STATE_SCALE
    value, gain = weight * np.outer(scale, scale), []
    for a, b, r in zip(model.transition[::-1], model.control[::-1], control_weight[::-1], strict=True):
        a, b = a * scale / scale[:, np.newaxis], b / scale
        bracket = b @ value @ b + r
        k = -(b @ value @ a) / bracket if b.any() else np.zeros(5)
        value = a.T @ value @ a - bracket * np.outer(k, k)
        gain.append(k / scale)
    return np.array(gain[::-1])


@pytest.mark.parametrize("trigger", range(2), ids=TRIGGERS)
def test_multipliers_as_lqg_weights_give_the_law(entry, trigger):
    """Theorem III.1, with a Riccati recursion of another form."""
    laws, model = entry.gains(), entry.linearization()
    objective = np.eye(5)[3] if trigger == 0 else model.trigger_projection[3]
    weight = np.outer(objective, objective)
    weight[0, 0] += laws.final_multiplier[trigger, 0]
    weight[2, 2] += laws.final_multiplier[trigger, 1]
    gain = riccati(model, weight, laws.control_weight + laws.control_multiplier[trigger])
    stored_gain = laws.stochastic_gain[trigger]
    # Eq. 55b as printed loses digits by cancellation, where the Joseph form does not.
    error = np.abs((gain - stored_gain) * STATE_SCALE).max(axis=1)
    assert (error <= 1e-5 * np.abs(stored_gain * STATE_SCALE).max(axis=1) + 1e-12).all()


@pytest.mark.parametrize("reading", DESIGNED)
@pytest.mark.parametrize("trigger", range(2), ids=TRIGGERS)
def test_predicted_covariance_meets_the_limits(entry, reading, trigger):
    """Limits of Eqs. 73 to 75 at 99.73 %, read off the covariance that the figures show."""
    laws, model = entry.gains(reading), entry.linearization(reading)
    altitude, _, path_angle, _ = three_sigma(laws.stochastic_covariance[trigger][-1])
    assert altitude == pytest.approx(2.000, abs=5.1e-4)  # the altitude limit is active
    assert path_angle <= 1.5501
    cosine = model.bank_cosine[:-1]
    limit = np.minimum(0.45, np.minimum(1 - cosine, 1 + cosine)) / chance_factor(0.9973)
    deviation = np.sqrt(laws.stochastic_control_variance[trigger])
    # Control limits of a coarse interval are the smallest inside of it, so they hold in every second.
    assert (deviation <= limit * (1 + 1e-6)).all()
    assert (3 * deviation[cosine > np.cos(np.radians(45.0)) - 1e-12] <= 0.2929 * 1.0001).all()


@pytest.mark.parametrize(
    ("reading", "trigger", "expected", "range_velocity", "objective"),
    [
        ("corrected", 0, (2.000, 51.45, 1.550, 0.256), 0.14, 0.0854),
        ("corrected", 1, (2.000, 48.91, 1.385, 6.90), -0.980, 0.4669),
        ("partition_24", 1, (2.000, 46.0, 1.29, 6.48), -0.977, 0.467),
        ("desensitized_density", 0, (2.000, 52.87, 1.550, 0.235), 0.13, 0.0782),
        ("desensitized_density", 1, (2.000, 48.44, 1.323, 6.75), -0.982, 0.4335),
    ],
)
def test_predicted_dispersions_at_the_end(entry, reading, trigger, expected, range_velocity, objective):
    """To 1 %, as the optimum is nearly degenerate: many laws reach the floor."""
    laws = entry.gains(reading)
    covariance = laws.stochastic_covariance[trigger][-1]
    np.testing.assert_allclose(three_sigma(covariance), expected, rtol=0.01)
    assert correlation(covariance, 3, 1) == pytest.approx(range_velocity, abs=0.02)
    weight = np.eye(5)[3] if trigger == 0 else entry.linearization(reading).trigger_projection[3]
    deviation = np.sqrt(weight @ covariance @ weight) / 1e3
    assert deviation == pytest.approx(objective, rel=1e-3)


def test_the_law_is_silent_after_entry(entry):
    for trigger, early in ((0, 8e-5), (1, 2e-5)):
        three = 3 * np.sqrt(entry.gains().stochastic_control_variance[trigger])
        assert three[0] < 1e-3
        assert three[0] == pytest.approx(early, rel=0.2)
        assert (three[:15] < 0.0015).all()
    # The velocity trigger needs less of its control limits.
    assert entry.gains().control_ratio[1].max() == pytest.approx(0.88, abs=0.005)
    assert entry.gains().final_ratio[1, 1] < 0.95


@pytest.mark.parametrize("trigger", range(2), ids=TRIGGERS)
def test_refining_the_partition_never_raises_the_optimum(entry, trigger):
    """1 s inside 2 s inside 4 s, with the smallest limit of an interval, and control weights by its length."""
    inputs, model = entry.stage_inputs("corrected", "gains"), entry.linearization()
    costs = []
    for interval in (1.0, 2.0, 4.0):
        posed = inputs.call(problem, model, trigger, interval=interval)
        starts = inputs.call(gains.partition_starts, len(model.control), interval)
        lengths = np.diff(np.append(starts, len(model.control)))
        solution = solve(posed._replace(control_weight=posed.control_weight * lengths))
        assert abs(solution.gap) < 1e-5
        costs.append((solution.dual_value, solution.cost))
    for (_, fine), (coarse, _) in pairwise(costs):
        assert fine <= coarse * (1 + 1e-6)  # whatever is attained, against what cannot be undercut


def test_a_coarse_partition_holds_gain_in_flight_and_control_in_the_design(entry):
    laws = entry.gains("partition_24")
    assert len(laws.partition_start) == 24
    np.testing.assert_array_equal(laws.partition_start, np.arange(0, 238, 10))
    for trigger in range(2):
        by_interval = laws.stochastic_gain[trigger][laws.partition_start]
        gain_of_interval = np.repeat(by_interval, 10, axis=0)[: len(laws.stochastic_gain[trigger])]
        np.testing.assert_array_equal(laws.stochastic_gain[trigger], gain_of_interval)
    # On the limit from entry on, against the silence that the paper shows.
    three = 3 * np.sqrt(laws.stochastic_control_variance[0])
    assert three[0] == pytest.approx(0.45, rel=1e-3)


def test_the_printed_gain_equation_overflows(entry):
    laws = entry.gains("printed")
    for trigger in range(2):
        finite = np.isfinite(laws.stochastic_gain[trigger]).all(axis=1)
        effective = entry.linearization("printed").control.any(axis=1)
        last = np.flatnonzero(effective)[-1]
        assert not finite[:60].any()  # marched backwards, it overflows well before entry
        assert finite[last:].all()
        gain = laws.stochastic_gain[trigger][last]
        assert 1e20 < np.abs(gain).max() < 1e60
        assert "gains are finite" in laws.status[trigger]
        for name in ("cost", "gap", "complementarity"):
            assert np.isnan(getattr(laws, name)[trigger])
    assert np.isfinite(laws.table_gain).all() and np.isfinite(laws.apollo_covariance).all()


# --- the Apollo law ---------------------------------------------------------------------------------------------------


def apollo_gain(entry, reading, trigger):
    """Gain of the Apollo law in every guidance period, (periods, 5): what the flown table is made from."""
    laws, model = entry.gains(reading), entry.linearization(reading)
    final = laws.adjoint[trigger][-1]
    if reading != "density_blind":
        return adjoint_gains(model.transition, model.control, final, 5.0).gain
    blind = adjoint_gains(model.slaved_transition, model.slaved_control, final[:4], 5.0).gain
    return np.column_stack([blind, np.zeros(len(blind))])


@pytest.mark.parametrize("trigger", range(2), ids=TRIGGERS)
def test_adjoint_predicts_the_final_range_of_deviations(entry, trigger):
    """By flying deviations forwards through the linear system, with and without a held control."""
    laws, model = entry.gains(), entry.linearization()
    goal = np.eye(5)[3] if trigger == 0 else model.trigger_projection[3]
    for start in (0, 40, 70, 100, 140):
        states, control_response = STATE_SCALE * np.eye(5), np.zeros(5)
        states = states.T.copy()
        for k in range(start, len(model.control)):
            states = model.transition[k] @ states
            control_response = model.transition[k] @ control_response + model.control[k]
        np.testing.assert_allclose(laws.adjoint[trigger][start] * STATE_SCALE, goal @ states, rtol=1e-9, atol=1e-9)
        # Overcontrol by 5: the command would turn the predicted error into minus four times itself.
        gain = apollo_gain(entry, "corrected", trigger)[start]
        turned = laws.adjoint[trigger][start] + (goal @ control_response) * gain
        np.testing.assert_allclose(turned, -4 * laws.adjoint[trigger][start], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("trigger", range(2), ids=TRIGGERS)
def test_gains_without_a_density_state_are_the_five_state_gains_on_the_mean_density(entry, trigger):
    """K4_r = K5_r - K5_rho rho/H, the others equal: density then is one of altitude."""
    five, four = (apollo_gain(entry, reading, trigger) for reading in ("corrected", "density_blind"))
    model = entry.linearization()
    slaved = five.copy()
    slaved[:, 0] -= five[:, 4] * model.state[:-1, 4] * model.inverse_scale_height[:-1]
    slaved[:, 4] = 0.0
    effective = model.control.any(axis=1)
    size = np.abs(four[effective] * STATE_SCALE).max(axis=1, keepdims=True)
    error = np.abs((slaved - four)[effective] * STATE_SCALE) / size
    assert error.max() < 1e-5
    assert not four[~effective].any()


def effective_gain(model, gain, slopes):
    """K_eff of a law flown against velocity: K - (K dx/dV) e_V + (du/dV) e_V; slopes: dx/dV of the reference."""
    fed_back = (np.arange(len(model.time)) >= np.argmax(model.state[:, 1])) & (model.drag >= 0.5)
    effective = np.where(fed_back[:-1, np.newaxis], gain, 0.0)
    effective[:, 1] += model.bank_cosine_slope[:-1] - np.einsum("ki,ki->k", effective, slopes)
    effective[~model.control.any(axis=1)] = 0.0
    return effective


@pytest.mark.parametrize("reading", ["corrected", "density_blind"])
@pytest.mark.parametrize("trigger", range(2), ids=TRIGGERS)
def test_covariance_of_the_apollo_law_is_that_of_the_law_as_flown(entry, reading, trigger):
    laws, model = entry.gains(reading), entry.linearization(reading)
    effective = effective_gain(model, apollo_gain(entry, reading, trigger), (model.slope / model.slope[:, [1]])[:-1])
    covariance = model.initial_covariance
    for k in range(len(effective)):
        variance = effective[k] @ covariance @ effective[k]
        assert laws.apollo_control_variance[trigger][k] == pytest.approx(variance, rel=1e-7, abs=1e-25)
        closed = model.transition[k] + np.outer(model.control[k], effective[k])
        covariance = closed @ covariance @ closed.T + model.noise[k]
    np.testing.assert_allclose(laws.apollo_covariance[trigger][-1], covariance, rtol=1e-8)


@pytest.mark.parametrize("case", ["apollo_time", "apollo_velocity"])
@pytest.mark.parametrize("component", [dispersions.SPEED, dispersions.PATH_ANGLE])
def test_flown_commands_of_the_apollo_law_are_those_of_an_effective_gain(entry, case, component):
    """Change of the commanded cosine after a small deviation at entry, against K_eff times the change of the state.

    With the slopes of the reference itself. Those of Eq. 27 without reversals, of the linear model, differ by up to
    10 % of the command, and by a factor of 2 while a reversal is rolled.
    """
    model, laws = entry.linearization(), entry.gains()
    # A threshold that no flight passes before its largest velocity, where the table holds for a later branch.
    inputs = entry.stage_inputs("corrected", "montecarlo", flight_substeps=20, apollo_least_drag=0.75)
    mean, air = inputs.call(dispersions.entry_mean), environment.undisturbed(inputs.call(environment.atmosphere))
    size = {dispersions.SPEED: 0.02, dispersions.PATH_ANGLE: 1e-6}[component]
    starts = np.tile(mean, (2, 1))
    starts[:, component] += [size, -size]
    body = inputs.call(dispersions.body_of)
    vehicles = flight.Vehicles(starts, *(np.full(2, factor) for factor in dispersions.factors(body)))
    trajectories = flight.fly(
        inputs.call(flight.settings, air),
        air,
        inputs.call(gains.law, model, laws, case),
        vehicles,
        trigger="time",
        end_time=140.0,
        substeps=20,
        seed=1,
    )
    change = (trajectories.history[:-1, :, 0] - trajectories.history[:-1, :, 1]) / (2 * size)
    # One trial is on either side of a row of the table: the mean of both slopes.
    sides = np.diff(model.state, axis=0) / np.diff(model.state[:, 1])[:, np.newaxis]
    slopes = np.vstack([sides[:1], (sides[1:] + sides[:-1]) / 2])
    effective = effective_gain(model, apollo_gain(entry, "corrected", TRIGGERS.index(case[7:])), slopes)[:140]
    terms = effective * change[:, :5]
    command_change = change[:, records.BANK_COSINE]
    times = np.arange(40, 140)
    # Terms of both signs nearly cancel.
    error = np.abs(command_change - terms.sum(axis=1))[times] / np.abs(terms).max(axis=1)[times]
    assert error.max() < 0.02 and np.median(error) < 2e-3


@pytest.mark.parametrize(
    ("reading", "kind", "trigger", "expected", "range_velocity", "tolerance"),
    [
        # As flown: these take the slopes of the reference from Eqs. 27, see below, and the flown table has its own.
        ("corrected", "apollo", 0, (2.17, 44.3, 1.15, 2.42), -0.68, 0.08),
        ("corrected", "apollo", 1, (2.51, 51.7, 1.66, 7.05), -0.98, 0.08),
        ("corrected", "timed", 0, (3.27, 71.0, 2.55, 0.256), 0.10, 0.002),
        ("corrected", "timed", 1, (2.21, 43.6, 1.38, 6.13), -0.97, 0.004),
        ("desensitized_density", "apollo", 0, (2.10, 41.3, 1.05, 2.19), -0.63, 0.08),
        ("desensitized_density", "apollo", 1, (2.34, 48.3, 1.53, 6.42), -0.98, 0.08),
    ],
)
def test_predicted_dispersions_of_the_apollo_law(entry, reading, kind, trigger, expected, range_velocity, tolerance):
    covariance = getattr(entry.gains(reading), f"{kind}_covariance")[trigger][-1]
    np.testing.assert_allclose(three_sigma(covariance), expected, rtol=tolerance)
    assert correlation(covariance, 3, 1) == pytest.approx(range_velocity, abs=0.05 if tolerance > 0.02 else 0.01)


def test_floor_and_what_the_linear_laws_leave_above_it(entry):
    """Noise after the heading alignment alone; the stochastic law and Apollo's against time are on it."""
    laws, model = entry.gains(), entry.linearization()
    for trigger, floor in enumerate((85.4, 466.9)):
        weight = np.eye(5)[3] if trigger == 0 else model.trigger_projection[3]
        covariance = np.zeros((5, 5))
        for k in np.flatnonzero(~model.control.any(axis=1)):
            covariance = model.transition[k] @ covariance @ model.transition[k].T + model.noise[k]
        floor_deviation = np.sqrt(weight @ covariance @ weight)
        assert floor_deviation == pytest.approx(floor, abs=0.06)
        assert np.sqrt(laws.noise_floor[trigger]) == pytest.approx(floor_deviation, rel=1e-9)
        for law in (laws.stochastic_covariance, laws.timed_covariance):
            assert np.sqrt(weight @ law[trigger][-1] @ weight) == pytest.approx(floor_deviation, rel=2e-4)
        apollo_deviation = np.sqrt(weight @ laws.apollo_covariance[trigger][-1] @ weight)
        assert apollo_deviation > floor_deviation


# --- certificates and trade-off ---------------------------------------------------------------------------------------


def test_other_formulations_find_the_same_optimum(entry):
    certificates = entry.certificates()
    np.testing.assert_allclose(certificates.cone_ratio, 1.0, atol=2e-6)
    assert (np.abs(certificates.coarse_gap) < 1e-6).all()
    # The paper's route: from the best start within half a per cent, and never below the optimum inside the limits.
    within_limits = certificates.search_worst < 1 + 1e-3
    assert (np.where(within_limits, certificates.search_ratio, np.inf).min(axis=1) < 1.005).all()
    assert (certificates.search_ratio[within_limits] > 1 - 2e-3).all()
    # With the trigger on velocity every start will do.
    assert within_limits[1].all() and (certificates.search_ratio[1] < 1.001).all()
    assert (certificates.weights_gain_error < 1e-7).all()
    assert (certificates.perturbed_cost > 0).all()


def test_a_tighter_altitude_limit_costs_range(entry):
    """And the printed limit on the reading's own partition costs none."""
    tradeoff = entry.tradeoff()
    assert tradeoff.noise_deviation**2 == pytest.approx(entry.gains().noise_floor[0], rel=1e-9)
    assert (np.diff(tradeoff.deviation, axis=-1) <= 1e-3 * tradeoff.deviation[:, 1:]).all()
    assert (tradeoff.deviation[:, 0] > 1.5 * tradeoff.deviation[:, 1]).all()
    assert tradeoff.deviation[0, 1] == pytest.approx(tradeoff.noise_deviation, rel=1e-3)
    # An altitude limit that no control can meet is a gap in the curve, not an error.
    unreachable = entry.tradeoff(altitude_limit_study=np.array([1.0, 2000.0]), partition_interval=10.0)
    np.testing.assert_array_equal(np.isnan(unreachable.deviation), [[True, False], [True, False]])
