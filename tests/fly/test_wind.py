"""Entries through air that is a trial's own: wind, given profiles, dispersed coefficients, density and planet."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from marsedl.fly import MARS, Below, Entry, Exponential, Markov, Normal, Profiles, Table, Wind, dynamics, fly
from marsedl.fly.own_air import AIR, varied
from marsedl.montecarlo.streams import normals

START = {"altitude_km": 125.0, "velocity": 5500.0, "flight_path_angle_deg": -14.0}
SLOW = Below("velocity", 480.0)
GUSTS = Wind(zonal=40.0, variation=Markov(8.0, 4e3))
WINDY = Entry(
    Normal(115.0, 2.0),
    0.24,
    variation=Markov(0.06, 5e3),
    planet=MARS._replace(rotation_rate=Normal(MARS.rotation_rate, 1e-6)),
    wind=GUSTS,
    drag_factor=Normal(1.0, 0.02),
    lift_factor=Normal(1.0, 0.03),
    density_factor=Normal(1.0, 0.2, above=0.0),
)


def flown(vehicle, start=START, law=0.8, end_time=150.0, trials=1, **options):
    """A few flights in Python."""
    options = {"compiled": False, "substeps": 2} | options
    return fly(vehicle, start, law=law, end_time=end_time, trials=trials, **options)


def only(flights):
    """Final numbers of one flight by name."""
    return {name: values[0] for name, values in flights.final.items()}


# ---- the right numbers -----------------------------------------------------------------------------------------------


def test_air_that_rotates_faster_is_a_planet_that_rotates_faster():
    faster, radius = 2e-5, MARS.radius + 125e3
    rows = [[altitude, faster * (MARS.radius + altitude)] for altitude in (-10e3, 150e3)]
    in_wind = only(flown(Entry(115.0, 0.24, wind=Wind(zonal=rows)), law=0.0, substeps=8))
    path = np.radians(-14.0)
    east, up = 5500.0 * np.cos(path) - faster * radius, 5500.0 * np.sin(path)
    start = {"altitude_km": 125.0, "velocity": np.hypot(east, up), "flight_path_angle": np.arctan2(up, east)}
    planet = MARS._replace(rotation_rate=MARS.rotation_rate + faster)
    co_rotating = only(flown(Entry(115.0, 0.24, planet=planet), start, law=0.0, substeps=8))
    np.testing.assert_allclose(in_wind["altitude"], co_rotating["altitude"], rtol=1e-8)
    np.testing.assert_allclose(in_wind["longitude"], co_rotating["longitude"] + faster * 150.0, rtol=1e-8)
    for name in ("drag", "lift", "density"):
        np.testing.assert_allclose(in_wind[name], co_rotating[name], rtol=1e-6)
    path, there = co_rotating["flight_path_angle"], MARS.radius + co_rotating["altitude"]
    east = co_rotating["velocity"] * np.cos(path) + faster * there
    np.testing.assert_allclose(in_wind["velocity"] * np.cos(in_wind["flight_path_angle"]), east, rtol=1e-7)


def test_an_entry_through_wind_agrees_with_another_integrator_in_inertial_coordinates():
    start = START | {"azimuth_deg": 60.0, "latitude_deg": 20.0, "longitude_deg": -40.0}
    rows = np.array([[-5e3, -20.0], [150e3, 135.0]])
    planet = MARS._replace(rotation_rate=9e-5, gravitational_parameter=4.3e13, radius=3390e3)
    wind = Wind(zonal=rows, meridional=lambda altitude: 15.0 + 2e-4 * altitude)
    vehicle = Entry(115.0, 0.24, planet=planet, wind=wind, drag_factor=1.1, lift_factor=0.9, density_factor=1.2)
    final = only(flown(vehicle, start, end_time=200.0, substeps=8))
    air, axis = Exponential(), np.array([0.0, 0.0, planet.rotation_rate])

    def directions(place):
        up = place / np.linalg.norm(place)
        east = np.cross([0.0, 0.0, 1.0], up)
        east /= np.linalg.norm(east)
        return up, east, np.cross(up, east)

    def accelerations(place, velocity):
        up, east, north = directions(place)
        altitude = np.linalg.norm(place) - planet.radius
        moving = np.cross(axis, place) + np.interp(altitude, *rows.T) * east + (15.0 + 2e-4 * altitude) * north
        through = velocity - moving
        speed = np.linalg.norm(through)
        ahead = through / speed
        right = np.cross(ahead, up)
        right /= np.linalg.norm(right)
        pressure = 1.2 * np.exp(air.log_density(altitude)) * speed**2 * 0.5 / 115.0
        lifting = np.cos(0.8) * np.cross(right, ahead) + np.sin(0.8) * right
        return -1.1 * pressure * ahead, 0.9 * 0.24 * pressure * lifting

    def rates(_, state):
        place, velocity = state[:3], state[3:]
        drag, lift = accelerations(place, velocity)
        gravity = -planet.gravitational_parameter * place / np.linalg.norm(place) ** 3
        return np.concatenate([velocity, gravity + drag + lift])

    latitude, longitude, path, azimuth = np.radians([20.0, -40.0, -14.0, 60.0])
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    place = (planet.radius + 125e3) * up
    _, east, north = directions(place)
    level = np.sin(azimuth) * east + np.cos(azimuth) * north
    velocity = 5500.0 * (np.sin(path) * up + np.cos(path) * level) + np.cross(axis, place)
    end = solve_ivp(rates, (0.0, 200.0), [*place, *velocity], method="DOP853", rtol=1e-12, atol=1e-9).y[:, -1]
    place, velocity = end[:3], end[3:]
    radius, relative = np.linalg.norm(place), velocity - np.cross(axis, place)
    np.testing.assert_allclose(final["altitude"], radius - planet.radius, rtol=1e-7)
    np.testing.assert_allclose(final["velocity"], np.linalg.norm(relative), rtol=1e-7)
    np.testing.assert_allclose(np.sin(final["latitude"]), place[2] / radius, rtol=1e-8)
    turned = np.arctan2(place[1], place[0]) - planet.rotation_rate * 200.0
    np.testing.assert_allclose(final["longitude"], turned, rtol=1e-8)
    drag, lift = (np.linalg.norm(one) for one in accelerations(place, velocity))
    np.testing.assert_allclose([final["drag"], final["lift"]], [drag, lift], rtol=1e-6)


def test_no_wind_is_no_wind_and_factors_are_those_of_the_coefficients():
    varies = Markov(0.06, 5e3)
    still, none = (only(flown(Entry(115.0, 0.24, variation=varies, wind=wind), trials=1)) for wind in (Wind(), None))
    np.testing.assert_allclose([still[name] for name in none], list(none.values()), rtol=1e-12, atol=1e-9)
    factors = {"drag_factor": 1.1, "lift_factor": 0.9, "density_factor": 1.2}
    scaled = only(flown(Entry(115.0, 0.24, **factors)))
    declared = only(flown(Entry(115.0 / 1.1, 0.24 * 0.9 / 1.1, air=Exponential(1.2 * 0.0159, 10.5e3))))
    np.testing.assert_allclose([scaled[name] for name in declared], list(declared.values()), rtol=1e-10, atol=1e-6)


def test_winds_vary_by_processes_of_their_own():
    mean = Wind(zonal=[[0.0, 10.0], [50e3, 60.0]], meridional=-5.0)
    deviation = Markov(lambda altitude: 5.0 + 1e-4 * altitude, 8e3, bottom=0.0, top=60e3)
    wind = Wind(mean.zonal, mean.meridional, deviation).own()
    values = wind.sample(3, range(4000)).reshape(2, -1, 4000)
    altitudes = wind.bottom + wind.spacing * np.arange(values.shape[1])
    low, high = (int(np.flatnonzero(altitudes == altitude)[0]) for altitude in (20e3, 26e3))
    np.testing.assert_allclose(values[0, low].mean(), 30.0, atol=4 * 7.0 / np.sqrt(4000))
    np.testing.assert_allclose(values[1, low].mean(), -5.0, atol=4 * 7.0 / np.sqrt(4000))
    for component in values:
        np.testing.assert_allclose(component[low].std(), 7.0, rtol=4 / np.sqrt(2 * 4000))
        correlation, expected = np.corrcoef(component[low], component[high])[0, 1], np.exp(-6.0 / 8.0)
        assert abs(correlation - expected) < 4 * (1 - expected**2) / np.sqrt(4000)
    density = varied(Markov(0.06, 5e3)).sample(3, range(4000))[50]
    for one, other in ((values[0, low], values[1, low]), (values[0, low], density), (values[1, low], density)):
        assert abs(np.corrcoef(one, other)[0, 1]) < 4 / np.sqrt(4000)
    assert (values[:, altitudes > 60e3].std(axis=2) > 10.0).all()  # held beyond
    assert (wind.sample(3, range(7, 9)).reshape(2, -1, 2) == values[:, :, 7:9]).all()


def test_the_density_varies_as_without_wind_to_the_bit():
    model, column = Entry(115.0, variation=Markov(0.06, 5e3)).model(), varied(Markov(0.06, 5e3)).sample(3, [11])[:, 0]
    drawn = dynamics.Drawn(0.0)
    for node, normal in zip(reversed(range(model.nodes)), normals(3, AIR, [11], model.nodes)[0], strict=True):
        value, drawn = dynamics.vary(node, normal, drawn, model.p)
        assert value == column[node]


# ---- given profiles --------------------------------------------------------------------------------------------------


def profiles():
    altitude = np.arange(0.0, 150e3, 500.0)
    return np.column_stack([altitude, *(0.0159 * np.exp(-altitude / height) for height in (10.2e3, 11.0e3, 10.5e3))])


def test_every_trial_flies_through_its_own_profile(tmp_path):
    given = profiles()
    file = tmp_path / "profiles.csv"
    names = "altitude_km,first,second,third"
    np.savetxt(file, given * [1e-3, 1.0, 1.0, 1.0], "%.17g", ",", header=names, comments="")
    trials = flown(Entry(115.0, 0.24, air=Profiles(file)), trials=3, trigger=SLOW, end_time=420.0)
    for trial in range(3):
        alone = only(flown(Entry(115.0, 0.24, air=Table(given[:, [0, trial + 1]])), trigger=SLOW, end_time=420.0))
        own = {name: values[trial] for name, values in trials.final.items()}
        np.testing.assert_allclose([own[name] for name in alone], list(alone.values()), rtol=1e-6, atol=0.1)
    assert np.ptp(trials.final["range"]) > 1e3
    with pytest.raises(ValueError, match=r"there are 3 profiles of air, and trial 3 is asked for: fly fewer trials"):
        trials.extended(4)


# ---- the same bits ---------------------------------------------------------------------------------------------------


def test_flights_through_own_air_have_the_same_bits_in_threads_chunks_and_python(monkeypatch):
    import numba

    options = {"compiled": True, "trials": 40, "seed": 5, "end_time": 60.0, "processes": 1}
    whole = flown(WINDY, **options)
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    assert (flown(WINDY, **options).numbers == whole.numbers).all()
    numba.set_num_threads(threads)
    monkeypatch.setattr("marsedl.fly.campaign.CHUNK_OF_OWN_AIR", 16)
    assert (flown(WINDY, **options | {"trials": 19}).extended(40).numbers == whole.numbers).all()
    for trial in (0, 37):
        assert whole.replay(trial, in_python=True).final == {
            name: values[trial] for name, values in whole.final.items()
        }
    assert [*whole.drawn] == ["ballistic_coefficient", "drag_factor", "lift_factor", "density_factor", "rotation_rate"]
    assert whole.final["zonal_wind"].std() > 2.0
    one = flown(Entry(115.0, 0.24, air=Profiles(profiles())), **options | {"trials": 3})
    assert one.replay(2, in_python=True).final == {name: values[2] for name, values in one.final.items()}


# ---- what is told ----------------------------------------------------------------------------------------------------

MISUSES = [
    (lambda: Entry(115.0, wind=30.0), r"Entry: wind is 30.0; give Wind\(zonal=..., meridional=...\), or None"),
    (lambda: Entry(115.0, wind=Wind("strong")), r"wind: zonal is 'strong': give numbers"),
    (lambda: Entry(115.0, wind=Wind(meridional=[[5e3, 1.0], [0.0, 2.0]])), r"meridional is .*; give m/s as a number"),
    (lambda: Entry(115.0, wind=Wind(lambda altitude: np.log(altitude - 1e6))), r"its mean is not finite"),
    (lambda: Entry(115.0, wind=Wind(variation=5.0)), r"variation is 5.0; give Markov\(deviation in m/s"),
    (lambda: Entry(115.0, wind=Wind([[0.0, 1.0], [1e-3, 2.0]])), r"nodes 0.001 m apart would be"),
    (
        lambda: Entry(115.0, density_factor=Normal(1.0, 2.0)),
        r"density_factor must not be negative, but \d+ of the trials",
    ),
    (lambda: Entry(115.0, drag_factor="high"), r"vehicle 'drag_factor' is 'high'; give a finite number"),
    (lambda: Entry(115.0, variation=Markov(0.1, 5e3), air=Profiles(profiles())), r"leave variation out"),
    (
        lambda: Entry(115.0, air=Profiles(profiles()[:, 0])),
        r"rows of altitude \(m\) and a density .* not shape \(300,\)",
    ),
    (lambda: Entry(115.0, air=Profiles(profiles()[::-1])), r"profile 0: .*sort the rows"),
    (lambda: Entry(115.0, air=Profiles(-profiles())), r"profile 0: "),
]


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize(("vehicle", "told"), MISUSES, ids=[told for _, told in MISUSES])
def test_a_misuse_is_told_in_one_sentence(vehicle, told):
    with pytest.raises(ValueError, match=told) as error:
        flown(vehicle(), trials=20, end_time=1.0)
    assert "\n" not in str(error.value)
