import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.models.orbits import apoapsis_radius, branch_of, burns, gradient, total_delta_v

MU, PLANET = 4.2828e13, 3397e3
TARGET_APOAPSIS, TARGET_PERIAPSIS = 5 * PLANET, 2 * PLANET
MISSION = (TARGET_APOAPSIS, TARGET_PERIAPSIS, MU)
UNDERSHOOT, OVERSHOOT, DESCENDING, LOW = (
    (3.524e6, 4400.0, 0.15),
    (3.524e6, 4550.0, 0.2),
    (3.524e6, 4450.0, -0.12),
    (3.524e6, 3800.0, 0.1),  # its apoapsis lies below the target periapsis
)


def speed_for(radius, path, apoapsis):
    """Speed of the orbit with this apoapsis: one angular momentum and one energy at both points."""
    return np.sqrt(2 * MU * (1 / radius - 1 / apoapsis) / (1 - (radius * np.cos(path) / apoapsis) ** 2))


def random_exits(count):
    """Captured exit states, (3, count)."""
    random = np.random.default_rng(6)
    return random.uniform([3.45e6, 3600.0, 0.01], [3.65e6, 4700.0, 0.3], (count, 3)).T


def printed_equations(radius, velocity, path):
    """Eqs. 62 to 70, term by term: (a, r_a, first burn, signed second burn)."""
    axis = MU / (2 * MU / radius - velocity**2)
    apoapsis = axis * (1 + np.sqrt(1 - radius**2 * velocity**2 * np.cos(path) ** 2 / (MU * axis)))
    arrival = np.sqrt(velocity**2 + 2 * MU * (1 / apoapsis - 1 / radius))
    departure = np.sqrt(2 * MU * (1 / apoapsis - 1 / (apoapsis + TARGET_PERIAPSIS)))
    before = np.sqrt(2 * MU * (1 / TARGET_PERIAPSIS - 1 / (apoapsis + TARGET_PERIAPSIS)))
    after = np.sqrt(2 * MU * (1 / TARGET_PERIAPSIS - 1 / (TARGET_APOAPSIS + TARGET_PERIAPSIS)))
    return axis, apoapsis, departure - arrival, after - before


def coast(position, velocity, direction):
    """Cartesian two-body flight to the next apse: +1 periapsis, -1 apoapsis."""

    def rates(_, state):
        return np.concatenate([state[2:], -MU * state[:2] / np.hypot(*state[:2]) ** 3])

    def apse(_, state):
        return state[:2] @ state[2:]

    apse.terminal, apse.direction = True, direction
    start = np.concatenate([position, velocity])
    flight = solve_ivp(rates, (0.0, 2e5), start, method="DOP853", rtol=1e-12, atol=1e-6, events=apse)
    assert flight.status == 1
    return flight.y_events[0][0, :2], flight.y_events[0][0, 2:]


# ---- the orbit -------------------------------------------------------------------------------------------------------


def test_formulas_are_the_printed_ones():
    exits = random_exits(500)
    _, apoapsis, raising, change = printed_equations(*exits)
    np.testing.assert_allclose(apoapsis_radius(*exits, MU), apoapsis, rtol=1e-13)
    computed = burns(*exits, *MISSION)
    # Eq. 64 loses about two digits: some 1e-14 of the square of 4 km/s in that of a few 100 m/s.
    np.testing.assert_allclose(computed.periapsis_raise, raising, rtol=0, atol=1e-9)
    np.testing.assert_allclose(computed.apoapsis_change, change, rtol=0, atol=1e-9)
    np.testing.assert_allclose(total_delta_v(*exits, *MISSION), raising + np.abs(change), rtol=0, atol=1e-9)


@pytest.mark.parametrize("state", [UNDERSHOOT, OVERSHOOT, DESCENDING, LOW])
def test_flying_the_burns_reaches_the_target_orbit(state):
    radius, speed, path = state
    raising, change = burns(*state, *MISSION)
    position, velocity = coast(
        np.array([radius, 0.0]), speed * np.array([np.sin(path), np.cos(path)]), -1
    )  # apoapsis of the exit orbit
    np.testing.assert_allclose(np.hypot(*position), apoapsis_radius(*state, MU), rtol=1e-10)
    low = np.hypot(*position) < TARGET_PERIAPSIS
    assert low == (state is LOW)

    velocity = velocity * (1 + raising / np.hypot(*velocity))
    position, velocity = coast(position, velocity, -1 if low else 1)
    np.testing.assert_allclose(np.hypot(*position), TARGET_PERIAPSIS, rtol=1e-9)

    velocity = velocity * (1 + change / np.hypot(*velocity))
    position, _ = coast(position, velocity, -1)
    np.testing.assert_allclose(np.hypot(*position), TARGET_APOAPSIS, rtol=1e-9)


