"""A numerical predictor-corrector of the FNPEG kind: the range of the rest of the flight decides the bank angle.

Every period it integrates the equations of the longitudinal motion to the velocity trigger, in the mean density times
what drag has shown of it, under a bank cosine that is linear in the square of the velocity (nearly the energy), from
its present value to a given last one. One Newton step, whose derivative is a difference, brings the predicted range
nearer to the target.
"""

from collections import namedtuple
from functools import partial
from typing import NamedTuple

import numpy as np

from marsedl.elementary import clip, exponential, sine_cosine
from marsedl.fly.dynamics import Bank
from marsedl.models.atmosphere import node_below
from marsedl.models.dynamics.planar_entry import planar_entry_rates
from marsedl.papers.stochastic_entry import dispersions, environment, flight
from marsedl.scenarios.entry import guidance
from marsedl.scenarios.entry.guidance import remembered, sensed_of

__all__ = ["Memory", "Predicting", "guide", "predicted_downrange", "predicting"]

STEPS = 400  # of a prediction, at most
PAST = 1.0  # m/s, by which the step that ends at the velocity of the heading alignment goes beyond it
DIFFERENCE = 0.02  # of the bank cosine, for the derivative
LARGEST_CHANGE = 0.1  # of the bank cosine in a period, as one Newton step may go far


class Predicting(NamedTuple):
    """Parameters: what guidance believes in, SI."""

    settings: flight.Settings
    table: flight.Law  # by which `flight.phase` tells the heading alignment; it is not flown
    log_density: np.ndarray  # (nodes,), of kg/m^3, mean, on the settings' nodes
    log_step: np.ndarray  # (nodes,), its rise to the next node
    drag_factor: float  # A C_D / (2 m), m^2/kg
    lift_factor: float
    least_drag: float  # m/s^2, below which nothing is corrected
    last_cosine: float  # of the bank, at the velocity of the heading alignment
    aligned_cosine: float  # mean of the nominal's while it aligns its heading
    aim: float  # downrange at the trigger, m
    filtering: float  # share of what drag shows that is believed in a period
    step: float  # of a prediction, as velocity that is lost in it, m/s


# What is remembered from cycle to cycle: that of `guidance`, the bank cosine of the last correction, and the density
# that was met over the expected one.
Memory = namedtuple(
    "Memory",
    (*guidance.Memory._fields, "level", "thickness"),
    defaults=(*guidance.Memory._field_defaults.values(), 0.0, 1.0),
)


def mean_density(altitude, law):
    """Expected density, kg/m^3, linear between the nodes in its logarithm."""
    position = (altitude - law.settings.bottom) * law.settings.nodes_per_metre
    node, fraction = node_below(position, law.log_density.shape[0])
    return exponential(law.log_density[node] + fraction * law.log_step[node])


def steered(velocity, begins, level, law):
    """Bank cosine of the prediction at a velocity; begins: the square of the velocity at which it is the level."""
    aligning = law.settings.alignment_velocity
    left = (velocity * velocity - aligning * aligning) / (begins - aligning * aligning)
    cosine = law.last_cosine + clip(left, 0.0, 1.0) * (level - law.last_cosine)
    return cosine if velocity > aligning else law.aligned_cosine


def change(altitude, velocity, path_angle, cosine, air, law):
    """Rates of altitude, velocity, flight path angle and downrange; air: see `predicted_downrange`."""
    thickness, turning = air
    radius = law.settings.planet_radius + altitude
    climb, deceleration, turn = planar_entry_rates(
        radius,
        velocity,
        path_angle,
        cosine,
        thickness * mean_density(altitude, law),
        law.drag_factor,
        law.lift_factor,
        law.settings.gravitational_parameter,
    )
    along = velocity * sine_cosine(path_angle)[1] * law.settings.planet_radius / radius
    return climb, deceleration, turn + turning, along


