"""Artifacts as xarray datasets."""

from pathlib import Path

import xarray

from marsedl.replication.errors import ArtifactError
from marsedl.replication.inputs import CORRECTED
from marsedl.replication.pipeline.catalogue import FLIGHTS
from marsedl.replication.records.store import FORMAT, REBUILD, opened
from marsedl.results.builds import find


def artifact(
    paper: str, stage: str, reading: str = CORRECTED, case: str | None = None, build: str | Path | None = None
) -> xarray.Dataset:
    """Return what a stage computed, in memory; `case` is the Monte Carlo case, of the stage "montecarlo" alone.

    Dimensions and their components have names: `dataset["mean"].sel(motion="altitude")`; the second such dimension of
    a matrix is `motion_2`. `units`, `long_name` (short) and `meaning` are attributes of every variable; where the units
    of components differ, the coordinate `motion_unit` holds them. An artifact that the reading shares with another is
    read from that one's file, whose `reading` is then in the attributes.

    Raises InputError, which names what exists, if there is no such paper, stage, case or reading, or it is not built,
    and ArtifactError if the file is damaged, or of another version.
    """
    with _lazily(find(build).artifact(paper, stage, reading, case)) as dataset:
        return dataset.load()


def ensemble(paper: str, case: str, reading: str = CORRECTED, build: str | Path | None = None) -> xarray.Dataset:
    """Return the trials of a Monte Carlo case; values are read from the file when they are used.

    `with results.ensemble(...) as flights:` closes the file at the end, `flights.load()` reads all of it. Names, units
    and errors are those of `artifact`.
    """
    return _lazily(find(build).artifact(paper, FLIGHTS, reading, case))


def _lazily(path: Path) -> xarray.Dataset:
    """The file's dataset, after the checks that every reader of artifacts makes."""
    with opened(path) as file:
        if file.attrs.get("format") != FORMAT:
            raise ArtifactError(f"{path}: was written by another version: {REBUILD}")
    # Without a lock, as it was just opened: HDF5 refuses a file that is open in another way.
    return xarray.open_dataset(path, engine="h5netcdf", decode_times=False, driver_kwds={"locking": False})
