"""The same flights in C: built by the system's compiler, called through ctypes.

Strict IEEE arithmetic, no contraction and no reordering, in the processor's widest vectors. The bits are the kernels'.
"""

import ctypes
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

FLAGS = "-std=c11 -O3 -march=native -ffp-contract=off -fno-math-errno -fno-trapping-math -shared -fPIC"
WIDE = "-mprefer-vector-width=512"  # on processors that have such vectors; without it compilers take 256 bits


@cache
def library(name):
    """The shared library of `name`.c in this folder; None, after a loud word, where no compiler is."""
    found = [command for command in ("cc", "gcc", "clang") if shutil.which(command)]
    if not (compiler := shlex.split(os.environ.get("CC", "")) or found[:1]):
        print(f"NO C COMPILER: flights in C are SKIPPED ({name}.c); install one, or name it by CC", file=sys.stderr)
        return None
    source, target = Path(__file__).with_name(f"{name}.c"), Path(tempfile.mkdtemp()) / f"{name}.so"
    flags = [*FLAGS.split(), *[WIDE] * (os.uname().machine == "x86_64")]
    subprocess.run([*compiler, *flags, "-o", str(target), str(source), "-lm"], check=True)
    return ctypes.CDLL(str(target))


def pointer(array):
    """Address of a C-contiguous array of doubles or integers."""
    assert array.flags.c_contiguous
    return array.ctypes.data_as(ctypes.c_void_p)


def structure(**fields):
    """A C structure of fields in their order: names, separated by blanks, by type."""
    listed = [(name, kind) for kinds, kind in _TYPES.items() for name in fields.get(kinds, "").split()]
    return type("Structure", (ctypes.Structure,), {"_fields_": listed})


_TYPES = {"pointers": ctypes.c_void_p, "doubles": ctypes.c_double, "integers": ctypes.c_int64, "keys": ctypes.c_uint64}
