"""Artifacts that are made up, of the declared shapes: nothing can hide behind the values of one reading."""

import numpy as np

from marsedl.replication.records.fields import quantities


def invented(kind, extents, seed=7, empty=False, **known):
    """An artifact of a type, of random numbers between 1 and 2 but for what is known; its names are numbered.

    extents: sizes of dimensions by name, those of others are 3. empty: NaN wherever the type allows for it.
    """
    random, fields = np.random.default_rng(seed), {}
    for name, declared in quantities(kind).items():
        shape = tuple(extents.get(extent, 3) if isinstance(extent, str) else extent for extent in declared.dims)
        if declared.dtype == "str":
            values = np.array([f"{name} {k}" for k in range(int(np.prod(shape)))]).reshape(shape)
        elif declared.dtype == "bool":
            values = np.ones(shape, bool)
        elif declared.dtype == "float64":
            values = np.full(shape, np.nan) if empty and declared.allow_nan else 1.0 + random.random(shape)
        else:
            values = np.zeros(shape, np.dtype(declared.dtype))
        fields[name] = known.get(name, values if shape else values.item())
    return kind(**fields)
