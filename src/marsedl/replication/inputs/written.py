"""What a configuration may hold, as it is written: models that check it, and that its JSON Schema is made from."""

import functools
import re
import typing
from dataclasses import dataclass

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, Strict, WithJsonSchema, create_model

from marsedl.replication.errors import nearest
from marsedl.replication.inputs import CORRECTED, PRINTED
from marsedl.replication.inputs.messages import Keys
from marsedl.replication.inputs.sections import KNOWN_SUFFIXES, Inputs, Section

READ_AS_MISSING = ("nan", "null")  # by pandas, in tables; it is not imported here, which takes time
_NAME = "^[a-z][a-z0-9_]{0,39}$"
_COMMON_SOURCE = "of all inputs of this section that name none, such as 'Eq. 51' or 'assumed: why'"
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
_CONTAIN_BOTH = {"allOf": [{"contains": {"const": name}} for name in (PRINTED, CORRECTED)]}


class Sourced(Keys):
    """An input as it is written."""

    value: typing.Any = Field(description="its value")
    unit: str = Field("", description="the unit again, for the reader")
    source: Source = Field(description="where it comes from")


def _complete(schema: dict) -> None:
    """Add to the JSON Schema of a reading that one that is based on none has all sections."""
    sections = [key for key in schema["properties"] if key not in WrittenReading.model_fields]
    schema |= {"if": {"not": {"required": ["based_on"]}}, "then": {"required": sections}}


class WrittenReading(Keys):
    """Base of a reading as it is written: what it is for, and the inputs that it sets, by section."""

    model_config = ConfigDict(json_schema_extra=_complete)
    inputs: typing.ClassVar[type[Inputs]]
    summary: str = Field("", description="in a sentence, what the reading is for")
    based_on: Name | None = Field(
        None, description="the reading of which the inputs are taken that are not given here; without it, give all"
    )
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


def _section_of(key: str, inputs: type[Inputs]) -> str:
    """Return the name of the section in which a key belongs; empty if it belongs in none."""
    return next((name for name, section in inputs.sections().items() if section.keys().get(key)), "")


def _section(section: type[Section], inputs: type[Inputs]) -> typing.Any:
    """Return the type of a section as it is written; values are checked with all others of the section, in SI."""
    accepted = section.keys()

    def known(key: str) -> str:
        if key in accepted:
            return key
        for name in section.model_fields:
            suffix = key.removeprefix(name)
            if key == name or (key.startswith(f"{name}_") and suffix in KNOWN_SUFFIXES):
                problem = f"has the wrong unit suffix '{suffix}'" if suffix else "needs its unit in its name"
                way = next(way for way, (target, _) in accepted.items() if target == name)
                raise ValueError(f"{problem}; the unit is {section.unit(name)}, write '{way}'")
        other = _section_of(key, inputs)
        remedy = f"it stands in the section '{other}'" if other else nearest(key, [*accepted, "source"])
        raise ValueError(f"unknown key; {remedy}")

    key = typing.Annotated[str, AfterValidator(known)]
    return typing.Annotated[dict[key, Sourced], BeforeValidator(_hand_down), _SectionSchema(section)]


def _hand_down(body: typing.Any) -> typing.Any:
    """Give the source of a section to all of its inputs that name none."""
    if not isinstance(body, dict) or "source" not in body:
        return body
    common = {"source": body["source"]}
    entries = {key: entry for key, entry in body.items() if key != "source"}
    return {key: common | entry if isinstance(entry, dict) else entry for key, entry in entries.items()}


