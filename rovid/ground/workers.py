"""Work spread over the cores, with never more threads than cores: more of them only wait for each other."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

# In the environment of a process that is one of several: how many cores are its own.
SHARE = "ROVID_CORES"
_NAME = "rovid-worker"
# s; Python's own 5 ms are as long as several passes over the readings.
_TURN = 2e-5

Item = TypeVar("Item")
Result = TypeVar("Result")


def spread(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """``function`` of each of ``items``; one after the other where this thread is itself one of many."""
    if threading.current_thread().name.startswith(_NAME):
        return [function(item) for item in items]
    with _handing_over(), ThreadPoolExecutor(cores(), thread_name_prefix=_NAME) as pool:
        return list(pool.map(function, items))


@contextlib.contextmanager
def _handing_over() -> Iterator[None]:
    """Let a thread that comes out of a compiled loop wait no longer for the others than that loop took."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(_TURN)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def cores() -> int:
    """How many this process may use."""
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(there, int(os.environ.get(SHARE, there)))
