"""YAML as it is written: without repeated keys, anchors, tags or surprising numbers; keys keep their lines."""

import re
from pathlib import Path

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.cyaml import CParser
from yaml.resolver import Resolver

from marsedl.replication.errors import InputError, shown
from marsedl.replication.terminal import printable

# Limits of a file. The project's own are a tenth of them; the largest allowed is read in seconds.
LARGEST_FILE = 2**18  # bytes
MOST_VALUES = 20_000  # keys, values and lists in a file
LONGEST_LIST = 5_000
LONGEST_NUMBER = 1_000  # characters
DEEPEST = 20  # lists or keys inside of one another


class Lined(dict):
    """A mapping that knows the line of each key."""

    def __init__(self):
        """Begin empty."""
        super().__init__()
        self.lines: dict[object, int] = {}


class _StrictLoader(Composer, CParser, SafeConstructor, Resolver):
    """YAML within limits and without repeated keys, anchors, aliases or tags, so that it means what it looks like."""

    def __init__(self, text):
        CParser.__init__(self, text)
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        Resolver.__init__(self)
        self._values = self._depth = 0

    def compose_node(self, parent, index):
        event = self.peek_event()
        self._values += 1
        if getattr(event, "anchor", None) is not None:
            raise _at(event, "anchors and aliases are not accepted; write the value out")
        if getattr(event, "tag", None) is not None:
            raise _at(event, f"the tag {shown(event.tag)} is not accepted; write the plain value")
        if self._values > MOST_VALUES:
            raise _at(event, f"more than {MOST_VALUES} keys and values; leave some out")
        if isinstance(index, int) and index >= LONGEST_LIST:
            raise _at(event, f"a list of more than {LONGEST_LIST} entries; shorten it")
        if self._depth >= DEEPEST:
            raise _at(event, f"lists or keys more than {DEEPEST} deep; write them flat")
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_object(self, node, deep=False):
        try:
            return super().construct_object(node, deep)
        except ValueError as error:  # such as a date in month 13
            raise _at(node, f"{error}; write another value") from None

    def construct_lined(self, node):
        mapping = Lined()
        yield mapping
        for key_node, value_node in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                raise _at(key_node, "'<<' is not accepted; write the values out")
            key = self.construct_object(key_node, deep=True)
            try:
                repeated = key in mapping
            except TypeError:
                raise _at(key_node, "a key must be a plain name; write one") from None
            if repeated:
                raise _at(key_node, f"the key {shown(key)} occurs twice; remove one")
            mapping[key] = self.construct_object(value_node)
            mapping.lines[key] = key_node.start_mark.line + 1

    def construct_decimal(self, node):
        """Numbers as they look: to YAML, 1:30 is ninety and 017 is fifteen."""
        if len(node.value) > LONGEST_NUMBER:
            raise _at(node, f"a number of {len(node.value)} characters; write it shorter, as in 1.0e+6")
        if ":" in node.value or re.fullmatch(r"[-+]?0[0-7_]+", node.value):
            base = 60 if ":" in node.value else 8
            raise _at(node, f"YAML reads {shown(node.value)} to base {base}; write a decimal")
        construct = self.construct_yaml_int if node.tag.endswith(":int") else self.construct_yaml_float
        return construct(node)


_StrictLoader.add_constructor("tag:yaml.org,2002:map", _StrictLoader.construct_lined)
_StrictLoader.add_constructor("tag:yaml.org,2002:int", _StrictLoader.construct_decimal)
_StrictLoader.add_constructor("tag:yaml.org,2002:float", _StrictLoader.construct_decimal)


def _at(event, reason: str) -> yaml.YAMLError:
    """Return an error that names the line."""
    return yaml.YAMLError(f"line {event.start_mark.line + 1}: {reason}")


def read_yaml(path: Path, remedy: str = "restore it") -> object:
    """Read a YAML file strictly; an unreadable or malformed one is an InputError naming file and line.

    remedy: what to do if the file is missing or cannot be read.
    """
    name = printable(str(path))
    try:
        path = Path(path)
        if path.exists() and not path.is_file() and not path.is_dir():  # it may never end, or be read only once
            raise InputError(f"{name}: is not a regular file; save it as one")
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except (OSError, RuntimeError) as error:  # the latter of a loop of links
        raise InputError(f"{name}: cannot be read ({getattr(error, 'strerror', error)}); {remedy}") from None
    if len(content) > LARGEST_FILE:
        raise InputError(
            f"{name}: is larger than {LARGEST_FILE} bytes, too large for a configuration; name another file"
        )
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(f"{name}: is not valid YAML: line {line}: not UTF-8; save the file in this encoding") from None
    if unfit := yaml.reader.Reader.NON_PRINTABLE.search(text):
        line = text.count("\n", 0, unfit.start()) + 1
        raise InputError(f"{name}: is not valid YAML: line {line}: has the character {unfit[0]!r}; remove it")
    try:
        return yaml.load(text, Loader=_StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        reason = printable(error.problem or error.context)
        line = text.split("\n")[mark.line] if mark.line < text.count("\n") + 1 else ""
        remedy = "indent with spaces, not with tabs" if re.match(r" *\t", line) else "fix it"
        if "another document" in reason:
            reason, remedy = "a second document begins", "keep one in a file"
        raise InputError(f"{name}: is not valid YAML: line {mark.line + 1}: {reason}; {remedy}") from None
    except yaml.YAMLError as error:
        raise InputError(f"{name}: is not valid YAML: {printable(str(error).splitlines()[0])}") from None