@dataclass(frozen=True)
class _SectionSchema:
    """Gives the type of a section its JSON Schema: every key, with the unit that it implies and bounds in that unit."""

    section: type[Section]

    def __get_pydantic_json_schema__(self, core, handler):
        entry = dict(handler.resolve_ref_schema(handler(core)["additionalProperties"]))
        entry.pop("title")
        source = entry["properties"]["source"] | {"description": _COMMON_SOURCE}
        accepted = self.section.keys()
        return {
            "type": "object",
            "description": " ".join((self.section.__doc__ or "").split()),
            "properties": {"source": source, **{key: self._sourced(key, entry) for key in accepted}},
            "additionalProperties": False,
            "anyOf": [{"required": ["source"]}, {"additionalProperties": {"required": ["source"]}}],
        }

    def _sourced(self, key: str, entry: dict) -> dict:
        (name, factor), unit = self.section.keys()[key], self.section.unit_of_key(key)
        of = self.section.model_json_schema()["properties"][name]
        value = {k: _in_unit(v, factor) for k, v in of.items() if k not in ("title", "unit", "description", "default")}
        value["description"] = "its value" if unit == "1" else f"its value, {unit}"
        keys = entry["properties"]
        meaning = {"description": self.section.model_fields[name].description, "required": ["value"]}
        return {**entry, **meaning, "properties": {**keys, "value": value, "unit": {**keys["unit"], "const": unit}}}


def _in_unit(schema: typing.Any, factor: float) -> typing.Any:
    """Return the schema of a value in SI as that of the value as it is written: bounds divided by the factor to SI."""
    if isinstance(schema, list):
        return [_in_unit(entry, factor) for entry in schema]
    if not isinstance(schema, dict) or factor == 1.0:
        return schema
    return {k: v / factor if k in _BOUNDS and v else _in_unit(v, factor) for k, v in schema.items()}


@functools.cache
def written_readings(inputs: type[Inputs]) -> type[dict[str, WrittenReading]]:
    """Return the type of the readings of a paper, by name."""
    sections = {name: (_section(of, inputs), Field({})) for name, of in inputs.sections().items()}
    reading = create_model(
        f"ReadingOf{inputs.__name__}", __base__=WrittenReading, __doc__="A named set of inputs, by section.", **sections
    )
    reading.inputs = inputs
    return dict[Name, reading]


def own_readings(inputs: type[Inputs]) -> type[Keys]:
    """Return the model of a paper's part of a user's own configuration."""
    readings = Field(description="readings of your own, by new names", json_schema_extra=_NO_OTHERS)
    return create_model(f"OwnReadingsOf{inputs.__name__}", __base__=Keys, readings=(written_readings(inputs), readings))


def own_configuration(parts: dict[str, typing.Any]) -> type[Settings]:
    """Return the model of a user's own configuration, of papers by slug with the types of their parts."""
    fields = {slug: (part, Field(None, description=f"of the paper {slug}")) for slug, part in parts.items()}
    return create_model("Own", __base__=Settings, __doc__="Readings of your own, for --configfile.", **fields)


def configuration(inputs: type[Inputs]) -> type[Keys]:
    """Return the model of a paper's configuration: readings, chunks and smaller sizes."""
    case = Field(description="into how many jobs the trials of this case are divided")
    chunks = create_model("Chunks", __base__=Keys, **dict.fromkeys(inputs.CASES, (Chunks, case)))
    section = "by input, the number that no number of the input may exceed"
    limits = {
        name: (dict[typing.Literal[tuple(of.model_fields)], Limit], Field({}, description=section))
        for name, of in inputs.sections().items()
    }
    meaning = "the readings in which claims are evaluated; all unless given"
    compared = list[str], Field(None, description=meaning, json_schema_extra=_CONTAIN_BOTH)
    size = create_model("Size", __base__=Keys, readings=compared, **limits)
    by_name = Field(description="the paper's readings by name", json_schema_extra=_NO_OTHERS)
    return create_model(
        "Configuration",
        __base__=Keys,
        readings=(written_readings(inputs), by_name),
        chunks=(chunks, Field(description="jobs of each case") if inputs.CASES else Field({}, description="none")),
        sizes=(dict[str, size], Field({}, description="smaller sizes of a build by name, for --config size=NAME")),
    )
