"""Readings: complete, named sets of inputs, checked before any job is planned.

A reading is written as the inputs that differ from the reading it is `based_on`, by section. Each input has a value, a
source and, if one likes, its unit; a section may name the `source` of all of its inputs that name none.
"""

import copy
import hashlib
import inspect
import json
import typing
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pydantic import ValidationError

from marsedl.replication.errors import InputError, nearest, shown
from marsedl.replication.inputs import CORRECTED, PRINTED
from marsedl.replication.inputs.choices import Assignment, Choices, Sources, inputs_set, of_written, source_of_key
from marsedl.replication.inputs.messages import Keys, Place, checked, sentence
from marsedl.replication.inputs.sections import Inputs, Section
from marsedl.replication.inputs.written import (
    Settings,
    WrittenReading,
    WrittenUniverses,
    configuration,
    own_configuration,
)
from marsedl.replication.inputs.yaml_file import read_yaml
from marsedl.replication.sizes import FULL

SMALL = 1  # universes of each design of a smaller size, beside corrected
COMMITTED_INPUTS = Path("data/reference/inputs.json")
SETTINGS = tuple(Settings.model_fields)  # at the top of a user's configuration, beside the papers
Limits = Mapping[str, Mapping[str, float]]  # by section and input: the number that no number of the input may exceed


@dataclass(frozen=True)
class Reading:
    """A complete, named set of inputs.

    `sources` are by "section.name"; their values are not limited by the size that is built, as those of `inputs` are.
    """

    name: str
    summary: str
    based_on: str | None
    frozen: str
    inputs: Inputs
    sources: Sources

    def trial_counts(self) -> dict[str, int]:
        """Return the Monte Carlo cases with their numbers of trials; a case without trials is left out."""
        trials = {case: self.inputs.get(name) for case, name in self.inputs.CASES.items()}
        return {case: number for case, number in trials.items() if number}


class Designs(typing.NamedTuple):
    """Which universes are computed."""

    space_filling: int = 0  # so many fill the space of choices
    one_at_a_time: Sequence[str] | None = None  # the choices that are varied by themselves; None: all
    at_most: int | None = None  # so many of these, with `corrected`; None: all


@dataclass(frozen=True)
class Study:
    """All of a paper's configuration: its readings, its choices and the number of chunks of each Monte Carlo case.

    `built` are the readings whose artifacts, figures and tables are made as files: `printed`, `corrected`, and
    `own_readings`, those of a user's file. `points` are the others, whose claims are evaluated in memory; a smaller
    size may leave some out. `own_choices` are those of a user's file as they are written. `universes` says how
    universes are computed; `limits` are those of the size and of them.
    """

    paper: str
    readings: dict[str, Reading]
    chunks: dict[str, int]
    built: tuple[str, ...]
    points: tuple[str, ...] = ()
    own_readings: frozenset[str] = frozenset()
    size: str = FULL
    choices: Choices = field(default_factory=Choices)
    own_choices: Mapping = field(default_factory=dict)
    universes: WrittenUniverses | None = None
    designs: Designs = field(default_factory=Designs)  # of a build's universes
    whole: int = 0  # universes that fill the space in a new run, which varies all choices by themselves
    universe_jobs: int = 1
    root: Path = Path()  # of the files that inputs name
    limits: tuple[tuple[Limits, Place], ...] = ()

    def reading(self, name: str) -> Reading:
        """Return a reading; raises InputError if there is none of this name."""
        if name not in self.readings:
            raise InputError(f"{self.paper} has no reading '{name}'; {nearest(name, self.readings)}")
        return self.readings[name]

    def universe(self, assignment: Assignment, inputs: Mapping[str, object] = {}, seed: int = 0) -> Reading:
        """Return `corrected` with values of choices by name, and with the numbers of trials of universes.

        inputs: further ones by "section.key", as they are written in a file; seed: added to that of the random streams

        Raises InputError for an unknown choice, value or input, and for inputs that do not fit together.
        """
        base = self.readings[CORRECTED]
        model, sources = type(base.inputs), self.choices.applied(base.sources, assignment)
        sources |= dict(source_of_key(model, key, value) for key, value in inputs.items())
        for name in [name for name in sources if name.endswith(".seed")]:
            sources[name] = replace(sources[name], value=sources[name].value + seed)
        typed = typed_inputs(model, self.root, sources, Place("universe"))
        return self.limited(replace(base, name="universe", based_on=CORRECTED, inputs=typed, sources=sources))

    def without_own_readings(self) -> "Study":
        """Return the configuration without the readings of a user's file."""
        readings = {name: one for name, one in self.readings.items() if name not in self.own_readings}
        built = tuple(name for name in self.built if name in readings)
        return replace(self, readings=readings, built=built, own_readings=frozenset())

    def limited(self, reading: Reading) -> Reading:
        """Return a reading with the limits of the size that is built and of universes, of which the lowest counts."""
        lowest: dict[str, dict[str, float]] = {}
        for limits, place in self.limits:
            for section, of_section in limits.items():
                of = lowest.setdefault(section, {})
                of.update({name: min(limit, of.get(name, limit)) for name, limit in of_section.items()})
            reading = _limited(reading, self.root, {section: lowest[section] for section in limits}, place)
        return reading


