"""Typed inputs and readings: everything a paper's stages may depend on, checked before any job is planned.

A reading is a complete, named set of inputs. It is written as the inputs that differ from the reading it is `based_on`;
each input has a value, a source and, if one likes, its unit. Angles are written with the suffix `_deg`, lengths in
kilometres with `_km`; inside, everything is SI and radians.
"""

import difflib
import hashlib
import json
import math
import re
import typing
import unicodedata
from dataclasses import dataclass, field, replace
from pathlib import Path

import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    ValidationError,
    WithJsonSchema,
    field_validator,
)
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.cyaml import CParser
from yaml.resolver import Resolver

from marsedl.replication.errors import InputError
from marsedl.replication.terminal import printable

# Suffixes under which a quantity of an SI unit may be written, with their factors.
SUFFIXES = {
    "rad": {"_deg": 0.017453292519943295},
    "rad/s": {"_deg_s": 0.017453292519943295},
    "rad/s^2": {"_deg_s2": 0.017453292519943295},
    "m": {"_km": 1000.0},
    "m/s": {"_km_s": 1000.0},
}
SUFFIX_ONLY = ("rad", "rad/s", "rad/s^2")  # an angle without its unit in the name is too easily taken for degrees
KNOWN_SUFFIXES = (
    *(suffix for accepted in SUFFIXES.values() for suffix in accepted),
    *("_rad", "_m", "_s", "_ms", "_h", "_kg", "_g", "_lb", "_t", "_N", "_kN", "_percent", "_ft", "_mi", "_m_s", "_K"),
)

COMMITTED_INPUTS = Path("data/reference/inputs.json")
# Limits of a configuration. The project's own are a tenth of them; the largest that is admitted is read in seconds.
LARGEST_FILE = 2**18  # bytes
MOST_VALUES = 20_000  # keys, values and lists in a file
LONGEST_LIST = 5_000
LONGEST_NUMBER = 1_000  # characters
DEEPEST = 20  # lists or keys inside of one another
MOST_READINGS = 200  # of a user's own, of one paper

# Magnitudes that no quantity here has, in any SI unit: what lies beyond is a slip, and overflows when it is squared.
SMALLEST, LARGEST = 1e-30, 1e30
LARGEST_ANGLE = 20 * math.pi  # rad; ten turns

SETTINGS = ("size", "chunks")  # at the top of a user's configuration, beside the papers
LONGEST_REASON = 5000  # characters of a message
INVISIBLE_LETTERS = "\u115f\u1160\u3164\uffa0"  # letters to Unicode, blank to a reader


def _no_stand_in(value):
    """Refuse what Python takes for equal to a whole number, of which a Literal would make one."""
    if isinstance(value, bool | float):
        raise ValueError("Input should be a whole number, 1 or -1")
    return value


# Strict: neither text nor true/false passes for a number.
Number = typing.Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = typing.Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)]
NonNegative = typing.Annotated[float, Strict(), Field(ge=0, allow_inf_nan=False)]
Fraction = typing.Annotated[float, Strict(), Field(gt=0, lt=1)]
Count = typing.Annotated[int, Strict(), Field(gt=0, le=1_000_000_000)]  # of flights in constant memory
CountOrNone = typing.Annotated[int, Strict(), Field(ge=0, le=1_000_000_000)]
Sign = typing.Annotated[typing.Literal[-1, 1], BeforeValidator(_no_stand_in)]
Seed = typing.Annotated[int, Strict(), Field(ge=0, lt=2**63)]


def at_most(most: int, reason: str) -> type:
    """Return the type of a whole number from 1 to `most`; the message beyond it gives the reason."""

    def check(value):
        if value > most:
            raise ValueError(f"should be at most {most}: {reason}")
        return value

    schema = WithJsonSchema({"type": "integer", "exclusiveMinimum": 0, "maximum": most})
    return typing.Annotated[int, Strict(), Field(gt=0), AfterValidator(check), schema]


Few = at_most(10_000, "each costs a computation of its own")
Drawn = at_most(10_000, "a figure shows no more")
Iterations = at_most(1_000_000, "what has not converged by then does not")
StudyTrials = at_most(10_000_000, "a study keeps all of its trials in memory")


def vector(length: int, of: type = Number) -> type:
    """Return the type of a list of `length` numbers."""
    return typing.Annotated[tuple[of, ...], Field(min_length=length, max_length=length)]


