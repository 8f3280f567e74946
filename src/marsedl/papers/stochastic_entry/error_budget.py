"""Final range dispersion from each source of uncertainty alone: by flights, and by the linear model."""

import numpy as np

from marsedl.methods.lincov import propagate
from marsedl.papers.stochastic_entry import dispersions
from marsedl.papers.stochastic_entry.linearization import system
from marsedl.papers.stochastic_entry.montecarlo import block_simulator, nominal_final
from marsedl.papers.stochastic_entry.records import (
    DOWNRANGE,
    STATES,
    TRIGGERS,
    ErrorBudget,
    Gains,
    Linearization,
    Nominal,
)
from marsedl.replication.catalogue import stage

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
def compute(inputs, nominal: Nominal, linearization: Linearization, gains: Gains) -> ErrorBudget:
    """Fly the same trials with one source of uncertainty at a time, and with all."""
    shape = len(LAWS), len(TRIGGERS), len(SOURCES)
    deviation, mean, largest, missed = np.empty(shape), np.empty(shape), np.empty(shape), np.zeros(shape, np.int64)
    reference = nominal_final(nominal)[DOWNRANGE]
    for index in np.ndindex(shape):
        law, trigger, source = LAWS[index[0]], TRIGGERS[index[1]], SOURCES[index[2]]
        simulate = block_simulator(
            inputs,
            nominal,
            linearization,
            gains,
            f"{law}_{trigger}",
            deviations=_deviations(inputs, source),
            aerodynamics=float(source in ("aerodynamics", "all")),
            varied=source in ("density", "all"),
        )
        flown = simulate(0, inputs.source_trials)
        error = flown.final_state[DOWNRANGE] - reference
        deviation[index], mean[index], largest[index] = error.std(ddof=1), error.mean(), np.abs(error).max()
        missed[index] = np.count_nonzero(flown.outcome)
    return ErrorBudget(
        source=np.array(SOURCES),
        law=np.array(LAWS),
        deviation=deviation,
        mean=mean,
        largest=largest,
        missed=missed,
        trials=inputs.source_trials,
        floor=_floor(linearization),
    )


def _deviations(inputs, source):
    """Standard deviations of the entry state with one source alone."""
    deviations = dispersions.entry_deviations(inputs)
    if source == "all":
        return deviations
    only = np.zeros_like(deviations)
    if source in _COMPONENTS:
        only[_COMPONENTS[source]] = deviations[_COMPONENTS[source]]
    return only


def _floor(linearization):
    """Range deviation at the fixed time and at the trigger from density noise that comes after the last control."""
    fine = system(linearization)
    after = ~fine.control.any(axis=1)
    late = fine._replace(noise=np.where(after[:, np.newaxis, np.newaxis], fine.noise, 0.0))
    covariance = propagate(late, np.zeros_like(late.control), np.zeros_like(linearization.initial_covariance))
    weights = np.eye(STATES)[DOWNRANGE], linearization.trigger_projection.T @ np.eye(STATES)[DOWNRANGE]
    return np.sqrt([weight @ covariance.covariance[-1] @ weight for weight in weights])
