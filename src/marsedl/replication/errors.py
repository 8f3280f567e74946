"""Errors whose message is meant for the user, and helpers for such messages."""

from marsedl.words import nearest as nearest

NOTES = "marsedl.notes"  # the name under which stages log what a reader of a result should know


class MarsedlError(Exception):
    """One clear message: the file, key or field, what is wrong with it, and the remedy."""


class ArtifactError(MarsedlError):
    """An artifact that cannot be written, or that must not be used."""


class StaleError(MarsedlError):
    """A build that is not made from the inputs and the code of now."""


class InputError(MarsedlError):
    """An input or a name given by the user that is not valid."""


class InadmissibleError(InputError):
    """Inputs that contradict what the paper prints, or each other."""


class SolverError(MarsedlError):
    """A solver that found no solution; `iterate` holds its last iterate as named columns of equal length."""

    def __init__(self, message: str, iterate: dict):
        """Take the message for the user and the iterate."""
        super().__init__(message)
        self.iterate = iterate


class InfeasibleError(SolverError):
    """A problem that has no solution."""


def shown(value: object) -> str:
    """Return a short text of a value for a message."""
    text = repr(value)
    return text if len(text) <= 100 else text[:97] + "..."
