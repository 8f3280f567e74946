"""The cache of compiled kernels: one process compiles at a time, and only files of this user's own jobs are loaded.

Numba's cache files are pickles. Whoever writes one can run code in the process that loads it, and one that is cut short
ends the job. So every file is sealed with a key that lies outside of the project, in the user's own cache folder, and
numba never sees a file without its seal: it is dropped, and the kernel compiled again. The folder's name depends on the
key too, so that a project that was copied from another user or machine begins with an empty cache.
"""

import contextlib
import fcntl
import hashlib
import hmac
import json
import os
import secrets
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from marsedl.replication.errors import MarsedlError

KEY_BYTES = 32
LOCATOR = f"{__name__}.Kernels"  # for numba's variable NUMBA_CACHE_LOCATOR_CLASSES


def cache_folder(root: Path, source: str) -> Path:
    """The folder for kernels of a project, which only this user can name; source: digest of the code that they reach.

    Numba does not notice edits of functions called from another file, hence the digest.
    """
    return root / ".cache" / "numba" / hmac.new(private_key(), source.encode(), hashlib.sha256).hexdigest()[:16]


def vector_features() -> str:
    """The features of this processor for NUMBA_CPU_FEATURES, with vectors of 512 bits; empty if it has none of these.

    By default LLVM uses 256 bits on processors that have 512. The bits of the numbers are the same.
    """
    from llvmlite.binding import get_host_cpu_features

    features = get_host_cpu_features()
    return f"{features.flatten()},-prefer-256-bit" if features.get("avx512f") else ""


def private_key() -> bytes:
    """This user's key, made when there is none; raises MarsedlError if no folder of the user's own can hold it."""
    folders = list(_private_folders())
    for folder in folders:
        try:
            return _key_in(folder)
        except OSError:
            continue
    raise MarsedlError(
        f"the key for the cache of compiled kernels cannot be stored in {' or '.join(map(str, folders))}: "
        "set XDG_CACHE_HOME to a folder of your own"
    )


class Kernels:
    """Tells numba where compiled functions are stored; the first call sets up the lock and the seals."""

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
    """Let one process at a time compile kernels; those that wait then load what it stored.

    Numba tells when it takes the lock of its compiler, before it looks into its cache, and when it gives it back, after
    it has stored there. Processes that end without doing so hold nothing: the system takes their file locks away.
    """
    from numba.core import event

    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    folder.mkdir(parents=True, exist_ok=True)
    lock, seals = (folder / "lock").open("w"), Seals(folder, private_key())

    class Turns(event.Listener):
        depth = 0  # kernels compile those that they call

        def on_start(self, event):
            if self.depth == 0:
                fcntl.flock(lock, fcntl.LOCK_EX)
                seals.drop_others()
            self.depth += 1

        def on_end(self, event):
            self.depth -= 1
            if self.depth == 0:
                seals.add()
                fcntl.flock(lock, fcntl.LOCK_UN)

    event.register("numba:compiler_lock", Turns())
    announce_compiling()


def announce_compiling() -> None:
    """Print once, on standard error, that kernels are being compiled, as it takes a while."""
    from numba.core import event

    class Announcement(event.Listener):
        announced = False

        def on_start(self, event):
            if not self.announced:
                print("compiling kernels; later runs load them", file=sys.stderr, flush=True)
            self.announced = True

        def on_end(self, event):
            pass

    event.register("numba:compile", Announcement())


class Seals:
    """The seals of the files in a cache folder; for the process that has its turn."""

    def __init__(self, folder: Path, key: bytes):
        """Take the folder and the user's key."""
        self._folder, self._key, self._file = folder, key, folder / "seals.json"
        self._seen: dict[str, tuple] = {}  # state and seal of files that this process has read

    def drop_others(self) -> None:
        """Delete files whose content is not what was sealed, and print which."""
        seals, dropped = self._stored_seals(), []
        for name, path, state in self._files():
            if self._seen.get(name) == (state, seals.get(name)):
                continue
            if hmac.compare_digest(str(seals.get(name)).encode(), self._seal(name, path).encode()):
                self._seen[name] = (state, seals[name])
            else:
                path.unlink(missing_ok=True)
                dropped.append(name)
        if dropped:
            more = f" and {len(dropped) - 1} more" if len(dropped) > 1 else ""
            print(
                f"{self._folder / dropped[0]}{more}: not as it was stored (cut short, edited or "
                "copied); it is deleted and compiled again",
                file=sys.stderr,
            )

    def add(self) -> None:
        """Seal what is new since `drop_others`: this process has stored it."""
        stored_seals = self._stored_seals()
        seals = {}
        for name, path, state in self._files():
            state_before, seal = self._seen.get(name, (None, None))
            seals[name] = seal if state_before == state else self._seal(name, path)
            self._seen[name] = (state, seals[name])
        if seals != stored_seals:
            partial = self._file.with_suffix(f".{os.getpid()}")
            partial.write_text(json.dumps(seals, indent=0), encoding="utf-8")
            partial.replace(self._file)

    def _files(self) -> Iterator[tuple[str, Path, tuple]]:
        for path in sorted(self._folder.rglob("*.nb[ic]")):
            status = path.lstat()
            yield path.relative_to(self._folder).as_posix(), path, (status.st_ino, status.st_mtime_ns, status.st_size)

    def _stored_seals(self) -> dict[str, str]:
        try:
            seals = json.loads(self._file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return {n: s for n, s in seals.items() if isinstance(s, str) and s.isascii()} if isinstance(seals, dict) else {}

    def _seal(self, name: str, path: Path) -> str:
        return hmac.new(self._key, f"{name}\0".encode() + path.read_bytes(), hashlib.sha256).hexdigest()


def _private_folders() -> Iterator[Path]:
    """Where the key may be: the user's cache folder; where there is none, a folder for temporary files."""
    configured = Path(os.environ.get("XDG_CACHE_HOME", ""))
    with contextlib.suppress(RuntimeError):  # some containers have users without a home
        yield (configured if configured.is_absolute() else Path.home() / ".cache") / "marsedl"
    yield Path(tempfile.gettempdir()) / f"marsedl-{os.getuid()}"


def _key_in(folder: Path) -> bytes:
    """The key in a folder that nobody else can write to; raises OSError if it cannot be stored."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    _make_private(folder, 0o700)
    path = folder / "kernels.key"
    for _ in range(3):
        try:
            _make_private(path, 0o600)
            key = path.read_bytes()
            if len(key) == KEY_BYTES:
                return key
            path.unlink(missing_ok=True)  # cut short
        except FileNotFoundError:
            pass
        partial = folder / f"{path.name}.{os.getpid()}.{secrets.token_hex(4)}"
        with os.fdopen(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "wb") as stream:
            stream.write(secrets.token_bytes(KEY_BYTES))
        try:
            os.link(partial, path)  # whole, and not over that of another process
        except FileExistsError:
            pass
        finally:
            partial.unlink()
    raise OSError(f"{path} does not last")


def _make_private(path: Path, mode: int) -> None:
    """Deny other users access to a file or folder; raises PermissionError if it belongs to someone else."""
    status = path.lstat()
    if status.st_uid != os.getuid() or path.is_symlink():
        raise PermissionError(f"{path} belongs to someone else")
    if status.st_mode & 0o077:
        path.chmod(mode)
