"""The records of a comparison, from the inputs and artifact files of all papers; and how papers are shown."""

from collections.abc import Callable

from marsedl.plotting.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION
from marsedl.replication.pipeline.catalogue import function_of
from marsedl.replication.pipeline.injection import Arguments

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
    records = {}
    for slug, paths in files.items():

        def artifact(name, kind, paths=paths):
            return load(paths[name], kind) if name in paths else None

        records[slug] = Arguments(inputs[slug], artifact).call(function_of(f"marsedl.comparison.{stem}:{slug}"))
    return records
