"""What the studies have in common: a design with some inputs changed, and its flights."""

import numpy as np

from marsedl.montecarlo import ensembles
from marsedl.papers.random_field import gains, linearization, montecarlo
from marsedl.papers.random_field.flight_statistics import delta_v_percentile
from marsedl.replication.catalogue import Flown
from marsedl.replication.errors import MarsedlError
from marsedl.replication.jobs import Slice


def changed(inputs, **changes):
    """The inputs with some of them changed."""
    return Slice({**vars(inputs), **changes})


def designed(inputs, nominal, **changes):
    """The design of changed inputs: them and the `Gains`. Raises MarsedlError if the reading's own is refused."""
    _, refused = linearization.partition_used(inputs)
    if refused:
        raise MarsedlError(f"there is no design to study: {refused}")
    varied = changed(inputs, **changes)
    return varied, gains.compute(varied, nominal, linearization.compute(varied, nominal))


def flown(inputs, nominal, made):
    """The study's trials of a design: `FlightEnsemble`, as of the Monte Carlo stage."""
    trials = Flown("aerocapture", inputs.study_trials, ensembles.BLOCK_SIZE)
    return montecarlo.gather(inputs, [montecarlo.simulate(inputs, nominal, made, flown=trials)])


def percentiles(ensemble):
    """99th percentiles of delta-v of all laws with standard errors, m/s, two arrays (laws,)."""
    found = [delta_v_percentile(ensemble, law) for law in range(len(ensemble.delta_v))]
    return tuple(np.array(values) for values in zip(*found, strict=True))
