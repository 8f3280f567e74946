"""Readings: complete, named sets of inputs, checked before any job is planned.

A reading is written as the inputs that differ from the reading it is `based_on`, by section. Each input has a value, a
source and, if one likes, its unit; a section may name the `source` of all of its inputs that name none.
"""

import functools
import hashlib
import inspect
import json
import typing
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from marsedl.replication.errors import InputError, nearest, shown
from marsedl.replication.inputs import CORRECTED, PRINTED
from marsedl.replication.inputs.messages import Place, checked, sentence
from marsedl.replication.inputs.sections import Inputs, Section
from marsedl.replication.inputs.written import WrittenReading, configuration, own_configuration, own_readings
from marsedl.replication.inputs.yaml_file import read_yaml

COMMITTED_INPUTS = Path("data/reference/inputs.json")
SETTINGS = ("size", "chunks")  # at the top of a user's configuration, beside the papers


@dataclass(frozen=True)
class Source:
    """Where an input comes from, the key and value as they are written, and the reading that sets it."""

    key: str
    written: object
    source: str
    reading: str


@dataclass(frozen=True)
class Reading:
    """A complete, named set of inputs.

    `written` are its inputs and `sources` where they come from, by "section.name"; `written` values are in SI, but not
    limited by the size that is built, as those of `inputs` are.
    """

    name: str
    summary: str
    based_on: str | None
    frozen: str
    inputs: Inputs
    written: dict[str, object]
    sources: dict[str, Source]

    def slice(self, names: Iterable[str]) -> dict:
        """Return inputs by "section.name" as plain numbers, strings and nested lists, in the order of their names."""
        values = self.inputs.plain()
        return {name: values[name] for name in sorted(names)}

    def trial_counts(self) -> dict[str, int]:
        """Return the Monte Carlo cases with their numbers of trials; a case without trials is left out."""
        trials = {case: self.inputs.get(name) for case, name in self.inputs.CASES.items()}
        return {case: number for case, number in trials.items() if number}

    def differences(self) -> dict[str, Source]:
        """Return the inputs that this reading sets itself."""
        return {name: source for name, source in self.sources.items() if source.reading == self.name}


@dataclass(frozen=True)
class Study:
    """All of a paper's configuration: its readings and the number of chunks of each Monte Carlo case.

    `compared` are the readings in which claims are evaluated; a smaller size may leave some out. `own_readings` are
    those of a user's file.
    """

    paper: str
    readings: dict[str, Reading]
    chunks: dict[str, int]
    compared: tuple[str, ...]
    own_readings: frozenset[str] = frozenset()


class _Written(typing.NamedTuple):
    """A reading as it stands in a file."""

    place: Place
    body: WrittenReading


def read_own_file(path: Path, keys: Iterable[str]) -> dict:
    """Read a user's own configuration, with only known keys at its top.

    Every reader calls this, so that all reject the same files with the same message.
    """
    document = read_yaml(path, "check its path and permissions")
    papers = dict.fromkeys((key for key in keys if key not in SETTINGS), typing.Any)
    checked(own_configuration(papers), document, Place(str(path), document))
    return document


def load_studies(
    models: dict[str, type[Inputs]], folder: Path, config: dict, config_files: Iterable[Path] = ()
) -> dict[str, Study]:
    """Load every paper's configuration, with what a user gave on the command line or in files of their own.

    Args:
        models: the papers' typed inputs by slug.
        folder: where their configurations are.
        config: the user's configuration: a paper's slug with readings; `size`; `chunks`.
        config_files: the files that it was read from.

    Returns:
        The studies by slug.

    Raises:
        InputError: before anything is computed.

    """
    documents = [read_own_file(path, (*models, *SETTINGS)) for path in config_files]
    # Of several files, Snakemake does not tell which one a key is of.
    place = Place(", ".join(map(str, config_files)) or "--config", documents[0] if len(documents) == 1 else None)
    settings = checked(own_configuration(dict.fromkeys(models, typing.Any)), config, place)
    studies = {}
    for slug, model in models.items():
        own = {}
        if slug in config:
            part = checked(own_readings(model), config[slug], place / slug)
            own = _written(part.readings, place / slug)
        study = load_study(slug, model, folder / f"{slug}.yaml", own=own, size=settings.size)
        chunks = dict.fromkeys(study.chunks, settings.chunks) if settings.chunks else study.chunks
        studies[slug] = replace(study, chunks=chunks)
    return studies


