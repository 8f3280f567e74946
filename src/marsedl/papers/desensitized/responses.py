"""Flights with position errors at entry, under every law: histories (Figs. 4 to 11) and sweeps (Figs. 3, 6 and 9)."""

from dataclasses import dataclass

import numpy as np

from marsedl.papers.desensitized import environment, flight
from marsedl.papers.desensitized.entry_problem import CHANNELS, STATE_UNIT
from marsedl.papers.desensitized.gains import Gains, flown_law
from marsedl.replication.artifacts import quantity


@dataclass(frozen=True)
class Responses:
    """What position errors at entry come to; channels are radius, crossrange, downrange.

    A flight that comes below the ground or is not finite has NaN from there on.
    """

    law: np.ndarray = quantity("1", ("laws",), "name, as in the gains", "str")
    time: np.ndarray = quantity("s", ("laws", "time"), "nodes")
    nominal: np.ndarray = quantity(STATE_UNIT, ("laws", "time", 8), "states of the unperturbed flight", allow_nan=True)
    nominal_acceleration: np.ndarray = quantity("rad/s^2", ("laws", "time"), "its bank acceleration", allow_nan=True)
    nominal_cumulative: np.ndarray = quantity(
        "rad/s", ("laws",), "its integral of the absolute bank acceleration", allow_nan=True
    )
    drawn_error: np.ndarray = quantity("m", (3,), "error at entry of the histories, by channel")
    state: np.ndarray = quantity(
        STATE_UNIT, ("laws", 3, "time", 8), "states with that error in each channel", allow_nan=True
    )
    error: np.ndarray = quantity(
        "m", ("laws", 3, "time", 3), "radius, crossrange and downrange error in them", allow_nan=True
    )
    acceleration: np.ndarray = quantity("rad/s^2", ("laws", 3, "time"), "bank acceleration flown", allow_nan=True)
    cumulative: np.ndarray = quantity(
        "rad/s", ("laws", 3), "integral of the absolute bank acceleration", allow_nan=True
    )
    largest_command: np.ndarray = quantity(
        "rad/s^2", ("laws", 3), "largest bank acceleration commanded, before its bound", allow_nan=True
    )
    largest_bank_rate: np.ndarray = quantity("rad/s", ("laws", 3), "largest bank rate", allow_nan=True)
    tabulated_error: np.ndarray = quantity(
        "m", ("laws", 3, 2, 3), "final errors for the error of Table 3, either way, in each channel", allow_nan=True
    )
    wide: np.ndarray = quantity("m", (3, "points"), "errors at entry of the wide sweeps, by channel")
    wide_error: np.ndarray = quantity("m", ("laws", 3, "points", 3), "final errors", allow_nan=True)
    narrow: np.ndarray = quantity("m", (3, "points"), "errors at entry of the zoomed sweeps, by channel")
    narrow_error: np.ndarray = quantity("m", ("laws", 3, "points", 3), "final errors", allow_nan=True)


def compute(inputs, gains: Gains) -> Responses:
    """Fly every law with the errors of the figures."""
    wide, narrow = (
        np.array([np.linspace(-size, size, inputs.sweep_points) for size in sizes])
        for sizes in (inputs.wide_errors, inputs.narrow_errors)
    )
    found = [flown(inputs, *flown_law(gains, number), wide, narrow) for number in range(len(gains.law))]
    return Responses(
        law=gains.law,
        time=gains.time,
        drawn_error=inputs.drawn_errors,
        wide=wide,
        narrow=narrow,
        **{name: np.array([law[name] for law in found]) for name in found[0]},
    )


def flown(inputs, reference, gain, wide, narrow):
    """Everything that is stored of one law, by field."""
    air, radius = environment.surroundings(inputs), inputs.planet_radius
    # The first trial has no error: it is the nominal, to the last bit.
    errors = np.vstack([np.zeros(3), np.diag(inputs.drawn_errors)])
    trials = flight.fly(
        *air,
        reference,
        gain,
        environment.displaced(inputs, reference.initial_state, errors),
        substeps=inputs.substeps,
    )
    states = np.moveaxis(trials.history, 2, 0)
    acceleration = trials.observed[:, flight.BANK_ACCELERATION].T
    state = states[1:, :, : flight.STATES]
    nominal = states[0, :, : flight.STATES]
    sizes = inputs.tabulated_error * np.array([1.0, -1.0])

    def swept(grid):
        return np.array(
            [
                environment.final_errors(
                    inputs, air, reference, gain, environment.along_channel(channel, grid[channel])
                )
                for channel in range(len(CHANNELS))
            ]
        )

    return {
        "nominal": nominal,
        "nominal_acceleration": acceleration[0],
        "nominal_cumulative": finite(trials.final_state[flight.CUMULATIVE, 0]),
        "state": state,
        "error": flight.position_errors(state, nominal, radius),
        "acceleration": acceleration[1:],
        "cumulative": finite(trials.final_state[flight.CUMULATIVE, 1:]),
        "largest_command": finite(trials.observed_maximum[flight.COMMAND_MAGNITUDE, 1:]),
        "largest_bank_rate": np.abs(state[:, :, flight.BANK_RATE]).max(axis=1),
        "tabulated_error": swept(np.tile(sizes, (len(CHANNELS), 1))),
        "wide_error": swept(wide),
        "narrow_error": swept(narrow),
    }


def finite(values):
    """The values, NaN where they are infinite."""
    return np.where(np.isfinite(values), values, np.nan)
