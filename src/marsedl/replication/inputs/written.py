"""What a configuration may hold, as it is written: models that check it."""

import functools
import re
import typing

from pydantic import AfterValidator, BeforeValidator, Field, Strict, create_model, model_validator

from marsedl.replication.errors import nearest
from marsedl.replication.inputs import RESERVED
from marsedl.replication.inputs.messages import Keys
from marsedl.replication.inputs.sections import KNOWN_SUFFIXES, Inputs, Number, Section

READ_AS_MISSING = ("nan", "null")  # by pandas, in tables; it is not imported here, which takes time


def _reading_name(name: str) -> str:
    if not re.fullmatch("[a-z][a-z0-9_]{0,39}", name):
        raise ValueError("a reading's name is lower case letters, digits and _, at most 40 of them; rename it")
    if name in READ_AS_MISSING:
        raise ValueError(f"pandas reads the name {name!r} in a table as no value; rename it")
    if name in RESERVED:
        raise ValueError(f"{name!r} is the name of a folder among those of readings; rename it")
    return name


def _reason(source: str) -> str:
    if not any(map(str.isalnum, source)):
        raise ValueError("say where the value comes from, or 'assumed: why'")
    if source.startswith("assumed") and not re.match(r"assumed: .*\w", source):
        raise ValueError("write 'assumed: ' and the reason")
    return source


Name = typing.Annotated[str, AfterValidator(_reading_name)]
Source = typing.Annotated[str, AfterValidator(_reason)]
Limit = typing.Annotated[float, Strict(), Field(gt=0)]
Chunks = typing.Annotated[int, Strict(), Field(ge=1, le=100_000)]
Trials = typing.Annotated[int, Strict(), Field(ge=1, le=100_000_000)]


class Sourced(Keys):
    """An input as it is written."""

    value: typing.Any
    unit: str = ""  # again, for the reader
    source: Source


class WrittenReading(Keys):
    """Base of a reading as it is written: what it is for, and the inputs that it sets, by section."""

    inputs: typing.ClassVar[type[Inputs]]
    summary: str = ""  # in a sentence, what the reading is for
    based_on: Name | None = None  # the reading from which the inputs are taken that are not given here
    choices: dict[str, str | Number] = Field({})  # their values, by name
    frozen: str = Field("", pattern="^([0-9a-f]{12})?$")  # the digest of inputs that must not change

    @classmethod
    def unknown(cls, key: str) -> str:
        """Return what is wrong with a key: its place or its spelling."""
        if section := _section_of(key, cls.inputs):
            return f"stands in the section '{section}'; write '{section}: {{{key}: ...}}'"
        return super().unknown(key)


class Settings(Keys):
    """Base of a user's own configuration."""

    size: str = "full"  # of the build: or one under `sizes` in configs/*.yaml
    chunks: Chunks | None = None  # into how many jobs the trials of every case are divided
    universes: Chunks | None = None  # so many fill the space of choices, and all are varied alone
    trials: Trials | None = None  # of every law and condition of the arena


def _section_of(key: str, inputs: type[Inputs]) -> str:
    """Return the name of the section in which a key belongs; empty if it belongs in none."""
    return next((name for name, section in inputs.sections().items() if key in dict(section.keys())), "")


def _section(section: type[Section], inputs: type[Inputs]) -> typing.Any:
    """Return the type of a section as it is written; values are checked with all others of the section, in SI."""
    accepted = section.keys()

    def known(key: str) -> str:
        if key in accepted:
            return key
        for way, (name, _, _) in accepted.items():
            suffix = key.removeprefix(name)
            if key == name or (key.startswith(name) and suffix in KNOWN_SUFFIXES):
                problem = f"has the wrong unit suffix '{suffix}'" if suffix else "needs its unit in its name"
                raise ValueError(f"{problem}; the unit is {section.unit(name)}, write '{way}'")
        other = _section_of(key, inputs)
        remedy = f"it stands in the section '{other}'" if other else nearest(key, [*accepted, "source"])
        raise ValueError(f"unknown key; {remedy}")

    def handed_down(body: typing.Any) -> typing.Any:  # the source of the section, to all inputs that name none
        if not isinstance(body, dict) or "source" not in body:
            return body
        common = {"source": body["source"]}
        return {k: common | entry if isinstance(entry, dict) else entry for k, entry in body.items() if k != "source"}

    key = typing.Annotated[str, AfterValidator(known)]
    return typing.Annotated[dict[key, Sourced], BeforeValidator(handed_down)]


@functools.cache
def written_reading(inputs: type[Inputs]) -> type[WrittenReading]:
    """Return the model of a reading of a paper, or of a scenario, as it is written."""
    sections = {name: (_section(of, inputs), {}) for name, of in inputs.sections().items()}
    reading = create_model(f"ReadingOf{inputs.__name__}", __base__=WrittenReading, **sections)
    reading.inputs = inputs
    return reading


