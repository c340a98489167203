"""Threads: a map over the cores, a shared cache, and settings of the garbage collector and the memory allocator."""

import atexit
import gc
import os
import random
import sys
import threading
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, Protocol, TypeVar

from rovid.core.errors import ConfigError

# New objects between two garbage collections.
_GC_THRESHOLD = 100_000
# Parameter numbers of glibc's mallopt, from malloc.h.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
# Bytes; less than the arrays of a day's logs, and more than arrays that are made again and again.
_LARGE = 16_000_000


def tune_process() -> None:
    """Collect garbage seldom, and return large arrays to the system when they are deleted."""
    # Imported modules stay until the end. A collection would look through all of them, also the one at the end.
    gc.set_threshold(_GC_THRESHOLD)
    atexit.register(gc.freeze)
    if sys.platform == "linux":
        # Let glibc use one heap for all threads, and no heap for large arrays; by itself it raises that limit to 32 MB.
        import ctypes

        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
        if mallopt is not None:
            for parameter, value in ((_M_ARENA_MAX, 1), (_M_MMAP_THRESHOLD, _LARGE), (_M_TRIM_THRESHOLD, _LARGE)):
                mallopt(parameter, value)


# Bytes of addresses that a diagnosis needs; with less the compiler ends the process or waits for ever.
_LEAST_ADDRESSES = 1_000_000_000


def require_address_space() -> None:
    """Raise MemoryError if the process may not have as much memory as a diagnosis needs (ulimit -v)."""
    if sys.platform != "win32":
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY and limit < _LEAST_ADDRESSES:
            raise MemoryError


# Environment variable: how many cores this process may use, if it shares them with other processes of rovid.
CORES_VARIABLE = "ROVID_CORES"
# s; switch interval of Python's threads while several work. A compiled loop takes less than Python's default of 5 ms.
_SWITCH_INTERVAL = 2e-5

Item = TypeVar("Item")
Result = TypeVar("Result")


def thread_map(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """``function`` of each item, on all free cores.

    ``function`` may itself call `thread_map`: threads that run out of items help with the inner map.
    """
    job = _Job(function, deque(enumerate(items)))
    started = _HELPERS.start(job)
    try:
        job.work()
    finally:
        job.left.clear()
        helped = _HELPERS.wait_for(started)
    for helper in helped:
        helper.result()
    return [job.done[index] for index in range(len(job.done))]


def core_count() -> int:
    """How many cores this process may use. Raises ConfigError if the environment variable is not a number of cores."""
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    wanted = os.environ.get(CORES_VARIABLE, str(available))
    if not wanted.isdecimal() or int(wanted) < 1:
        expected = "a whole number of cores, 1 or more, was expected."
        raise ConfigError(f"is {wanted!r}; {expected}", where=f"environment variable {CORES_VARIABLE}")
    return min(available, int(wanted))


@dataclass(eq=False)
class _Job(Generic[Item, Result]):
    """A map: (index, item) pairs that are ``left``, and the results of those that are ``done``."""

    function: Callable[[Item], Result]
    left: deque[tuple[int, Item]]
    done: dict[int, Result] = field(default_factory=dict)

    def work(self) -> None:
        """Take one item after the other until none is left."""
        try:
            while True:
                try:
                    index, item = self.left.popleft()
                except IndexError:
                    return
                self.done[index] = self.function(item)
        except BaseException:
            # The other threads need not go on.
            self.left.clear()
            raise


class _Helpers:
    """Threads that help with maps. With the caller at most one thread for each core is at work."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._busy = 0
        self._default_interval = 0.0

    def start(self, job: _Job[Item, Result]) -> list[Future[None]]:
        """Let the free helpers work at ``job``."""
        with self._lock:
            count = max(min(core_count() - 1 - self._busy, len(job.left) - 1), 0)
            self._change_busy(count)
        return [self._pool.submit(self._help, job) for _ in range(count)]

    def wait_for(self, helpers: Sequence[Future[None]]) -> list[Future[None]]:
        """Wait for the helpers that have begun, and return these. The waiting thread leaves its core to others."""
        begun = [helper for helper in helpers if not helper.cancel()]
        with self._lock:
            # A cancelled helper leaves its core too.
            self._change_busy(len(begun) - len(helpers) - 1)
        try:
            for helper in begun:
                helper.exception()
        finally:
            with self._lock:
                self._change_busy(1)
        return begun

    def _help(self, job: _Job[Item, Result]) -> None:
        try:
            job.work()
        finally:
            with self._lock:
                self._change_busy(-1)

    def _change_busy(self, change: int) -> None:
        """Count the busy helpers. While there are any, Python switches between threads more often."""
        before, self._busy = self._busy, self._busy + change
        if before <= 0 < self._busy:
            self._default_interval = sys.getswitchinterval()
            sys.setswitchinterval(_SWITCH_INTERVAL)
        elif self._busy <= 0 < before:
            sys.setswitchinterval(self._default_interval)

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        # One thread more than cores: while a helper waits for an inner map, another one may work.
        return ThreadPoolExecutor(max(core_count(), 1) + 1, thread_name_prefix="rovid-worker")


_HELPERS = _Helpers()


class HasNbytes(Protocol):
    """An object of known size, such as an array."""

    @property
    def nbytes(self) -> int:
        """Size in bytes."""


Value = TypeVar("Value", bound=HasNbytes)


class SizedCache:
    """Values by key, up to ``max_bytes`` in total. The value that was not used for the longest time is evicted first.

    A key that holds a weak reference does not keep its object alive. Several threads may compute the same value at
    once.

    ``evict_randomly``: For keys that are used in a fixed order again and again: the least recently used value is then
        needed next. A random value is evicted instead, and the latest is kept however large it is.
    """

    def __init__(self, max_bytes: int, *, evict_randomly: bool = False) -> None:
        self.max_bytes, self.evict_randomly = max_bytes, evict_randomly
        # Each with its size.
        self._values: dict[Hashable, tuple[Any, int]] = {}
        self._bytes = 0
        self._lock = threading.Lock()
        self._random = random.Random(0)  # noqa: S311 - nothing is secret

    def get_or_make(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """The value under ``key``, or the value that ``make`` returns, which is kept if it fits."""
        with self._lock:
            if (found := self._values.pop(key, None)) is not None:
                self._values[key] = found  # the latest key stands last
                kept: Value = found[0]
                return kept
        made = make()
        size = made.nbytes
        if size <= self.max_bytes or self.evict_randomly:
            with self._lock:
                self._pop(key)
                self._values[key] = made, size
                self._bytes += size
                fewest = 1 if self.evict_randomly else 0
                while self._bytes > self.max_bytes and len(self._values) > fewest:
                    keys = list(self._values)
                    self._pop(keys[self._random.randrange(len(keys) - 1)] if self.evict_randomly else keys[0])
        return made

    def _pop(self, key: Hashable) -> None:
        _, size = self._values.pop(key, (None, 0))
        self._bytes -= size
