"""The records of a comparison, from the inputs and artifact files of all papers; and how papers are shown."""

from importlib import import_module
from pathlib import Path

import numpy as np

from marsedl.plotting.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION
from marsedl.replication.claims import load_measured
from marsedl.replication.jobs import Slice, load_arguments

NAMES = {
    "powered_descent": "powered descent",
    "random_field": "random field",
    "desensitized": "desensitized",
    "funnels": "funnels",
    "stochastic_entry": "stochastic entry",
}
COLORS = dict(zip(NAMES, (PURPLE, BLUE, ORANGE, GREEN, VERMILION), strict=True))
NO_VALUE = "–"


def collect(stem: str, reading: str, inputs: dict, files: dict, benchmarks: str | Path | None = None) -> dict:
    """Return what a comparison knows of every paper.

    Args:
        stem: name of the comparison, a module of this package.
        reading: the reading that all artifacts are of.
        inputs: plain inputs by name, by paper.
        files: artifact files by the name of the function's parameter, by paper.
        benchmarks: table of run times, if the comparison shows them.

    Returns:
        Record of the comparison by paper, in the order of `files`.

    Raises:
        ArtifactError: if a file is missing, damaged or of another paper or reading.
        InputError: if the run times cannot be read, or lack one that is shown.
    """
    module = import_module(f"marsedl.comparison.{stem}")
    found = {}
    for slug, paths in files.items():
        function = getattr(module, slug)
        given = load_arguments(function, paths, slug, reading)
        if benchmarks is not None:
            given["measured"] = load_measured(benchmarks, slug)
        found[slug] = function(Slice(inputs[slug]), **given)
    return found


def number(value: float, form: str) -> str:
    """Format a number, or say that there is none."""
    return format(value, form) if np.isfinite(value) else NO_VALUE
