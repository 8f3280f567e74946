"""YAML as it is written: without repeated keys or surprising numbers; keys keep their lines."""

import re
from pathlib import Path

import yaml

from marsedl.replication.errors import InputError, shown


class Lined(dict):
    """A mapping that knows the line of each key."""

    lines: dict[object, int]


class _StrictLoader(yaml.CSafeLoader):
    def construct_lined(self, node):
        mapping = Lined()
        mapping.lines = {}
        yield mapping
        for key_node, value_node in node.value:
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, list | dict):
                raise yaml.MarkedYAMLError(problem="a key must be a plain name", problem_mark=key_node.start_mark)
            if key in mapping:
                reason = f"the key {shown(key)} occurs twice; remove one"
                raise yaml.MarkedYAMLError(problem=reason, problem_mark=key_node.start_mark)
            mapping[key] = self.construct_object(value_node)
            if node.flow_style and mapping[key] is None and isinstance(key, int):  # of {value: 0,5}
                reason = f"the comma before {key} begins another key; write numbers with a decimal point"
                raise yaml.MarkedYAMLError(problem=reason, problem_mark=key_node.start_mark)
            mapping.lines[key] = key_node.start_mark.line + 1

    def construct_decimal(self, node):
        """Numbers as they look: to YAML, 1:30 is ninety and 017 is fifteen."""
        if ":" in node.value or re.fullmatch(r"[-+]?0[0-7_]+", node.value):
            reason = f"YAML does not read {shown(node.value)} as a decimal number; write one, with a point for a comma"
            raise yaml.MarkedYAMLError(problem=reason, problem_mark=node.start_mark)
        return self.construct_yaml_int(node) if node.tag.endswith(":int") else self.construct_yaml_float(node)


_StrictLoader.add_constructor("tag:yaml.org,2002:map", _StrictLoader.construct_lined)
for _kind in ("int", "float"):
    _StrictLoader.add_constructor(f"tag:yaml.org,2002:{_kind}", _StrictLoader.construct_decimal)


def read_yaml(path: Path, remedy: str = "restore it") -> object:
    """Read a YAML file strictly; an unreadable or malformed one is an InputError naming file and line.

    remedy: what to do if the file is missing or cannot be read.
    """
    try:
        return yaml.load(Path(path).read_bytes(), Loader=_StrictLoader)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {remedy}") from None
    except yaml.MarkedYAMLError as error:
        mark, reason = error.problem_mark or error.context_mark, error.problem or error.context
        hint = "; quote it, or indent with spaces in place of tabs" if "start any token" in reason else ""
        raise InputError(f"{path}: is not valid YAML: line {mark.line + 1}: {reason}{hint}") from None
    except (yaml.YAMLError, ValueError) as error:  # the latter of a date in month 13
        raise InputError(f"{path}: is not valid YAML: {str(error).splitlines()[0]}") from None
