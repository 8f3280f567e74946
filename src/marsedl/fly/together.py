"""What start and vehicle draw together: correlations of their dispersions, or samples of one's own, trial by trial."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from marsedl.fly.declared import Column, Declared, MultivariateNormal, is_number, numbers_of, resolve
from marsedl.words import require

__all__ = ["Samples"]

START, VEHICLE = range(2)


class Samples:
    """Numbers of start and vehicle trial by trial: trial i flies row i, in place of what is declared of these names.

    A Latin hypercube in two quantities, for example:

        cube = scipy.stats.qmc.LatinHypercube(2, rng=1).random(1000)
        columns = scipy.stats.norm([5500.0, 115.0], [10.0, 2.0]).ppf(cube)
        fly(..., together=Samples(pandas.DataFrame(columns, columns=["velocity", "ballistic_coefficient"])))
    """

    def __init__(self, source):
        """Take the columns, whose names are those of start and vehicle, with their suffixes.

        Args:
            source: data frame, mapping from names to (trials,), or a CSV file with a row of names.

        Raises:
            ValueError: for a column that does not hold a finite number in each row.
        """
        import pandas as pd

        try:
            frame = pd.DataFrame(source) if hasattr(source, "keys") else pd.read_csv(source, skipinitialspace=True)
        except ValueError as error:
            raise ValueError(
                f"samples: {error}; give a data frame, a mapping from names to arrays, or a file"
            ) from None
        require(frame.size, "samples: there are no rows; give one for each trial")
        self.columns = {}
        for name in frame:
            values = pd.to_numeric(frame[name], errors="coerce").to_numpy(float)
            for row in np.flatnonzero(~np.isfinite(values))[:1]:
                raise ValueError(f"samples {name!r}: row {row} is {frame[name].iloc[row]}: give a finite number")
            self.columns[str(name)] = Column(values, float(values.mean()), "samples {!r}: row")

    def __repr__(self):
        """Names and rows."""
        rows = len(next(iter(self.columns.values())).values)
        return f"Samples({rows:,} rows of {', '.join(self.columns)})"


class Together(NamedTuple):
    """What start and vehicle draw together, checked."""

    start: Declared
    vehicle: Declared
    blocks: tuple[tuple[tuple[tuple[int, int], ...], np.ndarray], ...]  # part and place of each name; root

    def sample(self, seed, streams, trials, bounds, only=None):
        """Start and vehicle of these trials, each (names, trials). Raises ValueError for numbers beyond bounds."""
        parts = (self.start, self.vehicle)
        z = [part.normals(seed, stream, trials, only) for part, stream in zip(parts, streams, strict=True)]
        for members, root in self.blocks:
            independent = [z[part][place] for part, place in members]
            # Not a matrix product, whose sums depend on the number of trials.
            mixed = [sum(weight * one for weight, one in zip(row, independent, strict=True)) for row in root]
            for (part, place), numbers in zip(members, mixed, strict=True):
                z[part][place] = numbers
        return [part.of_normals(numbers, trials, bounds) for part, numbers in zip(parts, z, strict=True)]


def bound(together, model, start) -> Together:
    """Start and vehicle of a model, with what they draw together.

    Args:
        together: None, `Samples`, or a mapping from tuples of names to correlations, as `fly` takes them.
        model: `Model`. start: as `fly` takes it.

    Raises:
        ValueError: for an unknown name, a correlation that is none, or what is given twice, with the name.
    """
    of_start = model.units(model.flight.parts["state"]._fields)
    of_vehicle = model.units(getattr(model.vehicle, "_fields", ()))

    def located(written):
        """Whether a name is of the start or of the vehicle, and the name there."""
        prefixed = {f"start_{name}": unit for name, unit in of_start.items()}
        base, _ = resolve(written, {**of_start, **prefixed, **of_vehicle}, "together")
        if base in of_vehicle:
            return VEHICLE, base
        return START, base if base in of_start else base.removeprefix("start_")

    require(
        together is None or isinstance(together, Samples | Mapping),
        f"together is {together!r}; give correlations, {{('velocity', 'lift_to_drag'): 0.5}}, or Samples(frame)",
    )
    if isinstance(together, Samples):
        columns = {}, {}
        for written, column in together.columns.items():
            part, name = located(written)
            require(name not in [base for base, _ in columns[part].values()], f"samples {name!r}: two columns hold it")
            columns[part][written.removeprefix("start_") if part == START else written] = name, column
        start = _in_place(start, columns[START], of_start)
        given = dict(zip(of_vehicle, model.vehicle, strict=True))
        vehicle = _in_place(given, columns[VEHICLE], of_vehicle)
        return Together(model.declared_start(start), model.declared_vehicle(vehicle), ())
    parts = model.declared_start(start), model.declared_vehicle()
    blocks, seen = [], set()
    for names, given in (together or {}).items():
        require(
            isinstance(names, tuple) and len(names) > 1,
            f"together {names!r}: give a tuple of two names or more, ('velocity', 'lift_to_drag')",
        )
        members = tuple(located(name) for name in names)
        for part, name in members:
            require(
                (part, name) not in seen, f"together {name!r} is given twice; give all its correlations in one matrix"
            )
            seen.add((part, name))
            single = [parts[part].names[place] for place, *_ in parts[part].single]
            require(name in single, f"together {name!r} is no single dispersion; give Normal or Uniform for it, too")
        places = tuple((part, parts[part].names.index(name)) for part, name in members)
        blocks.append((places, _root(names, given)))
    return Together(*parts, tuple(blocks))


def _in_place(given, columns, units):
    """What is declared by name, columns in the place of numbers. Raises ValueError for two dispersions of a name."""
    if not isinstance(given, Mapping):
        return given
    sampled, kept = {name for name, _ in columns.values()}, {}
    for written, value in given.items():
        names = {resolve(name, units, "start")[0] for name in (written if isinstance(written, tuple) else (written,))}
        require(
            is_number(value) or not names & sampled,
            f"samples: {written!r} is {value!r} besides; leave out its column or this dispersion",
        )
        if not names & sampled:
            kept[written] = value
    return kept | {written: column for written, (_, column) in columns.items()}


def _root(names, given):
    """Root of correlations, checked: a number of two names, or a matrix."""
    if len(names) == 2 and is_number(given):
        require(abs(given) <= 1.0, f"together {names} is {given:g}; a correlation lies between -1 and 1")
        given = [[1.0, given], [given, 1.0]]
    matrix, size = numbers_of(given, f"together {names} is"), len(names)
    require(
        matrix.shape == (size, size),
        f"together {names} is {' '.join(repr(given).split())}; give a matrix of {size} x {size} correlations"
        f"{' or a number' if size == 2 else ''}",
    )
    require(
        np.abs(matrix.diagonal() - 1.0).max() < 1e-9,
        f"together {names}: the diagonal holds {matrix.diagonal()}; give correlations, whose diagonal is one",
    )
    try:
        _, root = MultivariateNormal(np.zeros(size), matrix).root()
    except ValueError:
        raise ValueError(
            f"together {names}: the correlations are not symmetric with eigenvalues of at least zero, so no numbers "
            f"have them"
        ) from None
    return root
