"""The errors whose message is meant for the user, and words that occur in many."""

import typing


class MarsedlError(Exception):
    """One clear message: the file, key or field, what is wrong with it, and the remedy."""


class ArtifactError(MarsedlError):
    """An artifact that cannot be written, or that must not be used."""


class InputError(MarsedlError):
    """An input or a name given by the user that is not valid."""


class SolverError(MarsedlError):
    """A program that came to no solution; `iterate` holds its last iterate, columns of equal length by name."""

    def __init__(self, message: str, iterate: dict):
        """Take the message for the user and the iterate."""
        super().__init__(message)
        self.iterate = iterate


def nearest(name: str, known: typing.Iterable[str]) -> str:
    """Return a remedy sentence: the nearest valid name, or all of them if none is near."""
    import difflib

    known = sorted(known)
    matches = difflib.get_close_matches(name, known, n=1) if isinstance(name, str) and len(name) <= 100 else []
    return f"did you mean '{matches[0]}'?" if matches else f"valid names: {', '.join(known)}"


def shown(value: object) -> str:
    """Return a value as a message shows it: short, and never an error of its own."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of thousands of digits, or lists inside of lists without end
        return f"a {type(value).__name__} too large to show"
    return text if len(text) <= 100 else text[:97] + "..."
