"""Parts of messages to users: the name that was meant, and where a function stands."""

from collections.abc import Callable, Iterable


def require(condition, sentence: str) -> None:
    """Raise ValueError with this sentence unless the condition holds."""
    if not condition:
        raise ValueError(sentence)


def nearest(name: str, valid: Iterable[str]) -> str:
    """Return a remedy sentence: the nearest valid name, or all of them if none is near."""
    valid = sorted(set(valid))
    return _meant(name, valid) or f"valid names: {', '.join(valid)}"


def remedy(name: str, valid: Iterable[str], said: str = "There are") -> str:
    """Return a longer one: the nearest valid name, if one is near, and all of them in their order."""
    valid = list(valid)
    return " ".join(filter(None, (_meant(name, valid), f"{said}: {', '.join(valid)}")))


def _meant(name, valid):
    import difflib

    matches = difflib.get_close_matches(name, valid, n=1) if isinstance(name, str) and len(name) <= 100 else []
    return f"did you mean '{matches[0]}'?" if matches else ""


def missing(error: ModuleNotFoundError, extra: str) -> ModuleNotFoundError:
    """Return the error of a package that is not installed, in one sentence with the extra that brings it."""
    return ModuleNotFoundError(f"{error.name} is not installed; run: pip install 'marsedl[{extra}]'", name=error.name)


def described(function: Callable) -> str:
    """Return a function's name with its file and line."""
    code = getattr(function, "__code__", None)
    return f"{function.__name__} ({code.co_filename}, line {code.co_firstlineno})" if code else repr(function)
