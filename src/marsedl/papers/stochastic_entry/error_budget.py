"""Final range dispersion from each source of uncertainty alone: by flights, and by the linear model."""

import numpy as np

from marsedl.methods.lincov import propagate
from marsedl.papers.stochastic_entry import dispersions, environment, flight
from marsedl.papers.stochastic_entry.gains import law
from marsedl.papers.stochastic_entry.inputs import Air, Guidance, Mission, Planet, Simulation, Vehicle
from marsedl.papers.stochastic_entry.linearization import system
from marsedl.papers.stochastic_entry.montecarlo import end_of, nominal_final, simulator_of
from marsedl.papers.stochastic_entry.records import (
    DOWNRANGE,
    STATES,
    TRIGGERS,
    ErrorBudget,
    Gains,
    Linearization,
    Nominal,
)
from marsedl.replication.pipeline.catalogue import stage

SOURCES = ("velocity", "flight path angle", "azimuth", "downrange", "crossrange", "density", "aerodynamics", "all")
_COMPONENTS = {
    "velocity": dispersions.SPEED,
    "flight path angle": dispersions.PATH_ANGLE,
    "azimuth": dispersions.AZIMUTH,
    "downrange": dispersions.LONGITUDE,
    "crossrange": dispersions.LATITUDE,
}
LAWS = ("apollo", "stochastic", "nominal")


@stage(claimed_in=("corrected",))
def compute(
    planet: Planet,
    air: Air,
    vehicle: Vehicle,
    mission: Mission,
    guidance: Guidance,
    simulation: Simulation,
    nominal: Nominal,
    linearization: Linearization,
    gains: Gains,
) -> ErrorBudget:
    """Fly the same trials with one source of uncertainty at a time, and with all."""
    shape = len(LAWS), len(TRIGGERS), len(SOURCES)
    deviation, missed = np.empty(shape), np.zeros(shape, np.int64)
    reference = nominal_final(nominal)[DOWNRANGE]
    plant = flight.plant_of(planet, air, vehicle, mission, guidance)
    for index in np.ndindex(shape):
        case, source = f"{LAWS[index[0]]}_{TRIGGERS[index[1]]}", SOURCES[index[2]]
        control_law, end = law(guidance, linearization, gains, case), end_of(mission, nominal, case)
        flights = simulator_of(_only(plant, source), control_law, end, simulation)(0, simulation.source_trials)
        error = flights.final_state[DOWNRANGE] - reference
        deviation[index] = error.std(ddof=1)
        missed[index] = np.count_nonzero(flights.outcome)
    return ErrorBudget(
        source=np.array(SOURCES),
        law=np.array(LAWS),
        deviation=deviation,
        missed=missed,
        trials=simulation.source_trials,
        floor=_floor(linearization),
    )


def _only(plant: flight.Plant, source: str) -> flight.Plant:
    """The plant with one source of uncertainty alone."""
    if source == "all":
        return plant
    deviations = np.zeros_like(plant.dispersions.entry_deviations)
    if source in _COMPONENTS:
        deviations[_COMPONENTS[source]] = plant.dispersions.entry_deviations[_COMPONENTS[source]]
    varied = plant.dispersions._replace(entry_deviations=deviations)
    if source != "aerodynamics":
        varied = varied._replace(drag_error=0.0, lift_error=0.0)
    atmosphere = plant.atmosphere if source == "density" else environment.undisturbed(plant.atmosphere)
    return plant._replace(atmosphere=atmosphere, dispersions=varied)


def _floor(linearization):
    """Range deviation at the fixed time and at the trigger from density noise that comes after the last control."""
    fine = system(linearization)
    after = ~fine.control.any(axis=1)
    late = fine._replace(noise=np.where(after[:, np.newaxis, np.newaxis], fine.noise, 0.0))
    covariance = propagate(late, np.zeros_like(late.control), np.zeros_like(linearization.initial_covariance))
    weights = np.eye(STATES)[DOWNRANGE], linearization.trigger_projection.T @ np.eye(STATES)[DOWNRANGE]
    return np.sqrt([weight @ covariance.covariance[-1] @ weight for weight in weights])
