"""Flights with position errors at entry, under every law: histories (Figs. 4 to 11) and sweeps (Figs. 3, 6 and 9)."""

import numpy as np

from marsedl.papers.desensitized import components, entry_problem, environment, flight
from marsedl.papers.desensitized.gains import flown_law
from marsedl.papers.desensitized.inputs import Inputs
from marsedl.papers.desensitized.records import CHANNELS, Gains, Responses
from marsedl.replication.pipeline.catalogue import stage
from marsedl.replication.records.fields import finite


@stage()
def compute(given: Inputs, gains: Gains) -> Responses:
    """Fly every law with the errors of the figures."""
    simulation = given.simulation
    wide, narrow = (
        np.array([np.linspace(-size, size, simulation.sweep_points) for size in sizes])
        for sizes in (simulation.wide_errors, simulation.narrow_errors)
    )
    of_laws = [responses_of_law(given, *flown_law(gains, number), wide, narrow) for number in range(len(gains.law))]
    return Responses(
        law=gains.law,
        time=gains.time,
        drawn_error=simulation.drawn_errors,
        wide=wide,
        narrow=narrow,
        compared_error=simulation.compared_errors,
        **{name: np.array([of_law[name] for of_law in of_laws]) for name in of_laws[0]},
    )


def responses_of_law(given: Inputs, reference, gain, wide, narrow):
    """Everything that is stored of one law, by field."""
    planet, simulation = given.planet, given.simulation
    air, radius = environment.surroundings(planet, given.vehicle), planet.planet_radius
    # The first trial has no error: it is the nominal, to the last bit.
    errors = np.vstack([np.zeros(3), np.diag(simulation.drawn_errors)])
    trials = flight.fly(
        *air,
        reference,
        gain,
        environment.displaced(planet, reference.initial_state, errors),
        substeps=simulation.substeps,
    )
    states = np.moveaxis(trials.history, 2, 0)
    acceleration = trials.observed[:, components.BANK_ACCELERATION].T
    state = states[1:, :, : components.STATES]
    nominal = states[0, :, : components.STATES]

    def swept(grid):
        return np.array(
            [
                environment.final_errors(
                    planet, simulation, air, reference, gain, environment.along_channel(channel, grid[channel])
                )
                for channel in range(len(CHANNELS))
            ]
        )

    return {
        "nominal": nominal,
        "nominal_acceleration": acceleration[0],
        "nominal_cumulative": finite(trials.final_state[components.CUMULATIVE, 0]),
        "state": state,
        "error": entry_problem.position_errors(state, nominal, radius),
        "acceleration": acceleration[1:],
        "cumulative": finite(trials.final_state[components.CUMULATIVE, 1:]),
        "largest_command": finite(trials.observed_maximum[components.COMMAND_MAGNITUDE, 1:]),
        "tabulated_error": swept(np.tile(simulation.compared_errors, (len(CHANNELS), 1))),
        "wide_error": swept(wide),
        "narrow_error": swept(narrow),
    }
