"""Work spread over the cores, with never more threads than cores: more of them only wait for each other."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_NAME = "rovid-worker"

Item = TypeVar("Item")
Result = TypeVar("Result")


def spread(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """``function`` of each of ``items``; one after the other where this thread is itself one of many."""
    if threading.current_thread().name.startswith(_NAME):
        return [function(item) for item in items]
    with ThreadPoolExecutor(_cores(), thread_name_prefix=_NAME) as pool:
        return list(pool.map(function, items))


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
