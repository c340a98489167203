"""What is freed is given back."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

# Large arrays, each with something small behind it that stays, as in a session with long logs.
CODE = """
import sys
import numpy as np
from rovid.core.threads import tune_process

def resident():
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) / 1024.0 for line in status if line.startswith("VmRSS"))

if "settle" in sys.argv:
    tune_process()
before = resident()
np.ones(30 << 17).sum()
stays, arrays = [], []
for _ in range(10):
    arrays.append(np.ones(20 << 17))
    stays.append(bytes(5000))
held = resident() - before
del arrays
print(held, resident() - before)
"""


def megabytes(*arguments: str) -> list[float]:
    """Held, and kept after it was let go."""
    done = subprocess.run([sys.executable, "-c", CODE, *arguments], capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()]


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of the GNU library")
def test_large_arrays_are_given_back() -> None:
    held, kept = megabytes("settle")
    assert held > 190.0
    assert kept < 20.0
    _, otherwise = megabytes()
    assert otherwise > 100.0
