"""What is counted of every flight of the entry: heat of the nose, reversals and way of the commanded bank angle."""

from collections import namedtuple
from dataclasses import replace
from functools import cache

from marsedl.fly import Model
from marsedl.fly.dynamics import Bank, EntryWatched, entry_watch
from marsedl.fly.generated import with_fields
from marsedl.fly.vehicles import parts_of
from marsedl.models.heating import sutton_graves_heat_rate
from marsedl.montecarlo.flights import Flight

__all__ = ["watching"]


# Of a nose of a metre in a gas whose constant is 1, by the law of Sutton and Graves: rate, and the folds of it: the
# largest rate, and its integral over time by trapezoids.
Heat = namedtuple("Heat", ("rate", "peak", "load"))
COUNTED = ("peak_heat", "heat_load", "reversals", "bank_moved")
LAST = ("last_time", "last_heat", "last_bank")  # with which the next step compares
Watched = namedtuple(
    "Watched",
    (*EntryWatched._fields, *COUNTED, *LAST),
    defaults=(*EntryWatched._field_defaults.values(), *[0.0] * len(COUNTED + LAST)),
)


def heated(watched, time, sensed) -> Heat:
    """The heat now."""
    rate = sutton_graves_heat_rate(sensed.density, sensed.velocity, 1.0, 1.0)
    load = watched.heat_load + 0.5 * (rate + watched.last_heat) * (time - watched.last_time)
    return Heat(rate, rate if rate > watched.peak_heat else watched.peak_heat, load)


def watch(watched, time, sensed, command: Bank) -> Watched:
    """At every step; the command is that of the law, before the limits of the actuator."""
    whole, heat = entry_watch(watched, sensed), heated(watched, time, sensed)
    return Watched(
        whole.max_load,
        whole.min_altitude,
        whole.max_altitude,
        heat.peak,
        heat.load,
        watched.reversals + (1.0 if command.bank * watched.last_bank < 0.0 else 0.0),
        watched.bank_moved + (0.0 if time == 0.0 else abs(command.bank - watched.last_bank)),
        time,
        heat.rate,
        command.bank,
    )


@cache
def _watching(flight) -> Flight:
    parts = parts_of(flight)
    counted = dict(zip(COUNTED, ("heat.peak", "heat.load", *(f"watched.{name}" for name in COUNTED[2:])), strict=True))
    asks, line = ["watched", "time", "sensed"], "heat = heated(watched, time, sensed)"
    return Flight(
        **parts | {"watch": watch, "finish": with_fields(parts["finish"], counted, asks, line, heated=heated)}
    )


def watching(model: Model) -> Model:
    """The model of an entry with these numbers at the end of its flights."""
    meanings = (
        ("W/m^2", "largest heat rate of a nose of a metre in a gas of the constant 1"),
        ("J/m^2", "its integral"),
        ("1", "changes of the commanded bank angle's sign"),
        ("rad", "way of the commanded bank angle"),
    )
    quantities = model.quantities | dict(zip(COUNTED, meanings, strict=True))
    return replace(model, flight=_watching(model.flight), quantities=quantities)
