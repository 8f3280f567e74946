"""Readings: complete, named sets of inputs, checked before any job is planned.

A reading is written as the inputs that differ from the reading it is `based_on`, by section. Each input has a value, a
source and, if one likes, its unit; a section may name the `source` of all of its inputs that name none.
"""

import hashlib
import inspect
import json
import re
import typing
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from marsedl.replication.errors import InputError, nearest, shown
from marsedl.replication.sections import KNOWN_SUFFIXES, Inputs
from marsedl.replication.strict_yaml import Lined, read_yaml

COMMITTED_INPUTS = Path("data/reference/inputs.json")
READ_AS_MISSING = ("nan", "null")  # by pandas, in tables; it is not imported here, which takes time
SETTINGS = ("size", "chunks")  # at the top of a user's configuration, beside the papers
MOST_CHUNKS = 100_000
ABOUT = ("summary", "based_on", "frozen")  # what a reading has beside sections


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
    origin: str = field(default="")

    def slice(self, names: typing.Iterable[str]) -> dict:
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


@dataclass(frozen=True)
class _Place:
    """A key in a configuration, as messages name it: file, line and the keys that lead to it."""

    origin: str
    document: object = None  # as it was read, for line numbers; None if there is no file
    keys: tuple[str, ...] = ()

    def __truediv__(self, key: object) -> "_Place":
        return replace(self, keys=(*self.keys, _bare(key)))

    def __str__(self) -> str:
        line, node = None, self.document
        for key in self.keys:
            if not isinstance(node, Lined) or key not in node:
                break
            line, node = node.lines[key], node[key]
        where = f"{self.origin}:{line}" if line else self.origin
        return ": ".join([where, ".".join(self.keys)] if self.keys else [where])


@dataclass(frozen=True)
class _Written:
    """A reading as it stands in a file."""

    place: _Place
    body: object


def read_own_file(path: Path, keys: typing.Iterable[str]) -> dict:
    """Read a user's own configuration: keys with values, and only the known ones at its top.

    Every reader calls this, so that all reject the same files with the same message.
    """
    document = read_yaml(path, "check its path and permissions")
    if not isinstance(document, dict):
        what = "nothing" if document is None else shown(document)
        raise InputError(f"{path}: must be keys with values, not {what}; begin with one of {', '.join(keys)}")
    return _mapping(document, _Place(str(path), document), keys)


def load_study(
    paper: str,
    model: type[Inputs],
    path: Path,
    *,
    overlay: object = None,
    overlay_name: str = "",
    overlay_document: object = None,
    size: str = "full",
) -> Study:
    """Load a paper's readings from its configuration, and a user's own from an overlay.

    Args:
        paper: its slug.
        model: its typed inputs.
        path: its configuration.
        overlay: the paper's part of a user's own configuration.
        overlay_name: the name of the file that the overlay came from.
        overlay_document: that file as it was read, for the numbers of its lines.
        size: "full", or one that the configuration defines.

    Raises:
        InputError: one message with file, line, key, what is wrong and the remedy.

    """
    document, place = _configuration(model, path)
    cases = set(model.CASES)
    chunks = _mapping(document.get("chunks", {}), place / "chunks", cases, required=cases)
    for case, number in chunks.items():
        _check_chunks(number, place / "chunks" / case)
    bodies = _readings(document["readings"], place / "readings")
    if overlay is not None:
        own_place = _Place(overlay_name, overlay_document) / paper
        body = _mapping(overlay, own_place, {"readings"}, required={"readings"})
        for name, reading in _readings(body["readings"], own_place / "readings").items():
            if name in bodies:
                raise InputError(
                    f"{reading.place}: the name belongs to a reading of {bodies[name].place.origin}; "
                    f"choose another name and write 'based_on: {name}'"
                )
            bodies[name] = reading
    limits, compared_readings = _size(document.get("sizes", {}), place / "sizes", size, model, document["readings"])
    readings = {}
    for name in bodies:
        for link in reversed(_lineage(name, bodies, readings, model)):
            readings[link] = _reading(link, bodies[link], readings, model)
    # Only now, so that a reading is what is written, whatever the size: frozen ones are compared with their digest.
    limited = {name: _limited(reading, limits, place / "sizes" / size) for name, reading in readings.items()}
    compared_names = tuple(name for name in readings if name in compared_readings or name not in document["readings"])
    return Study(paper, limited, chunks, compared_names, frozenset(readings.keys() - document["readings"].keys()))


def configured_readings(model: type[Inputs], path: Path) -> list[str]:
    """Return the names of the readings of a paper's configuration, whatever stands in them."""
    document, place = _configuration(model, path)
    return list(_mapping(document["readings"], place / "readings"))