def predicted_downrange(known, level, air, law):
    """Downrange, m, at which the velocity is that of the trigger, under a bank cosine that begins with a level.

    The midpoint rule, with steps in which about as much velocity is lost, of at most 8 s; one ends at the velocity of
    the heading alignment.

    Args:
        known: `flight.Sensed`. level: bank cosine now. air: density over the expected one, and the rate at which the
            planet's rotation lifts the flight path, rad/s. law: `Predicting`.
    """
    altitude, velocity, path_angle = known.radius - law.settings.planet_radius, known.velocity, known.path_angle
    downrange, end, aligning = known.downrange, law.settings.end_velocity, law.settings.alignment_velocity
    begins = velocity * velocity
    for _ in range(STEPS):
        a, v, p, _ = change(altitude, velocity, path_angle, steered(velocity, begins, level, law), air, law)
        step = clip(law.step / (abs(v) + 1.0), 0.0, 8.0)
        behind = velocity + step * v
        step = (aligning - PAST - velocity) / v if velocity > aligning > behind else step
        half = 0.5 * step
        middle = velocity + half * v
        cosine = steered(middle, begins, level, law)
        a, v, p, r = change(altitude + half * a, middle, path_angle + half * p, cosine, air, law)
        share = min(1.0, (end - velocity) / (step * v)) if v < 0.0 else 1.0
        altitude, velocity, path_angle = altitude + step * a, velocity + step * v, path_angle + step * p
        downrange += share * step * r
        if share < 1.0 or altitude < 0.0:
            break
    return downrange


def guide(time, cycle, nav, memory, law: Predicting) -> tuple[Bank, Memory]:
    """Bank angle by prediction, with the lateral logic and the heading alignment of the others."""
    settings, level, thickness = law.settings, memory.level, memory.thickness
    before, known = remembered(cycle, memory, settings), sensed_of(nav, settings)
    if flight.phase(known, before, law.table, settings) == flight.HEADING:
        _, after = flight.align_heading(cycle, 0.0, known, before, settings)
    else:
        if known.drag < law.least_drag:
            level = known.nominal_cosine
        else:
            expected = mean_density(nav.altitude, law)
            met = known.drag / (law.drag_factor * expected * known.velocity * known.velocity)
            thickness = thickness + law.filtering * (met - thickness)
            turning = 2.0 * settings.rotation_rate * sine_cosine(nav.latitude)[1] * sine_cosine(nav.azimuth)[0]
            reached = predicted_downrange(known, level, (thickness, turning), law)
            slope = (predicted_downrange(known, level + DIFFERENCE, (thickness, turning), law) - reached) / DIFFERENCE
            moved = (law.aim - reached) / slope if slope > 0.0 else 0.0
            level = clip(level + clip(moved, -LARGEST_CHANGE, LARGEST_CHANGE), -1.0, 1.0)
        _, after = flight.control_range(time, cycle, known, flight.Advice(level), before, settings)
    return Bank(after.bank), Memory(
        after.direction,
        after.command,
        after.cosine,
        after.bank,
        after.change,
        after.aligning,
        after.elapsed,
        after.reversals,
        level,
        thickness,
    )


def predicting(onboard, filtering=0.2, last_cosine=0.7, step=40.0):
    """The law for what is known on board.

    It aims at the end of the nominal flight. Predictions know no limits of the bank and no reversals.

    Args:
        onboard: `Onboard`. filtering: share of the density's ratio that is believed in a period. last_cosine: of the
            bank at the velocity of the heading alignment. step: velocity that is lost in a step of the prediction, m/s.
    """
    given, nominal = onboard.given, onboard.nominal
    log_density = environment.atmosphere(given.air).log_density
    drag_factor, lift_factor = dispersions.factors(dispersions.body_of(given.vehicle))
    aligned = nominal.time >= nominal.alignment_time
    law = Predicting(
        onboard.settings,
        flight.NOMINAL_LAW,
        log_density,
        np.append(np.diff(log_density), 0.0),
        drag_factor,
        lift_factor,
        given.guidance.apollo_least_drag,
        last_cosine,
        float(np.cos(nominal.bank[aligned]).mean()),
        float(nominal.downrange[-1]),
        filtering,
        step,
    )
    return partial(guide, law=law)
