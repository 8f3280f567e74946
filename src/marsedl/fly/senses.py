"""What laws know of a flight, with its errors: declared by quantity, and made into `navigate` of the engine."""

from collections import namedtuple
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from marsedl.fly.declared import SUFFIXES, Declared, Exponential, Normal, Uniform, declare, is_number, resolve
from marsedl.fly.generated import generated
from marsedl.words import require

__all__ = ["Error", "Senses", "ThroughDrag"]

_CONSTANTS = {"bias": 0.0, "scale": 1.0, "drift": 0.0}  # of a trial, and their values without an error


@dataclass(frozen=True)
class Error:
    r"""Error of what is known of a quantity: at the time t, in guidance period k,

        $\hat x = s x + b + d t + w_k + n_k$

    Errors of several quantities are independent of each other; where they are not, write `navigate` of a `Model`.

    Args:
        bias: b, in the unit of the quantity. scale: s, 1. drift: d, in its unit per second. All are constant in a
            trial, and may be dispersed.
        walk: deviation of the random walk w after a second, in its unit per s^(1/2); it starts from 0.
        noise: deviation of n, in its unit, new in every period.
    """

    bias: float | Normal | Uniform = 0.0
    scale: float | Normal | Uniform = 1.0
    drift: float | Normal | Uniform = 0.0
    walk: float = 0.0
    noise: float = 0.0


@dataclass(frozen=True)
class ThroughDrag:
    r"""Density or altitude, known through the sensed drag D and velocity V of an `Entry`, with their errors:

        $\hat\rho = 2 B D / V^2, \quad \hat h = H \log(\rho_0 / \hat\rho)$

    Args:
        ballistic_coefficient: B, that guidance takes the vehicle for, kg/m^2.
        air: that guidance takes the air for, rho_0 and H.
        least_drag: m/s^2; a smaller one, of which little is sensed, is taken for this one.
    """

    ballistic_coefficient: float
    air: Exponential = field(default_factory=Exponential)
    least_drag: float = 0.01


class Senses:
    """What laws know with errors: `Senses(altitude=Error(bias=Normal(0.0, 200.0), noise=20.0))`.

    All else that laws are told they know as it is. A suffix is the unit of the error: `altitude_km`.
    """

    def __init__(self, **errors):
        """Take an `Error` for each quantity that laws are told, or `ThroughDrag` for density and altitude."""
        self.errors = errors

    def __repr__(self):
        """As it is written."""
        return f"Senses({', '.join(f'{name}={error!r}' for name, error in self.errors.items())})"

    def bound(self, told, units: Mapping[str, str], period) -> "Bound":
        """What a flight needs of them.

        Args:
            told: names of what laws are told. units: of these. period: of the guidance, s.

        Raises:
            ValueError: for what laws are not told, or what is no error, with the name.
        """
        defaults = {f"{name}_{part}": value for name in told for part, value in _CONSTANTS.items()}
        unit_of = {f"{name}_{part}": "1" if part == "scale" else units[name] for name in told for part in _CONSTANTS}
        kinds, numbers, constants = [], [], {}
        for written, error in self.errors.items():
            name, factor = resolve(written, units, "senses")
            require(name not in dict(kinds), f"senses {name!r} is given twice; give it once")
            if isinstance(error, Error):
                suffix = written.removeprefix(name) if written.endswith(tuple(SUFFIXES)) else ""
                for part in _CONSTANTS:
                    constants[f"{name}_{part}{'' if part == 'scale' else suffix}"] = getattr(error, part)
                for part in ("walk", "noise"):
                    value = getattr(error, part)
                    require(
                        is_number(value) and value >= 0.0,
                        f"senses {written!r}: {part} is {value!r}; give the deviation, a number of at least 0",
                    )
                kinds.append((name, "error"))
                numbers.append((factor * float(error.walk) * period**0.5, factor * float(error.noise)))
            else:
                kinds.append((name, "drag"))
                numbers.append(_through_drag(written, error, told))
        declared = declare(constants, unit_of, defaults, "senses", {})
        used = [f"{name}_{part}" for name, kind in kinds if kind == "error" for part in _CONSTANTS]
        return Bound(tuple(kinds), declared, tuple(used), tuple(numbers))


