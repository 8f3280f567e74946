"""Scenarios: one vehicle in one uncertain world, which every law flies; see `scenario.Scenario`."""

from functools import cache
from importlib import import_module
from pathlib import Path

from marsedl.replication.errors import InputError, nearest
from marsedl.replication.inputs.yaml_file import read_yaml
from marsedl.replication.pipeline.catalogue import TEXTS, Arena

SCENARIOS = {
    "entry": "stochastic_entry",
    "descent": "powered_descent",
}  # by name, the paper whose `corrected` inputs it takes


def load(name: str, root: Path, file: Path | None = None):
    """The scenario of a name, or a user's file that is based on it.

    Raises InputError naming file, line, key and remedy.
    """
    if name not in SCENARIOS:
        raise InputError(f"there is no scenario '{name}'; {nearest(name, SCENARIOS)}")
    return import_module(f"marsedl.scenarios.{name}.scenario").SCENARIO.load(root, file)


@cache
def arenas() -> dict[str, Arena]:
    """What the workflow makes of every scenario. No scenario is imported."""
    found, texts = {}, read_yaml(Path(__file__).with_name(TEXTS))
    for name, paper in SCENARIOS.items():
        flies = f"marsedl.scenarios.{name}.scenario:SCENARIO"
        shows = (flies, "marsedl.scenarios.shown:write", f"marsedl.scenarios.{name}.figures:FIGURES")
        entries = flies, "marsedl.scenarios.arena:tuned", "marsedl.scenarios.records:flown_chunk"
        found[name] = Arena(name, paper, entries, shows, **texts[name])
    return found
