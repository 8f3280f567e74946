"""How a vehicle follows what is commanded: limits, lag and delay, declared by command, between law and `rates`."""

from collections import namedtuple
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from inspect import signature
from typing import NamedTuple, get_args

import numpy as np

from marsedl.compiling import inlined
from marsedl.elementary import clip, exponential
from marsedl.fly.declared import is_number, resolve
from marsedl.fly.generated import generated, with_fields
from marsedl.montecarlo.flights.binding import Nothing, hints
from marsedl.words import remedy, require

__all__ = ["Actuator"]

MOST_PERIODS = 50  # by which a command may be late: each is remembered
_SAME = 1e-6  # of a guidance period, by which two times may differ and are the same


@dataclass(frozen=True)
class Actuator:
    r"""How a number that is commanded is followed. By default at once.

    A command arrives after the delay, cut to `low` ... `high`. From where it is and as fast as it moves, y goes to it
    as fast as the limits of its rate and of its acceleration allow, and comes to rest there. What flies is y behind
    the lag, $\tau \dot x = y - x$. All of this is advanced exactly, not by steps.

    Args:
        rate, acceleration: largest ones of y, in the unit of the command per s and s^2; None: without limit.
        lag: time constant of x, s.
        delay: s, a whole number of integration steps. Before the first command arrives, its value is held, or `start`.
        low, high: limits of what is followed: numbers, or names of the vehicle's numbers; None: none.
        start: where y and x rest when the flight starts; None: at the first command.
        off: whether a command of zero, which turns it off, is followed although it lies below `low`.
    """

    rate: float | None = None
    acceleration: float | None = None
    lag: float = 0.0
    delay: float = 0.0
    low: float | str | None = None
    high: float | str | None = None
    start: float | None = None
    off: bool = False


class Coordinates(NamedTuple):
    """Numbers that actuators move, where these are not those of the command itself."""

    kind: type  # NamedTuple of these numbers
    of_command: Callable  # function of a command: these numbers
    to_command: Callable  # function of these numbers and the vehicle: a command


class Kind(NamedTuple):
    """Of an actuator what its functions are made from."""

    name: str
    rated: bool
    accelerated: bool
    lags: bool
    low: str | None  # the name of the vehicle's number, if it is one
    high: str | None
    starts: bool
    off: bool
    periods: int  # of its delay
    within: bool  # whether its delay ends within a guidance period


class Numbers(NamedTuple):
    """Of an actuator what its functions are told."""

    low: float
    high: float
    rate: float
    acceleration: float
    lag: float
    start: float
    period: float  # of the guidance, s
    share: float  # of a period, that its delay is longer than whole periods


class Bound(NamedTuple):
    """Actuators ready for a flight; without any they are false."""

    kinds: tuple[Kind, ...] = ()
    coordinates: Coordinates | None = None
    numbers: tuple[Numbers, ...] = ()

    @property
    def kind(self):
        """What functions are made from, hashable; empty without actuators."""
        return (self.kinds, self.coordinates) if self.kinds else ()


def bound(actuators: Mapping[str, Actuator], coordinates, command, vehicle, units, pace) -> Bound:
    """Check the actuators of a model.

    Args:
        actuators: by what they move; a suffix is the unit of their numbers. coordinates: `Coordinates`, or None.
        command: NamedTuple of the command. vehicle: names of the vehicle's numbers. units: function from names to
            units by name. pace: period of the guidance (s), integration steps in it, and the end time (s).

    Raises:
        ValueError: for what is not commanded, or a number that is no limit, lag or delay, with the name.
    """
    require(
        isinstance(actuators, Mapping), f"actuators are {actuators!r}; give a mapping from commands to Actuator(...)"
    )
    kinds, numbers, known = [], [], units((coordinates.kind if coordinates else command)._fields)
    for written, actuator in actuators.items():
        name, factor = resolve(written, known, "actuators")
        require(name not in [kind.name for kind in kinds], f"actuators {name!r} is given twice; give it once")
        require(
            isinstance(actuator, Actuator), f"actuators {written!r} is {actuator!r}; give Actuator(rate=..., delay=...)"
        )
        kind, values = _checked(name, f"actuator of {written!r}", actuator, factor, vehicle, pace)
        kinds.append(kind)
        numbers.append(values)
    return Bound(tuple(kinds), coordinates if kinds else None, tuple(numbers))


