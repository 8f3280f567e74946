"""Flights in a file: numbers that any reader of HDF5 understands, and the declaration, by which a study goes on."""

import inspect
import json
import pickle
import re
import warnings
from collections import namedtuple
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from marsedl.fly.campaign import Campaign
from marsedl.fly.flights import Flights, Search
from marsedl.montecarlo.flights.binding import digest, helpers_of
from marsedl.words import remedy, require

__all__ = ["load"]

FORMAT = "marsedl flights 1"
ARGUMENTS = tuple(inspect.signature(Campaign).parameters)
_NOT_FOUND = (AttributeError, ImportError, pickle.UnpicklingError, EOFError, TypeError, ValueError)
_KEPT = {"compression": "gzip", "shuffle": True, "fletcher32": True}  # a damaged number is no number


class Unflown:
    """Stands in for a campaign whose law is not here: questions are answered, and what would fly says why it cannot."""

    def __init__(self, why, seed, truth, counting, names, quantities, drawn, times, stored):
        """All that questions need. why: sentence on what is missing. counting: outcomes that count in statistics."""
        self.why, self.seed, self.truth, self.counting, self.names = why, seed, truth, counting, names
        self.model = SimpleNamespace(quantities=quantities)
        self.recorded, self.times, self.stored, self.history, self.before = drawn, times, stored, None, None

    def final(self, numbers):
        """Final numbers by name."""
        return dict(zip(self.names, numbers, strict=True))

    def counts(self, outcome):
        """Which of these outcomes count in statistics."""
        return np.isin(outcome, self.counting)

    def schedule(self, every):
        """When histories are stored."""
        return SimpleNamespace(times=self.times)

    def flight(self):
        """What histories hold."""
        return SimpleNamespace(parts={"stored": namedtuple("Stored", self.stored)})

    def __getattr__(self, name):
        """Raise ValueError: what is asked for beside these would fly."""
        raise AttributeError(name) if name.startswith("__") else ValueError(self.why)


def save(flights, path):
    """Write flights: see `Flights.save`."""
    import h5py

    campaign = flights.campaign
    require(
        isinstance(campaign, Campaign), "these flights were read without their law: copy the file that they are from"
    )
    functions = [name for name, (_, definition) in flights.derived.items() if callable(definition)]
    if functions:
        warnings.warn(
            f"{', '.join(functions)}: a function, which no file keeps; define it as an expression, or again after load",
            stacklevel=3,
        )
    path = Path(path)
    part = path.with_name(f".{path.name}.partial")
    try:
        with h5py.File(part, "w") as file:
            _write(file, flights, {name: flights.derived[name] for name in flights.derived if name not in functions})
        part.replace(path)
    except OSError as error:
        raise OSError(f"{path}: {error}") from error
    finally:
        part.unlink(missing_ok=True)


def _write(file, flights, derived):
    import h5py

    campaign, outcomes = flights.campaign, np.unique(flights.outcome)
    file.attrs.update(
        format=FORMAT,
        seed=campaign.seed,
        truth=json.dumps(campaign.truth),
        counting=json.dumps(outcomes[campaign.counts(outcomes)].tolist()),
        derived=json.dumps(derived),
        search=json.dumps(flights.search),
    )

    def variable(group, name, values, *scales):
        dataset = file.create_dataset(f"{group}/{name}", data=values, **_KEPT)
        unit, meaning = flights._meaning(name)
        dataset.attrs.update(units=unit, long_name=meaning)
        for dimension, scale in enumerate(scales):
            dataset.dims[dimension].attach_scale(file[scale])

    file["trial"] = np.arange(flights.trials)
    file["trial"].make_scale("trial")
    for group, numbers in (("final", flights.final), ("drawn", flights.drawn)):
        file.create_group(group).attrs["names"] = json.dumps([*numbers])
        for name, values in numbers.items():
            variable(group, name, values, "trial")
    ended = np.char.encode(flights.outcome, "utf-8")
    text = h5py.string_dtype("utf-8", ended.dtype.itemsize)
    file.create_dataset("final/outcome", data=ended.astype(text), **_KEPT).dims[0].attach_scale(file["trial"])
    stored = campaign.flight().parts["stored"]._fields if flights.histories is not None else ()
    file.create_group("history").attrs["names"] = json.dumps(stored)
    if stored:
        file["time"] = campaign.schedule(campaign.history).times
        file["time"].make_scale("time")
        for row, name in enumerate(stored):
            variable("history", name, flights.histories[:, row], "time", "trial")
    declaration = file.create_group("declaration")
    declaration.attrs.update(reached=campaign.reached, law=digest(campaign.law))
    declaration["law_source"] = _source(campaign.law.kind)
    for name, value in zip(ARGUMENTS, campaign.declared, strict=True):
        try:
            pickled = pickle.dumps(value)
        except (pickle.PicklingError, AttributeError, TypeError):
            pickled = b""
        declaration[name] = np.frombuffer(pickled, np.uint8)
        declaration[name].attrs["text"] = re.sub(r" at 0x\w+", "", repr(value))[:10_000]