def load_studies(
    models: Mapping[str, type[Inputs]], root: Path, config: Mapping = {}, config_files: Iterable[Path] = ()
) -> dict[str, Study]:
    """Load every paper's configuration, with what a user gave on the command line or in files of their own.

    models: the papers' typed inputs by slug
    root: the project's folder, which holds `configs/<slug>.yaml` and the files that inputs name by relative paths
    config: what the user sets (readings by paper, `size`, `chunks`), if it is not in `config_files`

    Raises InputError with file, line, key, what is wrong and the remedy, before anything is computed.
    """
    configuration_of_user = own_configuration(models)
    files = [Place(str(path), read_yaml(path, "check its path and permissions")) for path in config_files]
    for file in files:
        checked(configuration_of_user, file.document, file)
    places = _own_places(models, files)
    # Settings of the command line count before those of a file, and of files the last.
    of_files = {key: part for file in files for key, part in file.document.items() if key not in models}
    config = of_files | copy.deepcopy(dict(config))
    checked(configuration_of_user, config, Place("--config"))
    for (slug, kind, name), at in places.items():
        if config.setdefault(slug, {}).setdefault(kind, {}).setdefault(name, at.written()) != at.written():
            raise InputError(f"{at}: --config changes it; write the change into the file")
    settings = checked(configuration_of_user, config, Place("--config"))
    studies = {}
    for slug, model in models.items():
        study = _study(slug, model, root, settings, places, files)
        studies[slug] = replace(study, own_choices=config.get(slug, {}).get("choices", {}))
    return studies


def _own_places(models: Iterable[str], files: Iterable[Place]) -> dict[tuple[str, str, str], Place]:
    """Return where the files of a user hold their readings and choices, by paper, kind and name; InputError for two."""
    places: dict[tuple[str, str, str], Place] = {}
    for file in files:
        for slug in file.document.keys() & models:
            for kind, named in file.document[slug].items():
                for name in named:
                    at = file / slug / kind / name
                    if (other := places.setdefault((slug, kind, name), at)) is not at:
                        raise InputError(f"{at}: stands in {other} too; give one of them another name")
    return places


def load_study(paper: str, model: type[Inputs], root: Path, size: str = FULL, choices: Mapping = {}) -> Study:
    """Load a paper's configuration, see `load_studies`; choices: those of a user, as they are written."""
    own = {paper: {"choices": choices}} if choices else {}
    return load_studies({paper: model}, root, {"size": size, **own})[paper]


def counted_inputs(study: Study) -> str:
    """Return the digest of the resolved inputs of the readings in which verdicts count."""
    return _digest({name: study.readings[name].inputs.plain() for name in (PRINTED, CORRECTED)})


