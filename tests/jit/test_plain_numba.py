"""The backend in plain numba gives the results of the LLVM backend."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from tests.conftest import ROOT

FORMULA = """
    import json, math
    import numba
    import numpy as np
    from rovid.jit.decorators import USE_LLVM
    from rovid.jit.simd import broadcast, exp, extract, insert, load, maximum, minimum, sqrt, store, switch, traced
    from rovid.jit.simd import nan_unless_below, reduce_max, where_nonnegative

    @traced
    def product(x, y):
        return x * y - 2.0 / y

    @traced
    def roots(x, y):
        return sqrt(abs(x)) + exp(-y) + math.tanh(x) * math.sin(y) + math.pow(y, 1.7) + math.floor(3.0 * x)

    chosen = switch({2: product}, roots)

    @numba.njit(error_model="numpy")
    def run(rows, out):
        x, y = load(rows, 0), load(rows, 1)
        store(out, 0, chosen(2, x, y))
        store(out, 1, chosen(0, x, y))
        store(out, 2, where_nonnegative(x, maximum(x, 0.3), minimum(-y, x)))
        store(out, 3, insert(broadcast(2), 1, extract(y, 3)) + reduce_max(x))
        store(out, 4, nan_unless_below(x, y, 1.0))

    out = np.empty((5, 4))
    run(np.array([[-0.7, 0.4, 1.3, -2.0], [0.5, 1.5, 0.9, 2.5]]), out)
    print(json.dumps([USE_LLVM, np.nan_to_num(out, nan=99.0).tolist()]))
"""


def run_with(plain: str, *arguments: str) -> str:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "ROVID_PLAIN_NUMBA": plain}
    done = subprocess.run(
        [sys.executable, *arguments], env=environment, capture_output=True, text=True, check=True, cwd=ROOT
    )
    return done.stdout


@pytest.mark.slow
def test_functions_of_vectors() -> None:
    (uses_llvm, wanted), (uses_plain, found) = (
        json.loads(run_with(plain, "-c", textwrap.dedent(FORMULA))) for plain in ("0", "1")
    )
    assert (uses_llvm, uses_plain) == (True, False)
    for row, expected in zip(found, wanted, strict=True):
        # Products are added without rounding in the LLVM backend.
        assert row == pytest.approx(expected, rel=1e-14)


@pytest.mark.slow
def test_the_kernels_pass_the_tests_against_the_reference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert "passed" in run_with("1", "-m", "pytest", "-q", "-p", "no:xdist", "tests/model/test_reference.py")
