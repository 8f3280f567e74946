"""Sec. V: the set-up, Tables 2 and 3, Figs. 6 and 10."""

import numpy as np

from marsedl.montecarlo.statistics import wishart_deviance
from marsedl.papers.stochastic_entry import dispersions
from marsedl.papers.stochastic_entry.claims.measures import DEADBAND, Flights, crossrange_of_azimuth
from marsedl.papers.stochastic_entry.inputs import Guidance, Mission, Planet, Vehicle
from marsedl.papers.stochastic_entry.records import (
    BANK_CHANGE,
    DOWNRANGE,
    FLIGHT_PATH_ANGLE,
    STATES,
    VELOCITY,
    FlightEnsemble,
    Linearization,
    Nominal,
)
from marsedl.replication.claims.thresholds import ROUNDING, SIGMAS
from marsedl.replication.claims.verdicts import Evaluation
from marsedl.replication.claims.writing import Fails, claim, holds, measure, measured

UNLIKELY = 0.0027  # probability beyond three standard errors


@claim()
def tab2_altitude(planet: Planet, mission: Mission):
    deviation = dispersions.entry_deviations(planet, mission)[dispersions.RADIUS]
    above_radius = 100 * planet.atmosphere_altitude / planet.planet_radius
    return measured([planet.atmosphere_altitude / 1e3, SIGMAS * deviation], above_radius=above_radius)


@claim()
def tab2_downrange(mission: Mission):
    return measured([0.0, mission.entry_downrange_three_sigma / 1e3])


@claim(errata="E7")
def tab2_crossrange(planet: Planet, mission: Mission):
    arc, crossrange = crossrange_of_azimuth(planet, mission)
    return measured(
        [round(crossrange / 1e3, 2), mission.entry_crossrange_three_sigma / 1e3],
        evidence=f"{crossrange / 1e3:.4f} km before rounding",
        off_east=np.degrees(mission.entry_azimuth) - 90.0,
        arc=np.degrees(arc),
        length=planet.planet_radius * arc / 1e3,
    )


@claim(by_construction="the trials are drawn from Table 2")
def tab3_state(planet: Planet, linearization: Linearization, apollo_time: FlightEnsemble):
    entry, trials = apollo_time.covariance[0, :STATES, :STATES], apollo_time.count
    if trials <= 3:
        raise Fails("a covariance of three states needs more than three flights", trials)
    vehicle = np.ix_(*2 * [[VELOCITY, FLIGHT_PATH_ANGLE, DOWNRANGE]])
    deviance = wishart_deviance(entry[vehicle], trials, linearization.initial_covariance[vehicle])
    mean = linearization.state[0].copy()
    mean[0] -= planet.planet_radius
    miss = np.abs(apollo_time.mean[0, 1:4] - mean[1:4]) / np.sqrt(np.diag(entry)[1:4] / trials)
    return holds(
        measure("p-value of the entry covariance's deviance from Table 2", deviance.p_value) > UNLIKELY,
        measure("error of the means", miss, "standard errors") < SIGMAS,
        trials=trials,
    )


@claim("Mars-GRAM samples are not available; flights take a surrogate with exact variance.", choices="mean_density")
def tab3_density():
    return Evaluation(evidence="trials fly through an Ornstein-Uhlenbeck surrogate")


@claim("`corrected` takes a tenth of the error of C_L.", errata="E8")
def tab3_aero(vehicle: Vehicle):
    lift, drag = abs(vehicle.lift_dispersion), abs(vehicle.drag_dispersion)
    return measured([lift, drag], of_lift=lift / dispersions.body_of(vehicle).lift_coefficient)


@claim(
    "Density and deadband of `corrected` are chosen so that it ends there.",
    choices=f"mean_density {DEADBAND}",
)
def nominal_uprange(nominal: Nominal):
    return measured(
        float(-nominal.downrange[-1] / 1e3),
        evidence=f"after {nominal.end_time:.2f} s and {len(nominal.reversal_time)} bank reversals, decided at least "
        f"{nominal.deadband_margin:.0f} m from the deadband",
        by_construction="density or deadband are chosen for it",
    )


@claim("With Eq. 71 corrected.", errata="E6")
def bank_rate_respected(guidance: Guidance, nominal: Nominal, flights: Flights):
    changes = [np.nanmax(ensemble.observed_maximum[:, BANK_CHANGE], initial=0.0) for ensemble in flights.values()]
    steps = np.abs(np.diff(nominal.bank)).max()
    allowed = np.degrees(guidance.bank_rate_limit * guidance.guidance_period)
    return holds(
        measure("largest change of bank from one command to the next in all flights", np.degrees(max(changes)), "deg")
        <= allowed * (1.0 + ROUNDING),
        measure("in the nominal flight", np.degrees(steps), "deg") <= allowed * (1.0 + ROUNDING),
        *flights.lost("stochastic_time"),
        trials=sum(ensemble.count for ensemble in flights.values()),
        by_construction="the flights limit the rate" if guidance.rate_limit_form == "corrected" else "",
        # A reversal goes from one bank angle to its opposite.
        reversal_time=[
            2 * bank / guidance.bank_rate_limit for bank in (guidance.nominal_bank_slow, guidance.nominal_bank_fast)
        ],
    )
