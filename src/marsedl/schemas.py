"""JSON Schemas of the files that others write and read: configurations, and the claims of a build.

They are made from the models with which marsedl checks inputs, and from the type of a claim in `report/claims.json`.
`make schemas` writes them to `docs/schemas`; `docs/formats.md` says what they are for.
"""

import json
import sys
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

import marsedl
from marsedl.papers import SLUGS, input_model
from marsedl.replication.claims.claim import Claim
from marsedl.replication.inputs.sections import Inputs
from marsedl.replication.inputs.written import configuration, own_configuration

VERSION = 2  # of the formats: one more when a file that was valid no longer is, or a key means something else
DIALECT = "https://json-schema.org/draft/2020-12/schema"
_LINE = 120  # characters


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


class _Schema(GenerateJsonSchema):
    """Without titles that repeat the names of keys, and defaults that say that a key may be left out."""

    def field_title_should_be_set(self, schema):
        return False

    def default_schema(self, schema):
        return self.generate_inner(schema["schema"])


def configuration_schema(slug: str, inputs: type[Inputs]) -> dict:
    """Return the JSON Schema of a paper's `configs/<slug>.yaml`: readings, chunks and smaller sizes."""
    schema = configuration(inputs).model_json_schema(schema_generator=_Schema)
    head = _head(f"configuration:{slug}", f"Configuration of {slug}")
    return {**schema, **head, "description": f"All inputs of the paper {slug}: configs/{slug}.yaml."}


def own_configuration_schema(papers: dict[str, type[Inputs]]) -> dict:
    """Return the JSON Schema of a user's own configuration, the file that is given to Snakemake by `--configfile`."""
    schema = own_configuration(papers).model_json_schema(schema_generator=_Schema)
    return {**schema, **_head("configuration:own", "A configuration of your own")}


def _head(name: str, title: str) -> dict:
    identity = {"$schema": DIALECT, "$id": f"urn:marsedl:schema:{VERSION}:{name}", "title": title}
    return {**identity, "$comment": f"Made by marsedl {marsedl.__version__}; format version {VERSION}."}


# ----------------------------------------------------------------------------------------------------------- the claims


class _ClaimsSchema(_Schema):
    """Without titles that repeat the names of types, too."""

    def model_schema(self, schema):
        return {key: value for key, value in super().model_schema(schema).items() if key != "title"}


def claims_schema() -> dict:
    """Return the JSON Schema of `report/claims.json`."""
    schema = TypeAdapter(list[Claim]).json_schema(mode="serialization", schema_generator=_ClaimsSchema)
    text = "The claims of a build: papers in alphabetical order, a paper's claims in the order of its file."
    return {**_head("claims", "Claims of a build"), "description": text, **schema}


if __name__ == "__main__":
    write_schemas(Path(sys.argv[1]))
