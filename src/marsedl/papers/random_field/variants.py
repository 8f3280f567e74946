"""What the studies have in common: a design with some inputs changed, and its flights."""

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers.random_field import gains, montecarlo
from marsedl.papers.random_field.flight_statistics import delta_v_percentile
from marsedl.papers.random_field.inputs import Guidance
from marsedl.papers.random_field.linearization import motion_of, of_guess
from marsedl.papers.random_field.montecarlo import Flights
from marsedl.papers.random_field.records import FlightEnsemble, Gains, Nominal
from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.catalogue import Flown


def design(flights: Flights, guidance: Guidance, nominal: Nominal) -> Gains:
    """The design of changed inputs; raises MarsedlError if their partition gives none."""
    planet, air, vehicle = flights.planet, flights.air, flights.vehicle
    mission, simulation = flights.mission, flights.simulation
    motion = motion_of(planet, air, vehicle, mission, simulation)
    linear = of_guess(mission, guidance, motion, nominal)
    if linear.refused:
        raise MarsedlError(f"there is no design to study: {linear.refused}")
    return gains.along_motion(planet, air, vehicle, mission, guidance, simulation, motion, nominal, linear)


def ensemble(flights: Flights, nominal: Nominal, laws: Gains, trials: int) -> FlightEnsemble:
    """The first trials under all laws of a design, as the Monte Carlo stage flies them."""
    chunk = montecarlo.simulate(*flights, nominal, laws, flown=Flown("aerocapture", trials, ensembles.BLOCK_SIZE))
    return montecarlo.gather(flights.planet, flights.mission, [chunk])


def percentiles(ensemble: FlightEnsemble):
    """99th percentiles of delta-v of all laws with standard errors, m/s, two arrays (laws,)."""
    laws = [delta_v_percentile(ensemble, law) for law in range(len(ensemble.delta_v))]
    return tuple(np.array(values) for values in zip(*laws, strict=True))
