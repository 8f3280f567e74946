"""Readings that are malformed by construction, drawn by the hundred for every paper: each is refused, and how is held.

A fault is the content of a user's file and what the refusal has to say beside the file: the key or line, and the
remedy. Nothing here may be valid, so that nothing has to be decided after the fact.
"""

import contextlib
import functools
import json
import math
import re
import signal
import string
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from marsedl.papers import SLUGS, input_model
from marsedl.replication import inputs, sections, strict_yaml
from marsedl.replication.errors import InputError, nearest
from marsedl.replication.inputs import ABOUT, SETTINGS, load_studies, read_own_file
from marsedl.replication.strict_yaml import read_yaml

CONFIGS = Path(__file__).parents[2] / "configs"
MODELS = {slug: input_model(slug) for slug in SLUGS}
SECTIONS = {slug: model.sections() for slug, model in MODELS.items()}
KEYS = {
    slug: {key: way for of in sections.values() for key, way in of.keys().items()}
    for slug, sections in SECTIONS.items()
}
SCHEMAS = {
    slug: {name: field for of in sections.values() for name, field in of.model_json_schema()["properties"].items()}
    for slug, sections in SECTIONS.items()
}
EXAMPLES = 35  # of each kind of fault
SECONDS = 20  # within which each is refused, on a machine that does much else
LONGEST = 6000  # characters of a refusal: a paper has a hundred names that it may have to list

SLUG = st.sampled_from(SLUGS)
WORDS = st.text(string.ascii_lowercase, min_size=2, max_size=12)
LETTERS = string.ascii_letters + string.digits + "_"


def number(value) -> str:
    """A number as YAML reads it back."""
    if isinstance(value, int):
        return str(value)
    if math.isnan(value):
        return ".nan"
    if math.isinf(value):
        return ".inf" if value > 0 else "-.inf"
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def listed(values) -> str:
    """A list, perhaps of lists, in one line."""
    return "[" + ", ".join(listed(v) if isinstance(v, list) else number(v) for v in values) + "]"


def key_of(slug: str, name: str) -> str:
    """The first way in which an input may be written."""
    return next(key for key, (target, _) in KEYS[slug].items() if target == name)


def entry(slug: str, name: str, value: str) -> str:
    return f"{key_of(slug, name)}: {{value: {value}, source: 'assumed: test'}}"


def section_of(slug: str, key: str) -> str:
    """The section of an input, under whatever suffix; the first for what is no input."""
    fields = {name: section for section, of in SECTIONS[slug].items() for name in of.model_fields}
    names = [name for name in fields if key == name or key.startswith(f"{name}_")]
    return fields[max(names, key=len)] if names else next(iter(SECTIONS[slug]))


def place_of(slug: str, key: str) -> str:
    """How messages name an input of the reading."""
    return f"readings.mine.{section_of(slug, key)}.{key}"


def unit_of(slug: str, name: str) -> str:
    return MODELS[slug].unit(f"{section_of(slug, name)}.{name}")


def reading(slug: str, *lines: str, based_on: str = "corrected") -> str:
    """A user's file with one reading of the given inputs."""
    text = f"{slug}:\n  readings:\n    mine:\n      based_on: {based_on}\n"
    keys = {line: section_of(slug, line.partition(":")[0]) for line in lines}
    for section in dict.fromkeys(keys.values()):
        text += f"      {section}:\n" + "".join(f"        {line}\n" for line in lines if keys[line] == section)
    return text


def about(slug: str, name: str, value: str, *message: str) -> tuple[str, tuple[str, ...]]:
    """The fault that an input has a value that it must not have."""
    return reading(slug, entry(slug, name, value)), (place_of(slug, key_of(slug, name)), *message)


@functools.cache
def fields(*required: str) -> list[tuple[str, str, dict]]:
    """All inputs of all papers with the wanted keywords in their schema, or in that of the numbers in a list."""
    matches = []
    for slug, schema in SCHEMAS.items():
        for name, constraints in schema.items():
            bounds = constraints.get("items", constraints)
            kind = bounds.get("type")
            if all(word in bounds or word in constraints or word == kind for word in required):
                matches.append((slug, name, bounds))
    assert matches, required
    return matches


def as_listed(slug: str, name: str, values: list) -> str:
    """Numbers as the input takes them: one, or a list."""
    return listed(values) if "items" in SCHEMAS[slug][name] else number(values[0])


def valid(bounds: dict) -> float:
    """A number of the right kind within the bounds of an input."""
    least = bounds.get("exclusiveMinimum", bounds.get("minimum", 0))
    most = bounds.get("exclusiveMaximum", bounds.get("maximum", math.inf))
    return least + 1 if least + 1 < most else (least + most) / 2 if bounds["type"] == "number" else least


def length(slug: str, name: str) -> int:
    """How many numbers an input takes, at least."""
    return SCHEMAS[slug][name].get("minItems", 1)


# -------------------------------------------------------------------------------------------------- kinds of faults


