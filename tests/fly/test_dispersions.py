"""What is dispersed: within bounds, with correlations of start and vehicle, by samples of one's own."""

import numpy as np
import pandas as pd
import pytest
from scipy.special import ndtr
from scipy.stats import norm, qmc, truncnorm

from marsedl.fly import Below, Entry, MultivariateNormal, Normal, Samples, Uniform, fly
from marsedl.fly.campaign import Campaign

START = {"altitude_km": 125.0, "velocity": 5500.0, "flight_path_angle_deg": -14.0}
ERRORS = START | {"velocity": Normal(5500.0, 10.0), "flight_path_angle_deg": Uniform(-14.2, -13.8)}
CAPSULE = Entry(Normal(115.0, 2.0), Normal(0.24, 0.01))
PLAIN = Entry(115.0, Normal(0.24, 0.01))
FIRST, SECOND, BOTH = "velocity", "ballistic_coefficient", ("velocity", "ballistic_coefficient")


def drawn(trials, start=ERRORS, vehicle=CAPSULE, together=None, seed=3):
    """Start and vehicle by name, without a flight."""
    campaign = Campaign(vehicle, start, None, Below("velocity", 480.0), 420.0, 1.0, 4, None, seed, together=together)
    names = (*campaign.start.names, *campaign.vehicle.names)
    return dict(zip(names, np.concatenate(campaign.drawn(range(trials))), strict=True))


