"""JSON Schemas of the files that others write and read: configurations, and the claims of a build.

They are made from the models with which marsedl checks inputs, and from a model of a row of `report/claims.json`.
`make schemas` writes them to `docs/schemas`; `docs/formats.md` says what they are for.
"""

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, WithJsonSchema

import marsedl
from marsedl.papers import SLUGS, input_model
from marsedl.replication.claims import COUNTED_VERDICTS, LISTED_VERDICTS
from marsedl.replication.inputs import MOST_CHUNKS
from marsedl.replication.sections import Inputs, Section

VERSION = 1  # of the formats: one more when a file that was valid no longer is, or a key means something else
DIALECT = "https://json-schema.org/draft/2020-12/schema"
_BOUNDS = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")
_LINE = 120  # characters
_NAME = "^[a-z][a-z0-9_]{0,39}$"  # of a reading


def schemas() -> dict[str, dict]:
    """Return every JSON Schema by the name of its file: each paper's configuration, a user's own, and the claims."""
    papers = {slug: input_model(slug) for slug in SLUGS}
    return {
        **{f"configuration_{slug}.json": configuration_schema(slug, model) for slug, model in papers.items()},
        "configuration_own.json": own_configuration_schema(papers),
        "claims.json": claims_schema(),
    }


def write_schemas(folder: Path) -> None:
    """Write every JSON Schema into a folder, in place of those that are there."""
    for path in folder.glob("*.json"):
        path.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    for name, schema in schemas().items():
        (folder / name).write_text(f"{_text(schema)}\n", encoding="utf-8", newline="\n")


def _text(value: Any, indent: str = "") -> str:
    """Return a value as JSON, in one line where it fits into one."""
    line = json.dumps(value, ensure_ascii=False)
    if not isinstance(value, dict | list) or len(indent) + len(line) <= _LINE:
        return line
    deeper = f"{indent} "
    if isinstance(value, list):
        return "[\n" + ",\n".join(deeper + _text(entry, deeper) for entry in value) + f"\n{indent}]"
    entries = (f"{deeper}{json.dumps(key)}: {_text(entry, deeper)}" for key, entry in value.items())
    return "{\n" + ",\n".join(entries) + f"\n{indent}}}"


# ------------------------------------------------------------------------------------------------------- configurations


def configuration_schema(slug: str, model: type[Inputs]) -> dict:
    """Return the JSON Schema of a paper's `configs/<slug>.yaml`: readings, chunks and smaller sizes."""
    keys = {"readings": _readings("the paper's readings by name"), "sizes": _sizes(model)}
    if model.CASES:
        number = {**_chunks(), "description": "into how many jobs the trials of this case are divided"}
        keys["chunks"] = _object("jobs of each Monte Carlo case", dict.fromkeys(model.CASES, number), list(model.CASES))
    required = ["readings", "chunks"] if model.CASES else ["readings"]
    return {
        **_head(f"configuration:{slug}", f"Configuration of {slug}"),
        **_object(f"All inputs of the paper {slug}: configs/{slug}.yaml.", keys, required),
        "$defs": {**_shared(), "reading": _reading(model)},
    }


def own_configuration_schema(models: dict[str, type[Inputs]]) -> dict:
    """Return the JSON Schema of a user's own configuration, the file that is given to Snakemake by `--configfile`."""
    keys = {
        slug: _object(
            f"readings of your own of the paper {slug}",
            {
                "readings": _readings("by names that the paper's configuration has not", f"{slug}_reading"),
            },
            ["readings"],
        )
        for slug in models
    }
    size = {"type": "string", "description": "the size of the build: full, or one under sizes in configs/*.yaml"}
    chunks = {**_chunks(), "description": "into how many jobs the trials of every Monte Carlo case are divided"}
    return {
        **_head("configuration:own", "A configuration of your own"),
        **_object("Readings of your own, for --configfile.", {**keys, "size": size, "chunks": chunks}),
        "$defs": {**_shared(), **{f"{slug}_reading": _reading(model) for slug, model in models.items()}},
    }


def _head(name: str, title: str) -> dict:
    identity = {"$schema": DIALECT, "$id": f"urn:marsedl:schema:{VERSION}:{name}", "title": title}
    return {**identity, "$comment": f"Made by marsedl {marsedl.__version__}; format version {VERSION}."}


def _object(description: str, properties: dict, required: list[str] | None = None) -> dict:
    """The schema of known keys with values, and no others."""
    schema = {"type": "object", "description": description, "properties": properties, "additionalProperties": False}
    return {**schema, "required": required} if required else schema


def _chunks() -> dict:
    return {"type": "integer", "minimum": 1, "maximum": MOST_CHUNKS}


def _readings(description: str, definition: str = "reading") -> dict:
    return {
        "type": "object",
        "description": description,
        "propertyNames": {"pattern": _NAME},
        "additionalProperties": {"$ref": f"#/$defs/{definition}"},
    }