def _configuration(model: type[Inputs], path: Path) -> tuple[dict, _Place]:
    """A paper's configuration as it is written, and its place."""
    document = read_yaml(path)
    place = _Place(str(path), document)
    required = {"readings", "chunks"} if model.CASES else {"readings"}
    return _mapping(document, place, {"readings", "chunks", "sizes"}, required), place


def counted_inputs(study: Study) -> str:
    """Return the digest of the resolved inputs of the readings in which verdicts count."""
    values = {name: study.readings[name].inputs.plain() for name in ("printed", "corrected")}
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]


def committed_inputs(root: Path) -> dict[str, str]:
    """Return the committed digests of `counted_inputs` by paper; a paper that was never accepted has none."""
    path = root / COMMITTED_INPUTS
    try:
        digests = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read ({error}); restore it with 'git checkout {COMMITTED_INPUTS}'"
        ) from None
    if not isinstance(digests, dict):
        raise InputError(
            f"{path}: must hold a digest for each paper; restore it with 'git checkout {COMMITTED_INPUTS}'"
        )
    return digests


def load_studies(
    models: dict[str, type[Inputs]], folder: Path, config: dict, config_files: typing.Iterable[Path] = ()
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
    keys = (*models, *SETTINGS)
    documents = [read_own_file(path, keys) for path in config_files]
    origin = ", ".join(map(str, config_files)) or "--config"
    # Of several files, Snakemake does not tell which one a key is of.
    document = documents[0] if len(documents) == 1 else None
    place = _Place(origin, document)
    _mapping(config, place, keys)
    chunks = config.get("chunks")
    if chunks is not None:
        _check_chunks(chunks, place / "chunks")
    studies = {}
    for slug, model in models.items():
        study = load_study(
            slug,
            model,
            folder / f"{slug}.yaml",
            overlay=config.get(slug),
            overlay_name=origin,
            overlay_document=document,
            size=str(config.get("size", "full")),
        )
        studies[slug] = study if chunks is None else replace(study, chunks=dict.fromkeys(study.chunks, chunks))
    return studies


def _check_chunks(number: object, place: _Place) -> None:
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= MOST_CHUNKS:
        raise InputError(f"{place}: {shown(number)} is not a whole number from 1 to {MOST_CHUNKS}")


def _readings(bodies: object, place: _Place) -> dict[str, _Written]:
    return {name: _Written(place / name, body) for name, body in _mapping(bodies, place).items()}


def _size(sizes, place, size, model, readings) -> tuple[dict[str, dict], set[str]]:
    """Return the limits of a size, by section, and the names of the readings that it compares."""
    sizes = _mapping(sizes, place)
    if size == "full":
        return {}, set(readings)
    if size not in sizes:
        raise InputError(
            f"--config size={_bare(size)}: {place.origin} defines no such size; {nearest(size, ['full', *sizes])}"
        )
    place = place / size
    limits = dict(_mapping(sizes[size], place, {"readings", *model.sections()}))
    names = limits.pop("readings", list(readings))
    if not isinstance(names, list) or not {"printed", "corrected"} <= {str(name) for name in names}:
        raise InputError(f"{place / 'readings'}: {shown(names)} is not a list of readings with printed and corrected")
    for name in names:
        if name not in readings:
            raise InputError(f"{place / 'readings'}: there is no reading {shown(name)}; {nearest(name, readings)}")
    for section, numbers in limits.items():
        of = model.sections()[section]
        for name, limit in _mapping(numbers, place / section, of.model_fields).items():
            if isinstance(limit, bool) or not isinstance(limit, int | float) or not limit > 0:
                raise InputError(f"{place / section / name}: {shown(limit)} is not a number above zero")
    return limits, set(names)


def _limited(reading: Reading, limits: dict[str, dict], place: _Place) -> Reading:
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
            if entries.dtype.kind == "i" and not isinstance(limit, int):
                raise InputError(f"{place / section / name}: {shown(limit)} is not a whole number")
            if entries.max() > limit and np.ndim(value):
                lowered = np.minimum(entries, limit)
                smaller[name] = tuple(lowered.tolist()) if isinstance(value, tuple) else lowered
            elif entries.max() > limit:
                smaller[name] = limit
        if smaller:
            sections[section] = values.model_copy(update=smaller)
    return replace(reading, inputs=reading.inputs.model_copy(update=sections)) if sections else reading


def _lineage(name: str, bodies: dict[str, _Written], resolved: dict[str, Reading], model: type[Inputs]) -> list[str]:
    """Return a reading and those that it is based on in turn, up to one that is resolved or based on none."""
    names = []
    while name is not None and name not in resolved:
        if name in names:
            raise InputError(
                f"{bodies[names[-1]].place / 'based_on'}: '{name}' is itself based on '{names[-1]}', directly or "
                "through others; name another reading"
            )
        names.append(name)
        name = _base(name, bodies, model)
    return names


def _base(name: str, bodies: dict[str, _Written], model: type[Inputs]) -> str | None:
    """Return the name of the reading that a reading is based on, if any; checks both names."""
    place, body = bodies[name].place, bodies[name].body
    if not isinstance(name, str) or not re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name):
        raise InputError(
            f"{place}: a reading's name is lower case letters, digits and _, at most 40 of them; rename it"
        )
    if name in READ_AS_MISSING:
        raise InputError(f"{place}: pandas reads the name {name!r} in a table as no value; rename it")
    _check_keys(_mapping(body, place), place, model)
    based_on = body.get("based_on")
    if based_on is None:
        return None
    if not isinstance(based_on, str):
        raise InputError(f"{place / 'based_on'}: must be the name of a reading, not {shown(based_on)}")
    if based_on not in bodies:
        raise InputError(f"{place / 'based_on'}: there is no reading {shown(based_on)}; {nearest(based_on, bodies)}")
    return based_on