def committed_inputs(root: Path) -> dict[str, str]:
    """Return the committed digests of `counted_inputs` by paper; a paper that was never accepted has none."""
    path = root / COMMITTED_INPUTS
    try:
        return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}
    except (OSError, ValueError, TypeError) as error:
        remedy = f"restore it with 'git checkout {COMMITTED_INPUTS}'"
        raise InputError(f"{path}: cannot be read ({error}); {remedy}") from None


def _digest(values: dict) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True, default=str).encode()).hexdigest()[:12]


def _study(
    slug: str,
    model: type[Inputs],
    root: Path,
    settings: Settings,
    places: Mapping[tuple[str, str, str], Place],
    files: Iterable[Place],
) -> Study:
    path = Path("configs") / f"{slug}.yaml"
    place = Place(str(path), read_yaml(root / path))
    file, part = checked(configuration(model), place.document, place), getattr(settings, slug)
    bodies = {name: (place / "readings" / name, body) for name, body in file.readings.items()}
    for name, body in part.readings.items():
        at = places.get((slug, "readings", name), Place("--config") / slug / "readings" / name)
        remedy = f"choose another name and write 'based_on: {name}'"
        if bodies.setdefault(name, (at, body))[0] is not at:
            raise InputError(f"{at}: the name belongs to a reading of {path}; {remedy}")
    at = {name: place / "choices" / name for name in file.choices}
    at |= {n: places.get((slug, "choices", n), Place("--config") / slug / "choices" / n) for n in part.choices}
    choices = of_written(_joined(file.choices, part.choices), model, at)
    readings, left_out = _resolved(model, root, bodies, choices), set()
    if choices:
        choices = choices.placed(readings[PRINTED].sources, readings[CORRECTED].sources, at)
    choices = replace(choices, base=choices.checked(file.universes.choices, place / "universes" / "choices"))
    bounds = [(file.universes.model_dump(exclude_unset=True, include=set(model.sections())), place / "universes")]
    designs, jobs = Designs(file.universes.space_filling, file.universes.one_at_a_time), file.universes.jobs
    if settings.size != FULL:
        limits, left_out = _size(file, settings.size, place, files)
        # Only now, so that a reading is what is written, whatever the size: frozen ones are compared with their digest.
        place = place / "sizes" / settings.size
        readings = {name: _limited(reading, root, limits, place) for name, reading in readings.items()}
        bounds, designs, jobs = [(limits, place), *bounds], Designs(SMALL, designs.one_at_a_time, 1 + SMALL), 1
    chunks = {case: settings.chunks or number for case, number in file.chunks.model_dump().items()}
    built = tuple(name for name in readings if name in (PRINTED, CORRECTED, *part.readings))
    return Study(
        paper=slug,
        readings=readings,
        chunks=chunks,
        built=built,
        points=tuple(name for name in readings if name not in {*built, *left_out}),
        own_readings=frozenset(part.readings),
        size=settings.size,
        choices=choices,
        universes=file.universes,
        designs=designs,
        whole=settings.universes or file.universes.multiverse,
        universe_jobs=settings.chunks or jobs,
        root=root,
        limits=tuple(bounds),
    )


def _joined(file: Mapping[str, typing.Any], own: Mapping[str, typing.Any]) -> dict[str, typing.Any]:
    """Return choices of a paper with those of a user; of one that both name, the user's values are added."""
    joined = dict(file)
    for name, one in own.items():
        base = joined.get(name, one)
        joined[name] = base.model_copy(update={"values": {**base.values, **one.values}})
    return joined


def _size(file: Keys, size: str, place: Place, files: Iterable[Place]) -> tuple[Limits, set[str]]:
    """Return the limits of a size, by section, and the readings of the file that it does not compare."""
    if size not in file.sizes:
        hint = nearest(size, [FULL, *file.sizes])
        asked = [f"{one / 'size'}: {size}" for one in files if one.document.get("size") == size]
        raise InputError(f"{[*asked, f'--config size={size}'][0]}: {place.origin} defines no such size; {hint}")
    limits, place = file.sizes[size].model_dump(exclude_unset=True), place / "sizes" / size / "readings"
    names = limits.pop("readings", list(file.readings))
    if not {PRINTED, CORRECTED} <= set(names):
        raise InputError(f"{place}: {shown(names)} is not a list of readings with printed and corrected")
    for name in names:
        if name not in file.readings:
            raise InputError(f"{place}: there is no reading {shown(name)}; {nearest(name, file.readings)}")
    return limits, file.readings.keys() - set(names)