class Bound(NamedTuple):
    """Senses ready for a flight."""

    kinds: tuple[tuple[str, str], ...]  # quantity, and whether it has an error or is known through drag
    declared: Declared  # constants of all quantities, so that those of one stay when others get errors, too
    constants: tuple[str, ...]  # of the quantities that have errors
    numbers: tuple[tuple[float, ...], ...]  # that all trials share, a tuple for each quantity

    def sample(self, seed, stream, trials, only=None):
        """Constants of these trials, (constants, trials); only: see `Declared.sample`."""
        values = self.declared.sample(seed, stream, trials, only=only)
        return values[[self.declared.names.index(name) for name in self.constants]]


def _through_drag(written, given, told):
    """Numbers of what is known through drag, checked."""
    require(
        isinstance(given, ThroughDrag),
        f"senses {written!r} is {given!r}; give Error(bias=..., noise=...) or, for density and altitude, ThroughDrag",
    )
    require(
        written in ("density", "altitude") and {"drag", "velocity", "density", "altitude"} <= {*told},
        f"senses {written!r}: only density and altitude of an Entry are known through drag",
    )
    require(isinstance(given.air, Exponential), f"senses {written!r}: air is {given.air!r}; give Exponential(...)")
    numbers = (given.ballistic_coefficient, given.least_drag, *given.air)
    require(
        all(is_number(number) and number > 0.0 for number in numbers),
        f"senses {written!r} is {given}: its numbers must be positive",
    )
    coefficient, least_drag, surface_density, scale_height = map(float, numbers)
    return coefficient, least_drag, float(np.log(surface_density)), scale_height


@lru_cache(64)
def navigation(told, kinds):
    """Function `navigate` of these senses, and its `draws`, as arguments of a `Flight`.

    told: NamedTuple of what laws are told. kinds: see `Bound`. The random walks, which it remembers, come last in what
    it returns.
    """
    from marsedl.elementary import logarithm

    errors = {name: row for row, (name, kind) in enumerate(kinds) if kind == "error"}
    Nav = namedtuple("Nav", (*told._fields, *(f"{name}_walk" for name in errors)))
    Draws = namedtuple("Draws", [f"{name}_{part}" for name in errors for part in ("walk", "noise")])
    lines = []
    for name in told._fields:
        known = f"sensed.{name}"
        if name in errors:
            walked = f"nav.{name}_walk + p.senses[{errors[name]}][0] * draws.{name}_walk"
            lines.append(f"walk_{name} = {walked} if cycle > 0 else 0.0")
            known = (
                f"vehicle.{name}_scale * {known} + vehicle.{name}_bias + vehicle.{name}_drift * time "
                f"+ walk_{name} + p.senses[{errors[name]}][1] * draws.{name}_noise"
            )
        lines.append(f"known_{name} = {known}")
    for row, (name, kind) in enumerate(kinds):
        if kind == "drag":
            lines += [
                f"coefficient, least_drag, log_surface_density, scale_height = p.senses[{row}]",
                "drag = known_drag if known_drag > least_drag else least_drag",
                "density = 2.0 * coefficient * drag / (known_velocity * known_velocity)",
            ]
            through = {"density": "density", "altitude": "scale_height * (log_surface_density - logarithm(density))"}
            lines.append(f"known_{name} = {through[name]}")
    values = ", ".join([*(f"known_{name}" for name in told._fields), *(f"walk_{name}" for name in errors)])
    asked, lines = ("time", "cycle", "sensed", "nav", "draws", "vehicle", "p"), [*lines, f"return Nav({values})"]
    return {"navigate": generated(asked, lines, Nav, Nav=Nav, logarithm=logarithm), "draws": Draws}
