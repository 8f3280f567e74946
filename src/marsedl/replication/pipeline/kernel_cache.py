"""The cache of compiled kernels: one process compiles at a time, and those that wait load what it stored."""

import errno
import fcntl
import os
import sys
from functools import cache
from pathlib import Path

LOCATOR = f"{__name__}.Kernels"  # for numba's variable NUMBA_CACHE_LOCATOR_CLASSES
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)  # of file systems that have none, such as some of clusters


def cache_folder(root: Path, source: str) -> Path:
    """The folder for kernels of a project; source: digest of the code that they reach.

    Numba does not notice edits of functions called from another file, hence the digest.
    """
    return root / ".cache" / "numba" / source[:16]


def vector_features() -> str:
    """The features of this processor for NUMBA_CPU_FEATURES, with vectors of 512 bits; empty if it has none of these.

    By default LLVM uses 256 bits on processors that have 512. The bits of the numbers are the same.
    """
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
    folder.mkdir(parents=True, exist_ok=True)
    lock = (folder / "lock").open("w")

    class Turns(event.Listener):
        depth = 0  # kernels compile those that they call
        locks = True

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
                if self.locks:
                    fcntl.flock(lock, operation)
            except OSError as error:
                if error.errno not in NO_LOCKS:
                    raise
                self.locks = False
                print(f"{folder}: no file locks here, so several jobs may compile the same kernel", file=sys.stderr)

    class Announcement(event.Listener):
        announced = False

        def on_start(self, event):
            if not self.announced:
                print("compiling kernels; later runs load them", file=sys.stderr, flush=True)
            self.announced = True

        def on_end(self, event):
            pass

    event.register("numba:compiler_lock", Turns())
    event.register("numba:compile", Announcement())
