"""Fields of records as curves: values with the words, unit and abscissa that the record declares for them."""

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from marsedl.replication.errors import nearest
from marsedl.replication.records.fields import Axis, Quantity, layout, quantities
from marsedl.replication.units import PURE, converted


@dataclass(frozen=True)
class Field:
    """Values (..., n) with the name and the unit of the axis on which they are shown.

    `x` holds what they are drawn against (n,); `pieces` numbers the pieces of a curve that must not be joined (n,).
    Both are None where there is nothing to say.
    """

    values: np.ndarray
    name: str
    unit: str
    x: "Field | None" = None
    pieces: np.ndarray | None = None

    @property
    def label(self) -> str:
        """Label of an axis that shows the field: name and unit, "density (kg/m$^3$)"."""
        return self.name if self.unit in PURE else f"{self.name} ({printed_unit(self.unit)})"

    def of(self, values: Any, name: str = "", unit: str = "") -> "Field":
        """Return other values at the same places: of the same kind, unless another name or unit says more."""
        return dataclasses.replace(self, values=np.asarray(values), name=name or self.name, unit=unit or self.unit)

    def where(self, chosen: Any) -> "Field":
        """Return the part at some places: `chosen` is a mask (n,), a slice or indices of the last dimension."""
        return dataclasses.replace(
            self,
            values=self.values[..., chosen],
            x=None if self.x is None else self.x.where(chosen),
            pieces=None if self.pieces is None else self.pieces[chosen],
        )

    def minus(self, other: "Field", name: str = "") -> "Field":
        """Return the difference from another field, which is interpolated where it stands at other places.

        Raises ValueError if the units differ.
        """
        if other.unit != self.unit:
            raise ValueError(f"'{self.name}' is in {self.unit}, '{other.name}' in {other.unit}: take both in one unit")
        if other.x is not None and self.x is not None and not np.array_equal(other.x.values, self.x.values):
            other = other.at(self)
        return self.of(self.values - other.values, name)

    def at(self, other: "Field") -> "Field":
        """Return the values (n,) at the places of another field, linear in between.

        Raises ValueError if one of them lies along no coordinates.
        """
        if self.x is None or other.x is None:
            raise ValueError(f"'{self.name}' and '{other.name}' need places: one of them lies along no coordinates")
        values = np.interp(other.x.values, self.x.values, self.values)
        return dataclasses.replace(self, values=values, x=other.x, pieces=other.pieces)


def field(
    record: Any,
    path: str,
    *,
    unit: str = "",
    name: str = "",
    at: Mapping[str, int] | None = None,
    x: "str | Field" = "",
    pieces: str = "",
) -> Field:
    """Return a field of a record, or a component of it, ready to be drawn.

        field(gains, "mean.altitude", unit="km")                     of (time, MOTION)
        field(gains, "covariance.altitude")                          the variance, in m^2: of (time, MOTION, MOTION)
        field(gains, "gain.vertical.altitude")                       of (time, CONTROL, MOTION)
        field(flights, "kept_history.altitude", at={"laws": 2})      trials over time: of (laws, kept, time, STATE)

    Args:
        record: an artifact.
        path: name of a field and, after dots, of a component of each of its axes, in their order. One name chooses
            both components of a square.
        unit: to show the values in, if not that of the record.
        name: to show them under; by default the component's name in words, or the field's label if it has no axis.
        at: index in dimensions that are not shown, by their names.
        x: path of the field against which to draw, or a `Field`; by default the coordinates of the last dimension.
        pieces: name of the field that numbers the pieces of a curve which must not be joined.

    Returns:
        The field; its last dimension is the one along which it is drawn.

    Raises:
        ValueError: there is no such field, component, dimension or conversion.

    """
    kind, (field_name, *components) = type(record), path.split(".")
    declared = quantities(kind).get(field_name)
    if declared is None:
        raise ValueError(f"{kind.__name__} has no field '{field_name}'; {nearest(field_name, quantities(kind))}")
    dims, chosen = layout(kind).dims[field_name], _chosen(path, declared.dims, components)
    index: list[Any] = [slice(None)] * len(dims)
    for place, component in chosen.items():
        index[place] = declared.dims[place].index(component)
    for dimension, place in (at or {}).items():
        if dimension not in dims:
            raise ValueError(f"'{path}' of {kind.__name__} has no dimension '{dimension}'; {nearest(dimension, dims)}")
        index[dims.index(dimension)] = place
    remaining_dims = [dim for dim, part in zip(dims, index, strict=True) if isinstance(part, slice)]
    if isinstance(x, str):
        coordinates = x or next(
            (dim for dim in remaining_dims[-1:] if dim in layout(kind).fields and dim != field_name), ""
        )
        x = _coordinates(record, coordinates, at or {}) if coordinates else None
    words = dict.fromkeys(declared.dims[place].label(component) for place, component in chosen.items())
    stored_unit = _unit(path, declared, chosen)
    return Field(
        converted(np.asarray(getattr(record, field_name))[tuple(index)], stored_unit, unit or stored_unit, path),
        name or (" ".join(words) if len(words) == 1 else declared.label),
        unit or stored_unit,
        x,
        np.asarray(getattr(record, pieces)) if pieces else None,
    )