# ---- bounds ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("above", "below"), [(0.0, np.inf), (-np.inf, 90.0), (100.0, 130.0), (115.0 + 4 * 80.0, np.inf), (-300.0, 500.0)]
)
def test_what_lies_within_bounds_has_the_quantiles_of_a_truncated_normal(above, below):
    cut, z = Normal(115.0, 80.0, above=above, below=below), np.linspace(-8.5, 8.5, 1001)
    low, high = (above - 115.0) / 80.0, (below - 115.0) / 80.0
    exact, mirrored = truncnorm(low, high, 115.0, 80.0), truncnorm(-high, -low, -115.0, 80.0)
    expected = np.where(z < 0.0, exact.ppf(ndtr(z)), -mirrored.ppf(ndtr(-z)))
    np.testing.assert_allclose(cut.of_normals(z), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose([cut.mean, cut.deviation], [exact.mean(), exact.std()], rtol=1e-9)
    assert cut.of_normals(z).min() >= above and cut.of_normals(z).max() <= below


def test_bounds_keep_all_other_numbers_and_those_far_away_change_nothing():
    whole, cut = (
        drawn(4000, vehicle=Entry(coefficient, 0.24))
        for coefficient in (Normal(115.0, 2.0), Normal(115.0, 80.0, above=0.0))
    )
    assert (whole["velocity"] == cut["velocity"]).all()
    z = (whole[SECOND] - 115.0) / 2.0
    np.testing.assert_array_equal(np.argsort(cut[SECOND]), np.argsort(z))  # pairs stay pairs
    assert cut[SECOND].min() > 0.0
    error = cut[SECOND].std() / np.sqrt(4000)
    assert abs(cut[SECOND].mean() - Normal(115.0, 80.0, above=0.0).mean) < 4 * error
    far = Normal(115.0, 2.0, above=-1e4, below=1e4).of_normals(z)
    np.testing.assert_allclose(far, whole[SECOND], rtol=1e-12)


# ---- correlations ----------------------------------------------------------------------------------------------------


def test_start_and_vehicle_have_the_covariance_that_is_declared():
    matrix = np.array([[1.0, 0.6, -0.3], [0.6, 1.0, 0.2], [-0.3, 0.2, 1.0]])
    names = ("velocity", "ballistic_coefficient", "lift_to_drag")
    numbers = drawn(20_000, together={names: matrix})
    scaled = [
        (numbers[name] - middle) / width
        for name, middle, width in zip(names, (5500.0, 115.0, 0.24), (10.0, 2.0, 0.01), strict=True)
    ]
    error = np.sqrt((1.0 + matrix**2) / 20_000)  # of a covariance of normals
    assert (np.abs(np.cov(scaled) - matrix) < 4 * error).all()
    alone = drawn(20_000)
    for name in ("altitude", "flight_path_angle"):
        np.testing.assert_array_equal(numbers[name], alone[name])
    few = drawn(7, together={names: matrix})
    assert all((few[name] == numbers[name][:7]).all() for name in names)


def test_correlated_numbers_keep_distributions_of_their_own():
    names = ("start_flight_path_angle_deg", "ballistic_coefficient")
    cut = Normal(115.0, 80.0, above=0.0)
    numbers = drawn(20_000, vehicle=Entry(cut, 0.24), together={names: -0.8})
    angle, coefficient = np.degrees(numbers["flight_path_angle"]), numbers[SECOND]
    assert angle.min() >= -14.2 and angle.max() <= -13.8 and coefficient.min() > 0.0
    np.testing.assert_allclose(angle.std(), 0.4 / np.sqrt(12), rtol=0.02)
    np.testing.assert_allclose([coefficient.mean(), coefficient.std()], [cut.mean, cut.deviation], rtol=0.03)
    ranks = np.corrcoef(np.argsort(np.argsort(angle)), np.argsort(np.argsort(coefficient)))[0, 1]
    assert abs(ranks - 6.0 / np.pi * np.arcsin(-0.4)) < 4 / np.sqrt(20_000)  # of a Gaussian copula


def test_full_correlations_are_correlations():
    numbers = drawn(100, together={BOTH: 1.0})
    np.testing.assert_allclose((numbers[FIRST] - 5500.0) / 10.0, (numbers[SECOND] - 115.0) / 2.0, atol=1e-9)


# ---- samples ---------------------------------------------------------------------------------------------------------


def test_trials_take_their_rows(tmp_path):
    cube = qmc.LatinHypercube(3, rng=1).random(50)
    columns = dict(
        zip(
            ("velocity", "flight_path_angle_deg", SECOND),
            norm([5500.0, -14.0, 115.0], [10.0, 0.1, 2.0]).ppf(cube).T,
            strict=True,
        )
    )
    file = tmp_path / "cases.csv"
    pd.DataFrame(columns).to_csv(file, index=False)
    for source in (columns, pd.DataFrame(columns, index=range(100, 150)), file, str(file)):
        numbers = drawn(50, START | {"altitude_km": Normal(125.0, 1.0)}, PLAIN, Samples(source))
        np.testing.assert_allclose(numbers["velocity"], columns["velocity"], rtol=1e-15)
        np.testing.assert_allclose(
            np.degrees(numbers["flight_path_angle"]), columns["flight_path_angle_deg"], rtol=1e-14
        )
        np.testing.assert_allclose(numbers[SECOND], columns[SECOND], rtol=1e-15)
        others = drawn(50, ERRORS | {"altitude_km": Normal(125.0, 1.0)})
        for name in ("altitude", "lift_to_drag"):
            np.testing.assert_array_equal(numbers[name], others[name])


def test_flights_of_samples_are_told_what_they_drew_and_end_with_the_rows():
    samples = Samples({"start_velocity": [5490.0, 5500.0, 5510.0], SECOND: [110.0, 115.0, 120.0]})
    options = {"law": 1.0, "end_time": 5.0, "compiled": False, "together": samples}
    flown = fly(PLAIN, START, trials=2, **options)
    assert flown.drawn["start_velocity"].tolist() == [5490.0, 5500.0]
    assert flown.extended(3).drawn[SECOND].tolist() == [110.0, 115.0, 120.0]
    assert flown.replay(1).drawn[SECOND] == 115.0
    assert np.diff(flown.final["velocity"]) > 5.0
    with pytest.raises(ValueError, match=r"have 3 rows, for the trials 0 to 2, and trial 3 is asked for: fly fewer"):
        flown.extended(4)


# ---- what is told ----------------------------------------------------------------------------------------------------

PAIRED = {("velocity", "altitude_km"): MultivariateNormal([5500.0, 125.0], [[100.0, 4.0], [4.0, 0.25]])}
MISUSES = [
    (
        Entry(Normal(115.0, 2.0, above=200.0)),
        ERRORS,
        None,
        r"'ballistic_coefficient' is Normal\(mean=115.0, deviation=2.0, above=200.0\), of which nearly nothing",
    ),
    (
        Entry(Normal(115.0, 2.0, above=120.0, below=110.0)),
        ERRORS,
        None,
        r"below=110.0\), of which nearly nothing lies within",
    ),
    (Entry(Normal(115.0, 0.0, above=100.0)), ERRORS, None, r"a positive deviation"),
    (Entry(Normal(115.0, 2.0, above="a")), ERRORS, None, r"'ballistic_coefficient' is 'a'; give a finite number"),
    (
        CAPSULE,
        ERRORS,
        {BOTH: 2.0},
        r"\('velocity', 'ballistic_coefficient'\) is 2; a correlation lies between -1 and 1",
    ),
    (CAPSULE, ERRORS, {BOTH: np.eye(3)}, r"give a matrix of 2 x 2 correlations or a number"),
    (CAPSULE, ERRORS, {BOTH: "high"}, r"is 'high': give numbers"),
    (CAPSULE, ERRORS, {BOTH: [[100.0, 4.0], [4.0, 4.0]]}, r"the diagonal holds \[100. +4.\]; give correlations"),
    (CAPSULE, ERRORS, {BOTH: [[1.0, 0.2], [0.3, 1.0]]}, r"the correlations are not symmetric"),
    (
        CAPSULE,
        ERRORS,
        {(*BOTH, "lift_to_drag"): [[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]]},
        r"eigenvalues of at least",
    ),
    (CAPSULE, ERRORS, {("velocity", "altitude"): 0.5}, r"'altitude' is no single dispersion; give Normal or Uniform"),
    (CAPSULE, PAIRED | {"flight_path_angle": -0.2}, {BOTH: 0.5}, r"'velocity' is no single dispersion"),
    (CAPSULE, ERRORS, {("velocity", "start_velocity"): 0.5}, r"'velocity' is given twice"),
    (CAPSULE, ERRORS, {("velocty", "lift_to_drag"): 0.5}, r"together 'velocty' is unknown; did you mean 'velocity'"),
    (CAPSULE, ERRORS, {"velocity": 0.5}, r"together 'velocity': give a tuple of two names or more"),
    (CAPSULE, ERRORS, 0.5, r"together is 0.5; give correlations, \{\('velocity', 'lift_to_drag'\): 0.5\}, or Samples"),
    (
        CAPSULE,
        ERRORS,
        lambda: Samples({"velocity": [5500.0]}),
        r"samples: 'velocity' is Normal\(.*\) besides; leave out",
    ),
    (
        PLAIN,
        START,
        lambda: Samples({SECOND: [115.0, -5.0]}),
        r"samples 'ballistic_coefficient': row 1 is -5; it must be positive",
    ),
    (CAPSULE, START, lambda: Samples({"velocity": [5e3], "start_velocity": [5e3]}), r"'velocity': two columns hold it"),
    (
        CAPSULE,
        START,
        lambda: Samples({"velocity": [5500.0, np.nan]}),
        r"samples 'velocity': row 1 is nan: give a finite",
    ),
    (
        CAPSULE,
        START,
        lambda: Samples({"velocity": ["fast"]}),
        r"samples 'velocity': row 0 is fast: give a finite number",
    ),
    (
        CAPSULE,
        START,
        lambda: Samples({"velocity": [1.0, 2.0], SECOND: [1.0]}),
        r"samples: All arrays must be of the same",
    ),
    (CAPSULE, START, lambda: Samples({}), r"samples: there are no rows"),
    (CAPSULE, START, lambda: Samples({"flight_path_angle": [-14.0]}), r"more than a turn; for degrees write"),
    (CAPSULE, START, lambda: Samples({"mass": [900.0]}), r"together 'mass' is unknown"),
]


@pytest.mark.parametrize(("vehicle", "start", "together", "told"), MISUSES, ids=[told for *_, told in MISUSES])
def test_a_misuse_is_told_in_one_sentence(vehicle, start, together, told):
    with pytest.raises(ValueError, match=told) as error:
        drawn(2, start, vehicle, together() if callable(together) else together)
    assert "\n" not in str(error.value)
