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
    compiler = os.environ.get("CC") or next(filter(shutil.which, ("cc", "gcc", "clang")), None)
    if not compiler:
        print(f"NO C COMPILER: flights in C are SKIPPED ({name}.c); install one, or name it by CC", file=sys.stderr)
        return None
    source, target = Path(__file__).with_name(f"{name}.c"), f"{tempfile.mkdtemp()}/{name}.so"
    flags = [*FLAGS.split(), *[WIDE] * (os.uname().machine == "x86_64")]
    subprocess.run([*shlex.split(compiler), *flags, "-o", target, source, "-lm"], check=True)
    return ctypes.CDLL(target)


def call(function, values, arrays):
    """Call a C function with a structure of these values in their order, and with C-contiguous arrays.

    In the structure arrays are pointers, floats doubles and all others integers of 64 bits.
    """
    assert all(array.flags.c_contiguous for array in (*values, *arrays) if hasattr(array, "flags") and array.shape)
    fields = [_field(value) for value in values]
    kinds = [(f"field{number}", kind) for number, (kind, _) in enumerate(fields)]
    structure = type("Structure", (ctypes.Structure,), {"_fields_": kinds})(*(value for _, value in fields))
    function(ctypes.byref(structure), *(_field(array)[1] for array in arrays))


def _field(value):
    """The type and the value of a field."""
    if getattr(value, "shape", ()):
        return ctypes.c_void_p, value.ctypes.data_as(ctypes.c_void_p)
    return (ctypes.c_double, value) if isinstance(value, float) else (ctypes.c_int64, int(value))
