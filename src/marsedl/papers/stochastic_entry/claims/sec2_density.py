"""Sec. II: the density as a stochastic process."""

import numpy as np

from marsedl.models import density_variation
from marsedl.papers.stochastic_entry import environment
from marsedl.papers.stochastic_entry.claims.measures import DEADBAND, LAWS, Dispersions, Flights
from marsedl.papers.stochastic_entry.inputs import Air, Planet
from marsedl.papers.stochastic_entry.records import FLIGHT_PATH_ANGLE, Linearization, Nominal
from marsedl.replication.claims.counterexamples import scaled
from marsedl.replication.claims.thresholds import CLOSE, SIMILAR
from marsedl.replication.claims.verdicts import Evaluation
from marsedl.replication.claims.writing import Fails, claim, holds, listed, measure, measured

DENSITY_SIGMAS = 2.0  # at which Figs. 2 and 4 draw their limits
SINK_RATE = 0.05  # of the exponent 1/2


@claim()
def fig2_limits():
    return measured(DENSITY_SIGMAS)


@claim(by_construction="an identity of the process: Eq. 10 follows from Eq. 8")
def ou_limit_variance(air: Air):
    # Constant coefficients: twenty scale heights below the top nothing is left of the start.
    depth, scale_height = np.linspace(0.0, 20.0, 2001), 1.0
    decay = density_variation.decay_rate(1.0 / scale_height, air.decay_factor)
    marched = density_variation.process_variance(depth, decay, 1.0, 0.0)[0]
    closed_form = density_variation.stationary_variance(1.0, air.decay_factor)
    return measured(float(marched), evidence=f"Eq. 10 in closed form {closed_form:.6f}")


@claim(
    "Eq. 11 assumes a nearly constant profile: variances are {least:+.1f} to {most:+.1f} % off.",
    errata="E10",
    choices="density_variance density_growth_length",
    counterexample=scaled("air.diffusion_factor"),
)
def ou_variance_matches_profile(planet: Planet, air: Air, nominal: Nominal):
    altitude = np.arange(nominal.altitude.min(), planet.atmosphere_altitude, air.density_grid_interval)
    profile_variance, decay = environment.variance(air, altitude), environment.decay_rate(air, altitude)
    noise = environment.diffusion(air, altitude)
    process_variance = density_variation.process_variance(altitude, decay, noise, profile_variance[-1])
    bias = 100 * (process_variance / profile_variance - 1.0)
    return holds(
        measure("difference of the process's variance from the profile's", np.abs(bias), "%") < 100 * CLOSE,
        least=bias.min(),
        most=bias.max(),
    )


@claim("Mars-GRAM samples are not available.", choices="mean_density")
def ou_resembles_marsgram(air: Air):
    altitudes = np.array([40e3, 80e3])
    ours = 100 * np.sqrt(environment.variance(air, altitudes))
    gram = 100 * density_variation.mars_gram_2010_deviation(altitudes)
    return Evaluation(
        evidence=f"deviations at 40 and 80 km: ours {listed(ours, '.1f')} %, Mars-GRAM 2010 {listed(gram, '.1f')} %"
    )


@claim(by_construction="an identity of the linear model: its noise is that of Eq. 24")
def sde_diffusion_sink_rate(planet: Planet, air: Air, linearization: Linearization):
    exponent, difference = _sink_rate_exponent(planet, air, linearization)
    return holds(
        measure("distance of the exponent of the sink rate from one half", abs(exponent - 0.5)) < SINK_RATE,
        measure("largest difference from the process in altitude, of the deviation", 100 * difference, "%")
        < 100 * SINK_RATE,
    )


def _sink_rate_exponent(planet: Planet, air: Air, linearization: Linearization):
    """Exponent of the sink rate in the scaled density noise, and its largest distance from the process of Eq. 8."""
    altitude = linearization.state[:, 0] - planet.planet_radius
    sinking = linearization.state[:, FLIGHT_PATH_ANGLE] < 0.0  # at both ends of a step, so that it has no turning point
    steps = np.flatnonzero((np.diff(altitude) < -1.0) & sinking[1:] & sinking[:-1])  # m; the slope of less is rounding
    noise = linearization.noise[steps, 4, 4] / linearization.state[steps + 1, 4] ** 2
    decay, diffusion = environment.decay_rate(air, altitude), environment.diffusion(air, altitude)
    pairs = [[part[[k + 1, k]] for part in (altitude, decay, diffusion)] for k in steps]
    added = np.array([density_variation.innovation_variance(*pair)[0] for pair in pairs])
    duration = np.diff(linearization.time)[steps]
    middle = (diffusion[steps] + diffusion[steps + 1]) / 2
    sink_rate = -np.diff(altitude)[steps] / duration
    forgotten = (decay[steps] + decay[steps + 1]) * sink_rate * duration
    remains = -np.expm1(-forgotten) / forgotten
    slope = np.polyfit(np.log(sink_rate), 0.5 * np.log(noise / (duration * middle * remains)), 1)[0]
    return float(slope), float(np.abs(np.sqrt(noise / added) - 1.0).max())


@claim(
    "Predicted deviations are off by up to {apollo_off:.0f} (Apollo) and {stochastic_off:.0f} % (stochastic).",
    errata="E19",
    choices=DEADBAND,
    counterexample=scaled("gains.stochastic_covariance"),
)
def lofting_captured(linearization: Linearization, flights: Flights, dispersions: Dispersions):
    trials = flights["apollo_time"].count
    climbing = linearization.state[:, FLIGHT_PATH_ANGLE] > 0.0
    if not climbing.any():
        raise Fails("the nominal never climbs", trials)
    ratios = [dispersions[law].sampled[climbing] / dispersions[law].predicted[climbing] for law in LAWS]
    off = np.array([100 * np.abs(ratio - 1.0).max(axis=0) for ratio in ratios])  # of altitude, velocity, angle, range
    sampling = 100 * np.array([[dispersions[law].relative_error] for law in LAWS]) * [r.max(axis=0) for r in ratios]
    return holds(
        measure("error of the predicted deviations while the nominal climbs", off, "%", error=sampling) < 100 * SIMILAR,
        *flights.lost("stochastic_time"),
        trials=trials,
        **{f"{law}_off": off[k].max() for k, law in enumerate(LAWS)},
    )
