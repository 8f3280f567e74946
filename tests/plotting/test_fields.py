"""Fields of records as curves: components, units, names, coordinates."""

import numpy as np
import pytest

from marsedl.plotting.fields import Field, field, printed_unit, sigma_bounds, standard_deviation
from marsedl.replication.records.fields import Axis, quantity, record
from marsedl.replication.units import converted

MOTION = Axis("motion", altitude="m", velocity="m/s", flight_path_angle="rad")
CONTROL = Axis("control", downrange="N", vertical="N")


@record
class Ensemble:
    """Flights under two laws."""

    time: np.ndarray = quantity("s", ("time",), "time", label="time from entry")
    segment: np.ndarray = quantity("1", ("time",), "number of the segment", "int64")
    mass: np.ndarray = quantity("kg", ("laws", "time"), "mass of the vehicle", label="mass")
    mean: np.ndarray = quantity(MOTION.unit, ("laws", "time", MOTION), "mean state")
    covariance: np.ndarray = quantity("SI", ("laws", "time", MOTION, MOTION), "covariance")
    gain: np.ndarray = quantity("N/m, N s/m, N", ("time", CONTROL, MOTION), "feedback gain")
    kept_history: np.ndarray = quantity(MOTION.unit, ("laws", "kept", "time", MOTION), "trials")
    delta_v: np.ndarray = quantity("m/s", ("laws", "trials"), "delta-v of every trial", label=r"$\Delta v$")


@pytest.fixture(scope="module")
def flights():
    random = np.random.default_rng(2)
    root = random.normal(size=(2, 4, 3, 3))
    return Ensemble(
        time=np.array([0.0, 1.0, 1.0, 3.0]),
        segment=np.array([0, 0, 1, 1]),
        mass=random.normal(size=(2, 4)),
        mean=random.normal(size=(2, 4, 3)),
        covariance=root @ np.swapaxes(root, -1, -2),
        gain=random.normal(size=(4, 2, 3)),
        kept_history=random.normal(size=(2, 5, 4, 3)),
        delta_v=random.normal(size=(2, 6)),
    )


def test_a_component_has_its_name_unit_values_and_coordinates(flights):
    angle = field(flights, "mean.flight_path_angle", unit="deg", at={"laws": 1})
    assert angle.label == "flight path angle (deg)"
    np.testing.assert_allclose(angle.values, np.degrees(flights.mean[1, :, 2]), rtol=1e-15)
    assert angle.x.label == "time from entry (s)"
    np.testing.assert_array_equal(angle.x.values, flights.time)


def test_it_is_drawn_against_another_field_where_asked(flights):
    altitude = field(flights, "mean.altitude", at={"laws": 1}, x="mean.velocity")
    np.testing.assert_array_equal(altitude.x.values, flights.mean[1, :, 1])
    against_time = field(flights, "mean.altitude", at={"laws": 1}, x=field(flights, "time"))
    np.testing.assert_array_equal(against_time.x.values, flights.time)


@pytest.mark.parametrize(
    ("path", "unit", "index"),
    [
        ("covariance.altitude", "m^2", (0, 0)),
        ("covariance.velocity.velocity", "(m/s)^2", (1, 1)),
        ("covariance.altitude.velocity", "m (m/s)", (0, 1)),
        ("gain.vertical.velocity", "N s/m", (1, 1)),
        ("gain.downrange.flight_path_angle", "N", (0, 2)),
    ],
)
def test_entries_of_matrices_have_the_units_of_their_components(flights, path, unit, index):
    at = {"laws": 1} if path.startswith("cov") else None
    entry = field(flights, path, at=at)
    assert entry.unit == unit
    whole = flights.covariance[1] if at else flights.gain
    np.testing.assert_array_equal(entry.values, whole[:, *index])


def test_a_deviation_is_the_root_of_a_variance(flights):
    for component, unit, scale in (("altitude", "km", 1e-3), ("velocity", "", 1.0)):
        place = MOTION.index(component)
        root = standard_deviation(flights, f"covariance.{component}", unit=unit, at={"laws": 0})
        np.testing.assert_allclose(root.values, scale * np.sqrt(flights.covariance[0, :, place, place]))
        assert root.unit == (unit or MOTION.units[component])
        lower, upper = sigma_bounds(flights, component, 3.0, unit=unit, at={"laws": 0})
        np.testing.assert_allclose((upper.values + lower.values) / 2, scale * flights.mean[0, :, place])
        np.testing.assert_allclose(upper.values - lower.values, 6.0 * root.values)
        assert lower.name == component


def test_a_difference_is_taken_at_the_places_of_the_first(flights):
    mass = field(flights, "mass", at={"laws": 0})
    other = Field(np.zeros(4), "mass", "kg", Field(np.array([0.5, 1.0, 2.0, 3.0]), "time", "s"))
    m = mass.values
    np.testing.assert_allclose(mass.at(other).values, [(m[0] + m[1]) / 2, m[2], (m[2] + m[3]) / 2, m[3]])
    difference = other.minus(mass, "difference")
    np.testing.assert_allclose(difference.values, -mass.at(other).values)
    assert difference.label == "difference (kg)"
    np.testing.assert_array_equal(mass.minus(mass).values, 0.0)


def test_what_cannot_be_taken_is_refused_by_name(flights):
    mass, speed = field(flights, "mass", at={"laws": 0}), field(flights, "mean.velocity", at={"laws": 0})
    for refused, message in (
        (lambda: field(flights, "maas"), "no field 'maas'; did you mean 'mass'"),
        (lambda: field(flights, "mean.altitud"), "no component 'altitud'; did you mean 'altitude'"),
        (lambda: field(flights, "mean", at={"laws": 0}), "units of their own: choose one"),
        (lambda: field(flights, "mass.altitude"), "chooses 1 components"),
        (lambda: field(flights, "mass", at={"law": 0}), "no dimension 'law'; did you mean 'laws'"),
        (lambda: field(flights, "mass", unit="km"), "'mass' is in kg, which is not converted to km"),
        (lambda: field(flights, "mean.altitude", x="tim"), "no field 'tim'"),
        (lambda: mass.minus(speed), "'mass' is in kg, 'velocity' in m/s"),
        (lambda: mass.at(field(flights, "delta_v", at={"laws": 0})), "lies along no coordinates"),
    ):
        with pytest.raises(ValueError, match=message):
            refused()


def test_units_are_printed_as_formulas():
    assert printed_unit("kg/m^3") == "kg/m$^{3}$"
    assert printed_unit("N sqrt(s)") == "N s$^{1/2}$"
    assert printed_unit("s^-1") == "s$^{-1}$"
    assert Field(np.zeros(1), "share", "1").label == "share"
    assert converted(2.0, "rad", "deg") == pytest.approx(114.59156)