def _shared() -> dict:
    return {
        "source": {
            "type": "string",
            "description": "where the value comes from, such as 'Eq. 51' or 'Table 2', or 'assumed: why'",
            "pattern": r"^assumed: \S|^(?!assumed)[\s\S]*\S",
        }
    }


def _reading(model: type[Inputs]) -> dict:
    about = {
        "summary": {"type": "string", "description": "in a sentence, what the reading is for"},
        "based_on": {
            "type": "string",
            "pattern": _NAME,
            "description": "the reading of which the inputs are taken that are not given here; without it, give all",
        },
        "frozen": {
            "type": "string",
            "pattern": "^([0-9a-f]{12})?$",
            "description": "the digest of the inputs of a reading that must not change; change it in one based on it",
        },
    }
    sections = {name: _section(section) for name, section in model.sections().items()}
    complete = {"if": {"not": {"required": ["based_on"]}}, "then": {"required": list(sections)}}
    return {**_object("A complete, named set of inputs, by section.", {**about, **sections}), **complete}


def _section(section: type[Section]) -> dict:
    """The schema of a section: every key that a file may use, with the unit that it implies and bounds in that unit."""
    values = section.model_json_schema()["properties"]
    source = {"$ref": "#/$defs/source", "description": "of all inputs of this section that name none themselves"}
    keys = {"source": source}
    for key, (name, factor) in section.keys().items():
        unit = section.unit_of_key(key)
        meaning = section.model_fields[name].description
        value = {k: v for k, v in values[name].items() if k not in ("title", "unit", "description", "default")}
        keys[key] = _object(
            meaning,
            {
                "value": {
                    **_scaled(value, factor),
                    "description": "its value" if unit == "1" else f"its value, {unit}",
                },
                "unit": {"const": unit, "description": "the unit again, for the reader"},
                "source": {"$ref": "#/$defs/source"},
            },
            ["value"],
        )
    sourced = {"anyOf": [{"required": ["source"]}, {"additionalProperties": {"required": ["source"]}}]}
    return {**_object(" ".join((section.__doc__ or "").split()), keys), **sourced}


def _scaled(schema: Any, factor: float) -> Any:
    """Return the schema of a value in SI as that of the value as it is written: bounds divided by the factor to SI."""
    if isinstance(schema, list):
        return [_scaled(entry, factor) for entry in schema]
    if not isinstance(schema, dict) or factor == 1.0:
        return schema
    return {
        key: value / factor if key in _BOUNDS and value else _scaled(value, factor) for key, value in schema.items()
    }


def _sizes(model: type[Inputs]) -> dict:
    sections = {
        name: _object(
            " ".join((section.__doc__ or "").split()),
            {
                field: {
                    "type": "number",
                    "exclusiveMinimum": 0,
                    "description": f"no larger than this: {section.model_fields[field].description}",
                }
                for field in section.model_fields
            },
        )
        for name, section in model.sections().items()
    }
    readings_schema = {
        "type": "array",
        "items": {"type": "string"},
        "allOf": [{"contains": {"const": name}} for name in ("printed", "corrected")],
        "description": "the readings in which claims are evaluated; all unless given",
    }
    size = _object("The largest numbers of a smaller build, by section.", {"readings": readings_schema, **sections})
    return {
        "type": "object",
        "description": "smaller sizes of a build by name, for --config size=NAME",
        "additionalProperties": size,
    }


# ----------------------------------------------------------------------------------------------------------- the claims


def _nested(entry: dict) -> dict:
    """The schema of an entry, a vector of entries, or a matrix."""
    vector = {"type": "array", "items": entry}
    return {"anyOf": [entry, vector, {"type": "array", "items": vector}]}


Value = Annotated[Any, WithJsonSchema(_nested({"type": ["number", "boolean", "string", "null"]}))]
Sizes = Annotated[Any, WithJsonSchema(_nested({"type": ["number", "null"], "minimum": 0}))]
Verdict = Literal[(*COUNTED_VERDICTS, *LISTED_VERDICTS)]


class _Row(BaseModel):
    model_config = ConfigDict(extra="forbid", use_attribute_docstrings=True)


class Deviation(_Row):
    """How far a Monte Carlo result lies from the printed one."""

    largest: float
    """the deviation of the worst component, in combined standard errors"""
    component: list[int] | None
    """its indices, counted from 1; null for a number that stands alone"""


class Tolerance(_Row):
    """The tolerance, stated before the result was known, within which a number is close; relative or absolute."""

    reason: str
    """why this tolerance is the right one"""
    relative: float | None
    """share of the printed value"""
    absolute: Sizes
    """size in the claim's unit, a number or one for each component"""


