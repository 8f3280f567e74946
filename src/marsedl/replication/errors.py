"""The errors whose message is meant for the user."""


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