@st.composite
def wrong_type(draw):
    """Something that is neither a number, a list of them, nor one of the input's words."""
    slug = draw(SLUG)
    name = draw(st.sampled_from([n for n in SCHEMAS[slug] if n != "density_table"]))
    constraints = SCHEMAS[slug][name]
    value = draw(
        st.one_of(
            WORDS.filter(lambda word: word not in constraints.get("enum", ()) and yaml.safe_load(word) == word),
            st.sampled_from(["1e3", "-4E-5", "'3.7'", "''", "2017-08-17", "2017-08-17T12:00:00Z", "[]", "[[[]]]"]),
            st.dictionaries(WORDS, st.integers(), min_size=1, max_size=2).map(json.dumps),
            st.sampled_from(["{}", "[{}]", "[null]", "[true, false]", "[[1.0, 2.0], a]"]),
            st.sampled_from(["true", "false"]).filter(lambda _: constraints.get("type") != "boolean"),
            st.just("null").filter(
                lambda _: not any(way.get("type") == "null" for way in constraints.get("anyOf", ()))
            ),
        )
    )
    assume(
        not (
            value == "[]"
            and constraints.get("type") == "array"
            and "minItems" not in constraints
            and "maxItems" in constraints
        )
    )
    return about(slug, name, value, ("must be", "should "))


@st.composite
def not_finite(draw):
    slug, name, _ = draw(st.sampled_from(fields("number")))
    values = [1.0] * length(slug, name)
    values[draw(st.integers(0, len(values) - 1))] = draw(st.sampled_from([math.nan, math.inf, -math.inf]))
    return about(slug, name, as_listed(slug, name, values), "should be")


@st.composite
def wrong_sign(draw):
    slug, name, bounds = draw(st.sampled_from([*fields("exclusiveMinimum"), *fields("minimum")]))
    least = bounds.get("exclusiveMinimum", bounds.get("minimum"))
    values = [valid(bounds)] * length(slug, name)
    below = draw(st.integers(1, 10**15)) if bounds["type"] == "integer" else draw(st.floats(1e-3, 1e300))
    at_least = "exclusiveMinimum" in bounds
    values[draw(st.integers(0, len(values) - 1))] = least if at_least and draw(st.booleans()) else least - below
    return about(slug, name, as_listed(slug, name, values), "should be greater than")


@st.composite
def too_large(draw):
    slug, name, bounds = draw(st.sampled_from([*fields("maximum"), *fields("exclusiveMaximum")]))
    most = bounds.get("maximum", bounds.get("exclusiveMaximum"))
    beyond = draw(st.one_of(st.integers(1, 10**18), st.integers(10**300, 10**310)))
    if bounds["type"] == "number":
        beyond = draw(st.floats(1e-3, 1e300))
    values = [valid(bounds)] * length(slug, name)
    values[draw(st.integers(0, len(values) - 1))] = most + beyond
    return about(slug, name, as_listed(slug, name, values), "should be")


@st.composite
def not_whole(draw):
    slug, name, bounds = draw(st.sampled_from(fields("integer")))
    most = 1 if "enum" in bounds else min(bounds.get("maximum", 1000), 1000)
    whole = draw(st.integers(bounds.get("minimum", 1), most))
    values = [float(whole) + draw(st.sampled_from([0.0, 0.5, 0.25]))] * length(slug, name)
    return about(slug, name, as_listed(slug, name, values), "should be")


@st.composite
def wrong_word(draw):
    slug, name, constraints = draw(st.sampled_from([f for f in fields("enum") if f[2]["type"] == "string"]))
    word = draw(st.sampled_from(constraints["enum"]))
    change = draw(st.sampled_from([str.upper, str.title, lambda w: w + "s", lambda w: w[:-1], lambda w: f"{w} {w}"]))
    assume(change(word) not in constraints["enum"])
    return about(slug, name, f"'{change(word)}'", "should be", constraints["enum"][0])


@st.composite
def wrong_length(draw):
    """Too short, too long or enormously long."""
    slug, name, constraints = draw(st.sampled_from([(s, n, SCHEMAS[s][n]) for s, n, _ in fields("items")]))
    assume("maxItems" in constraints)
    allowed = range(constraints.get("minItems", 0), constraints["maxItems"] + 1)
    items = draw(st.one_of(st.integers(0, 30), st.integers(constraints["maxItems"] + 1, 1500)))
    assume(items not in allowed)
    values = [valid(constraints["items"])] * items
    more_or_fewer = "at most" if items > constraints["maxItems"] else "at least"
    return about(slug, name, listed(values), f"should have {more_or_fewer} ", f"not {items} (given: [")


@st.composite
def no_covariance(draw):
    """Indefinite, singular, negative, lopsided, or of another size."""
    name = draw(st.sampled_from(["initial_covariance", "intermediate_covariance", "final_covariance"]))
    deviations = np.array(draw(st.lists(st.floats(0.01, 100), min_size=4, max_size=4)))
    i, j = draw(st.permutations(range(4)))[:2]
    matrix = np.diag(deviations**2)
    kind = draw(st.sampled_from(["correlation", "singular", "negative", "zero", "lopsided", "size", "huge", "mixed"]))
    if kind in ("correlation", "singular"):
        correlation = 1.0 if kind == "singular" else draw(st.floats(1.001, 1e6))
        matrix[i, j] = matrix[j, i] = correlation * deviations[i] * deviations[j]
        message = "give variances above zero and correlations between -1 and 1"
    elif kind in ("negative", "zero"):
        matrix[i, i] = -draw(st.floats(1e-9, 1e9)) if kind == "negative" else 0.0
        message = "is not positive definite"
    elif kind == "lopsided":
        matrix[i, j], matrix[j, i] = 0.1 * deviations[i] * deviations[j], 0.2 * deviations[i] * deviations[j]
        message = "is not symmetric: entry"
    elif kind == "mixed":
        rows = matrix.tolist()
        rows[i] = 1.0
        return about("powered_descent", name, listed(rows), "must be 4 variances, or 4 rows of 4 numbers")
    else:
        size = draw(st.integers(0, 9).filter(lambda n: n != 4)) if kind == "size" else draw(st.integers(500, 3000))
        value = listed([1.0] * size) if kind == "huge" else listed(np.eye(size).tolist())
        return about("powered_descent", name, value, f"has size {size}, must have size 4: give 4 variances")
    diagonal = kind in ("negative", "zero") and draw(st.booleans())
    return about("powered_descent", name, listed((np.diag(matrix) if diagonal else matrix).tolist()), message)


