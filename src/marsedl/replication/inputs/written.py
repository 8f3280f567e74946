"""What a configuration may hold, as it is written: models that check it, and that its JSON Schema is made from."""

import functools
import re
import typing

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetPydanticSchema,
    Strict,
    WithJsonSchema,
    create_model,
    model_validator,
)

from marsedl.replication.errors import nearest
from marsedl.replication.inputs import CORRECTED, PRINTED
from marsedl.replication.inputs.messages import Keys
from marsedl.replication.inputs.sections import KNOWN_SUFFIXES, Inputs, Section

READ_AS_MISSING = ("nan", "null")  # by pandas, in tables; it is not imported here, which takes time
_NAME = "^[a-z][a-z0-9_]{0,39}$"
_COMMON_SOURCE = "of all inputs of this section that name none, such as 'Eq. 51' or 'assumed: why'"
_OF_THE_INPUT = ("title", "unit", "description", "default")  # and not of its value
_BOUNDS = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")


def _reading_name(name: str) -> str:
    if not re.fullmatch(_NAME, name):
        raise ValueError("a reading's name is lower case letters, digits and _, at most 40 of them; rename it")
    if name in READ_AS_MISSING:
        raise ValueError(f"pandas reads the name {name!r} in a table as no value; rename it")
    return name


def _reason(source: str) -> str:
    if not any(map(str.isalnum, source)):
        raise ValueError("say where the value comes from, or 'assumed: why'")
    if source.startswith("assumed") and not re.match(r"assumed: .*\w", source):
        raise ValueError("write 'assumed: ' and the reason")
    return source


Name = typing.Annotated[str, AfterValidator(_reading_name), WithJsonSchema({"type": "string", "pattern": _NAME})]
Source = typing.Annotated[
    str, AfterValidator(_reason), WithJsonSchema({"type": "string", "pattern": r"^assumed: \S|^(?!assumed).*\S"})
]
Limit = typing.Annotated[float, Strict(), Field(gt=0)]
Chunks = typing.Annotated[int, Strict(), Field(ge=1, le=100_000)]
_NO_OTHERS = {"additionalProperties": False}  # than those whose names have the pattern


class Sourced(Keys):
    """An input as it is written."""

    value: typing.Any = Field(description="its value")
    unit: str = Field("", description="the unit again, for the reader")
    source: Source = Field(description="where it comes from")


def _complete(schema: dict) -> None:
    """Add to the JSON Schema of a reading that one that is based on none has all sections."""
    sections = [key for key in schema["properties"] if key not in WrittenReading.model_fields]
    schema |= {"if": {"not": {"required": ["based_on"]}}, "then": {"required": sections}}


class WrittenReading(Keys, json_schema_extra=_complete):
    """Base of a reading as it is written: what it is for, and the inputs that it sets, by section."""

    inputs: typing.ClassVar[type[Inputs]]
    summary: str = Field("", description="in a sentence, what the reading is for")
    based_on: Name | None = Field(
        None, description="the reading of which the inputs are taken that are not given here; without it, give all"
    )
    choices: dict[str, str | float] = Field({}, description="values of choices, by the choices' names")
    frozen: str = Field(
        "",
        pattern="^([0-9a-f]{12})?$",
        description="the digest of the inputs of a reading that must not change; change it in one based on it",
    )

    @classmethod
    def unknown(cls, key: str) -> str:
        """Return what is wrong with a key: its place or its spelling."""
        if section := _section_of(key, cls.inputs):
            return f"stands in the section '{section}'; write '{section}: {{{key}: ...}}'"
        return super().unknown(key)


class Settings(Keys):
    """Base of a user's own configuration."""

    size: str = Field("full", description="the size of the build: full, or one under sizes in configs/*.yaml")
    chunks: Chunks | None = Field(None, description="into how many jobs the trials of every case are divided")
    universes: Chunks | None = Field(None, description="so many fill the space of choices, and all are varied alone")


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
    schema = GetPydanticSchema(get_pydantic_json_schema=functools.partial(_section_schema, section))
    return typing.Annotated[dict[key, Sourced], BeforeValidator(handed_down), schema]


def _section_schema(section: type[Section], core, handler) -> dict:
    """Return the JSON Schema of a section: every key, with the unit that it implies and bounds in that unit."""
    entry = dict(handler.resolve_ref_schema(handler(core)["additionalProperties"]))
    del entry["title"]
    parts, of = entry["properties"], section.model_json_schema()["properties"]
    keys = {"source": {**parts["source"], "description": _COMMON_SOURCE}}
    for key, (name, factor, unit) in section.keys().items():
        value = {k: _in_unit(v, factor) for k, v in of[name].items() if k not in _OF_THE_INPUT}
        value["description"] = "its value" if unit == "1" else f"its value, {unit}"
        properties = {**parts, "value": value, "unit": {**parts["unit"], "const": unit}}
        keys[key] = {**entry, "description": of[name]["description"], "required": ["value"], "properties": properties}
    return {
        "type": "object",
        "description": " ".join((section.__doc__ or "").split()),
        "properties": keys,
        "additionalProperties": False,
        "anyOf": [{"required": ["source"]}, {"additionalProperties": {"required": ["source"]}}],
    }


def _in_unit(schema: typing.Any, factor: float) -> typing.Any:
    """Return the schema of a value in SI as that of the value as it is written: bounds divided by the factor to SI."""
    if isinstance(schema, list):
        return [_in_unit(entry, factor) for entry in schema]
    if not isinstance(schema, dict) or factor == 1.0:
        return schema
    return {k: v / factor if k in _BOUNDS and v else _in_unit(v, factor) for k, v in schema.items()}


