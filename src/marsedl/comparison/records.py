"""The records of a comparison, from the inputs and artifact files of all papers; and how papers are shown."""

from collections.abc import Callable
from importlib import import_module

from marsedl.plotting.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION
from marsedl.replication.jobs import arguments_of

NAMES = {
    "powered_descent": "powered descent",
    "random_field": "random field",
    "desensitized": "desensitized",
    "funnels": "funnels",
    "stochastic_entry": "stochastic entry",
}
COLORS = dict(zip(NAMES, (PURPLE, BLUE, ORANGE, GREEN, VERMILION), strict=True))


def collect(stem: str, inputs: dict, files: dict, load: Callable) -> dict:
    """Return the record that a comparison makes of every paper.

    Args:
        stem: name of the comparison, a module of this package.
        inputs: plain inputs by "section.name", by paper.
        files: artifact files by the name of the function's parameter, by paper.
        load: function of a file and of an artifact type, which returns the artifact.

    Returns:
        Record of the comparison by paper, in the order of `files`.

    Raises:
        ArtifactError: if a file is missing, damaged or of another paper or reading.
    """
    module = import_module(f"marsedl.comparison.{stem}")
    records = {}
    for slug, paths in files.items():
        function = getattr(module, slug)

        def artifact(name, kind, paths=paths):
            return load(paths[name], kind) if name in paths else None

        records[slug] = function(**arguments_of(function, inputs[slug], artifact))
    return records
