"""Comparisons across papers, from the artifacts of all of them.

A comparison is a module of this package. For every paper it has a function of the paper's name, from the paper's inputs
and artifacts to a common record, and two functions of the records of all papers: `figure` and `table`.
"""

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from marsedl.papers import SLUGS, catalogue, input_model
from marsedl.replication.pipeline.catalogue import TEXTS
from marsedl.replication.pipeline.declarations import Taken, taken_by
from marsedl.replication.pipeline.fingerprints import fingerprints_of
from marsedl.replication.report.texts import comparison_texts


@dataclass(frozen=True)
class Comparison:
    """One figure and one table: their captions, and by paper what the function of its name takes."""

    figure: str
    table: str
    takes: dict[str, Taken] = field(default_factory=dict)

    @property
    def needs(self) -> dict[str, tuple[str, ...]]:
        """The artifacts that are compared, by paper."""
        return {paper: parameters.needs + parameters.optional for paper, parameters in self.takes.items()}

    @property
    def papers(self) -> tuple[str, ...]:
        """The papers that are compared."""
        return tuple(self.takes)


@cache
def comparisons() -> dict[str, Comparison]:
    """Return the comparisons by name, with what their functions take."""
    digests = fingerprints_of()
    functions = digests.functions(__name__)
    declared = {}
    for stem, captions in comparison_texts(Path(__file__).with_name(TEXTS)).items():
        takes = {}
        for slug in SLUGS:
            entry = f"{__name__}.{stem}:{slug}"
            if entry in functions:
                stages, parameters = catalogue(slug).stages, functions[entry]["parameters"]
                takes[slug] = taken_by(entry, parameters, input_model(slug), stages, digests)
        declared[stem] = Comparison(*captions, takes)
    return declared