def load_study(
    paper: str, model: type[Inputs], path: Path, *, own: dict[str, _Written] | None = None, size: str = "full"
) -> Study:
    """Load a paper's readings from its configuration.

    Args:
        paper: its slug.
        model: its typed inputs.
        path: its configuration.
        own: a user's own readings, as `load_studies` checks them.
        size: "full", or one that the configuration defines.

    Raises:
        InputError: one message with file, line, key, what is wrong and the remedy.

    """
    document = read_yaml(path)
    place = Place(str(path), document)
    written = checked(configuration(model), document, place)
    bodies, own = _written(written.readings, place), own or {}
    for name in own:
        if name in bodies:
            remedy = f"choose another name and write 'based_on: {name}'"
            raise InputError(f"{own[name].place}: the name belongs to a reading of {path}; {remedy}")
    bodies |= own
    readings: dict[str, Reading] = {}
    for name in bodies:
        _resolve(name, bodies, readings, model)
    compared = tuple(readings)
    if size != "full":
        limits, left_out = _size(written, size, place)
        # Only now, so that a reading is what is written, whatever the size: frozen ones are compared with their digest.
        readings = {name: _limited(reading, limits, place / "sizes" / size) for name, reading in readings.items()}
        compared = tuple(name for name in readings if name not in left_out)
    chunks = written.chunks.model_dump() if written.chunks else {}
    return Study(paper, readings, chunks, compared, frozenset(own))


def configured_readings(path: Path) -> list[str]:
    """Return the names of the readings of a paper's configuration, whatever stands in them."""
    document = read_yaml(path)
    if not isinstance(document, dict) or not isinstance(document.get("readings"), dict):
        raise InputError(f"{path}: readings: must be keys with values")
    return list(document["readings"])


def counted_inputs(study: Study) -> str:
    """Return the digest of the resolved inputs of the readings in which verdicts count."""
    return _digest({name: study.readings[name].inputs.plain() for name in (PRINTED, CORRECTED)})


def committed_inputs(root: Path) -> dict[str, str]:
    """Return the committed digests of `counted_inputs` by paper; a paper that was never accepted has none."""
    path = root / COMMITTED_INPUTS
    try:
        return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"{path}: cannot be read ({error}); restore it with 'git checkout {COMMITTED_INPUTS}'"
        ) from None


def _digest(values: dict) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True, default=str).encode()).hexdigest()[:12]


def _written(readings: dict[str, WrittenReading], place: Place) -> dict[str, _Written]:
    return {name: _Written(place / "readings" / name, body) for name, body in readings.items()}


# ------------------------------------------------------------------------------------------------------------ readings


def _resolve(
    name: str, bodies: dict[str, _Written], readings: dict[str, Reading], model: type[Inputs], based: tuple = ()
) -> Reading:
    """Return a reading, after the one that it is based on; `based` are those that are based on it in turn."""
    if name in readings:
        return readings[name]
    place, body = bodies[name]
    base = None
    if body.based_on:
        if body.based_on not in bodies:
            problem = f"there is no reading {shown(body.based_on)}; {nearest(body.based_on, bodies)}"
            raise InputError(f"{place / 'based_on'}: {problem}")
        if body.based_on in (name, *based):
            raise InputError(
                f"{place / 'based_on'}: '{body.based_on}' is itself based on '{name}', directly or through others; "
                "name another reading"
            )
        base = _resolve(body.based_on, bodies, readings, model, (name, *based))
    readings[name] = _reading(name, bodies[name], base, model)
    return readings[name]


