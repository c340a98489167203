"""A map over the cores by threads, and the settings of the process."""

from __future__ import annotations

import platform
import subprocess
import sys
import threading
import time

import pytest

from rovid.core.threads import CORES_VARIABLE, core_count, thread_map

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
fill = [bytes(5000) for _ in range(2000)]  # so that no gap of the heap takes what is to stand behind an array
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


@pytest.fixture(autouse=True)
def all_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not what is this worker's share of them."""
    monkeypatch.delenv(CORES_VARIABLE, raising=False)


def test_results_stand_in_the_order_of_what_they_are_of() -> None:
    def late(number: int) -> int:
        # The first is done last.
        time.sleep(0.01 * (5 - number))
        return number**2

    assert thread_map(late, range(5)) == [0, 1, 4, 9, 16]


def slow_name(_: int) -> str:
    time.sleep(0.002)
    return threading.current_thread().name


def test_no_more_are_at_work_than_there_are_cores() -> None:
    at_work, most, lock = 0, 0, threading.Lock()

    def leaf(_: int) -> None:
        nonlocal at_work, most
        with lock:
            at_work += 1
            most = max(most, at_work)
        time.sleep(0.002)
        with lock:
            at_work -= 1

    thread_map(lambda _: thread_map(leaf, range(5)), range(10))
    assert most == core_count()


def test_who_has_nothing_left_to_do_helps() -> None:
    if core_count() < 2:
        pytest.skip("one core alone")

    def threads(number: int) -> int:
        # The others are done at once; whether they are free already is known to nobody here.
        for _ in range(500 if number == 0 else 0):
            names = thread_map(slow_name, range(4))
            if len(set(names)) > 1:
                return len(set(names))
        return 0

    assert thread_map(threads, range(2))[0] > 1


def test_a_failure_comes_back() -> None:
    with pytest.raises(ZeroDivisionError):
        thread_map(lambda number: 1 // number, [1, 0])


def test_after_a_failure_nothing_more_is_begun() -> None:
    begun = []

    def failing(number: int) -> None:
        begun.append(number)
        if number == 0:
            raise ZeroDivisionError
        time.sleep(0.01)

    with pytest.raises(ZeroDivisionError):
        thread_map(failing, range(100))
    assert len(begun) <= 2 * core_count()


def test_however_deep_it_is_spread_it_ends() -> None:
    def deep(depth: int) -> int:
        time.sleep(0.001)
        return 1 + sum(thread_map(deep, [depth - 1] * 3)) if depth else 1

    assert deep(6) == sum(3**k for k in range(7))