def _readings(inputs: type[Inputs]) -> type[dict[str, WrittenReading]]:
    """Return the type of the readings of a paper, by name."""
    return dict[Name, written_reading(inputs)]


class WrittenRange(Keys):
    """The numbers that an input may take, or the factors on its value in the reading `corrected`."""

    input: str  # as section.key, with the unit suffix in which `between` is written
    component: int | None = Field(None, ge=0)  # of a list: which of its numbers, counted from 0
    between: tuple[float, float] | None = None  # the least and the largest number
    factor: tuple[float, float] | None = None  # the least and the largest factor, instead
    scale: typing.Literal["linear", "log"] = "linear"  # in what it is uniform
    source: Source  # of these limits

    @model_validator(mode="after")
    def _ascends(self):
        if (self.between is None) == (self.factor is None):
            raise ValueError("give either 'between' or 'factor'")
        low, high = self.between or self.factor
        if not low < high:
            raise ValueError(f"the limits {low:g} and {high:g} do not ascend")
        if (self.scale == "log" or self.factor) and low <= 0:
            raise ValueError(f"a factor and a logarithmic scale need positive limits, not {low:g}")
        return self


class WrittenChoice(Keys):
    """Base of a choice as it is written: what is doubted, and its values or its range."""

    asks: str  # the question that the choice answers, in a sentence
    because: str = Field(pattern=r"^(E\d+|withheld|misprint|setting)\b")  # with a remark if one likes
    entered: str = ""  # when, if that was after results had been seen
    only_if: dict[str, list[str]] = Field({})  # by other choices, their values without which this one changes nothing
    apart: list[str] = Field([])  # values not combined with others: a misprint, or what something printed rules out
    range: WrittenRange | None = None  # numbers that an input may take, instead of values


class WrittenUniverses(Keys):
    """Base of how universes are computed, as it is written."""

    space_filling: int = Field(64, ge=0)  # of the space-filling design of a full build
    sample: int = Field(8, ge=1)  # of the committed run, which a full build computes again
    multiverse: int = Field(512, ge=1)  # that fill the space in `snakemake multiverse`
    one_at_a_time: list[str] | None = None  # choices that a full build varies by themselves; all unless given
    redrawn: list[str] = Field([])  # choices that are drawn again until a universe is admissible
    choices: dict[str, str | Number] = Field({})  # values of choices that a universe leaves out
    tries: int = Field(100, ge=1)  # how often at most
    wave: int = Field(64, ge=1)  # universes of a wave of `snakemake multiverse`
    jobs: int = Field(2, ge=1)  # that compute them


def written_choices(inputs: type[Inputs]) -> typing.Any:
    """Return the type of the choices of a paper, by name."""
    sections = {name: (_section(of, inputs), {}) for name, of in inputs.sections().items()}
    alternative = create_model(f"AlternativeOf{inputs.__name__}", __base__=Keys, **sections)
    values = dict[Name, alternative], {}  # what each alternative sets; nothing: as in corrected
    return dict[Name, create_model(f"ChoiceOf{inputs.__name__}", __base__=WrittenChoice, values=values)]


def own_configuration(models: dict[str, type[Inputs]]) -> type[Settings]:
    """Return the model of a user's own configuration for papers by slug."""
    fields = {}
    for slug, inputs in models.items():
        types = {"readings": (_readings(inputs), {}), "choices": (written_choices(inputs), {})}
        part = create_model(f"OwnPartOf{inputs.__name__}", __base__=Keys, **types)
        fields[slug] = part, part()
    return create_model("Own", __base__=Settings, **fields)


def configuration(inputs: type[Inputs]) -> type[Keys]:
    """Return the model of a paper's configuration: readings, chunks and smaller sizes."""
    chunks = create_model("Chunks", __base__=Keys, **dict.fromkeys(inputs.CASES, (Chunks, ...)))
    names = {name: typing.Literal[tuple(of.model_fields)] for name, of in inputs.sections().items()}
    limits = {name: (dict[those, Limit], {}) for name, those in names.items()}  # that no number of an input may exceed
    size = create_model("Size", __base__=Keys, readings=(list[str], None), **limits)  # of which claims are evaluated
    universes = create_model("Universes", __base__=WrittenUniverses, **limits)
    return create_model(
        "Configuration",
        __base__=Keys,
        readings=(_readings(inputs), ...),
        chunks=(chunks, ... if inputs.CASES else chunks()),  # the jobs of each case
        choices=(written_choices(inputs), {}),  # what is doubted about the paper, by name
        universes=(universes, universes()),
        sizes=(dict[str, size], {}),  # smaller ones of a build by name, for --config size=NAME
    )
