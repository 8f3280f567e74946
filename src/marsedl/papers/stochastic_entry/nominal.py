"""The nominal flight: the mean vehicle in the mean atmosphere under the nominal bank profile (Sec. V, Figs. 5-7)."""

import numpy as np

from marsedl.elementary import sine_cosine
from marsedl.methods.guidance.lateral import bank_direction, deadband
from marsedl.methods.guidance.targeting import require_target_ahead, targeting
from marsedl.montecarlo.outcomes import ESCAPED
from marsedl.papers.density import TableExits
from marsedl.papers.stochastic_entry import dispersions, environment, flight
from marsedl.papers.stochastic_entry.inputs import Guidance, Inputs, Simulation
from marsedl.papers.stochastic_entry.records import (
    ALTITUDE,
    BANK,
    CROSSRANGE,
    DENSITY,
    DOWNRANGE,
    END_TIME,
    FLIGHT_PATH_ANGLE,
    HISTORY,
    VELOCITY,
    Nominal,
)
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import stage


@stage()
def compute(given: Inputs) -> Nominal:
    """Fly until the end velocity, then again to that time, so that every guidance period has equal steps.

    Raises MarsedlError if the target lies behind the entry point or the end velocity is not reached in the time limit.
    """
    mission, guidance, simulation = given.mission, given.guidance, given.simulation
    atmosphere = environment.undisturbed(environment.atmosphere(given.air))
    constants = flight.settings(given, atmosphere)
    drag_factor, lift_factor = dispersions.factors(dispersions.body_of(given.vehicle))
    mean = dispersions.entry_mean(given.planet, mission)
    state = dict(
        zip(("radius", "longitude", "latitude", "velocity", "flight_path_angle", "azimuth"), mean, strict=True)
    )
    entry_range, _ = targeting(
        **state,
        rotation_rate=given.planet.rotation_rate,
        target_longitude=mission.target_longitude,
        target_latitude=sine_cosine(mission.target_latitude),
    )
    try:
        require_target_ahead(entry_range)
    except ValueError as error:
        raise MarsedlError(f"entry_longitude, entry_azimuth, target_longitude: {error}") from None
    mean_vehicle = flight.Vehicles(mean[np.newaxis], np.array([drag_factor]), np.array([lift_factor]))

    def fly(trigger, end_time, every):
        return flight.fly(
            constants,
            atmosphere,
            flight.NOMINAL_LAW,
            mean_vehicle,
            trigger=trigger,
            end_time=end_time,
            substeps=simulation.nominal_substeps,
            seed=0,  # of which still air draws nothing
            every=every,
            place=True,
        )

    first = fly("velocity", mission.time_limit, simulation.nominal_substeps)
    if first.outcome[0] == ESCAPED:
        raise MarsedlError(
            f"the nominal flight still has {first.final_state[VELOCITY, 0]:.0f} m/s after {mission.time_limit:g} "
            "s; it must slow down to end_velocity: raise time_limit, or check density_profile and ballistic_coefficient"
        )
    end_time = float(first.final_state[END_TIME, 0])
    whole = fly("time", end_time, 1)
    history, observed = whole.history[..., 0], whole.observed[..., 0]
    time = fine_times(end_time, guidance, simulation)
    cycles = np.arange(0, len(time) - 1, simulation.nominal_substeps)
    slow = history[cycles, VELOCITY] <= guidance.heading_alignment_velocity
    if not slow.any():
        raise MarsedlError(
            f"the nominal flight has no bank command below {guidance.heading_alignment_velocity:g} m/s: raise "
            "heading_alignment_velocity, or lower end_velocity"
        )
    aligned = cycles[np.argmax(slow)]
    guided = cycles[cycles < aligned]
    width = deadband(
        time[cycles],
        guidance.deadband_times[0],
        guidance.deadband_widths[0],
        guidance.deadband_times[1],
        guidance.deadband_widths[1],
    )
    reversals, margin = _decisions(
        guidance.initial_bank_direction, time[guided], history[guided, CROSSRANGE], width[: len(guided)]
    )
    TableExits(given.air).count(history[:, ALTITUDE]).say("nominal flight")
    longitude, latitude, azimuth = history[:, HISTORY:].T
    return Nominal(
        time=time,
        altitude=history[:, ALTITUDE],
        longitude=longitude,
        latitude=latitude,
        velocity=history[:, VELOCITY],
        flight_path_angle=history[:, FLIGHT_PATH_ANGLE],
        azimuth=azimuth,
        downrange=history[:, DOWNRANGE],
        density=history[:, DENSITY],
        crossrange=history[:, CROSSRANGE],
        bank=observed[:, BANK],
        drag=drag_factor * history[:, DENSITY] * history[:, VELOCITY] ** 2,
        guidance_time=time[cycles],
        deadband=width,
        deadband_margin=margin,
        reversal_time=reversals,
        alignment_time=float(time[aligned]),
        end_time=end_time,
    )


def fine_times(end_time, guidance: Guidance, simulation: Simulation):
    """Times of all integration steps: equal ones in every guidance period, the last period being shorter."""
    starts = flight.schedule(end_time, guidance.guidance_period, "time").times
    steps = np.arange(simulation.nominal_substeps) / simulation.nominal_substeps
    return np.append((starts[:-1, np.newaxis] + np.diff(starts)[:, np.newaxis] * steps).ravel(), end_time)


def _decisions(direction, time, crossrange, width):
    """Times of the bank reversals, and the least distance between crossrange and deadband in all decisions."""
    reversals, margin = [], np.inf
    for now, error, limit in zip(time, crossrange, width, strict=True):
        margin = min(margin, abs(direction * error - limit))
        turned = bank_direction(direction, error, limit)
        if turned != direction:
            reversals.append(now)
        direction = turned
    return np.array(reversals, dtype=float), float(margin)