def _checked(name, said, actuator, factor, vehicle, pace):
    """An actuator's `Kind` and `Numbers`."""
    period, substeps, end_time = pace
    for limit in ("rate", "acceleration"):
        value = getattr(actuator, limit)
        require(
            value is None or (is_number(value) and value > 0.0),
            f"{said}: {limit} is {value!r}; give a positive number, or None for no limit",
        )
    for part in ("lag", "delay"):
        value = getattr(actuator, part)
        require(
            is_number(value) and value >= 0.0, f"{said}: {part} is {value!r} s; give a number of seconds, at least 0"
        )
    for side in ("low", "high"):
        value = getattr(actuator, side)
        if isinstance(value, str):
            require(value in vehicle, f"{said}: {side} {value!r} is no number of the vehicle; {remedy(value, vehicle)}")
        else:
            require(value is None or is_number(value), f"{said}: {side} is {value!r}; give a finite number, or None")
    start = actuator.start
    require(start is None or is_number(start), f"{said}: start is {start!r}; give a finite number, or None")
    low = actuator.low if is_number(actuator.low) else -np.inf
    high = actuator.high if is_number(actuator.high) else np.inf
    require(low <= high, f"{said}: low, {low:g}, lies above high, {high:g}; exchange the two")
    require(
        start is None or low <= start <= high, f"{said}: start is {start!r}; it must lie between {low:g} and {high:g}"
    )
    steps = actuator.delay * substeps / period
    require(
        abs(steps - round(steps)) < _SAME,
        f"{said}: a delay of {actuator.delay:g} s is no multiple of the integration step, {period / substeps:g} s; "
        f"change it, or substeps",
    )
    periods, within = divmod(round(steps), substeps)
    require(
        periods <= MOST_PERIODS,
        f"{said}: a delay of {actuator.delay:g} s is {periods} guidance periods, more than {MOST_PERIODS}; give a "
        f"longer period",
    )
    whole = end_time / period
    require(
        not within or abs(whole - round(whole)) < _SAME,
        f"{said}: a delay of {actuator.delay:g} s ends within a guidance period: let end_time, {end_time:g} s, be a "
        f"multiple of the period, {period:g} s",
    )
    kind = Kind(
        name=name,
        rated=actuator.rate is not None,
        accelerated=actuator.acceleration is not None,
        lags=actuator.lag > 0.0,
        low=actuator.low if isinstance(actuator.low, str) else None,
        high=actuator.high if isinstance(actuator.high, str) else None,
        starts=start is not None,
        off=bool(actuator.off),
        periods=int(periods),
        within=bool(within),
    )
    numbers = Numbers(
        low=factor * float(low),
        high=factor * float(high),
        rate=np.inf if actuator.rate is None else factor * float(actuator.rate),
        acceleration=np.inf if actuator.acceleration is None else factor * float(actuator.acceleration),
        lag=float(actuator.lag),
        start=0.0 if start is None else factor * float(start),
        period=float(period),
        share=within / substeps,
    )
    return kind, numbers


# ---- motion ----------------------------------------------------------------------------------------------------------


class Leg(NamedTuple):
    r"""Part of a motion in which y has a constant acceleration. Seconds s after it began there flies

        $x = \mathrm{settled} + \mathrm{speed} s + \mathrm{half} s^2 + \mathrm{apart} e^{-s / \tau}$

    Guidance plans the legs of a motion once a period, so that `rates` has to evaluate one of them only. For the first
    three terms, z, the lag is over: $y = z + \tau \dot z$.
    """

    begin: float  # s
    settled: float
    speed: float
    half: float  # of the acceleration
    apart: float  # x - settled, where the leg begins


def _held(kind):
    """Names of the numbers of each leg of a motion that are not always zero; on the last one y rests."""
    rests = ["begin", "settled", *["apart"] * kind.lags]
    if kind.accelerated:
        return [[*rests, "speed", "half"]] * 3 + [rests]
    return [[*rests, "speed"], rests] if kind.rated else [rests]


@inlined
def _leg(begin, place, speed, acceleration, value, lag):
    """The leg that begins with this y (place), its speed and acceleration, and this x (value)."""
    behind = speed - lag * acceleration
    settled = place - lag * behind
    return Leg(begin, settled, behind, 0.5 * acceleration, value - settled)


@inlined
def _moving(leg, lag, time):
    """Where y is on a leg, and its speed."""
    seconds = time - leg.begin
    behind = leg.speed + 2.0 * leg.half * seconds
    settled = leg.settled + seconds * (leg.speed + leg.half * seconds)
    return settled + lag * behind, behind + 2.0 * lag * leg.half