class Margin(_Row):
    """How far the measure that decides is from its limit."""

    measure: str
    """what decides, in words"""
    value: float | None
    """its value"""
    limit: float | None
    """the limit that it is compared with"""
    unit: str
    """unit of both; empty: that of the claim, or none"""
    distance: float | None
    """how far they are apart, in the unit under `in`"""
    scale: Literal["standard errors", "limits", "values"] = Field(alias="in")
    """what the distance counts: standard errors of the value, or shares of the limit or of the value"""
    standard_error: float | None
    """the standard error of the value; 0 if it is not sampled"""


class Counterexample(_Row):
    """The least change that turns the verdict, of those that are tried."""

    change: Literal["scaled", "shifted", "spread", "blended", "replaced", "in_reading"]
    """what is done"""
    of: str
    """the field, input or reading, with the component in brackets"""
    amount: float | str | None
    """a factor; a shift in standard deviations; the share of the way to another record; or what is put in its place"""
    to: str
    """the verdict after it"""


class Other(_Row):
    """What the reading gives with the number of trials that other readings have."""

    value: Value
    """as in the result"""
    standard_error: Sizes
    """as in the result"""
    trials: int | None
    """number of trials"""
    verdict: Verdict | None
    """the verdict from so many trials"""
    components: Any
    """as in the result"""
    margin: Margin | None
    """as in the result"""


class Result(_Row):
    """What one reading gives for the claim."""

    value: Value
    """shaped like the printed value; null: not evaluated in this reading, or not finite; an infinite input is a text"""
    standard_error: Sizes
    """of the value, shaped like it; null: no sampling error"""
    trials: Annotated[int, Field(ge=0)] | None
    """number of Monte Carlo trials behind the value; null: none"""
    verdict: Verdict | None
    """the reading's own verdict; null: not evaluated in this reading"""
    components: Any
    """verdicts on the numbers of a row, shaped like the printed value; null: a single number or a statement"""
    numbers: dict[str, Any]
    """numbers beside the value, by their names: those that the reason and texts may quote"""
    evidence: str
    """a sentence with the numbers that were tested"""
    doubt: str
    """why the verdict is undetermined, and how many trials would settle it"""
    margin: Margin | None
    """how far the measure that decides is from its limit; null: nothing was compared with a limit"""
    z: Deviation | None
    """the deviation beyond the printed rounding; null: not a Monte Carlo result"""
    at_equal_trials: Other | None
    """from as many trials as other readings have; null: they have no fewer, or its measure is stored of all alone"""


class Claim(_Row):
    """One printed number or statement, what every reading gives for it, and the verdict."""

    paper: str
    """the paper's name, such as powered_descent"""
    size: str
    """the size of the build: full, or a smaller one that decides nothing"""
    id: str
    """the claim's name, unique in its paper"""
    where: str
    """where the paper prints it"""
    quantity: str
    """what is printed, in words"""
    plain: str
    """the same in at most 12 words, for readers who do not know the paper; empty: not written"""
    unit: str
    """unit of the printed value, of those of the readings and of the resolution; 1: none"""
    kind: Literal["deterministic", "monte_carlo", "qualitative", "undetermined", "input", "context"]
    """a number, a number from trials, a statement, not determined by the paper, a stated input, quoted literature"""
    printed: Value
    """what the paper prints; true for a statement"""
    resolution: Sizes
    """size of the last printed digit, one or one for each component; null: not a measured number"""
    trials: Annotated[int, Field(gt=0)] | None
    """the paper's number of Monte Carlo trials; null: none"""
    note: str
    """a remark on the printed value"""
    headline: int | None
    """place among the claims that the paper's abstract and conclusions rest on, from 1; null: not among them"""
    verdict: Verdict
    """the verdict that counts: that of the reading named under `reading`"""
    reading: str
    """the reading that gives the verdict"""
    reason: str
    """why the verdict is what it is, if it needs a reason"""
    errata: list[str]
    """ids of the errata in the paper's method note that explain a difference"""
    withheld: list[str]
    """inputs that the paper does not give and that explain a difference"""
    close: Tolerance | None
    """the tolerance stated beforehand; null: none"""
    by_construction: str
    """why the claim cannot fail; empty: it can"""
    counterexample: Counterexample | None
    """the change that turns the verdict; null: not counted, or not turned"""
    thin: bool
    """whether the verdict is so far from its limit that it could hardly be another one"""
    readings: dict[str, Result]
    """what every reading gives, by the reading's name"""


def claims_schema() -> dict:
    """Return the JSON Schema of `report/claims.json`."""
    schema = TypeAdapter(list[Claim]).json_schema()
    text = "The claims of a build: papers in alphabetical order, a paper's claims in the order of its file."
    return {**_head("claims", "Claims of a build"), "description": text, **_untitled(schema)}


def _untitled(schema: Any) -> Any:
    """Return a schema without the titles that repeat the names of keys."""
    if isinstance(schema, list):
        return [_untitled(entry) for entry in schema]
    if not isinstance(schema, dict):
        return schema
    return {k: _untitled(v) for k, v in schema.items() if not (k == "title" and isinstance(v, str))}


if __name__ == "__main__":
    write_schemas(Path(sys.argv[1]))
