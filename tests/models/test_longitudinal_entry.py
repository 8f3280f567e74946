import numpy as np

from marsedl.models.dynamics.entry import entry_rates
from marsedl.models.dynamics.longitudinal_entry import density_noise_intensity, longitudinal_entry_rates
from three_ways import check_three_ways


def rates_of(*arguments):
    return longitudinal_entry_rates(arguments[:5], *arguments[5:])


def random_arguments(count):
    """Arguments of `longitudinal_entry_rates`, (12, count)."""
    random = np.random.default_rng(4)
    low = [3.4e6, 400, -0.4, -7e5, 1e-5, -1, 1e-5, 5e-5, 1e-4, 1e-3, 1e-4, 4e13]
    high = [3.6e6, 6000, 0.4, 1e4, 2e-2, 1, 2e-2, 2e-4, 4e-4, 5e-3, 2e-3, 5e13]
    return random.uniform(low, high, (count, 12)).T


def test_numba_casadi_and_numpy_agree():
    check_three_ways(rates_of, random_arguments(200))


def test_planar_part_is_equatorial_flight_over_a_planet_at_rest():
    for point in random_arguments(50).T:
        radius, velocity, path, _, density, cosine, *_, drag, lift, mu = point
        azimuth, bank = np.pi / 2, (np.sqrt(1.0 - cosine**2), cosine)
        full = entry_rates((radius, 1.0, 0.0, velocity, path, azimuth), bank, density, (drag, lift), (mu, 0.0), 1.0)
        rates = longitudinal_entry_rates(point[:5], *point[5:])
        # The downrange of Eq. 27d is measured along the flight: angle times radius.
        np.testing.assert_allclose(rates[:4], [full[0], full[3], full[4], radius * full[1]], rtol=1e-13, atol=1e-15)


def test_density_drift_is_that_of_mean_and_variation():
    # rho = rho_bar (1 + v), d rho_bar = rho_bar/H ds, dv = -lambda v ds (Eqs. 5, 6 and 8)
    for point in random_arguments(50).T:
        velocity, path, density, (mean, inverse, decay) = point[1], point[2], point[4], point[6:9]
        variation, sink_rate = density / mean - 1, -velocity * np.sin(path)
        expected = (mean * inverse * (1 + variation) - mean * decay * variation) * sink_rate
        scale = (inverse + decay) * (density + mean) * abs(sink_rate)  # the terms may cancel
        assert abs(longitudinal_entry_rates(point[:5], *point[5:])[4] - expected) < 1e-15 * scale


def test_noise_over_a_descent_is_that_of_the_process_of_altitude():
    # Over a small sink distance the relative variance grows by phi ds, whatever the speed.
    for speed in (10.0, 1000.0):
        np.testing.assert_allclose(density_noise_intensity(2e-3, 5e-5, -speed) * (3.0 / speed), 4e-6 * 5e-5 * 3.0)
