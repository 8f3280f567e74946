"""Kernels give the same bits on processors with and without wide vectors and fused products."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.workflow
SCRIPT = Path(__file__).with_name("kernel_calls.py")
PLAIN = {  # no vector unit wider than SSE, and no fused products: OpenBLAS, NumPy, LLVM and glibc
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F",
}


def run(*arguments, **environment):
    """Standard output of the script in a process of its own; None stands for a variable that must not be set."""
    variables = {name: value for name, value in (os.environ | environment).items() if value is not None}
    command = [sys.executable, str(SCRIPT), *map(str, arguments)]
    process = subprocess.run(command, env=variables, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr[-3000:]
    return process.stdout


# Of the papers whose flights are compiled, one in every run of the suite: each compiles its kernels anew.
@pytest.mark.parametrize(
    "slug",
    [
        "powered_descent",
        *(pytest.param(slug, marks=pytest.mark.long) for slug in ("random_field", "desensitized", "stochastic_entry")),
    ],
)
def test_kernels_give_the_same_bits_without_wide_vectors_and_fused_products(tree, tmp_path, slug):
    """The first block of every Monte Carlo case, on LLVM's plain x86-64 with a mathematical library to match."""
    calls, source = tmp_path / "calls", {"PYTHONPATH": str(tree.folder / "src")}
    run("record", calls, tree.folder, slug, **source)
    machine = PLAIN | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "NUMBA_NUM_THREADS": "1"}
    replayed = json.loads(run("replay", calls, **source, **machine))
    assert f"marsedl.papers.{slug}." in "".join(replayed["calls"])
    assert replayed["changed"] == []