def test_escape_has_no_apoapsis_and_no_velocity_change():
    escape = np.sqrt(2 * MU / 3.5e6)
    speed = np.array([4400.0, escape * (1 - 1e-6), escape * (1 + 1e-6), 9000.0, np.nan])
    apoapsis = apoapsis_radius(3.5e6, speed, 0.1, MU)
    assert np.isfinite(apoapsis[:2]).all()
    assert apoapsis[2:4].tolist() == [np.inf, np.inf]
    assert np.isnan(apoapsis[4])  # neither captured nor escaped
    for result in (*burns(3.5e6, speed, 0.1, *MISSION), total_delta_v(3.5e6, speed, 0.1, *MISSION)):
        assert np.isnan(result).tolist() == [False, False, True, True, True]
    # a parabola in numbers that are exact
    assert apoapsis_radius(2.0, 1.0, 0.3, 1.0) == np.inf
    assert np.isnan(total_delta_v(2.0, 1.0, 0.3, 4.0, 3.0, 1.0))


# ---- the velocity change and its kink --------------------------------------------------------------------------------


def test_modulus_is_the_larger_branch():
    exits = random_exits(500)
    change = burns(*exits, *MISSION).apoapsis_change
    assert change.min() < -10 < 10 < change.max()
    under, over, raising = (total_delta_v(*exits, *MISSION, branch=branch) for branch in (1, -1, 0))
    modulus = total_delta_v(*exits, *MISSION)
    np.testing.assert_array_equal(modulus, np.maximum(under, over))
    np.testing.assert_allclose((under + over) / 2, raising, rtol=1e-14)
    branch = branch_of(apoapsis_radius(*exits, MU), TARGET_APOAPSIS)
    np.testing.assert_array_equal(total_delta_v(*exits, *MISSION, branch=branch), modulus)


def test_velocity_change_falls_to_the_target_and_rises_behind_it():
    path, radius = 0.15, 3.5244e6
    state = np.array([radius, speed_for(radius, path, TARGET_APOAPSIS), path])
    # Thinner air leaves the vehicle higher, faster and steeper at once.
    scatter = np.array([6e3, 81.0, 8.5e-3])
    slopes = {}
    for branch in (-1, 0, 1):
        slopes[branch] = scatter @ gradient(lambda *x, s=branch: total_delta_v(*x, *MISSION, branch=s), state)
    assert slopes[1] < 0 < slopes[-1]
    np.testing.assert_allclose((slopes[1] + slopes[-1]) / 2, slopes[0], rtol=1e-12)

    def along(step):
        return total_delta_v(*(state + step * scatter), *MISSION)

    # one-sided differences of second order, of the modulus itself
    for branch, step in ((1, -1e-4), (-1, 1e-4)):
        difference = (-3 * along(0) + 4 * along(step) - along(2 * step)) / (2 * step)
        np.testing.assert_allclose(difference, slopes[branch], rtol=1e-6)


def test_branch_of_an_apoapsis():
    assert branch_of(0.9 * TARGET_APOAPSIS, TARGET_APOAPSIS) == 1
    assert branch_of(1.1 * TARGET_APOAPSIS, TARGET_APOAPSIS) == -1
    assert branch_of(np.inf, TARGET_APOAPSIS) == -1
    ratios = np.array([1 - 2e-6, 1 - 5e-7, 1.0, 1 + 5e-7, 1 + 2e-6])
    assert branch_of(ratios, 1.0).tolist() == [1, 0, 0, 0, -1]
    assert branch_of(ratios, 1.0, tolerance=0.0).tolist() == [1, 1, 0, -1, -1]
    with pytest.raises(ValueError, match="NaN"):
        branch_of([1.0, np.nan], 1.0)


# ---- gradients -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("state", [UNDERSHOOT, OVERSHOOT, DESCENDING, LOW])
@pytest.mark.parametrize(
    "function",
    [
        lambda *x: apoapsis_radius(*x, MU),
        lambda *x: burns(*x, *MISSION).periapsis_raise,
        lambda *x: burns(*x, *MISSION).apoapsis_change,
        lambda *x: total_delta_v(*x, *MISSION),
    ],
)
def test_gradients_are_those_of_central_differences(function, state):
    # Fourth order; truncation stays below 3e-10 of the derivative for these steps, rounding below that.
    steps = np.array([1e3, 1.0, 1e-4])
    computed, differences = gradient(function, state), np.empty(3)
    for i, step in enumerate(steps):
        near, far = (
            function(*(state + n * step * np.eye(3)[i])) - function(*(state - n * step * np.eye(3)[i])) for n in (1, 2)
        )
        differences[i] = (8 * near - far) / (12 * step)
    np.testing.assert_allclose(computed * steps, differences * steps, rtol=1e-9, atol=1e-10)


# ---- bad input -------------------------------------------------------------------------------------------------------


def test_bad_input_is_refused():
    with pytest.raises(ValueError, match="radii from the planet's centre"):
        burns(*UNDERSHOOT, TARGET_PERIAPSIS, TARGET_APOAPSIS, MU)
    with pytest.raises(ValueError, match="target_periapsis must be positive"):
        total_delta_v(*UNDERSHOOT, TARGET_APOAPSIS, -1.0, MU)
    with pytest.raises(ValueError, match=r"branch must be .* got 2"):
        total_delta_v(*UNDERSHOOT, *MISSION, branch=2)


def test_gradients_that_do_not_exist_are_refused():
    for state in ((3.5e6, 9000.0, 0.1), (3.5e6, np.nan, 0.1)):
        for function in (lambda *x: apoapsis_radius(*x, MU), lambda *x: total_delta_v(*x, *MISSION)):
            with pytest.raises(ValueError, match="not finite"):
                gradient(function, state)
