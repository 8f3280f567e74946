"""Physics that numba may compile, without importing numba where nothing is compiled.

Kernels call the same functions as claims and figures do. Importing numba takes longer than all that a claim or figure
computes, so `jitable` functions wait until numba compiles something: it then calls `register_waiting`, the package's
entry point `numba_extensions`. What a model of a flight calls needs no decorator, as the flight registers it (`renew`).
"""

import sys
from collections.abc import Callable
from functools import cache, wraps
from itertools import count
from secrets import randbits

_WAITING = []


def jitable(function: Callable, in_kernels: Callable | None = None, **options) -> Callable:
    """Let kernels call a plain function; returns the function itself.

    Args:
        function: what Python calls.
        in_kernels: returns the function of the same arguments that kernels call in its place, and may import numba; by
            default kernels call the function itself.
        options: of `numba.njit` for what kernels call.
    """
    if "numba" in sys.modules:
        _register(function, in_kernels, options)
    else:
        _WAITING.append((function, in_kernels, options))
    return function


def inlined(function: Callable, in_kernels: Callable | None = None) -> Callable:
    """Let kernels call a plain function within their loops over trials, where a call would prevent vector code."""
    return jitable(function, in_kernels, error_model="numpy", forceinline=True)


def compiled_when_called(function: Callable) -> Callable:
    """Return the function of which the first call compiles it, and imports numba."""

    @cache
    def kernel():
        from numba import njit

        return njit(error_model="numpy", cache=True)(function)

    return wraps(function)(lambda *arguments: kernel()(*arguments))


def register_waiting() -> None:
    """Tell numba of the functions that were defined before it was imported, and let it name symbols of this process.

    Numba numbers functions that are not inlined from 1 on in every process. Of two versions of a helper, which two
    processes compiled and cached in their kernels, a third process would call the first for both.
    """
    from numba.core.bytecode import FunctionIdentity

    FunctionIdentity._unique_ids = count(randbits(60))
    while _WAITING:
        _register(*_WAITING.pop())


def _register(function: Callable, in_kernels: Callable | None, options: dict) -> None:
    from numba.extending import overload

    overload(function, jit_options=options, strict=False)(lambda *kinds: in_kernels() if in_kernels else function)


_KNOWN = {}  # functions that kernels call, and the digest of what they reached when they were compiled


def renew(function: Callable, digest: str, compiler: Callable) -> None:
    """Let numba compile a function that kernels call again, if what it reaches is not what it was.

    Numba keeps what it has once compiled, with the numbers that the function read then. A plain function is registered.

    Args:
        function: plain, or compiled by numba. digest: of all that it reaches.
        compiler: returns the `pipeline_class` of numba that compiles it.
    """
    if "numba" not in sys.modules:
        return  # nothing is compiled yet
    from numba.core.caching import NullCache
    from numba.core.registry import cpu_target

    if _KNOWN.get(function) == digest:
        return
    _KNOWN[function] = digest
    if hasattr(function, "targetoptions"):
        function._reset_overloads()
        function._cache = NullCache()
        function._compiler.pipeline_class = compiler()
        return
    cpu_target.typing_context.refresh()
    known = cpu_target.typing_context._lookup_global(function)
    if known is None:
        _register(function, None, {"pipeline_class": compiler()})
    for template in getattr(known, "templates", ()):
        getattr(template, "_impl_cache", {}).clear()
