"""The versions of installed libraries: what the numbers of a stage depend on beside its inputs and its code."""

import importlib.metadata
import sys
from functools import cache

DISTRIBUTIONS = {"PIL": "pillow", "yaml": "pyyaml"}  # by the name of the module, where the two differ
# Libraries that others use without our code naming them: compilers, solvers, image libraries.
COMPANIONS = {
    "numba": ("llvmlite",),
    "cvxpy": ("clarabel", "scs"),
    "matplotlib": ("pillow", "contourpy", "fonttools", "kiwisolver"),
}
READ_INPUTS = ("yaml", "pydantic")  # they read and check inputs, which are parameters of the jobs themselves


def library_versions(*names: str) -> dict[str, str]:
    """Installed versions of the named distributions, sorted by name; "not installed" where there is none."""
    return {name: _version(name) for name in sorted(names)}


@cache
def versions_used(modules: frozenset[str]) -> str:
    """Return the versions of Python and of some top-level modules with their companions, for a person to read."""
    used = {DISTRIBUTIONS.get(module, module) for module in modules if module not in READ_INPUTS}
    used.update(*(COMPANIONS.get(name, ()) for name in used))
    python = f"python {sys.version_info.major}.{sys.version_info.minor}"
    return ", ".join([python, *(f"{name} {version}" for name, version in library_versions(*used).items())])


@cache
def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