@functools.cache
def _readings(inputs: type[Inputs]) -> type[dict[str, WrittenReading]]:
    """Return the type of the readings of a paper, by name."""
    sections = {name: (_section(of, inputs), Field({})) for name, of in inputs.sections().items()}
    reading = create_model(
        f"ReadingOf{inputs.__name__}", __base__=WrittenReading, __doc__="A named set of inputs, by section.", **sections
    )
    reading.inputs = inputs
    return dict[Name, reading]


class WrittenRange(Keys):
    """The numbers that an input may take, or the factors on its value in the reading `corrected`."""

    input: str = Field(description="the input as section.key, with the unit suffix in which `between` is written")
    component: int | None = Field(None, ge=0, description="of a list: which of its numbers, counted from 0")
    between: tuple[float, float] | None = Field(None, description="the least and the largest number")
    factor: tuple[float, float] | None = Field(None, description="the least and the largest factor, instead")
    scale: typing.Literal["linear", "log"] = Field("linear", description="in what it is uniform")
    source: Source = Field(description="where these limits come from")

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

    asks: str = Field(description="the question that the choice answers, in a sentence")
    because: str = Field(
        pattern=r"^(E\d+|withheld|misprint|setting)\b",
        description="the erratum, or 'withheld', 'misprint' or 'setting', with a remark if one likes",
    )
    entered: str = Field("", description="when it was entered, if that was after results had been seen")
    only_if: dict[str, list[str]] = Field(
        {}, description="by other choices, their values without which this one changes nothing"
    )
    apart: list[str] = Field(
        [], description="values that are not combined with others: a misprint, or what something printed rules out"
    )
    range: WrittenRange | None = Field(None, description="numbers that an input may take, instead of values")


class WrittenUniverses(Keys):
    """Base of how universes are computed, as it is written."""

    space_filling: int = Field(64, ge=0, description="universes of the space-filling design of a full build")
    one_at_a_time: list[str] | None = Field(
        None, description="choices that a full build varies by themselves; all unless given"
    )
    redrawn: list[str] = Field([], description="choices that are drawn again until a universe is admissible")
    choices: dict[str, str | float] = Field({}, description="values of choices that a universe leaves out")
    tries: int = Field(100, ge=1, description="how often at most")
    wave: int = Field(64, ge=1, description="universes of a wave of `snakemake multiverse`")
    jobs: int = Field(2, ge=1, description="jobs that compute them")


def written_choices(inputs: type[Inputs]) -> typing.Any:
    """Return the type of the choices of a paper, by name."""
    sections = {name: (_section(of, inputs), Field({})) for name, of in inputs.sections().items()}
    alternative = create_model(f"AlternativeOf{inputs.__name__}", __base__=Keys, **sections)
    values = (dict[Name, alternative], Field({}, description="what each alternative sets; nothing: as in corrected"))
    return dict[Name, create_model(f"ChoiceOf{inputs.__name__}", __base__=WrittenChoice, values=values)]


def own_configuration(models: dict[str, type[Inputs]]) -> type[Settings]:
    """Return the model of a user's own configuration for papers by slug."""
    own = Field({}, description="readings of your own, by new names", json_schema_extra=_NO_OTHERS)
    doubts = Field({}, description="choices of your own, and further values of the paper's choices")
    fields = {}
    for slug, inputs in models.items():
        types = {"readings": (_readings(inputs), own), "choices": (written_choices(inputs), doubts)}
        part = create_model(f"OwnPartOf{inputs.__name__}", __base__=Keys, **types)
        fields[slug] = part, Field(part(), description=f"of the paper {slug}")
    return create_model("Own", __base__=Settings, __doc__="Readings of your own, for --configfile.", **fields)


def configuration(inputs: type[Inputs]) -> type[Keys]:
    """Return the model of a paper's configuration: readings, chunks and smaller sizes."""
    case = Field(description="into how many jobs the trials of this case are divided")
    chunks = create_model("Chunks", __base__=Keys, **dict.fromkeys(inputs.CASES, (Chunks, case)))
    jobs = Field(description="jobs of each case") if inputs.CASES else Field(chunks(), description="none")
    section = Field({}, description="by input, the number that no number of the input may exceed")
    names = {name: typing.Literal[tuple(of.model_fields)] for name, of in inputs.sections().items()}
    limits = {name: (dict[those, Limit], section) for name, those in names.items()}
    meaning = "the readings in which claims are evaluated; all unless given"
    both = {"allOf": [{"contains": {"const": name}} for name in (PRINTED, CORRECTED)]}
    compared = list[str], Field(None, description=meaning, json_schema_extra=both)
    size = create_model("Size", __base__=Keys, readings=compared, **limits)
    by_name = Field(description="the paper's readings by name", json_schema_extra=_NO_OTHERS)
    universes = create_model("Universes", __base__=WrittenUniverses, **limits)
    return create_model(
        "Configuration",
        __base__=Keys,
        readings=(_readings(inputs), by_name),
        chunks=(chunks, jobs),
        choices=(written_choices(inputs), Field({}, description="what is doubted about the paper, by name")),
        universes=(universes, Field(universes(), description="how universes are computed: numbers of trials at most")),
        sizes=(dict[str, size], Field({}, description="smaller sizes of a build by name, for --config size=NAME")),
    )
