"""What is wrong in a file, in one line: the file, the line, the key, the fault and the remedy."""

import functools
import re
import typing
from dataclasses import dataclass, replace

from pydantic import BaseModel, ValidationError

from marsedl.replication.errors import InputError, nearest, shown

Model = typing.TypeVar("Model", bound=BaseModel)


@dataclass(frozen=True)
class Place:
    """A key in a file, as messages name it: the file, the line and the keys that lead to it."""

    origin: str
    document: object = None  # as `read_yaml` returns it, for line numbers; None if there is no file
    keys: tuple = ()

    def __truediv__(self, key: object) -> "Place":
        """Return the place of a key below this one."""
        return replace(self, keys=(*self.keys, key))

    def written(self) -> object:
        """Return what is written there."""
        return functools.reduce(lambda node, key: node[key], self.keys, self.document)

    def __str__(self) -> str:
        """Return the place as "file:line: key.key", with the line of the innermost key that has one."""
        line, node = None, self.document
        for key in self.keys:
            line, node = getattr(node, "lines", {}).get(key, line), node.get(key) if isinstance(node, dict) else None
        where = f"{self.origin}:{line}" if line else self.origin
        return f"{where}: {'.'.join(map(str, self.keys))}" if self.keys else where


class Keys(BaseModel, extra="forbid", frozen=True, defer_build=True):
    """Base of what is written as keys with values: no unknown keys."""

    @classmethod
    def unknown(cls, key: str) -> str:
        """Return what is wrong with a key that is not one of these."""
        return f"unknown key; {nearest(key, cls.model_fields)}"


def checked(model: type[Model], value: object, place: Place) -> Model:
    """Return what is written at a place as a model has it; InputError tells all faults, a line each."""
    try:
        return model.model_validate(value)
    except ValidationError as error:
        # First unknown keys: one may be a missing one, misspelt, which is not told as well.
        faults = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
    unknown = {fault["loc"][:-1] for fault in faults if fault["type"] == "extra_forbidden"}
    those = [one for one in faults if one["type"] != "missing" or one["loc"][:-1] not in unknown]
    # Of a key one fault: of several types that it may have, none fits.
    told = {_keys_of(one, value): _fault(model, one, place) for one in reversed(those)}
    raise InputError("\n".join(told.values()))


def _keys_of(fault: typing.Mapping, value: object) -> tuple:
    """The keys that lead to a fault, as they are written: behind them pydantic names the types that it tried."""
    for count, key in enumerate(fault["loc"]):
        if not isinstance(value, dict) or key not in value:
            return fault["loc"][:count]
        value = value[key]
    return fault["loc"]


def _fault(model: type[BaseModel], fault: typing.Mapping, place: Place) -> str:
    """One fault, with its place."""
    keys, kind, written = fault["loc"], fault["type"], fault["input"]
    of_key = keys[-1:] == ("[key]",)  # not of what stands under it
    for key in keys[:-1] if of_key or kind == "missing" else keys:
        place /= key
    if kind == "extra_forbidden":
        problem = functools.reduce(_below, keys[:-1], model).unknown(keys[-1])
    elif kind == "missing":
        problem = f"the key '{keys[-1]}' is missing; add it"
    elif kind in ("model_type", "dict_type"):
        names = getattr(functools.reduce(_below, keys, model), "model_fields", ())
        problem = f"must be keys with values, not {'nothing' if written is None else shown(written)}"
        problem += f"; {nearest('', names)}" if names else ""
    else:
        problem = sentence(fault) if of_key else sentence(fault, written)
    return f"{place}: {problem}"


def sentence(fault: typing.Mapping, written: object = ...) -> str:
    """Return what is wrong by an entry of `ValidationError.errors`, and the value as it is written unless left out."""
    message = fault["msg"].removeprefix("Value error, ").replace("valid tuple", "valid list").replace("Tuple", "List")
    given = "" if written is ... else f" (given: {shown(written)})"
    if fault["type"] == "string_type" and not isinstance(fault["input"], dict | list):
        given += f"; YAML reads it as {shown(fault['input'])}: write it in quotes"
    is_number = re.fullmatch(r"[+-]?[0-9]+(,[0-9]+|[eE][+-]?[0-9]+)", str(fault["input"]).strip())
    hint = "; YAML reads this as text: write the number with a point, as in 0.03 or 1.0e+5" if is_number else ""
    return f"{message}{given}{hint}"


def _below(of: typing.Any, key: object) -> typing.Any:
    """Return the type of what stands under a key of a model, or of a mapping or list."""
    return of.model_fields[key].annotation if hasattr(of, "model_fields") else typing.get_args(of)[-1]
