"""Choices: what is doubted about a paper, with the alternatives that each doubt admits.

A choice is an erratum (printed or corrected), something that the paper withholds, a misprint that is searched apart, or
a numerical setting that the paper leaves open. It names the inputs that each of its values sets, or gives the range of
one; docs/universes.md shows how it is written.

An assignment gives some choices a value: the name of an alternative, or a number of the range. It is applied to the
inputs of the reading `corrected`; a choice that it leaves out stays as it is there.
"""

import math
import typing
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from marsedl.replication.errors import InputError, nearest, shown
from marsedl.replication.inputs.messages import Keys, Place
from marsedl.replication.inputs.sections import Inputs

WITHHELD, MISPRINT, SETTING = "withheld", "misprint", "setting"
Value = str | float  # of a choice: the name of an alternative, or a number of its range
Assignment = Mapping[str, Value]


@dataclass(frozen=True)
class Source:
    """Where an input comes from: key, value and unit as written, the reading that sets it, and the value in SI."""

    key: str
    written: object
    unit: str
    source: str
    reading: str
    value: object


Sources = Mapping[str, Source]  # inputs by "section.name"


@dataclass(frozen=True)
class Range:
    """The numbers that an input may take."""

    input: str
    component: int | None
    low: float
    high: float
    is_factor: bool
    scale: str
    to_si: float
    source: str

    def at(self, share: float) -> float:
        """Return the number at a share (0 to 1) of the range, in the unit in which it is written."""
        if self.scale == "log":
            return self.low * (self.high / self.low) ** share
        return self.low + share * (self.high - self.low)

    def share(self, number: float) -> float:
        """Return the share of the range at which a number lies."""
        if self.scale == "log":
            return math.log(number / self.low) / math.log(self.high / self.low)
        return (number - self.low) / (self.high - self.low)

    def applied(self, source: Source, number: float, choice: str) -> Source:
        """Return the input with a number of the range."""
        entries, at = np.array(source.value, dtype=float), () if self.component is None else self.component
        entries[at] = entries[at] * number if self.is_factor else number * self.to_si
        written = (entries / self.to_si).tolist()
        return replace(source, written=written, source=self.source, reading=choice, value=entries.tolist())

    def of(self, value: object) -> float:
        """Return the number at which an input has a value in SI, or 1 if the numbers are factors."""
        entry = np.array(value, dtype=float)[() if self.component is None else self.component]
        return 1.0 if self.is_factor else float(entry) / self.to_si


@dataclass(frozen=True)
class Choice:
    """One doubt about a paper.

    `alternatives` are the values by name, empty if there is a `range`; those `apart` are not combined with others.
    `entered` says when the choice was entered, if that was after results had been seen. `corrected` and `printed` are
    its values in these readings; None if a reading has none of them.
    """

    name: str
    asks: str
    because: str
    entered: str
    only_if: Mapping[str, list[str]]
    alternatives: Mapping[str, Sources]
    range: Range | None
    apart: tuple[str, ...] = ()
    corrected: Value | None = None
    printed: Value | None = None

    @property
    def kind(self) -> str:
        """Whether it is withheld, a misprint, or a setting; else the id of an erratum."""
        return self.because.split()[0].strip(":,.")

    @property
    def erratum(self) -> str:
        """The id of its erratum, or nothing."""
        return "" if self.kind in (WITHHELD, MISPRINT, SETTING) else self.kind

    @property
    def inputs(self) -> tuple[str, ...]:
        """The inputs that it sets."""
        if self.range:
            return (self.range.input,)
        return tuple(dict.fromkeys(name for one in self.alternatives.values() for name in one))

    def sets(self) -> dict[str, object]:
        """Return what the choice sets and how it is varied, without the words about it."""
        alternatives = {
            value: {name: one.value for name, one in sources.items()} for value, sources in self.alternatives.items()
        }
        varied = {"kind": self.kind, "only_if": self.only_if, "apart": self.apart, "corrected": self.corrected}
        limits = asdict(replace(self.range, source="")) if self.range else None
        return {**varied, "alternatives": alternatives, "range": limits}

    def checked(self, value: object, where: str = "") -> Value:
        """Return a value that the choice has; raises InputError with the nearest one otherwise."""
        if self.range is None:
            if value not in self.alternatives:
                problem = f"{where}choice {self.name}: there is no value {shown(value)}"
                raise InputError(f"{problem}; {nearest(str(value), self.alternatives)}")
            return str(value)
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        if not self.range.low <= number <= self.range.high:
            limits = f"{self.range.low:g} and {self.range.high:g}"
            raise InputError(f"{where}choice {self.name}: {shown(value)} is not a number between {limits}")
        return number

    def applied(self, sources: Sources, value: Value) -> dict[str, Source]:
        """Return inputs, by "section.name", with a value of the choice."""
        if self.range is None:
            return {**sources, **self.alternatives[str(value)]}
        if (name := self.range.input) not in sources:  # of an incomplete reading, which is refused as such
            return dict(sources)
        return {**sources, name: self.range.applied(sources[name], float(value), self.name)}

    def value_in(self, sources: Sources, base: Sources) -> Value | None:
        """Return the choice's value in a reading's inputs; None if they have none of its values.

        base: the inputs of `corrected`, which an alternative has where it sets nothing.
        """
        if self.range:
            number = self.range.of(sources[self.range.input].value)
            return number if self.range.low <= number <= self.range.high else None
        for name in self.alternatives:
            if all(self.applied(base, name)[one].value == sources[one].value for one in self.inputs):
                return name
        return None


