"""Guidance on board: the range control of a table of gains, deadband and heading alignment, from what is navigated.

The functions are those that fly in the stochastic entry guidance, so that a table gives the same commands here and
there.
"""

from collections import namedtuple
from typing import NamedTuple

from marsedl.elementary import sine_cosine
from marsedl.fly.dynamics import Bank
from marsedl.methods.guidance.bank_profile import ramped_bank_cosine
from marsedl.methods.guidance.targeting import targeting
from marsedl.papers.stochastic_entry import flight

__all__ = ["Guided", "Memory", "guide", "remembered", "sensed_of"]


class Guided(NamedTuple):
    """Parameters: constants of the guidance, and the table of gains."""

    settings: flight.Settings
    table: flight.Law


# What is remembered from cycle to cycle; see `flight.Memory`.
Memory = namedtuple("Memory", flight.Memory._fields, defaults=(0.0, *flight.Memory._field_defaults.values()))


def sensed_of(nav, settings) -> flight.Sensed:
    """What laws feed back (Eqs. 31, 40), and where the target is (Appendix D), as it is navigated."""
    radius = nav.altitude + settings.planet_radius
    downrange_angle, crossrange_angle = targeting(
        nav.longitude,
        nav.latitude,
        radius,
        nav.velocity,
        nav.flight_path_angle,
        nav.azimuth,
        settings.rotation_rate,
        settings.target_longitude,
        (settings.sin_target_latitude, settings.cos_target_latitude),
    )
    nominal_cosine = ramped_bank_cosine(
        nav.velocity, settings.fast_velocity, settings.slow_velocity, settings.fast_cosine, settings.slow_cosine
    )
    return flight.Sensed(
        radius,
        nav.velocity,
        nav.flight_path_angle,
        -settings.planet_radius * downrange_angle,
        nav.density,
        nav.drag,
        nav.velocity * sine_cosine(nav.flight_path_angle)[0],
        settings.planet_radius * crossrange_angle,
        downrange_angle,
        crossrange_angle,
        nominal_cosine,
    )


def remembered(cycle, memory, settings) -> flight.Memory:
    """What a law remembers as the functions of the paper take it; the first direction is that of the settings."""
    return flight.Memory(
        memory.direction if cycle > 0 else settings.initial_direction,
        memory.command,
        memory.cosine,
        memory.bank,
        memory.change,
        memory.aligning,
        memory.elapsed,
        memory.reversals,
    )


def guide(time, cycle, nav, memory, law: Guided) -> tuple[Bank, Memory]:
    """Bank angle of a table of gains, of its lateral logic and of the heading alignment."""
    settings, table = law.settings, law.table
    before, sensed = remembered(cycle, memory, settings), sensed_of(nav, settings)
    steers = flight.phase(sensed, before, table, settings)
    if steers == flight.HEADING:
        _, after = flight.align_heading(cycle, 0.0, sensed, before, settings)
    elif steers == flight.RANGE_BY_TIME:
        _, after = flight.control_range_by_time(time, cycle, sensed, before, table, settings)
    else:
        advice = flight.consult(sensed, table, settings)
        _, after = flight.control_range(time, cycle, sensed, advice, before, settings)
    return Bank(after.bank), Memory(*after)
