"""The records of a comparison, from the inputs and artifact files of all papers; and how papers are shown."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np

from marsedl.plotting.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION
from marsedl.replication.claims import load_measured
from marsedl.replication.jobs import given

NAMES = {
    "powered_descent": "powered descent",
    "random_field": "random field",
    "desensitized": "desensitized",
    "funnels": "funnels",
    "stochastic_entry": "stochastic entry",
}
COLORS = dict(zip(NAMES, (PURPLE, BLUE, ORANGE, GREEN, VERMILION), strict=True))
NO_VALUE = "–"


def collect(stem: str, inputs: dict, files: dict, load: Callable, benchmarks: str | Path | None = None) -> dict:
    """Return what a comparison knows of every paper.

    Args:
        stem: name of the comparison, a module of this package.
        inputs: plain inputs by "section.name", by paper.
        files: artifact files by the name of the function's parameter, by paper.
        load: function of a file and of an artifact type, which returns the artifact.
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
        measured = {} if benchmarks is None else {"measured": load_measured(benchmarks, slug)}

        def artifact(name, kind, paths=paths):
            return load(paths[name], kind) if name in paths else None

        found[slug] = function(**given(function, inputs[slug], artifact, **measured))
    return found


def number(value: float, form: str) -> str:
    """Format a number, or say that there is none."""
    return format(value, form) if np.isfinite(value) else NO_VALUE