def covariance(size: int) -> type:
    """Return the type of a positive definite covariance (size, size), written whole or as its diagonal."""
    import numpy as np

    def check(value):
        if len(value) != size:  # before a matrix is made of it
            raise ValueError(
                f"has size {len(value)}, must have size {size}: give {size} variances, or {size} rows of {size} numbers"
            )
        if all(isinstance(entry, float) for entry in value):
            matrix = np.diag(np.array(value, dtype=float))
        elif all(isinstance(row, tuple) and len(row) == len(value) for row in value):
            matrix = np.array(value, dtype=float)
        else:
            raise ValueError(f"must be {size} variances, or {size} rows of {size} numbers")
        if not np.all(np.isfinite(matrix)):
            raise ValueError("has an entry that is not finite")
        asymmetry = np.abs(matrix - matrix.T)
        if np.any(asymmetry > 1e-12 * np.abs(matrix).max()):
            row, column = np.unravel_index(np.argmax(asymmetry), matrix.shape)
            raise ValueError(
                f"is not symmetric: entry ({row + 1}, {column + 1}) is {matrix[row, column]:g}, "
                f"entry ({column + 1}, {row + 1}) is {matrix[column, row]:g}"
            )
        # Scaled to unit diagonal, so that the units of the components do not decide what counts as singular.
        scale = np.sqrt(np.abs(np.diag(matrix)))
        smallest = np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min() if np.all(scale > 0) else 0.0
        if np.any(np.diag(matrix) <= 0) or smallest <= 1e-12:
            raise ValueError(
                f"is not positive definite: its smallest eigenvalue is {np.linalg.eigvalsh(matrix).min():g}; "
                "give variances above zero and correlations between -1 and 1"
            )
        return tuple(tuple(row) for row in matrix.tolist())

    entry = Number | tuple[Number, ...]
    return typing.Annotated[tuple[entry, ...], AfterValidator(check)]


def given(unit: str, meaning: str, **constraints):
    """Declare an input: its SI unit ("1" for none) and what it is; constraints go to `pydantic.Field`."""
    return Field(json_schema_extra={"unit": unit}, description=meaning, **constraints)


