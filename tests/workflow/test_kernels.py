"""Kernels give the same bits on processors with and without wide vectors and fused products."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.workflow
CASES = Path(__file__).parents[1] / "flights" / "cases.py"
SCRIPT = f"""
import json, runpy, sys
cases = runpy.run_path({str(CASES)!r})
held = json.loads(cases["DIGESTS"].read_text(encoding="utf-8"))
own = [name for name in held if name.startswith(sys.argv[1] + "/")]
print(json.dumps([len(own), [name for name in own if cases["digests"](name) != held[name]]]))
"""
PLAIN = {  # no vector unit wider than SSE, and no fused products: OpenBLAS, NumPy, LLVM and glibc
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F",
}


# Of the papers whose flights are compiled, one in every run of the suite: each compiles its kernels anew.
@pytest.mark.parametrize(
    "slug",
    [
        "powered_descent",
        *(pytest.param(slug, marks=pytest.mark.long) for slug in ("random_field", "desensitized", "stochastic_entry")),
    ],
)
def test_kernels_give_the_same_bits_without_wide_vectors_and_fused_products(tmp_path, slug):
    """The flights whose bits are held, on LLVM's plain x86-64 with a mathematical library to match."""
    machine = PLAIN | {"NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_NUM_THREADS": "1"}
    process = subprocess.run(
        [sys.executable, "-c", SCRIPT, slug], env=os.environ | machine, capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stderr[-3000:]
    flown, differing = json.loads(process.stdout.splitlines()[-1])
    assert flown > 10
    assert differing == []
