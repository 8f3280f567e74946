"""Artifacts of flown trials: the fields of `marsedl.montecarlo.ensembles`, along the axes of a paper's model.

@along(state=STATE, observed=OBSERVED, outcome="0 completed, 3 not finite")
class FlightEnsemble(Ensemble):
    \"\"\"All trials of one Monte Carlo case.\"\"\"

    time: np.ndarray = quantity("s", ("time",), "time from the start of the flight")
"""

from collections.abc import Callable
from dataclasses import fields
from typing import dataclass_transform

import numpy as np

from marsedl.replication.errors import ArtifactError, nearest
from marsedl.replication.records.fields import Axis, Quantity, quantities, quantity, record

Along = Axis | tuple[str, str]  # an axis, or the name and unit of a dimension whose extent is not fixed


@record
class Flights:
    """What chunks and ensembles have in common; units and dimensions are the names of arguments of `along`."""

    maximum_over_trials: np.ndarray = quantity(
        "observed", ("time", "observed"), "largest values over the trials", allow_nan=True
    )
    final_state: np.ndarray = quantity("final", ("trials", "final"), "state at the end", allow_nan=True)
    observed_maximum: np.ndarray = quantity(
        "observed", ("trials", "observed"), "largest observed values", allow_nan=True
    )
    outcome: np.ndarray = quantity("1", ("trials",), "code of how the trial ended", "int8")
    kept_history: np.ndarray = quantity("state", ("kept", "time", "state"), "states of the kept trials", allow_nan=True)
    kept_observed: np.ndarray = quantity(
        "observed", ("kept", "time", "observed"), "observed of the kept trials", allow_nan=True
    )


@record
class Counted(Flights):
    """Flights with a histogram over time."""

    histogram: np.ndarray = quantity("1", ("time", "counted", "bins"), "trials by what is observed", "int64")
    histogram_edges: np.ndarray = quantity("counted", ("counted", "edges"), "edges of the inner bins")


@record
class Chunk(Counted):
    """Reduced trials of one chunk, block by block."""

    first_trial: int = quantity("1", (), "number of the first trial")
    block_size: int = quantity("1", (), "trials in a block")
    block_counts: np.ndarray = quantity("1", ("blocks", "time"), "trials in the moments of each block", "int64")
    block_excluded: np.ndarray = quantity("1", ("blocks",), "non-finite trials of each block", "int64")
    block_mean: np.ndarray = quantity("state", ("blocks", "time", "state"), "mean state of each block")
    block_second_moment: np.ndarray = quantity(
        "SI", ("blocks", "time", "state", "state"), "second moment about that mean"
    )
    block_observed_mean: np.ndarray = quantity("observed", ("blocks", "time", "observed"), "mean of the observed")


@record
class Moments(Flights):
    """Flights with the moments of all trials."""

    count: int = quantity("1", (), "trials in the moments")
    excluded: int = quantity("1", (), "trials left out of them because they are not finite")
    mean: np.ndarray = quantity("state", ("time", "state"), "mean state", allow_nan=True)
    covariance: np.ndarray = quantity("SI", ("time", "state", "state"), "sample covariance", allow_nan=True)


@record
class Ensemble(Counted, Moments):
    """All trials of one Monte Carlo case."""

    flying: np.ndarray = quantity("1", ("time",), "trials still flying, over which moments are taken", "int64")
    observed_mean: np.ndarray = quantity("observed", ("time", "observed"), "mean of the observed", allow_nan=True)


@dataclass_transform(frozen_default=True, field_specifiers=(quantity,))
def along(
    *,
    state: Along,
    observed: Along,
    final: Along | None = None,
    counted: Along | None = None,
    time: str = "time",
    bins: str | Axis = "bins",
    edges: str | Axis = "edges",
    per: tuple[str, ...] = (),
    **meanings: str,
) -> Callable[[type], type]:
    """Make a class that inherits from `Chunk`, `Ensemble` or a part of them an artifact type, along these axes.

    state, observed: of the histories. final: of the final state, the state unless given. counted: of what the histogram
    counts, the observed unless given. time, bins, edges: dimensions. per: what all fields lie along first, such as the
    laws that are flown. meanings: of inherited fields, in the paper's words. Raises ArtifactError for a meaning of a
    field that neither a chunk nor an ensemble has.
    """
    known = quantities(Chunk) | quantities(Ensemble)
    if unknown := next((name for name in meanings if name not in known), None):
        raise ArtifactError(f"flights have no field {unknown!r} to give a meaning: {nearest(unknown, known)}")
    axes = {"state": state, "observed": observed, "final": final or state, "counted": counted or observed}
    dims = {name: axis[0] if isinstance(axis, tuple) else axis for name, axis in axes.items()}
    dims |= {"time": time, "bins": bins, "edges": edges}
    units = {name: axis[1] if isinstance(axis, tuple) else axis.unit for name, axis in axes.items()}

    def declared(name: str, of: Quantity) -> Quantity:
        return quantity(
            units.get(of.unit, of.unit),
            (*per, *(dims.get(dimension, dimension) for dimension in of.dims)),
            meanings.get(name, of.meaning),
            of.dtype,
            allow_nan=of.allow_nan,
        )

    def made(kind: type) -> type:
        for base in (base for base in reversed(kind.__mro__) if base.__module__ == __name__):
            for field in fields(base):
                kind.__annotations__[field.name] = field.type
                setattr(kind, field.name, declared(field.name, field.metadata["quantity"]))
        return record(kind)

    return made