def _check_keys(body: dict, place: _Place, model: type[Inputs]) -> None:
    """Reject unknown sections; the message names the section to which a misplaced input belongs."""
    sections = model.sections()
    for key in body:
        if key in sections or key in ABOUT:
            continue
        if section := _section_of(key, model):
            raise InputError(f"{place / key}: stands in the section '{section}'; write '{section}: {{{key}: ...}}'")
        raise InputError(f"{place / key}: unknown key; {nearest(key, [*sections, *ABOUT])}")


def _section_of(key: str, model: type[Inputs]) -> str:
    """Return the name of the section in which a key belongs; empty if it belongs in none."""
    return next((name for name, section in model.sections().items() if section.keys().get(key)), "")


def _reading(name: str, source_body: _Written, resolved: dict[str, Reading], model: type[Inputs]) -> Reading:
    """Return a reading; the one that it is based on is resolved already."""
    place, body = source_body.place, source_body.body
    summary, based_on, frozen = body.get("summary", ""), body.get("based_on"), body.get("frozen", "")
    if not isinstance(summary, str):
        raise InputError(f"{place / 'summary'}: must be a sentence, not {shown(summary)}")
    if not isinstance(frozen, str):
        raise InputError(f"{place / 'frozen'}: must be the digest of the reading's inputs, not {shown(frozen)}")
    sources = dict(resolved[based_on].sources) if based_on else {}
    values = dict(resolved[based_on].written) if based_on else {}
    for section, of in model.sections().items():
        for field_name, value, source in _entries(body.get(section, {}), place / section, section, model, name):
            values[f"{section}.{field_name}"], sources[f"{section}.{field_name}"] = value, source
        missing = [field_name for field_name in of.model_fields if f"{section}.{field_name}" not in sources]
        if missing:
            raise InputError(
                f"{place / section}: '{missing[0]}' ({of.unit(missing[0])}) is missing; "
                "give it, or name a complete reading under based_on"
            )
    inputs = _validated(values, sources, place, model)
    for section in body:  # an inherited number is only an upper limit
        if section in model.sections() and "drawn_trials" in body[section]:
            trials = getattr(inputs, section)
            if trials.drawn_trials > trials.trials:
                raise InputError(
                    f"{place / section / 'drawn_trials'}: {trials.drawn_trials} is more than trials ({trials.trials}): "
                    "lower it"
                )
    _check_frozen(frozen, name, values, place)
    return Reading(name, summary, based_on, frozen, inputs, values, sources, place.origin)


def _entries(
    body: object, place: _Place, section: str, model: type[Inputs], reading: str
) -> typing.Iterator[tuple[str, object, Source]]:
    """Yield name, value in SI and source of the inputs that a reading sets in a section."""
    of, accepted, keys = model.sections()[section], model.sections()[section].keys(), {}
    body = _mapping(body, place)
    common = body.get("source")
    if common is not None:
        _check_source(common, place)
    for key, entry in body.items():
        if key == "source":
            continue
        name, factor = _accepted_key(key, accepted, model, section, place)
        input_place = place / key
        if not isinstance(entry, dict):
            raise InputError(f'{input_place}: write {{value: ..., source: "..."}}, not {shown(entry)}')
        required = {"value"} if common is not None else {"value", "source"}
        entry = _mapping(entry, input_place, {"value", "unit", "source"}, required)
        source = entry.get("source", common)
        _check_source(source, input_place)
        unit = of.unit_of_key(key)
        if "unit" in entry and entry["unit"] != unit:
            raise InputError(f"{input_place / 'unit'}: is {shown(entry['unit'])}, must be '{unit}'")
        if name in keys:
            raise InputError(f"{input_place}: '{name}' is set twice, also as '{keys[name]}'")
        keys[name] = key
        yield name, _scaled(entry["value"], factor, input_place), Source(key, entry["value"], source, reading)