@st.composite
def wrong_unit(draw):
    slug = draw(SLUG)
    key, (name, factor) = draw(st.sampled_from(sorted(KEYS[slug].items())))
    value = "1.0" if factor != 1.0 else "true"  # of which only the unit is looked at
    unit = draw(
        st.one_of(WORDS, st.sampled_from(["ft", "ft/s", "lb", "deg/min", "K", "furlong", "1.0", "null", "[m]"]))
    )
    assume(unit not in (unit_of(slug, name), key.removeprefix(f"{name}_").replace("_", "/")))
    place = f"{place_of(slug, key)}.unit"
    return reading(slug, f"{key}: {{value: {value}, unit: {unit}, source: 'assumed: test'}}"), (place, "must be '")


@st.composite
def wrong_suffix(draw):
    slug = draw(SLUG)
    name, suffix = (
        draw(st.sampled_from(sorted(SCHEMAS[slug]))),
        draw(st.sampled_from(sections.KNOWN_SUFFIXES)),
    )
    key = name + draw(st.sampled_from(["", suffix]))
    assume(key not in KEYS[slug])
    message = (
        "has the wrong unit suffix" if key != name else "needs its unit in its name",
        f"write '{key_of(slug, name)}'",
    )
    return reading(slug, f"{key}: {{value: 1.0, source: 'assumed: test'}}"), (f"{place_of(slug, key)}: ", *message)


@st.composite
def misspelt(draw):
    """A letter that is missing, doubled, exchanged or another one, in the name of an input or of another key."""
    slug = draw(SLUG)
    section, of = draw(st.sampled_from(sorted(SECTIONS[slug].items())))
    place, valid_keys = draw(
        st.sampled_from(
            [
                ("", [*SLUGS, "size", "chunks"]),
                (f"{slug}.", ["readings"]),
                ("readings.mine.", [*SECTIONS[slug], *ABOUT]),
                (f"readings.mine.{section}.", [*of.keys(), "source"]),
                ("entry", ["value", "unit", "source"]),
            ]
        )
    )
    name = draw(st.sampled_from(sorted(valid_keys)))
    at = draw(st.integers(0, len(name) - 1))
    change = draw(st.sampled_from(["missing", "doubled", "another"]))
    letter = {"missing": "", "doubled": 2 * name[at], "another": draw(st.sampled_from("jqxz"))}[change]
    wrong = name[:at] + letter + name[at + 1 :]
    assume(wrong and wrong not in valid_keys and yaml.safe_load(wrong) == wrong and wrong not in KEYS[slug])
    message = (f"{place}{wrong}: unknown key; {nearest(wrong, valid_keys)}",)
    if place == "":
        return f"{wrong}: {{}}\n", message
    if place.startswith(slug):
        return f"{slug}:\n  {wrong}: {{}}\n", message
    if place == "readings.mine.":
        assume(wrong != "inputs")
        return f"{slug}: {{readings: {{mine: {{based_on: corrected, {wrong}: {{}}}}}}}}\n", message
    if place == "entry":
        key = key_of(slug, draw(st.sampled_from(sorted(SCHEMAS[slug]))))
        line = f"{key}: {{value: 1.0, source: 'assumed: test', {wrong}: 1}}"
        return reading(slug, line), (f"{place_of(slug, key)}.{wrong}: unknown key; {nearest(wrong, valid_keys)}",)
    for target in SCHEMAS[slug]:  # another input's name with another unit, of which `wrong_suffix` is
        suffix = wrong.removeprefix(target)
        assume(not (wrong == target or (wrong.startswith(target + "_") and suffix in sections.KNOWN_SUFFIXES)))
    body = f"{{{wrong}: {{value: 1.0, source: 'assumed: test'}}}}"
    return f"{slug}: {{readings: {{mine: {{based_on: corrected, {section}: {body}}}}}}}\n", message


@st.composite
def unknown(draw):
    """A key that has nothing to do with any other, may be of any length, and may be no name at all."""
    slug = draw(SLUG)
    key = draw(
        st.one_of(
            st.text(min_size=1, max_size=20),
            st.text("qxz\n\t \0", min_size=1, max_size=8),
            st.integers(),
            st.floats(),
            st.booleans(),
            st.none(),
            st.dates(),
            st.integers(1_000, 50_000).map(lambda size: "x" * size),
        )
    )
    assume(not isinstance(key, str) or key not in {*KEYS[slug], "source"})
    body, section = {"value": 1.0, "source": "assumed: test"}, next(iter(SECTIONS[slug]))
    document = {slug: {"readings": {"mine": {"based_on": "corrected", section: {key: body}}}}}
    message = "unknown key" if isinstance(key, str) else "must be a name"
    return yaml.safe_dump(document, allow_unicode=True), (f"readings.mine.{section}", message)


