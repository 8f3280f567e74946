"""Acceleration that takes out the miss and the velocity that are left at the end, then a slow descent to the ground.

What a law may ask for by name: time (s), downrange, crossrange (to the right), altitude (m), downrange_velocity,
crossrange_velocity, vertical_velocity (m/s, positive upwards), mass (kg). All are as navigation has them. The law is
asked once a guidance cycle.
"""

from typing import NamedTuple


class Thrust(NamedTuple):
    """What is commanded, in N; the engine has a smallest and a largest one."""

    thrust_downrange: float
    thrust_crossrange: float
    thrust_vertical: float


class Parameters(NamedTuple):
    """What the law asks for as `law`: what `prepare` returns."""

    end_time: float  # s, at which it aims to be at rest
    downrange: float  # m, of the place where that is
    altitude: float
    gravity: float  # m/s^2
    sink_speed: float  # m/s, with which it goes on to the ground
    sink_gain: float  # 1/s
    gain: float = 6.0  # of the miss; 6 is least effort
    damping: float = 2.0  # of the velocity; 2 is least effort
    least_time: float = 1.0  # s, by which the law divides at least


# Least and largest value that `marsedl fly --tune` tries.
TUNED = {"gain": (4.0, 12.0), "damping": (1.0, 6.0)}


def prepare(onboard):
    """What is aimed at, from what is known on board; plain Python, once before all flights."""
    return Parameters(
        end_time=float(onboard.time[-1]),
        downrange=float(onboard.goal[0]),
        altitude=float(onboard.goal[2]),
        gravity=onboard.p.gravity,
        sink_speed=onboard.lander.sink_speed,
        sink_gain=onboard.lander.sink_gain,
    )


def toward(miss, velocity, left, law):
    """Acceleration of an axis: from the distance to the target and the velocity that no acceleration would leave."""
    return law.gain / (left * left) * (miss - velocity * left) + law.damping / left * velocity


def guide(
    time,
    downrange,
    crossrange,
    altitude,
    downrange_velocity,
    crossrange_velocity,
    vertical_velocity,
    mass,
    law: Parameters,
) -> Thrust:
    """Thrust until the next cycle."""
    to_go = law.end_time - time
    left = to_go if to_go > law.least_time else law.least_time
    fallen = vertical_velocity - law.gravity * left  # at the end, without thrust
    drop = 0.5 * law.gravity * left * left
    along = toward(law.downrange - downrange, downrange_velocity, left, law)
    across = toward(-crossrange, crossrange_velocity, left, law)
    up = law.gain / (left * left) * (law.altitude - altitude - vertical_velocity * left + drop)
    up += law.damping / left * fallen
    steers = to_go > 0.0
    sinks = law.gravity - law.sink_gain * (vertical_velocity + law.sink_speed)
    return Thrust(
        mass * (along if steers else -law.sink_gain * downrange_velocity),
        mass * (across if steers else -law.sink_gain * crossrange_velocity),
        mass * (up if steers else sinks),
    )