@dataclass(frozen=True)
class Choices:
    """All choices of a paper, by name, and what makes a universe of them.

    `base` has the values of universes that leave a choice out, where these are not those of `corrected`.
    """

    by_name: Mapping[str, Choice] = field(default_factory=dict)
    base: Assignment = field(default_factory=dict)

    def __iter__(self):
        """Iterate over the choices in the order of the file."""
        return iter(self.by_name.values())

    def __len__(self) -> int:
        """Return their number."""
        return len(self.by_name)

    def default(self, choice: Choice) -> Value | None:
        """Return the value of a choice that an assignment leaves out."""
        return self.base.get(choice.name, choice.corrected)

    def placed(self, printed: Sources, corrected: Sources, places: Mapping[str, Place]) -> "Choices":
        """Return the choices with their values in two readings; InputError for a range of what is no number."""
        placed = {}
        for one in self:
            try:
                values = one.value_in(printed, corrected), one.value_in(corrected, corrected)
            except (IndexError, TypeError, ValueError):
                problem = f"is of no number in {one.range.input}"
                remedy = "name one of a list by 'component', and none of a single number"
                raise InputError(f"{places[one.name] / 'range'}: {problem}; {remedy}") from None
            placed[one.name] = replace(one, printed=values[0], corrected=values[1])
        return Choices(placed)

    def checked(self, assignment: Mapping[str, object], place: object = "") -> dict[str, Value]:
        """Return an assignment in the order of the choices; raises InputError for an unknown choice or value."""
        where = f"{place}: " if place else ""
        for name in assignment:
            if name not in self.by_name:
                raise InputError(f"{where}there is no choice {shown(name)}; {nearest(name, self.by_name)}")
        return {one.name: one.checked(assignment[one.name], where) for one in self if one.name in assignment}

    def complete(self, assignment: Mapping[str, object]) -> dict[str, Value | None]:
        """Return the value of every choice; the default of one that is left out or does not apply.

        Raises InputError as `checked` does.
        """
        given = self.checked(assignment)
        values = {one.name: given.get(one.name, self.default(one)) for one in self}
        for one in self:
            if any(values[other] not in those for other, those in one.only_if.items()):
                values[one.name] = self.default(one)
        return values

    def applied(self, sources: Sources, assignment: Mapping[str, object]) -> dict[str, Source]:
        """Return the inputs of `corrected`, by "section.name", as an assignment changes them.

        Factors come last, on what other choices set.
        """
        complete = self.complete(assignment)
        changed = [one for one in self if complete[one.name] != one.corrected]
        for one in sorted(changed, key=lambda one: one.range is not None):
            sources = one.applied(sources, complete[one.name])
        return dict(sources)


