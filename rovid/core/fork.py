"""Copies of this process: they have all that it has in memory, and say nothing."""

from __future__ import annotations

import contextlib
import os
import pickle
import platform
import signal
import threading
import warnings
from collections.abc import Callable
from typing import BinaryIO, Generic, Self, TypeVar

from rovid.core.threads import core_count

Result = TypeVar("Result")


def can_fork() -> bool:
    """On Linux alone: elsewhere libraries do not bear it, or there is no such thing; and where a core is free."""
    return platform.system() == "Linux" and core_count() > 1 and threading.current_thread() is threading.main_thread()


def fork_process() -> int:
    """The number of a copy that begins here; 0 in the copy.

    Raises
    ------
    OSError
        There is no room for one.
    """
    with warnings.catch_warnings():
        # Threads that help or listen wait for work meanwhile, and hold nothing that a copy might wait for.
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def silence_child() -> None:
    """Say nothing, and leave nothing behind."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for standard in range(3):
        os.dup2(nowhere, standard)


def kill_child(copy: int) -> None:
    """End the copy of this number, whatever it is at."""
    os.kill(copy, signal.SIGKILL)
    os.waitpid(copy, 0)


class ForkedCall(Generic[Result]):
    """What a ``function`` returns, worked out by a copy while this process does something else.

    It is told as pickle tells it. Where there is no copy, or it fails, nothing is told.
    """

    def __init__(self, function: Callable[[], Result]) -> None:
        self._copy: int | None = None
        self._told: BinaryIO | None = None
        if not can_fork():
            return
        reads, writes = os.pipe()
        try:
            self._copy = fork_process()
        except OSError:
            os.close(reads)
            os.close(writes)
            return
        if self._copy == 0:
            os.close(reads)
            _tell(function, writes)
        os.close(writes)
        self._told = os.fdopen(reads, "rb")

    @property
    def is_at_work(self) -> bool:
        """Whether there is a copy, of which nothing was heard yet."""
        return self._told is not None

    def result(self) -> Result | None:
        """What was told, once it is; None where nothing is."""
        if self._told is None:
            return None
        told = self._told.read()
        self.stop()
        result: Result | None = None
        with contextlib.suppress(EOFError, pickle.UnpicklingError):
            result = pickle.loads(told)  # noqa: S301 - of a copy of this process
        return result

    def stop(self) -> None:
        """End the copy, whatever it is at."""
        if self._told is None or self._copy is None:
            return
        self._told.close()
        self._told = None
        kill_child(self._copy)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def _tell(function: Callable[[], object], writes: int) -> None:
    """As the copy."""
    try:
        silence_child()
        with os.fdopen(writes, "wb") as pipe:
            pickle.dump(function(), pipe, protocol=pickle.HIGHEST_PROTOCOL)
    finally:
        os._exit(0)