@st.composite
def no_source(draw):
    slug = draw(SLUG)
    key = key_of(slug, draw(st.sampled_from(sorted(SCHEMAS[slug]))))
    place = place_of(slug, key)
    body, *message = draw(
        st.sampled_from(
            [
                ("{value: 1.0}", f"{place}: the key 'source' is missing; add it"),
                ("{source: Eq. 1}", f"{place}: the key 'value' is missing; add it"),
                ("{}", f"{place}: the key 'source' is missing; add it"),
                *((f"{{value: 1.0, source: {what}}}", f"{place}.source: say where")
                  for what in ("''", "' '", "null", "7", "[Eq. 1]", "true", "{Eq: 1}")),
                *((f"{{value: 1.0, source: '{what}'}}", f"{place}.source: write 'assumed: ' and the reason")
                  for what in ("assumed", "assumed:", "assumed: ", "assumed:because", "assumed because")),
                *((what, f"{place}: write {{value: ..., source:") for what in ("3.7", "[3.7, Eq. 1]", "null", "Eq. 1")),
            ]
        )
    )  # fmt: skip
    return reading(slug, f"{key}: {body}"), tuple(message)


@st.composite
def set_twice(draw):
    slug = draw(SLUG)
    name = draw(st.sampled_from(sorted(SCHEMAS[slug])))
    ways = [key for key, (target, _) in KEYS[slug].items() if target == name]
    first, second = draw(st.sampled_from(ways)), draw(st.sampled_from(ways))
    same = first == second
    value = listed([1.0] * length(slug, name)) if "items" in SCHEMAS[slug][name] else "1.0"
    lines = [f"{key}: {{value: {value}, source: 'assumed: test'}}" for key in (first, second)]
    return reading(slug, *lines), (
        (f"the key '{first}' occurs twice",) if same else (f"'{name}' is set twice, also as",)
    )


@functools.cache
def names_of(slug: str) -> list[str]:
    """The readings of the project."""
    return list(yaml.safe_load((CONFIGS / f"{slug}.yaml").read_text(encoding="utf-8"))["readings"])


@st.composite
def bad_reading(draw):
    """A reading that is none, of no name, or of no base."""
    slug = draw(SLUG)
    base = draw(st.sampled_from(names_of(slug)))
    length = draw(st.integers(1, inputs.MOST_READINGS))
    circle = ", ".join(f"r{i}: {{based_on: r{(i + 1) % length}}}" for i in range(length))
    name = draw(
        st.one_of(
            # What JSON writes as a pair of surrogates is no YAML.
            st.text(st.characters(max_codepoint=0xFFFF, exclude_categories=["Cs"]), min_size=1, max_size=60).filter(
                lambda n: not n.isascii() or n != n.lower() or " " in n
            ),
            st.integers(41, 900).map(lambda size: "m" * size),  # YAML itself takes no key of more than 1024
            st.sampled_from(
                ["../mine", "Mine", "mine/fig07", "1st", "_mine", "min-e", "mine.h5", "min*", "m\nn", ".."]
            ),
        )
    )
    nowhere = draw(WORDS.filter(lambda name: name not in names_of(slug) and yaml.safe_load(name) == name))
    nothing = draw(st.sampled_from(["[]", "null", "3", "a", "true", "[{a: b}]"]))
    other = draw(st.sampled_from(["[a]", "3", "true", "{a: b}", "1.0e+300"]))
    section = next(iter(SECTIONS[slug]))
    missing = (f"readings.mine.{section}: '", "is missing; give it, or name a complete reading under based_on")
    body, *message = draw(
        st.sampled_from(
            [
                (
                    f"{{{json.dumps(name)}: {{based_on: {base}}}}}",
                    ("a reading's name is lower case letters", "invalid Unicode character escape code"),
                    ("rename it", "fix it"),
                ),
                (f"{{{base}: {{based_on: {base}}}}}", f"readings.{base}: the name belongs to", "choose another name"),
                (f"{{{circle}}}", ".based_on: 'r", "is itself based on 'r", "name another reading"),
                (f"{{mine: {{based_on: {other}}}}}", "readings.mine.based_on: must be the name of a reading, not "),
                (
                    f"{{mine: {{based_on: {nowhere}}}}}",
                    f"readings.mine.based_on: there is no reading '{nowhere}'; ",
                    nearest(nowhere, [*names_of(slug), "mine"]),
                ),
                (
                    f"{{mine: {{based_on: {base}, summary: {other}}}}}",
                    "readings.mine.summary: must be a sentence, not ",
                ),
                (f"{{mine: {{based_on: {base}, frozen: {other}}}}}", "readings.mine.frozen: must be the digest of the"),
                (
                    f"{{mine: {{based_on: {base}, frozen: {nowhere}}}}}",
                    "readings.mine: is frozen, and",
                    "based_on: mine",
                ),
                (
                    f"{{mine: {{based_on: {base}, {section}: {nothing}}}}}",
                    f"readings.mine.{section}: must be keys with values",
                ),
                (f"{{mine: {nothing}}}", "readings.mine: must be keys with values, not "),
                (nothing, f"{slug}.readings: must be keys with values, not "),
                (f"{{mine: {{summary: {nowhere}}}}}", *missing),
                (f"{{mine: {{{section}: {{}}}}}}", *missing),
            ]
        )
    )
    return f"{slug}:\n  readings: {body}\n", tuple(message)


