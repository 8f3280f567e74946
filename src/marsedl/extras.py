"""What to install when a package is missing: the extra of marsedl that brings it.

The library alone needs few packages; the others come with extras, see pyproject.toml.
A module of marsedl that imports one of them and does not find it raises `MissingExtra`.
"""

import sys

DISTRIBUTIONS = {"PIL": "pillow", "yaml": "pyyaml"}  # by the name of the module, where the two differ


class MissingExtra(ModuleNotFoundError):
    """A package that an extra of marsedl brings is not installed."""


def extra_of(module: str) -> str:
    """Return the name of the smallest extra that brings a top-level module; empty if none does.

    It is empty, too, where marsedl is not installed but imported from a folder.
    """
    import re
    from importlib.metadata import PackageNotFoundError, requires

    try:
        required = requires("marsedl") or ()
    except PackageNotFoundError:
        return ""
    extras: dict[str, set[str]] = {}
    for requirement in required:
        if extra := re.search(r"""extra == ['"]([\w-]+)['"]""", requirement):
            extras.setdefault(extra[1], set()).add(re.match(r"[\w.-]+", requirement)[0].lower())
    package = DISTRIBUTIONS.get(module, module)
    return min((name for name in extras if package in extras[name]), key=lambda name: len(extras[name]), default="")


class _LastFinder:
    """Last finder of imports: tells modules of marsedl which extra brings a missing package."""

    def find_spec(self, name, path=None, target=None):
        extra = extra_of(name) if path is None and _imported_by_marsedl() else ""
        if extra:
            raise MissingExtra(
                f"{name} is not installed; it comes with the extra '{extra}': pip install 'marsedl[{extra}]'", name=name
            )


def _imported_by_marsedl() -> bool:
    """Whether the statement that is being executed is an import in a module of marsedl."""
    frame = sys._getframe(2)
    while frame and frame.f_code.co_filename.startswith("<frozen importlib."):
        frame = frame.f_back
    return frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "marsedl"


sys.meta_path.append(_LastFinder())
