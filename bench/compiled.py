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


def compiler():
    """Command of the system's C compiler; None if there is none."""
    found = [name for name in ("cc", "gcc", "clang") if shutil.which(name)]
    return shlex.split(os.environ.get("CC", "")) or found[:1] or None


@cache
def library(name):
    """The shared library of `name`.c in this folder; None, after a loud word, where no compiler is."""
    if not (command := compiler()):
        print(f"NO C COMPILER: flights in C are SKIPPED ({name}.c); install one, or name it by CC", file=sys.stderr)
        return None
    folder = Path(tempfile.mkdtemp())
    source, target = Path(__file__).with_name(f"{name}.c"), folder / f"{name}.so"
    wide = [WIDE] if os.uname().machine == "x86_64" else []
    subprocess.run([*command, *FLAGS.split(), *wide, "-o", str(target), str(source), "-lm"], check=True)
    return ctypes.CDLL(str(target))


def pointer(array):
    """Address of a C-contiguous array of doubles or integers."""
    assert array.flags.c_contiguous
    return array.ctypes.data_as(ctypes.c_void_p)


def structure(name, **types):
    """A C structure of these fields in their order."""
    return type(name, (ctypes.Structure,), {"_fields_": list(types.items())})