class Inputs(BaseModel):
    """Base of every paper's typed inputs: no unknown keys, no changes after validation, no silent conversions."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    # Monte Carlo ensembles of the paper, with the input that holds their number of trials.
    CASES: typing.ClassVar[dict[str, str]] = {}

    @field_validator("*")
    @classmethod
    def _plausible(cls, value, info):
        unit = cls.unit(info.field_name)
        single = isinstance(value, float)
        for number in (value,) if single else value if isinstance(value, tuple) else ():
            if isinstance(number, tuple):  # a row, in which a tiny number may be the rounding of zero
                if any(isinstance(entry, float) and abs(entry) > LARGEST for entry in number):
                    raise ValueError(f"has a number above {LARGEST:g}: check it and its unit")
            elif isinstance(number, float) and number and not SMALLEST <= abs(number) <= LARGEST:
                raise ValueError(
                    f"{number:g} is neither 0 nor between {SMALLEST:g} and {LARGEST:g}: check the number and its unit"
                )
            elif unit == "rad" and isinstance(number, float) and abs(number) > LARGEST_ANGLE:
                raise ValueError(
                    f"{math.degrees(number):g} deg are more than ten turns, {math.degrees(LARGEST_ANGLE):g} deg: "
                    "check the angle and its unit"
                )
        return value

    @classmethod
    def unit(cls, name: str) -> str:
        """Return the SI unit of an input."""
        return cls.model_fields[name].json_schema_extra["unit"]

    @classmethod
    def keys(cls) -> dict[str, tuple[str, float]]:
        """Return every key that a file may use, with the input it sets and the factor to SI."""
        accepted = {}
        for name in cls.model_fields:
            unit = cls.unit(name)
            if unit not in SUFFIX_ONLY:
                accepted[name] = (name, 1.0)
            for suffix, factor in SUFFIXES.get(unit, {}).items():
                accepted[name + suffix] = (name, factor)
        return accepted


@dataclass(frozen=True)
class Source:
    """Where an input comes from, the key and value as they are written, and the reading that sets it."""

    key: str
    written: object
    source: str
    reading: str


@dataclass(frozen=True)
class Reading:
    """A complete, named set of inputs."""

    name: str
    summary: str
    based_on: str | None
    frozen: str
    inputs: Inputs
    sources: dict[str, Source]
    origin: str = field(default="")

    def slice(self, names: typing.Iterable[str]) -> dict:
        """Return the named inputs as plain numbers, strings and nested lists, in the order of their names."""
        values = self.inputs.model_dump(mode="json")
        return {name: values[name] for name in sorted(names)}

    def flown(self) -> dict[str, int]:
        """Return the Monte Carlo cases with their numbers of trials; a case without trials is left out."""
        trials = {case: getattr(self.inputs, name) for case, name in self.inputs.CASES.items()}
        return {case: number for case, number in trials.items() if number}

    def differences(self) -> dict[str, Source]:
        """Return the inputs that this reading sets itself."""
        return {name: source for name, source in self.sources.items() if source.reading == self.name}


@dataclass(frozen=True)
class Study:
    """All of a paper's configuration: its readings and the number of chunks of each Monte Carlo case.

    `compared` are the readings in which claims are evaluated; a smaller size may leave some out.
    """

    paper: str
    readings: dict[str, Reading]
    chunks: dict[str, int]
    compared: tuple[str, ...]


class _StrictLoader(Composer, CParser, SafeConstructor, Resolver):
    """YAML within limits and without repeated keys, anchors, aliases or tags: what is read is what is written there."""

    def __init__(self, text):
        CParser.__init__(self, text)
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        Resolver.__init__(self)
        self._values = self._depth = 0

    def compose_node(self, parent, index):
        event = self.peek_event()
        self._values += 1
        if getattr(event, "anchor", None) is not None:
            raise _at(event, "anchors and aliases are not used here; write it out")
        if getattr(event, "tag", None) is not None:
            raise _at(event, f"the tag {_shown(event.tag)} is not used here; write the plain value")
        if self._values > MOST_VALUES:
            raise _at(event, f"more than {MOST_VALUES} keys and values; leave some out")
        if isinstance(index, int) and index >= LONGEST_LIST:
            raise _at(event, f"a list of more than {LONGEST_LIST} entries; shorten it")
        if self._depth >= DEEPEST:
            raise _at(event, f"lists or keys more than {DEEPEST} deep; write them flat")
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_object(self, node, deep=False):
        try:
            return super().construct_object(node, deep)
        except ValueError as error:  # such as a date in month 13
            raise _at(node, f"{error}; write another value") from None

    def construct_mapping(self, node, deep=False):
        seen = {}
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                raise _at(key_node, "'<<' is not used here; write it out")
            key = self.construct_object(key_node, deep=True)
            try:
                repeated = key in seen
            except TypeError:
                raise _at(key_node, "a key must be a plain name; write one") from None
            if repeated:
                raise _at(key_node, f"the key {_shown(key)} stands twice; leave one out")
            seen[key] = True
        return super().construct_mapping(node, deep)

    def construct_decimal(self, node):
        """Numbers as they look: to YAML, 1:30 is ninety and 017 is fifteen."""
        if len(node.value) > LONGEST_NUMBER:
            raise _at(node, f"a number of {len(node.value)} characters; write it shorter, as in 1.0e+6")
        if ":" in node.value or re.fullmatch(r"[-+]?0[0-7_]+", node.value):
            base = 60 if ":" in node.value else 8
            raise _at(node, f"YAML reads {_shown(node.value)} to base {base}; write a decimal")
        construct = self.construct_yaml_int if node.tag.endswith(":int") else self.construct_yaml_float
        return construct(node)


_StrictLoader.add_constructor("tag:yaml.org,2002:int", _StrictLoader.construct_decimal)
_StrictLoader.add_constructor("tag:yaml.org,2002:float", _StrictLoader.construct_decimal)


def _at(event, reason: str) -> yaml.YAMLError:
    """Return the error that something is wrong in a line."""
    return yaml.YAMLError(f"line {event.start_mark.line + 1}: {reason}")


def read_yaml(path: Path, remedy: str = "restore it") -> object:
    """Read a YAML file strictly; an unreadable or malformed one is an InputError naming file and line.

    remedy: what to do if there is no such file, or none that can be read.
    """
    name = printable(str(path))
    try:
        path = Path(path)
        if path.exists() and not path.is_file() and not path.is_dir():  # it may never end, or be read only once
            raise InputError(f"{name}: is no ordinary file; save it as one")
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except (OSError, RuntimeError) as error:  # the latter of a loop of links
        raise InputError(f"{name}: cannot be read ({getattr(error, 'strerror', error)}); {remedy}") from None
    if len(content) > LARGEST_FILE:
        raise InputError(f"{name}: is larger than {LARGEST_FILE} bytes, so it is no configuration; name another file")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(f"{name}: is not valid YAML: line {line}: no UTF-8; save the file in this encoding") from None
    if unfit := yaml.reader.Reader.NON_PRINTABLE.search(text):
        line = text.count("\n", 0, unfit.start()) + 1
        raise InputError(f"{name}: is not valid YAML: line {line}: has the character {unfit[0]!r}; remove it")
    try:
        return yaml.load(text, Loader=_StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        reason = printable(error.problem or error.context)
        line = text.split("\n")[mark.line] if mark.line < text.count("\n") + 1 else ""
        remedy = "indent with spaces, not with tabs" if re.match(r" *\t", line) else "mend it"
        if "another document" in reason:
            reason, remedy = "a second document begins", "keep one in a file"
        raise InputError(f"{name}: is not valid YAML: line {mark.line + 1}: {reason}; {remedy}") from None
    except yaml.YAMLError as error:
        raise InputError(f"{name}: is not valid YAML: {printable(str(error).splitlines()[0])}") from None


def read_own_file(path: Path, known: typing.Iterable[str]) -> dict:
    """Read a user's own configuration: keys with values, and only the known ones at its top.

    Snakemake reads such a file too, and would run what stands under `__use_yte__` in it. Whoever reads one reads it
    with this first, so that all refuse the same files with the same words.
    """
    document = read_yaml(path, "check its path and permissions; write targets before --configfile, not after it")
    name = printable(str(path))
    if not isinstance(document, dict):
        shown = "nothing" if document is None else _shown(document)
        raise InputError(f"{name}: must be keys with values, not {shown}; begin with one of {', '.join(known)}")
    return _mapping(document, name, "", set(known))


def nearest(name: str, known: typing.Iterable[str]) -> str:
    """Return a remedy sentence: the nearest valid name, or all of them if none is near."""
    known = sorted(known)
    matches = difflib.get_close_matches(name, known, n=1) if isinstance(name, str) and len(name) <= 100 else []
    return f"did you mean '{matches[0]}'?" if matches else f"valid names: {', '.join(known)}"


def load_study(
    paper: str, model: type[Inputs], path: Path, *, overlay: object = None, overlay_name: str = "", size: str = "full"
) -> Study:
    """Load a paper's readings from its configuration, and a user's own from an overlay.

    Arguments: the paper's slug; its typed inputs; the file; the paper's part of a user's own configuration with the
    name of the file it came from; the size ("full", or one that the file defines).
    Returns the study. Raises InputError: one message with file, key, what is wrong and the remedy.
    """
    sections = {"readings", "chunks", "sizes"}
    required = sections - {"sizes"} if model.CASES else {"readings"}
    document = _mapping(read_yaml(path), str(path), "", sections, required=required)
    chunks = _mapping(document.get("chunks", {}), str(path), "chunks", set(model.CASES), required=set(model.CASES))
    for case, number in chunks.items():
        if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= 100_000:
            raise InputError(f"{path}: chunks.{case}: {_shown(number)} is not a whole number from 1 to 100000")
    raw = {}
    for name, body in _mapping(document["readings"], str(path), "readings").items():
        raw[name] = (str(path), body)
    if overlay is not None:
        body = _mapping(overlay, overlay_name, paper, {"readings"}, required={"readings"})
        own = _mapping(body["readings"], overlay_name, f"{paper}.readings")
        if len(own) > MOST_READINGS:
            raise InputError(
                f"{overlay_name}: {paper}.readings: {len(own)} readings are more than {MOST_READINGS}; "
                "write several files and run them one after the other"
            )
        for name, reading in own.items():
            if name in raw:
                raise InputError(
                    f"{overlay_name}: {paper}.readings.{name}: the name is taken by a reading of {raw[name][0]}; "
                    f"choose another name and write 'based_on: {name}'"
                )
            raw[name] = (overlay_name, reading)
    sizes = _mapping(document.get("sizes", {}), str(path), "sizes")
    if size != "full" and size not in sizes:
        raise InputError(f"--config size={_bare(size)}: {path} defines no such size; {nearest(size, ['full', *sizes])}")
    limits = dict(_mapping(sizes[size], str(path), f"sizes.{size}")) if size != "full" else {}
    left_out = _left_out(limits.pop("readings", None), document["readings"], f"{path}: sizes.{size}.readings")
    limits = _limits(limits, str(path), f"sizes.{size}", model)
    readings = {}
    for name in raw:
        for link in reversed(_lineage(name, raw, readings)):
            readings[link] = _reading(link, raw, readings, model)
    # Only now, so that a reading is what is written, whatever the size: frozen ones are compared with their digest.
    limited = {name: _limited(reading, limits, f"{path}: sizes.{size}") for name, reading in readings.items()}
    return Study(paper, limited, chunks, tuple(name for name in readings if name not in left_out))


def counted_inputs(study: Study) -> str:
    """Return the digest of the resolved inputs of the readings in which verdicts count."""
    counted = {name: study.readings[name].inputs.model_dump(mode="json") for name in ("printed", "corrected")}
    return hashlib.sha256(json.dumps(counted, sort_keys=True).encode()).hexdigest()[:12]


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

    Arguments: the papers' input models by slug; the folder of their configurations; the user's configuration (a
    paper's slug with readings; `size`; `chunks`); the files that it was read from.
    Returns the studies by slug. Raises InputError before anything is computed.
    """
    known = (*models, *SETTINGS)
    for path in config_files:
        read_own_file(path, known)
    origin = ", ".join(printable(str(path)) for path in config_files) or "--config"
    _mapping(config, origin, "", set(known))
    chunks = config.get("chunks")
    if chunks is not None and (isinstance(chunks, bool) or not isinstance(chunks, int) or not 1 <= chunks <= 100_000):
        raise InputError(f"{origin}: chunks: {_shown(chunks)} is not a whole number from 1 to 100000")
    studies = {}
    for slug, model in models.items():
        study = load_study(
            slug,
            model,
            folder / f"{slug}.yaml",
            overlay=config.get(slug),
            overlay_name=origin,
            size=str(config.get("size", "full")),
        )
        studies[slug] = study if chunks is None else replace(study, chunks=dict.fromkeys(study.chunks, chunks))
    return studies


