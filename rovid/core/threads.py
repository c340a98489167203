"""Work spread over the cores, with never more threads at work than cores: more of them only wait for each other."""

from __future__ import annotations

import os
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Generic, TypeVar

# In the environment of a process that is one of several: how many cores are its own.
CORES_VARIABLE = "ROVID_CORES"
# s that a thread which comes out of a compiled loop waits for the others; Python's own 5 ms are several loops' time.
_TURN = 2e-5

Item = TypeVar("Item")
Result = TypeVar("Result")


def thread_map(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """``function`` of each of ``items``, on all cores that are not at work already.

    What is spread within such a function is spread too, as soon as another has run out of work: the last of many is
    not left to one core.
    """
    job = _Job(function, deque(enumerate(items)))
    helpers = _HANDS.help_with(job)
    try:
        job.work()
    finally:
        job.left.clear()
        helped = _HANDS.wait_for(helpers)
    for helper in helped:
        helper.result()
    return [job.done[place] for place in range(len(job.done))]


@dataclass(eq=False)
class _Job(Generic[Item, Result]):
    """Items that are ``left``, each with its place, and what was ``done``."""

    function: Callable[[Item], Result]
    left: deque[tuple[int, Item]]
    done: dict[int, Result] = field(default_factory=dict)

    def work(self) -> None:
        """One item after the other, until none is left."""
        try:
            while True:
                try:
                    place, item = self.left.popleft()
                except IndexError:
                    return
                self.done[place] = self.function(item)
        except BaseException:
            # The others need not go on.
            self.left.clear()
            raise


class _Hands:
    """The threads that help, as many at work as there are cores beside that of who asks."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._busy = 0
        self._turn = 0.0

    def help_with(self, job: _Job[Item, Result]) -> list[Future[None]]:
        """Let those work at ``job`` who are free."""
        with self._lock:
            count = max(min(core_count() - 1 - self._busy, len(job.left) - 1), 0)
            self._count(count)
        return [self._pool.submit(self._help, job) for _ in range(count)]

    def wait_for(self, helpers: Sequence[Future[None]]) -> list[Future[None]]:
        """Until they are done, those of them that have begun; who waits leaves its core to others."""
        begun = [helper for helper in helpers if not helper.cancel()]
        with self._lock:
            # Who has not begun never will, and leaves its core too.
            self._count(len(begun) - len(helpers) - 1)
        try:
            for helper in begun:
                helper.exception()
        finally:
            with self._lock:
                self._count(1)
        return begun

    def _help(self, job: _Job[Item, Result]) -> None:
        try:
            job.work()
        finally:
            with self._lock:
                self._count(-1)

    def _count(self, more: int) -> None:
        """So many more are at work; as long as any is, they hand over to each other sooner."""
        before, self._busy = self._busy, self._busy + more
        if before <= 0 < self._busy:
            self._turn = sys.getswitchinterval()
            sys.setswitchinterval(_TURN)
        elif self._busy <= 0 < before:
            sys.setswitchinterval(self._turn)

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        # One more than help at a time: who waits may be helped for.
        return ThreadPoolExecutor(max(core_count(), 1) + 1, thread_name_prefix="rovid-worker")


_HANDS = _Hands()


def core_count() -> int:
    """How many this process may use."""
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(there, int(os.environ.get(CORES_VARIABLE, there)))