@inlined
def _later(leg, following, time):
    """The leg that follows another, once it has begun."""
    begun = time >= following.begin
    return Leg(
        following.begin if begun else leg.begin,
        following.settled if begun else leg.settled,
        following.speed if begun else leg.speed,
        following.half if begun else leg.half,
        following.apart if begun else leg.apart,
    )


@lru_cache(64)
def _flown(accelerated, lags):
    """Function of a leg, the lag and the time: x."""

    def flown(leg, lag, time):
        seconds = time - leg.begin
        speed = leg.speed + leg.half * seconds if accelerated else leg.speed
        settled = leg.settled + seconds * speed
        if not lags:
            return settled
        faded = seconds * (1.0 / lag)
        left = exponential(-(faded if faded < 700.0 else 700.0))  # of which less is as good as nothing
        return settled + leg.apart * left

    return inlined(flown)


@lru_cache(64)
def _planner(rated, accelerated, lags):
    """Function of time, y, its speed, x, target and `Numbers`: legs of the motion, and how many seconds y moves."""
    flown = _flown(accelerated, lags)

    def at_once(time, place, speed, value, target, numbers):
        return (_leg(time, target, 0.0, 0.0, value, numbers.lag),), 0.0

    def by_rate(time, place, speed, value, target, numbers):
        lag, lasts = numbers.lag, abs(target - place) / numbers.rate
        going = _leg(time, place, numbers.rate if target >= place else -numbers.rate, 0.0, value, lag)
        end = time + lasts
        return (going, _leg(end, target, 0.0, 0.0, flown(going, lag, end), lag)), lasts

    def by_acceleration(time, place, speed, value, target, numbers):
        """In the shortest time: to a cruise, and down from it, in the direction in which it is not where it stops."""
        lag, largest = numbers.lag, numbers.acceleration
        side = 1.0 if target - place - 0.5 * speed * abs(speed) / largest >= 0.0 else -1.0
        ahead, begun = side * (target - place), side * speed
        squared = largest * ahead + 0.5 * begun * begun
        highest = np.sqrt(squared if squared > 0.0 else 0.0)
        cruise = highest if highest < numbers.rate else numbers.rate
        cruise = cruise if cruise > begun else begun
        level = ahead - (cruise * cruise - 0.5 * begun * begun) / largest
        level = level / cruise if level > 0.0 and cruise > 0.0 else 0.0
        gaining, braking = (cruise - begun) / largest, (cruise if cruise > 0.0 else 0.0) / largest

        acceleration, cruise = side * largest, side * cruise
        gains = _leg(time, place, speed, acceleration, value, lag)
        place, end = place + gaining * (speed + 0.5 * acceleration * gaining), time + gaining
        cruises = _leg(end, place, cruise, 0.0, flown(gains, lag, end), lag)
        place, end = place + level * cruise, end + level
        brakes = _leg(end, place, cruise, -acceleration, flown(cruises, lag, end), lag)
        end = end + braking
        rests = _leg(end, target, 0.0, 0.0, flown(brakes, lag, end), lag)
        return (gains, cruises, brakes, rests), gaining + level + braking

    return inlined(by_acceleration if accelerated else by_rate if rated else at_once)


@lru_cache(64)
def _stepper(kind):
    """Function that tells an actuator at a call of guidance what it goes to now.

    It returns the legs of the motion, and in how many guidance periods the command was beyond its limits.
    """
    plan, flown = _planner(kind.rated, kind.accelerated, kind.lags), _flown(kind.accelerated, kind.lags)
    off, starts = kind.off, kind.starts

    def step(first, arrives, time, wanted, low, high, leg, target, saturated, numbers):
        allowed = clip(wanted, low, high)
        allowed = 0.0 if off and wanted == 0.0 else allowed
        rest = numbers.start if starts else allowed
        (place, speed), value = _moving(leg, numbers.lag, time), flown(leg, numbers.lag, time)
        target = allowed if arrives else target
        target = rest if first and not arrives else target
        place, speed, value = (rest, 0.0, rest) if first else (place, speed, value)
        legs, lasts = plan(time, place, speed, value, target, numbers)
        limited = arrives and (allowed != wanted or lasts > numbers.period * (1.0 + 1e-9))
        return legs, (0.0 if first else saturated) + (1.0 if limited else 0.0)

    return inlined(step)


# ---- functions of a flight -------------------------------------------------------------------------------------------


def _only(command):
    """The number of a command that is one: it may stand alone."""
    return command[0] if isinstance(command, tuple) else command


def _only_in_kernels():
    from marsedl.montecarlo.flights.columns import only

    return lambda command: only(command)


_only = inlined(_only, _only_in_kernels)