def _left_out(compared, known, where) -> set[str]:
    """The readings that a size does not compare, of those which the paper's file defines."""
    if compared is None:
        return set()
    if not isinstance(compared, list) or not {"printed", "corrected"} <= {str(name) for name in compared}:
        raise InputError(f"{where}: {_shown(compared)} is not a list of readings with printed and corrected")
    for name in compared:
        if name not in known:
            raise InputError(f"{where}: there is no reading {_shown(name)}; {nearest(name, known)}")
    return set(known) - set(compared)


def _limits(limits, path, where, model) -> dict[str, int | float]:
    """Return the limits of a size, whole or decimal numbers above zero."""
    for name, limit in _mapping(limits, path, where, set(model.model_fields)).items():
        if isinstance(limit, bool) or not isinstance(limit, int | float) or not limit > 0:
            raise InputError(f"{path}: {where}.{name}: {_shown(limit)} is not a number above zero")
    return limits


def _limited(reading: Reading, limits: dict[str, int | float], where: str) -> Reading:
    """Return the reading with no input, and no number in one, above its limit."""
    smaller = {}
    for name, limit in limits.items():
        value = getattr(reading.inputs, name)
        if value is None:
            continue
        numbers = value if isinstance(value, tuple) else (value,)
        if not all(isinstance(number, int | float) for number in numbers):
            raise InputError(f"{where}.{name}: only numbers can be limited, and it is {_shown(value)}")
        if all(isinstance(number, int) for number in numbers) and not isinstance(limit, int):
            raise InputError(f"{where}.{name}: {_shown(limit)} is not a whole number")
        if max(numbers) > limit:
            smaller[name] = tuple(min(number, limit) for number in numbers) if isinstance(value, tuple) else limit
    return replace(reading, inputs=reading.inputs.model_copy(update=smaller)) if smaller else reading


