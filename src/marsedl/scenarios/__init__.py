"""Scenarios: one vehicle in one uncertain world, which every law flies; see `scenario.Scenario`."""

from importlib import import_module
from pathlib import Path

from marsedl.replication.errors import InputError, nearest

SCENARIOS = ("entry",)


def load(name: str, root: Path, file: Path | None = None):
    """The scenario of a name, or a user's file that is based on it.

    Raises InputError naming file, line, key and remedy.
    """
    if name not in SCENARIOS:
        raise InputError(f"there is no scenario '{name}'; {nearest(name, SCENARIOS)}")
    return import_module(f"marsedl.scenarios.{name}.scenario").SCENARIO.load(root, file)