def actuated(parts, kinds, coordinates=None):
    """Functions of a flight, by role, with actuators between `guide` and the others.

    `guide` remembers where the actuators are, beside what the law does, and commands where they go. All others that ask
    for the command are told what is flown, but `watch`, which is told what is commanded.

    Args:
        parts: functions by role. kinds, coordinates: see `Bound`.
    """
    return _Actuated(parts, kinds, coordinates).parts()


class _Actuated:
    """The functions of a flight, from those without actuators."""

    def __init__(self, parts, kinds, coordinates):
        self.given, self.kinds, self.coordinates = parts, kinds, coordinates
        guide = parts["guide"]
        self.law = guide[0] if isinstance(guide, tuple) else guide
        self.plain, self.memory = get_args(hints(self.law)["return"])
        self.names, self.moved = self.plain._fields, [kind.name for kind in kinds]
        self.within = any(kind.within for kind in kinds)
        motions = [part for kind in kinds for part in [*_parts(kind), f"saturated_of_{kind.name}"]]
        self.command = namedtuple("Actuated", [*(f"commanded_{name}" for name in self.names), *motions])
        self.commanded = f"Command({', '.join(f'command.commanded_{name}' for name in self.names)})"
        self.flown = f"flown(time, command, p{', vehicle' if coordinates else ''})"
        self.asks = ["time", "command", "p", *(["vehicle"] if coordinates else [])]
        self.space = {"flown": self._flown(), "Command": self.plain}

    def parts(self):
        """All functions of the flight."""
        changed = {}
        if "command" in signature(self.given["rates"]).parameters:
            changed["actuate"] = generated(self.asks, [f"return {self.flown}"], self.plain, **self.space)
            changed["rates"] = self._told(self.given["rates"], "flown", ["flown"])
        for role in ("sense", "store", "observe", "watch", "finish"):
            function = self.given.get(role)
            if function and "command" in signature(function).parameters:
                told = (self.commanded, []) if role == "watch" else (self.flown, self.asks)
                changed[role] = self._told(function, *told)
        commanded = {f"commanded_{name}": f"command.commanded_{name}" for name in self.names}
        changed["store"] = with_fields(changed.get("store", self.given["store"]), commanded, ["command"])
        final = {name: f"now.{name}" for name in self.names}
        final |= {f"saturated_{name}": f"command.saturated_of_{name}" for name in self.moved}
        finish, now = changed.get("finish", self.given["finish"]), f"now = {self.flown}"
        changed["finish"] = with_fields(finish, final, self.asks, now, **self.space)
        if self.within:
            changed["interrupts"] = self._interrupts()
        return {**self.given, **changed, "guide": self._guide()}

    def _flown(self):
        """Function of what `asks` says: the command that is flown."""
        lines, space = [], {"Leg": Leg, "later": _later, "Command": self.plain}
        for row, kind in enumerate(self.kinds):
            space[f"flown_{row}"] = _flown(kind.accelerated, kind.lags)
            lines.append(f"now_{kind.name} = flown_{row}({_leg_now(kind)}, p.actuators[{row}].lag, time)")
        values = (f"now_{name}" if name in self.moved else f"command.commanded_{name}" for name in self.names)
        result = f"Command({', '.join(values)})"
        if self.coordinates:
            kind, space["of_command"], space["to_command"] = self.coordinates
            lines.append(f"wanted = of_command({self.commanded})")
            space["Kind"] = kind
            moved = (f"now_{name}" if name in self.moved else f"wanted.{name}" for name in kind._fields)
            result = f"to_command(Kind({', '.join(moved)}), vehicle)"
        return inlined(generated(self.asks, [*lines, f"return {result}"], self.plain, **space))

    def _told(self, function, command, asks):
        """The function, told this command; asks: what that needs."""
        asked = [*signature(function).parameters]
        arguments = ", ".join(command if name == "command" else name for name in asked)
        lines = [f"return function({arguments})"]
        return generated([*asked, *asks], lines, hints(function)["return"], function, function=function, **self.space)

    def _guide(self):
        """Guidance with the actuators: what is asked once a period, and where a delay ends within one."""
        own, asked = getattr(self.memory, "_fields", ()), [*signature(self.law).parameters]
        late = [f"late_{n}_of_{kind.name}" for kind in self.kinds for n in range(1, kind.periods + kind.within + 1)]
        remembered = [*(f"law_{name}" for name in own), *late]
        defaults = [*getattr(self.memory, "_field_defaults", {}).values(), *[0.0] * len(late)]
        Memory = namedtuple("Memory", remembered, defaults=defaults) if remembered else Nothing
        space = {"guide": self.law, "LawMemory": self.memory, "Memory": Memory, "only": _only}
        space |= {"Leg": Leg, "later": _later, "Command": self.plain, "Actuated": self.command}

        kept = f"LawMemory({', '.join(f'memory.law_{name}' for name in own)})"
        arguments = ", ".join(kept if name == "memory" and own else name for name in asked)
        asks_law = [f"new_command, new_memory = guide({arguments})"]
        names = {"command": [f"commanded_{name}" for name in self.names], "memory": [f"law_{name}" for name in own]}
        for part, members in names.items():
            for row, name in enumerate(members):
                asks_law.append(f"{name} = 1.0 * {f'only(new_{part})' if len(members) == 1 else f'new_{part}[{row}]'}")
        lines = ["begins = share == 0.0", "first = begins and cycle == 0"]
        if self.within:  # the law is not asked where a delayed command arrives
            lines += ["if begins:", *(f"    {line}" for line in asks_law), "else:"]
            lines += [f"    {name} = {part}.{name}" for part, members in names.items() for name in members]
        else:
            lines += asks_law

        wanted = {name: f"commanded_{name}" for name in self.names}
        if self.coordinates:
            kind, space["of_command"], _ = self.coordinates
            lines.append(f"quantities = of_command(Command({', '.join(wanted.values())}))")
            wanted = {name: f"quantities.{name}" for name in kind._fields}
        for row, kind in enumerate(self.kinds):
            space[f"step_{row}"] = _stepper(kind)
            lines += _step(row, kind, wanted[kind.name])
        commanded = ", ".join([*names["command"], *self.command._fields[len(self.names) :]])
        members = ", ".join([*names["memory"], *(f"new_{name}" for name in late)])
        lines.append(f"return Actuated({commanded}), {f'Memory({members})' if remembered else '()'}")
        limits = ["vehicle"] if any(kind.low or kind.high for kind in self.kinds) else []
        needed = [*asked, "cycle", "share", "time", "command", "memory", "p", *limits]
        return generated(needed, lines, tuple[self.command, Memory], self.law, **space)

    def _interrupts(self):
        """Function that says where a delayed command arrives within a guidance period."""
        lines, due = [], []
        for row in (row for row, kind in enumerate(self.kinds) if kind.within):
            lines.append(f"passed_{row} = time / p.actuators[{row}].period")
            lines.append(f"passed_{row} = passed_{row} - np.floor(passed_{row} + {_SAME})")
            due.append(f"abs(passed_{row} - p.actuators[{row}].share) < {_SAME}")
        return generated(["time", "p"], [*lines, f"return {' or '.join(due)}"], bool, np=np)