def _source(kind):
    """Source of a law and its helpers, but for those of this package."""
    texts = []
    for function in helpers_of(kind[1]) if kind[0] in ("simple", "guide") else ():
        if not str(function.__module__).startswith("marsedl."):  # None of what `exec` defines
            try:
                texts.append(inspect.getsource(function))
            except OSError:
                texts.append(f"# {function.__qualname__}: its source is not found\n")
    return "\n\n".join(texts)


def load(path, *, processes=1, progress=None, compiled=True, **declared) -> Flights:
    """Flights that `Flights.save` has kept: `extended`, `until` and `replay` go on with the same bits.

    Functions of the declaration are found by import, as pickle does: load files that you trust. Those that are not
    found, such as a law that was defined in a notebook, are given again under their names in `fly`. Without them, or if
    a law is found that is another one now, a warning says so; the numbers can be asked all questions even then, and
    nothing is flown.

    Args:
        path: of the file. processes, progress, compiled: as of `fly`, for further flights.
        declared: arguments of `fly` that are not found, such as law=guide.

    Returns:
        `Flights`.

    Raises:
        ValueError: for a file that is none, a name that is no argument, or something given again that is another one
            than that which flew: its code, its numbers, or what it draws.
    """
    import h5py

    for name in declared:
        require(name in ARGUMENTS, f"load has no argument {name!r}; {remedy(name, ARGUMENTS)}")
    require(Path(path).is_file(), f"{path}: there is no such file")
    try:
        with h5py.File(path, "r") as file:
            require(file.attrs.get("format") == FORMAT, f"{path} is no file of `Flights.save`, format {FORMAT!r}")
            return _read(path, file, declared, (processes, progress, compiled))
    except (OSError, KeyError) as error:
        raise ValueError(f"{path} is damaged, or no file of `Flights.save`: {error}") from error


def _read(path, file, declared, how):
    attributes = {name: json.loads(file.attrs[name]) for name in ("truth", "counting", "derived", "search")}
    names = {group: json.loads(file[group].attrs["names"]) for group in ("final", "drawn", "history")}
    final, drawn, history = ({name: file[group][name][()] for name in names[group]} for group in names)
    outcome = np.char.decode(file["final/outcome"][()], "utf-8")
    numbers = np.array([*final.values()]).reshape(len(final), outcome.size)
    histories = np.stack([*history.values()], axis=1) if history else None
    search = attributes["search"] and Search(*attributes["search"])

    def flights(campaign):
        derived = {name: tuple(definition) for name, definition in attributes["derived"].items()}
        return Flights(campaign, numbers, outcome, histories, how, derived, search)

    campaign, why = _found(path, file["declaration"], declared)
    if campaign is not None:
        last = range(outcome.size - 1, outcome.size)
        again = flights(campaign)._drawn(last)
        if again == {name: values[last] for name, values in drawn.items()}:
            return flights(campaign)
        why = f"{path}: start, vehicle or errors draw other numbers than those that flew"
    require(not declared, why)
    warnings.warn(f"{why}; the numbers can be asked, nothing can be flown", stacklevel=4)
    variables = [file[group][name] for group in names for name in names[group]]
    units = {Path(one.name).name: (one.attrs["units"], one.attrs["long_name"]) for one in variables}
    times = file["time"][()] if history else None
    told = attributes["truth"], attributes["counting"], names["final"], units, drawn, times, names["history"]
    return flights(Unflown(why, int(file.attrs["seed"]), *told))


def _found(path, group, declared):
    """The campaign that flew, or None and a sentence on why it is not found."""
    arguments, missing = dict(declared), {}
    for name in ARGUMENTS:
        if name in group and name not in declared:  # of another version it may have fewer
            try:
                arguments[name] = pickle.loads(group[name][()].tobytes())
            except _NOT_FOUND:
                missing[name] = f"{name} ({group[name].attrs['text']})"
    again = f"give it again, as in load({str(path)!r}, {next(iter(missing), 'law')}=...)"
    if missing:
        return None, f"{path}: import does not find {' and '.join(missing.values())}: {again}"
    try:
        with warnings.catch_warnings(action="ignore"):  # they were told when it flew
            campaign = Campaign(**arguments)
    except ValueError as error:
        return None, f"{path}: {error}"
    if campaign.reached == group.attrs["reached"]:
        return campaign, ""
    if digest(campaign.law) != group.attrs["law"]:
        then = "in the file declaration/law_source shows that of then"
        return None, f"{path}: the law is not the one that flew, its code or its numbers are others; {then}; {again}"
    return None, f"{path}: the equations or numbers of the vehicle are not those that flew, or Python is another"