def of_written(written: Mapping[str, typing.Any], model: type[Inputs], places: Mapping[str, Place]) -> Choices:
    """Return the choices of a paper from what is written, as `written_choices` of its typed inputs; places: by name."""
    found = {name: _choice(name, one, model, places[name]) for name, one in written.items()}
    setters: dict[str, Choice] = {}
    for one in found.values():
        for other, those in one.only_if.items():
            at = places[one.name] / "only_if"
            if other not in found:
                raise InputError(f"{at}: there is no choice {shown(other)}; {nearest(other, found)}")
            for value in those:
                if value not in (names := found[other].alternatives):
                    raise InputError(f"{at}: {other} has no value {shown(value)}; {nearest(value, names)}")
        for name in one.inputs if not (one.range and one.range.is_factor) else ():
            key = f"{name}[{one.range.component}]" if one.range and one.range.component is not None else name
            if key in setters and setters[key].name not in one.only_if and one.name not in setters[key].only_if:
                raise InputError(f"{places[one.name]}: {key} is set by the choice '{setters[key].name}' too; join them")
            setters[key] = one
    return Choices(found)


def _choice(name: str, written: typing.Any, model: type[Inputs], place: Place) -> Choice:
    if bool(written.values) == (written.range is not None):
        raise InputError(f"{place}: give either 'values' or 'range'")
    at, limits = place / "values", None
    if written.values and len(written.values) < 2:
        raise InputError(f"{at}: a choice needs at least two values")
    alternatives = {value: inputs_set(model, body, name, at / value) for value, body in written.values.items()}
    for value in written.apart:
        if value not in alternatives:
            raise InputError(f"{place / 'apart'}: there is no value {shown(value)}; {nearest(value, alternatives)}")
    if one := written.range:
        key, source = source_of_key(model, one.input, 1.0, place / "range" / "input")
        low, high = one.between or one.factor
        limits = Range(key, one.component, low, high, one.factor is not None, one.scale, source.value, one.source)
    about = written.asks, written.because, written.entered, written.only_if
    return Choice(name, *about, alternatives, limits, tuple(written.apart))


def inputs_set(model: type[Inputs], body: Keys, name: str, place: Place) -> dict[str, Source]:
    """Return the inputs that a reading or an alternative sets, by "section.name"; `name` is what sets them."""
    found: dict[str, Source] = {}
    for section, of in model.sections().items():
        for key, entry in getattr(body, section).items():
            (field, factor, unit), at = of.keys()[key], place / section / key
            if entry.unit not in ("", unit):
                raise InputError(f"{at / 'unit'}: is {shown(entry.unit)}, must be '{unit}'")
            source = Source(key, entry.value, unit, entry.source, name, in_si(entry.value, factor))
            if (other := found.setdefault(f"{section}.{field}", source)) is not source:
                raise InputError(f"{at}: '{field}' is set twice, also as '{other.key}'")
    return found


def in_si(value: object, factor: float) -> object:
    """Return a value in SI; what is no number is left to its section to refuse."""
    if isinstance(value, list):
        return [in_si(entry, factor) for entry in value]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return value * factor if is_number and factor != 1.0 else value


def source_of_key(model: type[Inputs], key: str, value: object, place: object = "universe") -> tuple[str, Source]:
    """Return the input "section.name" that a key "section.key" sets, and its source.

    Raises InputError naming the place and the nearest key.
    """
    keys = {f"{name}.{one}": (name, found) for name, of in model.sections().items() for one, found in of.keys().items()}
    if key not in keys:
        raise InputError(f"{place}: there is no input {shown(key)}; {nearest(key, keys)}")
    section, (target, factor, unit) = keys[key]
    written = key.partition(".")[2]
    return f"{section}.{target}", Source(written, value, unit, "given by hand", str(place), in_si(value, factor))


def in_words(name: object) -> str:
    """Return the name of a choice or of a value, or the number of a range, as it is shown."""
    return f"{name:.3g}" if isinstance(name, float) else str(name).replace("_", " ")