def _parts(kind):
    """Names of the numbers of all legs of an actuator."""
    return [f"{part}_{n}_of_{kind.name}" for n, parts in enumerate(_held(kind)) for part in parts]


def _leg_now(kind):
    """Text: the leg on which an actuator is now."""
    now = ""
    for n, held in enumerate(_held(kind)):
        parts = (f"command.{part}_{n}_of_{kind.name}" if part in held else "0.0" for part in Leg._fields)
        leg = f"Leg({', '.join(parts)})"
        now = f"later({now}, {leg}, time)" if n else leg
    return now


def _step(row, kind, wanted):
    """Lines that step an actuator: its queue of late commands, and to what has arrived of them."""
    name, numbers, length = kind.name, f"p.actuators[{row}]", kind.periods + kind.within
    lines = [f"late_{row}_0 = {wanted}"]
    for n in range(1, length + 1):
        rest = f"{numbers}.start" if kind.starts else wanted
        lines.append(f"late_{row}_{n} = {rest} if first else memory.late_{n}_of_{name}")
        lines.append(f"new_late_{n}_of_{name} = late_{row}_{n - 1} if begins else late_{row}_{n}")
    arrives = f"abs(share - {numbers}.share) < {_SAME}" if kind.within else "begins"
    low = f"vehicle.{kind.low}" if kind.low else f"{numbers}.low"
    high = f"vehicle.{kind.high}" if kind.high else f"{numbers}.high"
    last = len(_held(kind)) - 1
    goes = f"{_leg_now(kind)}, command.settled_{last}_of_{name}, command.saturated_of_{name}"
    told = f"first, {arrives}, time, late_{row}_{length}, {low}, {high}, {goes}, {numbers}"
    lines.append(f"legs_{row}, saturated_of_{name} = step_{row}({told})")
    for n, held in enumerate(_held(kind)):
        lines += [f"{part}_{n}_of_{name} = legs_{row}[{n}].{part}" for part in held]
    return lines