def _validated(values: dict[str, object], sources: dict[str, Source], place: _Place, model: type[Inputs]) -> Inputs:
    """Return the typed inputs; each input is checked by itself, then what has to fit together."""
    sections = {}
    for section, of in model.sections().items():
        plain = {name: values[f"{section}.{name}"] for name in of.model_fields}
        try:
            sections[section] = of.model_validate(plain)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            source = sources.get(f"{section}.{first['loc'][0]}") if first["loc"] else None
            input_place = place / section / source.key if source else place / section
            value_in_file = f" (given: {shown(source.written)})" if source else ""
            message = first["msg"].removeprefix("Value error, ").replace("valid tuple", "list of numbers")
            raise InputError(f"{input_place}: {message}{value_in_file}{_number_hint(first['input'])}") from None
    for check in model.CHECKS:
        try:
            check(*(sections[name] for name in inspect.signature(check).parameters))
        except ValueError as error:
            raise InputError(f"{place}: {error}") from None
    return model(**sections)


def _mapping(value: object, place: _Place, allowed=None, required=frozenset()) -> dict:
    """Return value if it is a mapping with allowed keys only; the message names the nearest valid key."""
    if not isinstance(value, dict):
        raise InputError(f"{place}: must be keys with values, not {shown(value)}")
    for key in value:
        if not isinstance(key, str):
            raise InputError(f"{place}: the key {shown(key)} must be a name")
        if allowed is not None and key not in allowed:
            raise InputError(f"{place / key}: unknown key; {nearest(key, allowed)}")
    for key in sorted(required):
        if key not in value:
            raise InputError(f"{place}: the key '{key}' is missing; add it")
    return value


def _check_frozen(frozen: str, name: str, values: dict[str, object], place: _Place) -> None:
    digest = hashlib.sha256(json.dumps(values, sort_keys=True, default=str).encode()).hexdigest()[:12]
    if frozen and frozen != digest:
        raise InputError(
            f"{place}: is frozen, and its inputs have changed (their digest is {digest}, not {frozen}); "
            f"undo the change and write it into a reading of your own that is based_on: {name}"
        )


def _accepted_key(
    key: str, accepted: dict[str, tuple[str, float]], model: type[Inputs], section: str, place: _Place
) -> tuple[str, float]:
    """Return the input that a key of a section sets, and its factor to SI."""
    if key in accepted:
        return accepted[key]
    of = model.sections()[section]
    for name in of.model_fields:
        if key != name and not (key.startswith(name + "_") and key.removeprefix(name) in KNOWN_SUFFIXES):
            continue
        ways = [k for k, (target, _) in accepted.items() if target == name]
        suffix = key.removeprefix(name)
        problem = f"has the wrong unit suffix '{suffix}'" if suffix else "needs its unit in its name"
        raise InputError(f"{place / key}: {problem}; the unit is {of.unit(name)}, write '{ways[0]}'")
    if other := _section_of(key, model):
        raise InputError(f"{place / key}: unknown key; it stands in the section '{other}'")
    raise InputError(f"{place / key}: unknown key; {nearest(key, [*accepted, 'source'])}")


def _check_source(source, place) -> None:
    if not isinstance(source, str) or not any(map(str.isalnum, source)):
        raise InputError(f"{place / 'source'}: say where the value comes from, or 'assumed: why'")
    if source.startswith("assumed") and not re.match(r"assumed: .*\w", source):
        raise InputError(f"{place / 'source'}: write 'assumed: ' and the reason")


def _scaled(value, factor, place):
    if factor == 1.0 or value is None:
        return value
    if isinstance(value, list):
        return [_scaled_number(entry, factor, place) for entry in value]
    return _scaled_number(value, factor, place)


def _scaled_number(value, factor, place):
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{place}: must be a number, not {shown(value)}")
    return value * factor


def _bare(name: object) -> str:
    """Return a valid name as it is, and anything else as `shown` does."""
    return name if isinstance(name, str) and re.fullmatch(r"\S{1,60}", name) and name.isprintable() else shown(name)


def _number_hint(value) -> str:
    if isinstance(value, str) and re.fullmatch(r"[+-]?\d+[eE][+-]?\d+", value.strip()):
        return "; YAML reads this as text: write the number with a point, as in 1.0e-3"
    return ""
