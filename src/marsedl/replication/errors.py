"""The errors whose message is meant for the user."""


class MarsedlError(Exception):
    """One clear message: the file, key or field, what is wrong with it, and the remedy."""


class ArtifactError(MarsedlError):
    """An artifact that cannot be written, or that must not be used."""


class InputError(MarsedlError):
    """An input or a name given by the user that is not valid."""
