"""Fields that artifacts of large ensembles have beside those of all ensembles, see `marsedl.montecarlo.streaming`."""

import numpy as np

from marsedl.montecarlo.streaming import OUTCOMES
from marsedl.replication.records.fields import Axis, quantity, record

CODE = Axis("code", *map(str, range(OUTCOMES)))


@record
class Sketched:
    """What chunks and ensembles have in common; a sketched quantity is a final component or an observed maximum."""

    outcome_counts: np.ndarray = quantity("1", (CODE,), "how many of all trials ended in each outcome", "int64")
    centre: np.ndarray = quantity("SI", ("sketched",), "what deviations of the sketched quantities are taken from")
    lowest: np.ndarray = quantity("SI", ("sketched",), "lowest value of each over all trials", allow_nan=True)
    highest: np.ndarray = quantity("SI", ("sketched",), "highest value of each over all trials", allow_nan=True)
    cell_quantity: np.ndarray = quantity("1", ("cells",), "number of the sketched quantity", "int64")
    cell_side: np.ndarray = quantity("1", ("cells",), "sign of the deviations in this bin", "int8")
    cell_key: np.ndarray = quantity("1", ("cells",), "key of the bin in the sketch's mapping", "int64")
    cell_count: np.ndarray = quantity("1", ("cells",), "trials in this bin", "int64")


@record
class StreamedChunk(Sketched):
    """The further fields of a chunk, whose moments are those of runs of blocks."""

    block_runs: np.ndarray = quantity("1", ("blocks",), "number of blocks in each run", "int64")
    block_final_mean: np.ndarray = quantity("SI", ("blocks", "final"), "mean final state of each run")
    block_final_second_moment: np.ndarray = quantity(
        "SI", ("blocks", "final", "final"), "second moment of the final state about the run's mean"
    )


@record
class StreamedEnsemble(Sketched):
    """The further fields of an ensemble."""

    final_mean: np.ndarray = quantity("SI", ("final",), "mean final state of all trials", allow_nan=True)
    final_covariance: np.ndarray = quantity(
        "SI", ("final", "final"), "sample covariance of the final state of all trials", allow_nan=True
    )
