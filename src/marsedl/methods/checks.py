"""What arguments of several methods must be: functions that raise ValueError with the name and what is wrong."""

import numpy as np

__all__ = ["require_array", "require_at_least", "require_one_of", "require_positive", "require_shape", "require_values"]


def require_shape(name, value, shape, why=""):
    """Refuse an array of another shape.

    Args:
        name: of the argument.
        value: the array.
        shape: extents; a text stands for any: ("N", 5).
        why: what the shape follows from, for the message, such as " to fit the system".

    Raises:
        ValueError: with both shapes.
    """
    found = np.shape(value)
    extents = [have if isinstance(wanted, str) else wanted for wanted, have in zip(shape, found, strict=False)]
    if len(found) != len(shape) or tuple(extents) != found:
        written = ", ".join(map(str, shape)) + "," * (len(shape) == 1)
        raise ValueError(f"{name} must have shape ({written}){why}, not {found}")


def require_array(name, value, shape, why=""):
    """Refuse an array of another shape, as `require_shape`, or with entries that are not finite."""
    require_shape(name, value, shape, why)
    finite = np.isfinite(value)
    if not finite.all():
        first = np.argwhere(~finite)[0].tolist()
        raise ValueError(f"{name} has entries that are not finite, the first at {first}")


def require_values(what, values, count):
    """Refuse what a function returns unless it is one finite value for each point."""
    finite = np.isfinite(values)
    if finite.shape != (count,) or not finite.all():
        raise ValueError(
            f"{what} must return {count} finite values, one for each point, not an array {finite.shape} with "
            f"{np.count_nonzero(~finite)} that are not finite"
        )


def require_positive(name, values):
    """Refuse a vector with an entry that is not positive."""
    positive = np.asarray(values) > 0
    if not positive.all():
        first = np.argmin(positive)
        raise ValueError(f"{name} must be positive; entry {first} is {values[first]:g}")


def require_at_least(name, number, least):
    """Refuse a number below the least."""
    if number < least:
        raise ValueError(f"{name} must be at least {least}, not {number}")


def require_one_of(name, word, choices):
    """Refuse a word that is none of the choices."""
    if word not in choices:
        raise ValueError(f"{name} must be one of {', '.join(choices)}, not {word!r}")
