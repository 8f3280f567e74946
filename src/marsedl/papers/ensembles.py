"""Records of flown trials, with the fields of `marsedl.montecarlo.ensembles`: chunks, and a paper's ensembles.

All papers have the same chunks. The fields of an ensemble lie along the axes of the paper's model:

    @record
    class FlightEnsemble(Ensemble):
        \"\"\"All trials of one Monte Carlo case.\"\"\"

        inherited = along(state=STATE, observed=OBSERVED, outcome="0 completed, 3 not finite")

        time: np.ndarray = quantity("s", ("time",), "time from the start of the flight")
"""

from dataclasses import fields, replace

import numpy as np

from marsedl.replication.errors import ArtifactError, nearest
from marsedl.replication.records.fields import Axis, Quantity, quantities, quantity, record

Along = Axis | tuple[str, str]  # an axis, or the name and unit of a dimension whose extent is not fixed


@record
class Chunk:
    """Reduced trials of one chunk, block by block, under each law: one, unless all trials fly under several."""

    first_trial: np.ndarray = quantity("1", ("laws",), "number of the first trial", "int64")
    block_size: np.ndarray = quantity("1", ("laws",), "trials in a block", "int64")
    block_counts: np.ndarray = quantity("1", ("laws", "blocks", "time"), "trials in the moments", "int64")
    block_excluded: np.ndarray = quantity("1", ("laws", "blocks"), "non-finite trials", "int64")
    block_mean: np.ndarray = quantity("SI", ("laws", "blocks", "time", "state"), "mean state")
    block_second_moment: np.ndarray = quantity(
        "SI", ("laws", "blocks", "time", "state", "state"), "second moment about that mean"
    )
    block_observed_mean: np.ndarray = quantity("SI", ("laws", "blocks", "time", "observed"), "mean of the observed")
    histogram: np.ndarray = quantity("1", ("laws", "time", "counted", "bins"), "trials by what is observed", "int64")
    histogram_edges: np.ndarray = quantity("SI", ("laws", "counted", "edges"), "edges of the inner bins")
    maximum_over_trials: np.ndarray = quantity(
        "SI", ("laws", "time", "observed"), "largest values over the trials", allow_nan=True
    )
    maximum_of_parts: np.ndarray = quantity(
        "SI", ("laws", "parts", "time", "observed"), "the same of some parts of the trials", allow_nan=True
    )
    final_state: np.ndarray = quantity("SI", ("laws", "trials", "final"), "state at the end", allow_nan=True)
    observed_maximum: np.ndarray = quantity(
        "SI", ("laws", "trials", "observed"), "largest observed values", allow_nan=True
    )
    outcome: np.ndarray = quantity("1", ("laws", "trials"), "code of how the trial ended", "int8")
    kept_history: np.ndarray = quantity(
        "SI", ("laws", "kept", "time", "state"), "states of the kept trials", allow_nan=True
    )
    kept_observed: np.ndarray = quantity(
        "SI", ("laws", "kept", "time", "observed"), "observed of the kept trials", allow_nan=True
    )


@record
class Moments:
    """All trials of one Monte Carlo case; units and dimensions are the names of arguments of `along`."""

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
    count: int = quantity("1", (), "trials in the moments")
    excluded: int = quantity("1", (), "trials left out of them because they are not finite")
    mean: np.ndarray = quantity("state", ("time", "state"), "mean state", allow_nan=True)
    covariance: np.ndarray = quantity("SI", ("time", "state", "state"), "sample covariance", allow_nan=True)


@record
class Ensemble(Moments):
    """The same with a histogram and the trials over time."""

    histogram: np.ndarray = quantity("1", ("time", "counted", "bins"), "trials by what is observed", "int64")
    histogram_edges: np.ndarray = quantity("counted", ("counted", "edges"), "edges of the inner bins")
    flying: np.ndarray = quantity("1", ("time",), "trials still flying, over which moments are taken", "int64")
    observed_mean: np.ndarray = quantity("observed", ("time", "observed"), "mean of the observed", allow_nan=True)


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
) -> dict[str, Quantity]:
    """Return what the fields are of a class that inherits from `Ensemble` or `Moments`, along these axes.

    state, observed: of the histories. final: of the final state, the state unless given. counted: of what the histogram
    counts, the observed unless given. time, bins, edges: dimensions. per: what all fields lie along first, such as the
    laws that are flown. meanings: of inherited fields, in the paper's words. Raises ArtifactError for a meaning of a
    field that no ensemble has.
    """
    known = quantities(Ensemble)
    if unknown := next((name for name in meanings if name not in known), None):
        raise ArtifactError(f"flights have no field {unknown!r} to give a meaning: {nearest(unknown, known)}")
    axes = {"state": state, "observed": observed, "final": final or state, "counted": counted or observed}
    dims = {name: axis[0] if isinstance(axis, tuple) else axis for name, axis in axes.items()}
    dims |= {"time": time, "bins": bins, "edges": edges}
    units = {name: axis[1] if isinstance(axis, tuple) else axis.unit for name, axis in axes.items()}

    def declared(name: str, of: Quantity) -> Quantity:
        return replace(
            of,
            unit=units.get(of.unit, of.unit),
            dims=(*per, *(dims.get(dimension, dimension) for dimension in of.dims)),
            meaning=meanings.get(name, of.meaning),
        )

    return {field.name: declared(field.name, field.metadata["quantity"]) for field in fields(Ensemble)}