def standard_deviation(record: Any, path: str, *, unit: str = "", at: Mapping[str, int] | None = None) -> Field:
    """Return the standard deviation of a component: the root of its variance.

    Args:
        record: an artifact.
        path: a covariance and one component of it: "covariance.altitude".
        unit: to show it in, if not that of the component.
        at: as for `field`.

    Raises ValueError as `field` does.
    """
    variance = field(record, path, at=at)
    stored_unit = variance.unit.removesuffix("^2").removeprefix("(").removesuffix(")")
    root = np.sqrt(np.maximum(variance.values, 0.0))  # rounding can make a vanishing variance negative
    return variance.of(converted(root, stored_unit, unit or stored_unit, path), unit=unit or stored_unit)


def sigma_bounds(
    record: Any, component: str, sigma: float, *, unit: str = "", at: Mapping[str, int] | None = None
) -> tuple[Field, Field]:
    """Return the mean of a component minus and plus some standard deviations.

    Args:
        record: an artifact with the fields `mean` and `covariance`, such as an ensemble.
        component: a component of both.
        sigma: number of standard deviations.
        unit: to show them in, if not that of the component.
        at: as for `field`.

    Raises ValueError as `field` does.
    """
    mean = field(record, f"mean.{component}", unit=unit, at=at)
    bound = sigma * standard_deviation(record, f"covariance.{component}", unit=unit, at=at).values
    return mean.of(mean.values - bound), mean.of(mean.values + bound)


def printed_unit(unit: str) -> str:
    """Return a unit as figures show it: "kg/m$^{3}$" of "kg/m^3", "N s$^{1/2}$" of "N sqrt(s)"."""
    return re.sub(r"sqrt\((\w+)\)", r"\1$^{1/2}$", re.sub(r"\^(-?\d+)", r"$^{\1}$", unit))


def _chosen(path: str, dims: tuple, components: list[str]) -> dict[int, str]:
    """Names of the components that a path chooses, by the place of their dimension."""
    places = [place for place, dimension in enumerate(dims) if isinstance(dimension, Axis)]
    if len(components) == 1 and len(places) == 2 and dims[places[0]] is dims[places[1]]:
        components = components * 2
    if len(components) > len(places):
        named_dims = " and ".join(str(dims[place]) for place in places) or "no dimension"
        raise ValueError(f"'{path}' chooses {len(components)} components, but the field has names along {named_dims}")
    for place, component in zip(places, components, strict=False):
        if component not in dims[place].names:
            raise ValueError(
                f"'{path}': '{dims[place]}' has no component '{component}'; {nearest(component, dims[place].names)}"
            )
    return dict(zip(places, components, strict=False))


def _unit(path: str, declared: Quantity, chosen: Mapping[int, str]) -> str:
    """Unit of what a path chooses."""
    if declared.unit == "SI":
        units = [declared.dims[place].units[component] for place, component in chosen.items()]
        if len(units) == 2 and "" not in units:
            first, second = (f"({unit})" if "/" in unit else unit for unit in units)
            if units == ["1", "1"]:
                return "1"
            return f"{first}^2" if first == second else f"{first} {second}"
        return declared.unit
    units = declared.unit.split(", ")
    if len(units) == 1:
        return declared.unit
    place = max(place for place, dimension in enumerate(declared.dims) if dimension == len(units))
    if place not in chosen:
        raise ValueError(f"'{path}': components along '{declared.dims[place]}' have units of their own: choose one")
    return units[declared.dims[place].index(chosen[place])]


def _coordinates(record: Any, path: str, at: Mapping[str, int]) -> Field:
    """What a curve is drawn against: a field of the record, at the same place in the dimensions that it has."""
    dims = layout(type(record)).dims.get(path.partition(".")[0], ())
    return field(record, path, at={dimension: index for dimension, index in at.items() if dimension in dims})