@st.composite
def bad_yaml(draw):
    """What the language of the file itself allows, and a configuration does not, or what is no file of it at all."""
    slug, word = draw(SLUG), draw(WORDS)
    name = draw(st.sampled_from([n for n, constraints in SCHEMAS[slug].items() if constraints.get("type") == "number"]))
    good = reading(slug, entry(slug, name, "1.0"))
    number = draw(st.integers(1, 59))
    tags = ["!!float", "!!str", "!!binary", "!!set", "!!omap", "!", "!mine", "!<tag:yaml.org,2002:int>"]
    tag = draw(st.sampled_from([*tags, "!!python/object/apply:os.system", "!!python/name:os.getcwd"]))
    value = {
        "tag": f"{tag} '1'",
        "anchor": f"&{word} 1.0",
        "alias": f"*{word}",
        "base 60": f"{number}:{draw(st.integers(0, 59)):02}" + draw(st.sampled_from(["", ".5", ":00"])),
        "base 8": f"0{oct(draw(st.integers(1, 10**6)))[2:]}",
    }
    kind = draw(st.sampled_from([*value, "merge", "cut off", "tab", "control", "huge", "not UTF-8", "bomb"]))
    if kind in value:
        text = reading(slug, entry(slug, name, value[kind]))
    else:
        text = {
            "merge": good.replace("based_on: corrected", "<<: {based_on: corrected}"),
            "cut off": good[: good.index("1.0") + draw(st.integers(0, 20))],
            "tab": good.replace("        ", "\t", 1),
            "control": good.replace("1.0", f"1.0{chr(draw(st.integers(0, 8)))}"),
            "huge": good + "#" * (strict_yaml.LARGEST_FILE + draw(st.integers(0, 10))),
            "not UTF-8": good.replace("mine", chr(draw(st.integers(0xDC80, 0xDCFF)))),
            "bomb": "\n".join(["a0: &a0 [1]", *(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]" for i in range(1, 60))]),
        }[kind]
    message = {
        "huge": ("is larger than", "name another file"),
        "tag": ("is not valid YAML: line 6: the tag '", "write the plain value"),
        "anchor": ("is not valid YAML: line 6: anchors and aliases", "write the value out"),
        "alias": ("is not valid YAML: line 6: anchors and aliases", "write the value out"),
        "merge": ("is not valid YAML: line 4: '<<' is not accepted; write the values out",),
        "base 60": ("is not valid YAML: line 6: YAML reads '", "to base 60; write a decimal"),
        "base 8": ("is not valid YAML: line 6: YAML reads '", "to base 8; write a decimal"),
        "bomb": ("is not valid YAML: line 1: anchors and aliases are not accepted",),
    }
    return text, message.get(kind, ("is not valid YAML: line ",))


@st.composite
def bad_encoding(draw):
    """A file in another encoding than UTF-8, or with characters that YAML does not know."""
    slug = draw(SLUG)
    before = draw(st.integers(0, 9))
    good = "# Länge\n" * before + reading(slug, "gravity: {value: 1.0, source: 'Höhe'}")
    kind = draw(st.sampled_from(["utf-16", "utf-16-le", "utf-32", "latin-1", "cp1252", "mac-roman", "control"]))
    if kind == "control":
        unfit = draw(st.sampled_from([*range(9), 11, 12, *range(14, 32), *range(127, 133), *range(134, 160), 0xFFFF]))
        at = draw(st.integers(0, len(good)))
        line = good.count("\n", 0, at) + 1
        return good[:at] + chr(unfit) + good[at:], (f"is not valid YAML: line {line}: has the character", "remove it")
    line = "" if kind.startswith("utf") else 1 if before else 6
    message = ("not UTF-8; save the file in this encoding", "has the character '\\x00'")  # of UTF-16 without its mark
    return good.encode(kind), (f"is not valid YAML: line {line}", message)


@st.composite
def bad_document(draw):
    """No document, several, or one that is not keys with values; and keys that are no names."""
    slug, word = draw(SLUG), draw(WORDS)
    blank = "\n" * draw(st.integers(0, 5))
    good = f"{slug}: {{readings: {{}}}}\n"
    begin = f"begin with one of {SLUGS[0]}, "
    content, *message = draw(
        st.sampled_from(
            [
                (blank, "must be keys with values, not nothing", begin),
                (f"{blank}# {word}\n", "must be keys with values, not nothing", begin),
                ("---\n...\n", "must be keys with values, not nothing", begin),
                (f"{blank}- {slug}\n- {word}\n", f"must be keys with values, not ['{slug}', ", begin),
                (f"{blank}3\n", "must be keys with values, not 3", begin),
                (f"'{word}'\n", f"must be keys with values, not '{word}'", begin),
                (f"{blank}{good}---\n{good}", f"line {len(blank) + 2}: a second document begins; keep one in a file"),
                (f"{blank}? [{slug}]\n: 3\n", f"line {len(blank) + 1}: a key must be a plain name; write one"),
                (f"{blank}? {{a: b}}\n: 3\n", f"line {len(blank) + 1}: a key must be a plain name; write one"),
                (f"{good}{word}:\n\ta: 1\n", "line 3: ", "indent with spaces, not with tabs"),
                (f"__use_yte__: true\n{good}", "__use_yte__: unknown key; valid names: "),
                (f"{slug}: &a {{b: *a}}\n", "line 1: anchors and aliases are not accepted; write the value out"),
                (f"{slug}: !!python/object/apply:os.getcwd []\n", "line 1: the tag '", "write the plain value"),
                (f"when: {draw(st.integers(1000, 9999))}-99-99\n", "line 1: month must be in 1..12", "write another"),
            ]
        )
    )
    return content, tuple(message)


@st.composite
def too_much(draw):
    """More than a configuration holds: depth, digits, lengths, keys, readings."""
    slug = draw(SLUG)
    more = draw(st.sampled_from([1, 2, 50]))
    deep = strict_yaml.DEEPEST + draw(st.sampled_from([more, 20_000]))
    digits = strict_yaml.LONGEST_NUMBER + draw(st.sampled_from([more, 5000]))
    lines = strict_yaml.MOST_VALUES // 2 + more
    readings = "".join(f"    r{i}: {{based_on: corrected}}\n" for i in range(inputs.MOST_READINGS + more))
    content, *message = draw(
        st.sampled_from(
            [
                (f"{slug}: {'[' * deep}{']' * deep}", f"line 1: lists or keys more than {strict_yaml.DEEPEST} deep"),
                (
                    f"{slug}: {'{a: ' * deep}1{'}' * deep}",
                    f"line 1: lists or keys more than {strict_yaml.DEEPEST} deep",
                ),
                (f"\nchunks: {'1' * digits}\n", f"line 2: a number of {digits} characters; write it shorter"),
                (f"chunks: 0.{'1' * digits}\n", f"line 1: a number of {digits + 2} characters; write it shorter"),
                (f"chunks: 0x{'f' * digits}\n", f"line 1: a number of {digits + 2} characters; write it shorter"),
                (
                    f"{slug}: [{'1, ' * (strict_yaml.LONGEST_LIST + more)}]\n",
                    f"line 1: a list of more than {strict_yaml.LONGEST_LIST} entries; shorten it",
                ),
                (
                    "".join(f"a{i}: 1\n" for i in range(lines)),
                    f"line {strict_yaml.MOST_VALUES // 2}: ",  # the document itself is one of the values
                    f"more than {strict_yaml.MOST_VALUES} keys and values; leave some out",
                ),
                (
                    f"{slug}:\n  readings:\n{readings}",
                    f"{slug}.readings: {inputs.MOST_READINGS + more} readings are more than {inputs.MOST_READINGS}; ",
                ),
            ]
        )
    )
    return content, tuple(message)


@st.composite
def periodic_name(draw):
    """A name that Snakemake would take for the trace of a rule that calls itself."""
    part = draw(st.text("abc_1", min_size=1, max_size=2))
    times = draw(st.integers(20, 40 // len(part)))
    before = draw(st.text("xyz", min_size=0, max_size=40 - times * len(part)))
    name = before + part * times
    assume(name[0].isalpha())
    text = f"{draw(SLUG)}:\n  readings:\n    {name}: {{based_on: corrected}}\n"
    return text, (f"readings.{name}: the name ends in '", "repeated", "rename it")


BLANK = "\u200b\u200c\u200d\u2060\ufeff\u00ad\u202e\u3164\u115f\u00a0\u2003 "


@st.composite
def blank_source(draw):
    """A source that no reader sees, or that no terminal shows."""
    slug = draw(SLUG)
    key = key_of(slug, draw(st.sampled_from(sorted(SCHEMAS[slug]))))
    blank = draw(st.text(BLANK, min_size=1, max_size=9))
    unfit = draw(st.sampled_from([*range(9), *range(11, 32), *range(127, 160)]))
    assume(unfit != 13)
    source, *message = draw(
        st.sampled_from(
            [
                (blank, "source: say where the value comes from"),
                (f"assumed: {blank}", "source: write 'assumed: ' and the reason"),
                (f"Eq. 1{chr(unfit)}", "source: has the character '", "which cannot be shown; remove it"),
            ]
        )
    )
    assume(not (source.startswith("assumed") and blank[0] == " "))
    line = json.dumps({"value": 1.0, "source": source})  # characters that YAML does not take are written as escapes
    return reading(slug, f"{key}: {line}"), (f"{place_of(slug, key)}.", *message)


@st.composite
def lone_surrogate(draw):
    """Half of a character, which no file can hold and an escape in one can mean."""
    where = draw(st.sampled_from(["source", "summary", "key"]))
    half = f"\\u{draw(st.integers(0xD800, 0xDFFF)):04x}"
    slug = draw(SLUG)
    key = key_of(slug, draw(st.sampled_from(sorted(SCHEMAS[slug]))))
    text = {
        "source": reading(slug, f'{key}: {{value: 1.0, source: "Eq. {half}"}}'),
        "summary": reading(slug).replace("based_on: corrected", f'based_on: corrected\n      summary: "{half}"'),
        "key": reading(slug, f'"{half}": {{value: 1.0, source: Eq. 1}}'),
    }[where]
    return text, ("is not valid YAML: line ", "fix it")


@st.composite
def implausible(draw):
    """A magnitude or an angle that nothing here has, or a number of things that nobody wants."""
    kind = draw(st.sampled_from(["large", "tiny", "angle", "count"]))
    if kind == "count":
        slug, name, bounds = draw(st.sampled_from(fields("integer", "maximum")))
        values = [draw(st.integers(bounds["maximum"] + 1, bounds["maximum"] + 10**6))] * length(slug, name)
        return about(
            slug, name, as_listed(slug, name, values), ("should be at most", "should be less than or equal to")
        )
    unbounded = [f for f in fields("number") if not {"maximum", "exclusiveMaximum"} & {*f[2]}]
    slug, name, bounds = draw(st.sampled_from(unbounded))
    sign = 1 if {"minimum", "exclusiveMinimum"} & {*bounds} else draw(st.sampled_from([-1, 1]))
    unit = unit_of(slug, name)
    factor = KEYS[slug][key_of(slug, name)][1]
    if kind == "angle":
        assume(unit == "rad")
        size = draw(st.floats(3601, 1e25))
        message = ("deg are more than ten turns", "check the angle and its unit")
    else:
        size = draw(st.floats(1e35, 1e300) if kind == "large" else st.floats(5e-324, 1e-32))
        assume(size * factor > 0.0)
        message = (
            f"is neither 0 nor between {sections.SMALLEST:g} and {sections.LARGEST:g}",
            "check the number and its unit",
        )
    values = [sign * size] * length(slug, name)
    return about(slug, name, as_listed(slug, name, values), *message)


@st.composite
def bad_table(draw):
    """A density table that is no table, or cannot be read, or has no end."""
    slug = draw(st.sampled_from([slug for slug in SLUGS if "density_table" in SCHEMAS[slug]]))
    rows = [[1e4 * i, 0.02 * math.exp(-i)] for i in range(draw(st.integers(3, 9)))]
    at = draw(st.integers(1, len(rows) - 1))
    fault, *message = draw(
        st.sampled_from(
            [
                ((0, math.nan), "finite"),
                ((1, math.inf), "finite"),
                ((1, -draw(st.floats(0, 1e3))), f"row {at + 1}: density", "is not positive; remove or fix the row"),
                ((0, -1.0), f"row {at + 1}: non-monotone density table", "strictly increasing altitude"),
                (None, f"{at if at < 3 else 2} rows are too few for a density table; give at least 3"),
                ("/dev/zero", "it is not a regular file", "give a UTF-8 CSV file"),
                ("/proc/self", "it is not a regular file", "give a UTF-8 CSV file"),
                (f"data/{draw(WORDS)}.csv", "there is no such density table; check the path"),
                ("x" * draw(st.integers(300, 9000)), "give a UTF-8 CSV file"),
                ("true", "should be"),
                ("3.7", "should be"),
                ("[[0, a], [1, 2], [3, 4]]", "should be"),
                ("[['0', '1'], ['1', '2'], ['3', '4']]", "should be"),
                ("[[0, 1, 2], [1, 2, 3]]", "should have"),
                ("\"data\\u0000\\n\"", "cannot be read as a density table", "give a UTF-8 CSV file"),
            ]
        )
    )  # fmt: skip
    if fault is None:
        value = listed(rows[: min(at, 2)])
    elif isinstance(fault, tuple):
        rows[at][fault[0]] = fault[1]
        value = listed(rows)
    else:
        value = fault
    return about(slug, "density_table", value, *message)


POSITIVE = st.floats(1e-3, 1e6)
REVERSED = st.tuples(POSITIVE, POSITIVE).filter(lambda pair: pair[0] != pair[1]).map(lambda pair: sorted(pair)[::-1])
TINY = st.floats(1e-29, 1e-20)
UNFIT = [  # inputs that are each in order and do not go together
    ("powered_descent", "time_step", TINY, "steps in a segment, more than"),
    ("powered_descent", "output_interval", TINY, "steps in a segment, more than"),
    ("powered_descent", "design_interval", TINY, "steps in a segment, more than"),
    ("powered_descent", "time_step", st.floats(15.1, 1e9), "is longer than a segment", "lower it"),
    ("powered_descent", "drawn_trials", st.integers(2001, 10_000), "is more than trials (2000): lower it"),
    (
        "stochastic_entry",
        "density_grid_interval",
        st.floats(1e-20, 1e-3),
        "altitudes from air.lowest_tabulated_altitude",
    ),
    (
        "stochastic_entry",
        "partition_interval",
        st.floats(401.0, 1e9),
        "is longer than mission.time_limit (",
        "lower it",
    ),
    ("random_field", "output_interval", TINY, "must not be below time_step"),
    ("random_field", "time_step", st.floats(0.32, 0.35), "is no multiple of simulation.time_step"),
    ("random_field", "double_integrator_output_interval", TINY, "is no multiple of "),
    ("random_field", "field_interval", TINY, "makes more than 100000 nodes"),
    ("random_field", "control_limits", REVERSED, "stand in the wrong order"),
    ("random_field", "delta_v_window", REVERSED, "stand in the wrong order"),
    ("random_field", "paper_trials", st.integers(10**8, 10**9), "must not be fewer than paper_trials"),
    ("random_field", "partition", st.lists(POSITIVE, min_size=2, max_size=9), "must begin at 0"),
    ("desensitized", "final_time_bounds", REVERSED, "wrong way round: write the smaller one first"),
    ("desensitized", "final_altitude", st.floats(1e7, 1e29), "is not below entry_altitude: exchange them"),
    ("desensitized", "infinite_weights", REVERSED, "does not increase"),
    (
        "desensitized",
        "guess_banks",
        st.lists(st.floats(1, 180), min_size=12, max_size=20),
        "give one less than there are banks",
    ),
    ("desensitized", "initial_bank_rate", st.floats(1e3, 1e29), "lies beyond vehicle.bank_rate_bound"),
    ("desensitized", "studied_intervals", st.sampled_from([[20, 30], [40, 40], [80, 40]]), "must be a multiple"),
    ("desensitized", "tuning_errors", st.permutations([0.0, 1.0, 2.0, 3.0]).map(list), "has a zero", "leave it out"),
    ("desensitized", "density_profile", st.just("table"), "density_table is empty: write the name of its file"),
    ("funnels", "final_velocity_bounds", REVERSED, "wrong way round: write the smaller one first"),
    ("funnels", "final_altitude", st.floats(1e7, 1e29), "is not below entry_altitude: exchange them"),
    ("funnels", "least_velocity", st.floats(1e5, 1e29), "lies above the first of final_velocity_bounds: lower it"),
    ("funnels", "guess_final_time", st.floats(1e5, 1e29), "lies outside of its bounds"),
    ("funnels", "steps_per_slice", st.integers(7001, 10_000), "is not a multiple of recursion.steps_per_slice"),
    ("funnels", "fig4_slice", st.integers(6000, 10_000), "no stage begins at slice"),
    ("funnels", "fig4_coordinates", st.integers(1, 6).map(lambda i: [i, i]), "two different ones span a plane"),
    ("stochastic_entry", "time_limit", st.floats(1e9, 1e29), "guidance periods, more than 100000"),
    ("stochastic_entry", "guidance_period", TINY, "guidance periods, more than 100000"),
    (
        "stochastic_entry",
        "partition_interval",
        st.integers(0, 399).map(lambda n: n + 0.123),
        "must be multiples of guidance.guidance_period",
    ),
    ("stochastic_entry", "ramp_velocities", REVERSED.map(lambda pair: pair[::-1]), "stand in the wrong order"),
    ("stochastic_entry", "deadband_times", REVERSED, "stand in the wrong order"),
    ("stochastic_entry", "paper_trials", st.integers(10**8, 10**9), "must not be fewer than paper_trials"),
    ("stochastic_entry", "density_profile", st.just("table"), "density_table is empty: write the name of its file"),
]


@st.composite
def unfit(draw):
    slug, name, values, *message = draw(st.sampled_from(UNFIT))
    value = draw(values)
    text = value if isinstance(value, str) else listed(value) if isinstance(value, list) else number(value)
    return reading(slug, entry(slug, name, text)), ("readings.mine", name, *message)


KINDS = [
    *(wrong_type, not_finite, wrong_sign, too_large, not_whole, wrong_word, wrong_length, no_covariance, wrong_unit),
    *(wrong_suffix, misspelt, unknown, no_source, set_twice, bad_reading, bad_yaml, bad_table, unfit),
    *(bad_encoding, bad_document, too_much, periodic_name, blank_source, lone_surrogate, implausible),
]

# ------------------------------------------------------------------------------------------------------------ the test


@contextlib.contextmanager
def within(seconds: float):
    """An error, and not a test without end, if something hangs."""

    def late(*_):
        raise AssertionError(f"not refused within {seconds} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="module", autouse=True)
def project_read_once():
    """The project's own files are read once: they are the same for all."""
    remembered = functools.cache(read_yaml)

    def read(path, *remedy):
        return remembered(path) if path.parent == CONFIGS else read_yaml(path, *remedy)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inputs, "read_yaml", read)
        yield


def test_enough_is_drawn():
    assert len(KINDS) * EXAMPLES >= 500


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_what_is_malformed_is_refused_with_file_key_and_remedy(tmp_path_factory, kind):
    path = tmp_path_factory.mktemp(kind.__name__) / "mine.yaml"
    count_of_content = Counter()

    @settings(
        max_examples=EXAMPLES, deadline=None, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow]
    )
    @given(fault=kind())
    def refused(fault):
        content, fragments = fault
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogateescape"))
        with within(SECONDS), pytest.raises(InputError) as caught:
            load_studies(MODELS, CONFIGS, read_own_file(path, (*SLUGS, *SETTINGS)), [path])
        message = str(caught.value)
        assert re.match(rf"{re.escape(str(path))}(:\d+)?: ", message)
        for fragment in fragments:
            assert any(text in message for text in ([fragment] if isinstance(fragment, str) else fragment)), fragment
        assert message.isprintable(), "one line that a terminal shows as it is"
        assert len(message) <= LONGEST
        count_of_content[content] += 1

    refused()
    assert count_of_content.total() >= EXAMPLES
