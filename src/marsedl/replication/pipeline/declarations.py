"""Stages, figures and tables as their functions' signatures declare them.

A stage is a function with the decorator `stage`. It takes sections of the paper's inputs, or all of them as
`given: Inputs`, and artifacts by their names, an artifact by that of its stage or Monte Carlo case. So do figures and
tables, which may take the printed claims as `published` as well. Keyword-only parameters are options of the job.

A function is given the inputs that its code reads: `planet.gravity` or `given.planet.gravity` in itself, or in a
function that it reaches and that takes a parameter annotated as `Planet`, or as `Inputs`. All of it is read from the
source, by `replication/pipeline/fingerprints.py`, without importing what compiles.

A stage has the name of its module if its function is called `compute`, else the function's. Studies beyond what a paper
prints are in its package `beyond`. In the module `montecarlo` the functions `simulate` and `gather`, which fly a chunk
of a case and join all, are one stage.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING, NamedTuple

from marsedl.replication.errors import InputError, nearest
from marsedl.replication.pipeline.catalogue import FLIGHTS, Paper, Product, Stage, entry_of
from marsedl.replication.pipeline.fingerprints import Fingerprints

if TYPE_CHECKING:
    from marsedl.replication.inputs.sections import Inputs, Section

STAGE, PUBLISHED = "stage", "published"
SKETCHES = "sketches"  # a paper's module of schematic drawings, which its module of figures imports
_OF_A_CASE = (f"{FLIGHTS}:simulate", f"{FLIGHTS}:gather")
OTHERS = ("given", PUBLISHED, "measured", "chunks")  # what functions take beside sections and artifacts


class Taken(NamedTuple):
    """What a function takes according to its signature, and what its code reads."""

    inputs: tuple[str, ...]  # "section.name"
    needs: tuple[str, ...]  # artifacts
    optional: tuple[str, ...]  # artifacts that it takes where there are any
    others: tuple[str, ...]  # of OTHERS


def declared(paper: Paper, model: type[Inputs], digests: Fingerprints) -> Paper:
    """Return a catalogue with its stages, and its products with what they are made from.

    Raises InputError if a parameter is not a section, stage or case, or if stages depend on each other in a circle.
    """
    functions, entries = _functions(paper.slug, digests), stage_entries(paper.slug, digests)

    def taken_of(entry: str) -> Taken:
        if entry not in functions:
            raise InputError(f"{entry}: there is no such function, but {paper.slug} has it in its catalogue; write it")
        return taken_by(entry, functions[entry]["parameters"], model, entries, digests)

    def stage_of(name: str, of: tuple[str, ...]) -> Stage:
        for entry in of:
            if unread := functions[entry]["unread"].get(STAGE):
                raise InputError(
                    f"{entry}: write {', '.join(unread)} of 'stage' as a literal: nothing is imported to read it"
                )
        takes, first = [taken_of(entry) for entry in of], functions[of[0]]
        inputs = {name for one in takes for name in one.inputs}
        needs = dict.fromkeys(need for one in takes for need in one.needs)
        meaning = "Fly the trials of a Monte Carlo case" if name == FLIGHTS else first["summary"].rstrip(".")
        return Stage(of, tuple(sorted(inputs)), tuple(needs), meaning, **first["decorators"][STAGE])

    def products_of(kind: str) -> dict[str, Product]:
        products = {}
        for stem, product in getattr(paper, kind).items():
            drawing = entry_of(paper.slug, SKETCHES, stem)
            entry = drawing if drawing in functions else entry_of(paper.slug, kind, stem)
            inputs, needs, optional, others = taken_of(entry)
            shows_printed = PUBLISHED in others
            products[stem] = replace(product, inputs=inputs, needs=needs, optional=optional, published=shows_printed)
        return products

    stages = {name: stage_of(name, of) for name, of in entries.items()}
    in_order = {name: stages[name] for name in _in_order(paper.slug, stages)}
    return replace(paper, stages=in_order, figures=products_of("figures"), tables=products_of("tables"))


def stage_entries(slug: str, digests: Fingerprints) -> dict[str, tuple[str, ...]]:
    """Return the functions of a paper that are stages, by the names of the stages."""
    entries: dict[str, tuple[str, ...]] = {}
    for entry, function in _functions(slug, digests).items():
        if STAGE in function["decorators"]:
            name = _stage_name(entry)
            entries[name] = (*entries.get(name, ()), entry)
    return entries


def _functions(slug: str, digests: Fingerprints) -> dict[str, dict]:
    """What the functions of a paper declare, and those of its studies beyond what it prints."""
    package = f"marsedl.papers.{slug}"
    return digests.functions(package) | digests.functions(f"{package}.beyond")


def taken_by(
    entry: str, parameters: Mapping[str, bool], model: type[Inputs], stages: Iterable[str], digests: Fingerprints
) -> Taken:
    """Return what a function "package.module:function" takes; its parameters are True if they may be left out.

    Raises InputError if a parameter is not a section of the model, a stage of the paper, or a case.
    """
    sections, needs, others = model.sections(), {False: [], True: []}, []
    for parameter, optional in parameters.items():
        if parameter in OTHERS:
            others.append(parameter)
        elif parameter in model.CASES or parameter in stages:
            needs[optional].append(f"{FLIGHTS}.{parameter}" if parameter in model.CASES else parameter)
        elif parameter not in sections:
            near = nearest(parameter, [*sections, *stages, *model.CASES])
            raise InputError(f"{entry}: the parameter '{parameter}' is not a section, stage or case; {near}")
    inputs = tuple(sorted(inputs_read(digests.reads(entry), sections)))
    return Taken(inputs, tuple(needs[False]), tuple(needs[True]), tuple(others))


def inputs_read(reads: Mapping[str, list[str]], sections: Mapping[str, type[Section]]) -> Iterator[str]:
    """Yield "section.name" of the inputs that code reads; reads: what it reads of parameters, by names of types."""
    from marsedl.replication.inputs.sections import Section  # here, as it takes long to import

    for section, of in sections.items():
        names = {kind.__name__ for kind in of.__mro__ if issubclass(kind, Section) and kind is not Section}
        read = {attribute for name in names for attribute in reads.get(name, ())}
        yield from (f"{section}.{name}" for name in of.model_fields if name in read)


def _stage_name(entry: str) -> str:
    module, function = entry.rpartition(".")[2].split(":")
    return module if function == "compute" or f"{module}:{function}" in _OF_A_CASE else function


def _in_order(slug: str, stages: Mapping[str, Stage]) -> list[str]:
    """The names of the stages, none before one that it needs; the Monte Carlo flights come last."""
    needs = {name: {need.partition(".")[0] for need in stage.needs} for name, stage in sorted(stages.items())}
    try:
        order = list(TopologicalSorter(needs).static_order())
    except CycleError as error:
        raise InputError(f"{slug}: stages depend on each other in a circle: {' -> '.join(error.args[1])}") from None
    return sorted(order, key=lambda name: name == FLIGHTS)
