"""The cache of compiled kernels: one process compiles at a time, and those that wait load what it stored."""

import fcntl
import os
import sys
from functools import cache
from pathlib import Path

from marsedl.replication.errors import MarsedlError

LOCATOR = f"{__name__}.Kernels"  # for numba's variable NUMBA_CACHE_LOCATOR_CLASSES


def vector_features() -> str:
    """NUMBA_CPU_FEATURES for processors with vectors of 512 bits, of which LLVM uses 256; the numbers are the same."""
    from llvmlite.binding import get_host_cpu_features

    features = get_host_cpu_features()
    return f"{features.flatten()},-prefer-256-bit" if features.get("avx512f") else ""


class Kernels:
    """Tells numba where compiled functions are stored; the first call sets up the lock."""

    @staticmethod
    def from_function(py_func, py_file):
        """Return numba's own locator for NUMBA_CACHE_DIR, where the module counts and not the path of its file."""
        from numba.core.caching import UserProvidedCacheLocator

        class ByModule(UserProvidedCacheLocator):
            @classmethod
            def get_suitable_cache_subpath(cls, py_file):
                return py_func.__module__

        _take_turns()
        return ByModule.from_function(py_func, py_file)


@cache
def _take_turns() -> None:
    """Let one process at a time compile kernels, and say on standard error that it does, as it takes a while.

    Numba tells when it takes the lock of its compiler, before it looks into its cache, and when it gives it back, after
    it has stored there. The system releases the file locks of processes that end in between.
    """
    from numba.core import event

    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / "lock").open("w")
    except OSError as error:
        remedy = "let all who share the project's folder write it"
        raise MarsedlError(f"{folder}: cannot be written ({error.strerror}); {remedy}") from None

    @cache  # so that it is said once
    def say(message: str) -> None:
        print(message, file=sys.stderr, flush=True)

    class Turns(event.Listener):
        depth = 0  # kernels compile those that they call

        def on_start(self, event):
            if self.depth == 0:
                self.flock(fcntl.LOCK_EX)
            self.depth += 1

        def on_end(self, event):
            self.depth -= 1
            if self.depth == 0:
                self.flock(fcntl.LOCK_UN)

        def flock(self, operation):
            try:
                fcntl.flock(lock, operation)
            except OSError:
                say(f"{folder}: no file locks here, so several jobs may compile the same kernel")

    class Announcement(event.Listener):
        def on_start(self, event):
            say("compiling kernels; later runs load them")

        def on_end(self, event):
            pass

    event.register("numba:compiler_lock", Turns())
    event.register("numba:compile", Announcement())
