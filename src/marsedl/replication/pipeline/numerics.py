"""The numeric environment of jobs: threads, instruction sets, caches."""

import os
import platform
import re
import sys
from pathlib import Path

from marsedl.replication.errors import MarsedlError

# One thread per job, one instruction set for linear algebra and array code: the same numbers on every run.
NUMERIC_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "RAYON_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "SOURCE_DATE_EPOCH": "1502928000",
    "MPLBACKEND": "agg",
    "PYDANTIC_DISABLE_PLUGINS": "__all__",
}
# Variables beside these that choose instruction sets or the way kernels are compiled: a shell's do not reach jobs.
_OF_A_SHELL = ("NPY_ENABLE_CPU_FEATURES", "GLIBC_TUNABLES")
_OF_THIS_PROJECT = ("PYTHONHASHSEED", "NUMBA_CACHE_DIR", "NUMBA_CACHE_LOCATOR_CLASSES")
# Settings that libraries read from the working directory, whoever starts them there. Matplotlib's are dropped where
# figures are drawn.
_SETTINGS_FILES = {".numba_config.yaml": "numba", "ipopt.opt": "IPOPT"}


def check_start() -> None:
    """Refuse to start where jobs would fail or give other numbers.

    Raises:
        MarsedlError: for a Python whose path bash does not take as it is, one that drops docstrings, which describe
            artifacts, or a working directory with settings of a library.

    """
    if found := re.search(r"[^\w@%+=,./-]", sys.executable):
        raise MarsedlError(
            f"{sys.executable}: Snakemake runs no Python whose path has {found[0]!r}; move the project, or its "
            "environment, to a path of letters, digits and _.,+=@%-"
        )
    if sys.flags.optimize > 1:
        raise MarsedlError("Python drops docstrings, which describe artifacts: unset PYTHONOPTIMIZE, or leave -OO out")
    for name, library in _SETTINGS_FILES.items():
        if Path(name).exists():
            raise MarsedlError(f"{Path(name).absolute()}: changes the settings of {library}; move it to another folder")


def pin_numerics(root: Path, *, here: bool = True) -> None:
    """Set the numeric environment of this process and its children.

    Args:
        root: the project's folder, which also holds the cache of compiled kernels.
        here: this process computes too. Then numpy, which reads the environment once, must not be imported yet.

    Raises:
        MarsedlError: if this processor lacks what OpenBLAS's pinned kernels use: it would end with SIGILL; and as
            `check_start` does.
        RuntimeError: if numpy was imported in another environment.

    """
    from llvmlite.binding import get_host_cpu_features

    from marsedl.replication.pipeline import kernel_cache
    from marsedl.replication.pipeline.fingerprints import fingerprints_of

    check_start()
    features = get_host_cpu_features()
    if platform.machine() == "x86_64" and not (features.get("avx2") and features.get("fma")):
        raise MarsedlError(
            "this processor, or the virtual machine's, has no AVX2 and FMA, which linear algebra is pinned to: run on "
            "one that has, or let the virtual machine pass on its host's processor"
        )
    pinned = all(os.environ.get(name) == value for name, value in NUMERIC_ENVIRONMENT.items())
    if here and not pinned and "numpy" in sys.modules:
        raise RuntimeError("numpy is imported before the numeric environment is pinned: import it afterwards")
    for name in [name for name in os.environ if name.startswith("NUMBA_") or name in _OF_A_SHELL]:
        del os.environ[name]
    os.environ.update(NUMERIC_ENVIRONMENT)
    os.environ.setdefault("PYTHONHASHSEED", "0")
    if features := kernel_cache.vector_features():
        os.environ["NUMBA_CPU_FEATURES"] = features
    # Numba does not notice edits of functions that a kernel calls from another file, hence a folder for each code.
    os.environ["NUMBA_CACHE_DIR"] = str(root / ".cache" / "numba" / fingerprints_of(root).kernels()[:16])
    os.environ["NUMBA_CACHE_LOCATOR_CLASSES"] = kernel_cache.LOCATOR
    os.environ["MPLCONFIGDIR"] = str(root / ".cache" / "matplotlib")


def assert_numerics() -> None:
    """Raise MarsedlError if this process was started without the pinned numeric environment, and as `check_start`."""
    check_start()
    unset = [name for name, value in NUMERIC_ENVIRONMENT.items() if os.environ.get(name) != value]
    unset += [name for name in _OF_THIS_PROJECT if name not in os.environ]
    if unset:
        raise MarsedlError(f"the numeric environment is not pinned ({', '.join(unset)}); start jobs through snakemake")