def _reading(name: str, written: _Written, base: Reading | None, model: type[Inputs]) -> Reading:
    """Return a reading from what is written of it and the one that it is based on."""
    place, body = written
    sources = dict(base.sources) if base else {}
    values = dict(base.written) if base else {}
    sections = {}
    for section, of in model.sections().items():
        entries = getattr(body, section)
        if base and not entries:
            sections[section] = getattr(base.inputs, section)
            continue
        keys: dict[str, str] = {}
        for key, entry in entries.items():
            (target, factor), at = of.keys()[key], place / section / key
            if entry.unit not in ("", unit := of.unit_of_key(key)):
                raise InputError(f"{at / 'unit'}: is {shown(entry.unit)}, must be '{unit}'")
            if keys.setdefault(target, key) != key:
                raise InputError(f"{at}: '{target}' is set twice, also as '{keys[target]}'")
            values[f"{section}.{target}"] = _in_si(entry.value, factor)
            sources[f"{section}.{target}"] = Source(key, entry.value, entry.source, name)
        sections[section] = _section(section, of, values, sources, place / section)
    for check in model.CHECKS:
        try:
            check(*(sections[parameter] for parameter in _parameters(check)))
        except ValueError as error:
            raise InputError(f"{place}: {error}") from None
    digest = _digest(values)
    if body.frozen and body.frozen != digest:
        raise InputError(
            f"{place}: is frozen, and its inputs have changed (their digest is {digest}, not {body.frozen}); "
            f"undo the change and write it into a reading of your own that is based_on: {name}"
        )
    return Reading(name, body.summary, body.based_on, body.frozen, model(**sections), values, sources)


def _section(name: str, of: type[Section], values: dict, sources: dict[str, Source], place: Place) -> Section:
    """Return a section from the values of a reading in SI."""
    for field_name in of.model_fields:
        if f"{name}.{field_name}" not in values:
            raise InputError(
                f"{place}: '{field_name}' ({of.unit(field_name)}) is missing; "
                "give it, or name a complete reading under based_on"
            )
    try:
        return of.model_validate({field_name: values[f"{name}.{field_name}"] for field_name in of.model_fields})
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        if not fault["loc"]:
            raise InputError(f"{place}: {sentence(fault)}") from None
        source = sources[f"{name}.{fault['loc'][0]}"]
        raise InputError(f"{place / source.key}: {sentence(fault, source.written)}") from None


@functools.cache
def _parameters(check: Callable) -> tuple[str, ...]:
    return tuple(inspect.signature(check).parameters)


def _in_si(value: object, factor: float) -> object:
    """Return a value in SI; what is no number is left to its section to refuse."""
    if isinstance(value, list):
        return [_in_si(entry, factor) for entry in value]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return value * factor if is_number and factor != 1.0 else value


# --------------------------------------------------------------------------------------------------------------- sizes


def _size(written: typing.Any, size: str, place: Place) -> tuple[dict[str, dict[str, float]], set[str]]:
    """Return the limits of a size, by section, and the readings of the file that it does not compare."""
    if size not in written.sizes:
        raise InputError(
            f"--config size={size}: {place.origin} defines no such size; {nearest(size, ['full', *written.sizes])}"
        )
    limits, place = written.sizes[size].model_dump(exclude_unset=True), place / "sizes" / size / "readings"
    names = limits.pop("readings", list(written.readings))
    if not {PRINTED, CORRECTED} <= set(names):
        raise InputError(f"{place}: {shown(names)} is not a list of readings with printed and corrected")
    for name in names:
        if name not in written.readings:
            raise InputError(f"{place}: there is no reading {shown(name)}; {nearest(name, written.readings)}")
    return limits, set(written.readings) - set(names)


def _limited(reading: Reading, limits: dict[str, dict[str, float]], place: Place) -> Reading:
    """Return the reading with no input, and no number in one, above its limit."""
    sections = {}
    for section, numbers in limits.items():
        values = getattr(reading.inputs, section)
        smaller = {}
        for name, limit in numbers.items():
            value = getattr(values, name)
            if value is None:
                continue
            entries = np.atleast_1d(value)
            if entries.dtype.kind not in "if":
                raise InputError(f"{place / section / name}: only numbers can be limited, but this is {shown(value)}")
            if entries.dtype.kind == "i" and not limit.is_integer():
                raise InputError(f"{place / section / name}: {shown(limit)} is not a whole number")
            if entries.max() > limit:
                lowered = np.minimum(value, entries.dtype.type(limit))
                smaller[name] = lowered if isinstance(value, np.ndarray) else lowered.tolist()
                if isinstance(value, tuple):
                    smaller[name] = tuple(smaller[name])
        sections[section] = values.model_copy(update=smaller)
    return replace(reading, inputs=reading.inputs.model_copy(update=sections))
