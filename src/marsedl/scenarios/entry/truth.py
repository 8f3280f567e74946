"""What flies in the entry: the vehicle with its errors, air that varies, wind, and what navigation makes of it."""

import numpy as np

from marsedl.fly import Above, Below, Error, Markov, Normal, Profiles, Senses, Table, ThroughDrag, Uniform, Wind
from marsedl.fly.own_air import AIR, OwnAir
from marsedl.models import random_field
from marsedl.montecarlo.streams import normals
from marsedl.papers.stochastic_entry import dispersions, environment
from marsedl.scenarios.entry.inputs import Inputs

__all__ = ["RandomAir", "random_air", "senses_of", "start_of", "together_of", "trigger_of", "vehicle_errors"]


class RandomAir(Profiles):
    """Air whose relative variation is a Markov process over altitude with other coefficients at every node."""

    def __init__(self, mean: Table, altitude, markov: random_field.Markov):
        """Take the mean density, the nodes (m, ascending, equally spaced) and the coefficients between them."""
        self.table, self.altitude, self.markov = mean, altitude, markov

    def mean(self) -> Table:
        """Mean density."""
        return self.table

    def own(self) -> OwnAir:
        """Variations at the nodes, made from the highest one down."""
        count = self.altitude.size

        def sample(seed, trials, first_stream=0, only=None):
            z = normals(seed, first_stream + AIR, trials, count, only).T
            values = np.empty(z.shape)
            values[-1] = self.markov.top_deviation * z[0]
            for number, node in enumerate(reversed(range(count - 1)), 1):
                kept = self.markov.retention[node] * values[node + 1]
                values[node] = kept + self.markov.innovation_deviation[node] * z[number]
            return values

        spacing = float(self.altitude[1] - self.altitude[0])
        return OwnAir(float(self.altitude[0]), spacing, count, sample, (("air", AIR, count),))


SPACING = 500.0  # m, of the nodes of the variation


def random_air(given: Inputs) -> RandomAir:
    """Mean density and variation of the truth."""
    air, truth = given.air, given.truth
    tables = environment.atmosphere(air)
    mean = Table(np.column_stack([tables.altitude, np.exp(tables.log_density)]))
    altitude = np.arange(air.lowest_tabulated_altitude, air.highest_tabulated_altitude + SPACING, SPACING)
    if truth.density_process == "gaussian_random_field":
        markov = random_field.markov(
            lambda first, second: random_field.altitude_exponential(
                first,
                second,
                air.variance_at_top,
                air.variance_top_altitude,
                air.variance_growth_length,
                truth.correlation_length,
            ),
            altitude,
        )
        return RandomAir(mean, altitude, markov)
    varies = float(truth.density_process != "none")
    deviation = varies * np.sqrt(environment.variance(air, altitude))
    decay = environment.decay_rate(air, altitude)
    retention = np.exp(-0.5 * (decay[1:] + decay[:-1]) * SPACING)
    fresh = deviation[:-1] * np.sqrt((1.0 - retention) * (1.0 + retention))
    kept = np.divide(retention * deviation[:-1], deviation[1:], out=np.zeros_like(fresh), where=deviation[1:] > 0.0)
    return RandomAir(mean, altitude, random_field.Markov(kept, fresh, float(deviation[-1])))


def vehicle_errors(given: Inputs) -> dict:
    """Arguments of `Entry` for the errors of mass, drag and lift."""
    truth, body = given.truth, dispersions.body_of(given.vehicle)
    drag = truth.vehicle_errors * abs(given.vehicle.drag_dispersion) / body.drag_coefficient
    lift = truth.vehicle_errors * abs(given.vehicle.lift_dispersion) / abs(body.lift_coefficient)
    errors = {}
    if truth.vehicle_errors:
        errors |= {"drag_factor": Uniform(1.0 - drag, 1.0 + drag), "lift_factor": Uniform(1.0 - lift, 1.0 + lift)}
    if truth.mass_deviation:
        ballistic_coefficient = given.vehicle.ballistic_coefficient
        errors["ballistic_coefficient"] = Normal(ballistic_coefficient, truth.mass_deviation * ballistic_coefficient)
    if truth.density_factor != 1.0:
        errors["density_factor"] = truth.density_factor
    if truth.wind_deviation:
        errors["wind"] = Wind(variation=Markov(truth.wind_deviation, truth.wind_length))
    return errors


def together_of(given: Inputs):
    """One trim angle drives the errors of lift and drag."""
    if not given.truth.vehicle_errors:
        return None
    return {
        ("drag_factor", "lift_factor"): float(np.sign(given.vehicle.drag_dispersion * given.vehicle.lift_dispersion))
    }


def start_of(given: Inputs) -> dict:
    """State at the entry interface, with its dispersions."""
    mean = dispersions.entry_mean(given.planet, given.mission)
    deviations = dispersions.entry_deviations(given.planet, given.mission)
    names = ("altitude", "longitude", "latitude", "velocity", "flight_path_angle", "azimuth")
    start = {n: Normal(float(m), float(d)) if d else float(m) for n, m, d in zip(names, mean, deviations, strict=True)}
    return start | {"altitude": float(mean[0] - given.planet.planet_radius)}


def senses_of(given: Inputs) -> Senses | None:
    """What laws know with errors. Range and longitude, which are one, have errors of the same size apart."""
    nav, velocity, radius = given.navigation, given.mission.entry_velocity, given.planet.planet_radius
    if not any((nav.position_deviation, nav.velocity_deviation, nav.drag_scale_deviation, nav.drag_noise)):
        return None
    position, angle, along = nav.position_deviation, nav.velocity_deviation / velocity, nav.downrange_offset
    scale = Normal(1.0, nav.drag_scale_deviation)
    return Senses(
        altitude=Error(bias=Normal(nav.altitude_offset, position)),
        velocity=Error(bias=Normal(0.0, nav.velocity_deviation)),
        flight_path_angle=Error(bias=Normal(0.0, angle)),
        azimuth=Error(bias=Normal(0.0, angle)),
        latitude=Error(bias=Normal(0.0, position / radius)),
        longitude=Error(bias=Normal(along / radius, position / radius)),
        range=Error(bias=Normal(along, position)),
        crossrange=Error(bias=Normal(0.0, position)),
        energy=Error(bias=Normal(0.0, velocity * nav.velocity_deviation)),
        drag=Error(scale=scale, noise=nav.drag_noise),
        lift=Error(scale=scale, noise=nav.drag_noise),
        density=ThroughDrag(given.vehicle.ballistic_coefficient, least_drag=nav.least_drag),
    )


def trigger_of(given: Inputs, nominal) -> dict:
    """The outcome that counts and its trigger; nominal: mapping with `end_time`, `velocity` and `range` of its end."""
    triggers = {
        "velocity": Below("velocity", given.mission.end_velocity),
        "time": Above("time", nominal["end_time"]),
        "range": Above("range", nominal["range"]),
    }
    return {"parachute": triggers[given.truth.trigger]}
