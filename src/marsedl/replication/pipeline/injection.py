"""Arguments by name: what a stage, figure, table, claim or measure asks for in its signature.

There is one rule for all of them. A parameter takes, by its name and annotation,

- what is given beside inputs and records under its name, such as the printed claims `published`;
- a section of the inputs; all of them, of a parameter annotated with the paper's class `Inputs`;
- what another function of the claims returns, if that is annotated with the class of the parameter;
- the artifact of its name; `Largest[...]` is that of the case `<name>_large` where there is one.

A parameter with a default may lack. A keyword-only one is given only what a caller names.
"""

import inspect
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property

from marsedl.replication.inputs.sections import Inputs, Section, by_section

LARGE = "_large"  # ends the name of the case of more trials
_Record = typing.TypeVar("_Record")
_LARGEST = "the largest ensemble"
Largest = typing.Annotated[_Record, _LARGEST]


class Missing(Exception):
    """What a function asks for does not exist."""


@dataclass(frozen=True)
class Arguments:
    """What functions can ask for."""

    values: Mapping[str, object]  # plain inputs by "section.name"; a section has no others
    artifact: Callable[[str, type], object] = lambda name, kind: None  # of a name and type; None if there is none
    further: Mapping[str, object] = field(default_factory=dict)  # other arguments by the name of the parameter
    providers: Mapping[type, Callable] = field(default_factory=dict)  # by the class that they return
    _known: dict = field(default_factory=dict)  # what was asked for before

    def of(self, function: Callable, **further) -> dict[str, object]:
        """Return a function's arguments by name; raises Missing if there is none for a parameter without a default.

        further: used if the function has parameters of these names, which may be keyword-only.
        """
        arguments = {}
        for name, kind, optional in _parameters(function):
            value = further[name] if name in further else self._once(name, kind)
            if value is not None:
                arguments[name] = value
            elif not optional:
                raise Missing(f"{function.__module__}.{function.__name__} asks for '{name}', which there is not")
        return arguments | {name: further[name] for name in _keyword_only(function) if name in further}

    def available(self, function: Callable) -> dict[str, object]:
        """Return those of a function's arguments that there are."""
        found = {name: self._once(name, kind) for name, kind, _ in _parameters(function)}
        return {name: value for name, value in found.items() if value is not None}

    def call(self, function: Callable, **further) -> typing.Any:
        """Call a function with its arguments."""
        return function(**self.of(function, **further))

    @cached_property
    def _sections(self) -> dict[str, dict[str, object]]:
        return by_section(self.values)

    def _once(self, name: str, kind: object) -> object:
        """What a parameter takes, found once; what a provider raises, it raises again."""
        if (name, kind) not in self._known:
            try:
                self._known[name, kind] = self._value(name, kind)
            except Exception as error:
                self._known[name, kind] = error
        if isinstance(value := self._known[name, kind], Exception):
            raise value
        return value

    def _value(self, name: str, kind: object) -> object:
        plain, *marks = typing.get_args(kind) if typing.get_origin(kind) is typing.Annotated else (kind,)
        if name in self.further:
            return self.further[name]
        if plain in self.providers:
            return self.call(self.providers[plain])
        if isinstance(plain, type) and issubclass(plain, Section):
            return plain.from_plain(self._sections.get(name, {}))
        if isinstance(plain, type) and issubclass(plain, Inputs):
            return plain.from_plain(self.values)
        if _LARGEST in marks and (large := self.artifact(name + LARGE, plain)) is not None:
            return large
        return self.artifact(name, plain)


@cache
def _parameters(function: Callable) -> tuple[tuple[str, object, bool], ...]:
    """Name, type and whether it may be left out of each parameter that is given."""
    hints = typing.get_type_hints(function, include_extras=True)
    parameters = [p for p in inspect.signature(function).parameters.values() if p.kind is not p.KEYWORD_ONLY]
    return tuple((p.name, _without_none(hints.get(p.name)), p.default is not p.empty) for p in parameters)


@cache
def _keyword_only(function: Callable) -> tuple[str, ...]:
    parameters = inspect.signature(function).parameters.values()
    return tuple(parameter.name for parameter in parameters if parameter.kind is parameter.KEYWORD_ONLY)


def _without_none(kind: object) -> object:
    """The type of an annotation that may allow None."""
    if typing.get_origin(kind) not in (typing.Union, types.UnionType):
        return kind
    return next((of for of in typing.get_args(kind) if of is not type(None)), kind)