def _lineage(name, raw, done) -> list[str]:
    """Return a reading and those that it is based on in turn, up to one that is done or stands alone."""
    names = [name]
    while True:
        name = names[-1]
        origin, body = raw[name]
        if not isinstance(name, str) or not re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name):
            raise InputError(
                f"{origin}: readings.{_bare(name)}: a reading's name is lower case letters, digits and _, at most 40 "
                "of them; rename it"
            )
        if periodic := re.search(r"(.+?)\1{19,}$", name):
            raise InputError(
                f"{origin}: readings.{name}: the name ends in {periodic[1]!r} over and over, by which Snakemake knows "
                "rules that call themselves; rename it"
            )
        where = f"readings.{name}"
        based_on = _mapping(body, origin, where, {"summary", "based_on", "frozen", "inputs"}).get("based_on")
        if based_on is None or (isinstance(based_on, str) and based_on in done):
            return names
        if not isinstance(based_on, str):
            raise InputError(f"{origin}: {where}.based_on: must be the name of a reading, not {_shown(based_on)}")
        if based_on not in raw:
            raise InputError(
                f"{origin}: {where}.based_on: there is no reading {_shown(based_on)}; {nearest(based_on, raw)}"
            )
        if based_on in names:
            raise InputError(
                f"{origin}: {where}.based_on: '{based_on}' is in the end based on '{name}' itself; name another reading"
            )
        names.append(based_on)


