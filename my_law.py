"""Bank angle over velocity, corrected by the range.

What a law may ask for by name: time (s), altitude (m), velocity (m/s), flight_path_angle (rad, positive while
climbing), azimuth (rad, clockwise from north), latitude, longitude (rad), range (m, flown from the nominal start),
crossrange (m, to the right of the great circle of that start), density (kg/m^3), drag, lift (m/s^2), energy
(m^2/s^2). All are as navigation has them. The law is asked once a second.
"""

from typing import NamedTuple

import numpy as np

from marsedl.elementary import arc_cosine, clip

STEP = 50.0  # m/s, from one row of the tables to the next; the first row is at rest


class Bank(NamedTuple):
    """What is commanded."""

    bank: float  # rad; zero is lift up, a positive one turns to the right


class Parameters(NamedTuple):
    """What the law asks for as `law`: what `prepare` returns."""

    cosine: np.ndarray  # of the bank angle, over velocity
    range: np.ndarray  # m, of the nominal flight, over velocity
    end: float  # m, range of the target
    crossrange: float  # m, of the target
    azimuth: float  # rad, of the nominal flight at the target
    gain: float = 2e-5  # 1/m, by which the bank's cosine grows for each metre that is short: more lift up
    narrow: float = 500.0  # m, predicted crossrange at which the bank is reversed: at 500 m/s,
    wide: float = 4e3  # m, and at 4 km/s


class Memory(NamedTuple):
    """What is remembered from one second to the next, and its value at the start."""

    side: float = -1.0  # to which the bank goes: 1 right, -1 left


# Least and largest value that `marsedl fly --tune` tries.
TUNED = {"gain": (2e-6, 2e-4)}


def prepare(onboard):
    """Tables over velocity from the nominal flight; plain Python, once before all flights."""
    nominal, guidance, end = onboard.nominal, onboard.given.guidance, onboard.end
    velocity = STEP * np.arange(130)
    slow, fast = np.cos([guidance.nominal_bank_slow, guidance.nominal_bank_fast])
    slows = slice(None, np.argmax(nominal.velocity), -1)  # from the end back to where it begins to slow down

    def over(values):
        return np.interp(velocity, nominal.velocity[slows], values[slows])

    return Parameters(
        cosine=np.interp(velocity, guidance.ramp_velocities[::-1], (slow, fast)),
        range=over(end["range"] + nominal.downrange - nominal.downrange[-1]),
        end=end["range"],
        crossrange=end["crossrange"],
        azimuth=end["azimuth"],
    )


def at(table, velocity):
    """Value of a table at a velocity, linear between rows."""
    place = clip(velocity / STEP, 0.0, len(table) - 1.001)
    row = int(place)
    return table[row] + (place - row) * (table[row + 1] - table[row])


def guide(velocity, range, crossrange, azimuth, drag, memory, law: Parameters) -> tuple[Bank, Memory]:
    """Bank angle of the next second."""
    felt = 1.0 if drag > 1.0 else 0.0  # above, there is no air to steer in
    cosine = at(law.cosine, velocity)
    cosine += felt * law.gain * (at(law.range, velocity) - range)
    width = law.narrow + (law.wide - law.narrow) * clip((velocity - 500.0) / 3500.0, 0.0, 1.0)
    right = crossrange - law.crossrange + (azimuth - law.azimuth) * (law.end - range)  # where it goes without bank
    side = -1.0 if right > width else 1.0 if right < -width else memory.side
    return Bank(side * arc_cosine(clip(cosine, -1.0, 1.0))), Memory(side)