def _resolved(
    model: type[Inputs], root: Path, bodies: Mapping[str, tuple[Place, WrittenReading]], choices: Choices
) -> dict[str, Reading]:
    """Return the readings of a paper from what is written of them, each after the one that it is based on."""
    readings: dict[str, Reading] = {}

    def resolve(name: str, above: tuple[str, ...] = ()) -> Reading:
        """Return a reading; `above` are those that are based on it, directly or through others."""
        if name in readings:
            return readings[name]
        (place, body), sources = bodies[name], {}
        if body.based_on:
            at, other = place / "based_on", body.based_on
            if other not in bodies:
                raise InputError(f"{at}: there is no reading {shown(other)}; {nearest(other, bodies)}")
            if other in (name, *above):
                problem = f"'{other}' is itself based on '{name}', directly or through others"
                raise InputError(f"{at}: {problem}; name another reading")
            sources = dict(resolve(other, (name, *above)).sources)
        for choice, value in choices.checked(body.choices, place / "choices").items():
            sources = choices.by_name[choice].applied(sources, value)
        sources |= inputs_set(model, body, name, place)
        inputs = typed_inputs(model, root, sources, place)
        digest = _digest({key: source.value for key, source in sources.items()})
        if body.frozen not in ("", digest):
            raise InputError(
                f"{place}: is frozen, and its inputs have changed (their digest is {digest}, not {body.frozen}); "
                f"undo the change and write it into a reading of your own that is based_on: {name}"
            )
        readings[name] = Reading(name, body.summary, body.based_on, body.frozen, inputs, sources)
        return readings[name]

    for name in bodies:
        resolve(name)
    return readings


def typed_inputs(model: type[Inputs], root: Path, sources: Sources, place: Place) -> Inputs:
    """Return typed inputs from their sources; raises InputError for inputs that do not fit together."""
    sections = {name: _section(of, name, root, sources, place) for name, of in model.sections().items()}
    for check in model.CHECKS:
        try:
            check(*(sections[parameter] for parameter in inspect.signature(check).parameters))
        except ValueError as error:
            raise InputError(f"{place}: {error}") from None
    return model(**sections)


def _limited(reading: Reading, root: Path, limits: Limits, place: Place) -> Reading:
    """Return a reading with no input, and no number in one, above its limit."""
    of, sources = reading.inputs.sections(), reading.sources
    sections = {name: _section(of[name], name, root, sources, place, those) for name, those in limits.items()}
    return replace(reading, inputs=reading.inputs.model_copy(update=sections))


def _section(
    of: type[Section], name: str, root: Path, sources: Sources, place: Place, limits: Mapping[str, float] = {}
) -> Section:
    place = place / name
    if missing := [field for field in of.model_fields if f"{name}.{field}" not in sources]:
        remedy = "give it, or name a complete reading under based_on"
        raise InputError(f"{place}: '{missing[0]}' ({of.unit(missing[0])}) is missing; {remedy}")
    values = {field: sources[f"{name}.{field}"].value for field in of.model_fields}
    values |= {field: _lowered(values[field], limit) for field, limit in limits.items()}
    try:
        return of.model_validate(values, context={"root": root})
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
    if not fault["loc"]:
        raise InputError(f"{place}: {sentence(fault)}")
    field = fault["loc"][0]
    source = sources[f"{name}.{field}"]
    raise InputError(f"{place / source.key}: {sentence(fault, limits.get(field, source.written))}")


def _lowered(value: object, limit: float) -> object:
    """Return a number or a list of them with none above a limit; the section refuses a limit of anything else."""
    if isinstance(value, list):
        return [_lowered(entry, limit) for entry in value]
    if value is None:
        return None
    limit = int(limit) if limit.is_integer() else limit
    return min(value, limit) if isinstance(value, int | float) else limit
