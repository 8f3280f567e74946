"""Physics that numba may compile, without importing numba where nothing is compiled.

Kernels call the same functions as claims and figures do. Importing numba takes longer than all that a claim or figure
computes, so `jitable` functions wait until numba compiles something: it then calls `register_waiting`, the package's
entry point `numba_extensions`.
"""

import sys
from collections.abc import Callable

_WAITING = []


def jitable(function: Callable) -> Callable:
    """Let kernels call a plain function, as `numba.extending.register_jitable` does; returns the function itself."""
    if "numba" in sys.modules:
        _register(function)
    else:
        _WAITING.append(function)
    return function


def register_waiting() -> None:
    """Tell numba of the functions that were defined before it was imported."""
    while _WAITING:
        _register(_WAITING.pop())


def _register(function: Callable) -> None:
    from numba.extending import register_jitable

    register_jitable(function)