def _reading(name, raw, done, model) -> Reading:
    """Return a reading, of which that which it is based on is done."""
    origin, body = raw[name]
    where = f"readings.{name}"
    summary, based_on, frozen = body.get("summary", ""), body.get("based_on"), body.get("frozen", "")
    if not isinstance(summary, str):
        raise InputError(f"{origin}: {where}.summary: must be a sentence, not {_shown(summary)}")
    _check_characters(summary, origin, f"{where}.summary")
    if not isinstance(frozen, str):
        raise InputError(f"{origin}: {where}.frozen: must be the digest of the reading's inputs, not {_shown(frozen)}")
    sources, values = {}, {}
    if based_on is not None:
        sources, values = dict(done[based_on].sources), dict(done[based_on].inputs.model_dump())
    fresh = {}
    accepted = model.keys()
    for key, entry in _mapping(body.get("inputs", {}), origin, f"{where}.inputs").items():
        name_si, factor = _accepted_key(key, accepted, model, origin, where)
        place = f"{where}.inputs.{key}"
        if not isinstance(entry, dict):
            raise InputError(f'{origin}: {place}: write {{value: ..., source: "..."}}, not {_shown(entry)}')
        entry = _mapping(entry, origin, place, {"value", "unit", "source"}, required={"value", "source"})
        _check_source(entry["source"], origin, place)
        unit = model.unit(name_si) if key == name_si else key.removeprefix(f"{name_si}_").replace("_", "/")
        if "unit" in entry and entry["unit"] != unit:
            raise InputError(f"{origin}: {place}.unit: is {_shown(entry['unit'])}, must be '{unit}'")
        if name_si in fresh:
            raise InputError(f"{origin}: {place}: '{name_si}' is set twice, also as '{fresh[name_si]}'")
        fresh[name_si] = key
        sources[name_si] = Source(key, entry["value"], entry["source"], name)
        values[name_si] = _scaled(entry["value"], factor, origin, place)
    missing = [field_name for field_name in model.model_fields if field_name not in sources]
    if missing:
        remedy = "give it, or name a complete reading under based_on"
        raise InputError(f"{origin}: {where}.inputs: '{missing[0]}' ({model.unit(missing[0])}) is missing; {remedy}")
    try:
        inputs = model.model_validate(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field_name = str(first["loc"][0]) if first["loc"] else ""
        source = sources.get(field_name)
        key = f"inputs.{source.key}" if source else "inputs"
        message = first["msg"].removeprefix("Value error, ").replace("valid tuple", "list of numbers")
        shown = f" (given: {_shown(source.written)})" if source else ""
        # What a validator says of a file may hold whatever stands in its name.
        message = printable(message[:LONGEST_REASON])
        raise InputError(f"{origin}: {where}.{key}: {message}{shown}{_number_hint(first['input'])}") from None
    # One that is taken over from another reading is how many are drawn at most.
    if "drawn_trials" in fresh and inputs.drawn_trials > inputs.trials:
        raise InputError(
            f"{origin}: {where}.inputs.drawn_trials: {inputs.drawn_trials} is more than trials ({inputs.trials}): "
            "lower it"
        )
    _check_frozen(frozen, name, values, origin)
    return Reading(name, summary, based_on, frozen, inputs, sources, origin)


def _mapping(value, origin, place, allowed=None, required=frozenset()) -> dict:
    """Return value if it is a mapping with allowed keys only; the message names the nearest valid key."""
    where = f"{origin}: {place}: " if place else f"{origin}: "
    if not isinstance(value, dict):
        raise InputError(f"{where}must be keys with values, not {_shown(value)}")
    for key in value:
        if not isinstance(key, str):
            raise InputError(f"{where}the key {_shown(key)} must be a name")
        if allowed is not None and key not in allowed:
            raise InputError(f"{where}unknown key {_shown(key)}; {nearest(key, allowed)}")
    for key in sorted(required):
        if key not in value:
            raise InputError(f"{where}the key '{key}' is missing; add it")
    return value


def _check_frozen(frozen, name, values, origin) -> None:
    digest = hashlib.sha256(json.dumps(values, sort_keys=True, default=str).encode()).hexdigest()[:12]
    if frozen and frozen != digest:
        raise InputError(
            f"{origin}: readings.{name}: is frozen, and its inputs have changed (their digest is {digest}, not "
            f"{frozen}); "
            f"undo the change and write it into a reading of your own that is based_on: {name}"
        )


def _accepted_key(key, accepted, model, origin, where) -> tuple[str, float]:
    if key in accepted:
        return accepted[key]
    for name in model.model_fields:
        if key != name and not (key.startswith(name + "_") and key.removeprefix(name) in KNOWN_SUFFIXES):
            continue
        unit = model.unit(name)
        ways = [k for k, (target, _) in accepted.items() if target == name]
        suffix = key.removeprefix(name)
        problem = f"has the wrong unit suffix '{suffix}'" if suffix else "needs its unit in its name"
        raise InputError(f"{origin}: {where}.inputs.{key}: {problem}; the unit is {unit}, write '{ways[0]}'")
    raise InputError(f"{origin}: {where}.inputs: unknown key {_shown(key)}; {nearest(key, accepted)}")


def _check_source(source, origin, place) -> None:
    if not isinstance(source, str) or not _visible(source):
        raise InputError(f"{origin}: {place}.source: say where the value comes from, or 'assumed: why'")
    _check_characters(source, origin, f"{place}.source")
    if source.startswith("assumed") and not (re.match(r"assumed: \S", source) and _visible(source[len("assumed: ") :])):
        raise InputError(f"{origin}: {place}.source: write 'assumed: ' and the reason")


def _visible(text: str) -> bool:
    """Whether a reader sees a letter or a digit of a text."""
    return any(c.isalnum() and c not in INVISIBLE_LETTERS for c in text)


def _check_characters(text, origin, place) -> None:
    """Refuse what no file or terminal can show: control characters and lone surrogates."""
    unfit = next((c for c in text if c not in "\n\t" and unicodedata.category(c) in ("Cc", "Cs")), None)
    if unfit is not None:
        raise InputError(f"{origin}: {place}: has the character {unfit!r}, which cannot be shown; remove it")


def _scaled(value, factor, origin, place):
    if factor == 1.0 or value is None:
        return value
    if isinstance(value, list):
        return [_scaled_number(entry, factor, origin, place) for entry in value]
    return _scaled_number(value, factor, origin, place)


def _scaled_number(value, factor, origin, place):
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{origin}: {place}: must be a number, not {_shown(value)}")
    try:
        return value * factor
    except OverflowError:  # of a whole number with more than 308 digits
        raise InputError(f"{origin}: {place}: {_shown(value)} is too large") from None


def _shown(value: object) -> str:
    """Return a value as a message shows it: short, and never an error of its own."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of thousands of digits, or lists inside of lists without end
        return f"a {type(value).__name__} too large to show"
    return text if len(text) <= 100 else text[:97] + "..."


def _bare(name: object) -> str:
    """Return a name as it is, or as `_shown` if it is none."""
    return name if isinstance(name, str) and re.fullmatch(r"\S{1,60}", name) and name.isprintable() else _shown(name)


def _number_hint(value) -> str:
    if isinstance(value, str) and re.fullmatch(r"[+-]?\d+[eE][+-]?\d+", value.strip()):
        return "; YAML takes this for text: write the number with a point, as in 1.0e-3"
    return ""
