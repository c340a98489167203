"""Forked copies of this process: workers that share a map, and a single call in the background.

SPMD stands for single program, multiple data. Inside `forked_workers` this process and its copies run the same
statements. Each of them does the quick work itself, so all have the same state at any time. Only in `parallel_map` do
they divide the items among themselves and exchange the results. Threads would not help here: Python code runs in one of
them at a time.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import platform
import signal
import struct
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

from rovid.core.threads import CORES_VARIABLE, core_count, thread_map

if TYPE_CHECKING:  # Imported where it is used: most commands start no process.
    from multiprocessing.connection import Connection

Item = TypeVar("Item")
Result = TypeVar("Result")

# Forked workers; more of them find little left to share.
_MAX_WORKERS = 3
# An index among the shared items, and the index that says that no item is left.
_INDEX, _NO_ITEM = struct.Struct("=I"), 2**32 - 1


def parallel_map(
    function: Callable[[Item], Result], items: Iterable[Item], *, use_threads: bool = True
) -> list[Result]:
    """``function`` of each item: shared among the forked workers if there are any, otherwise among threads.

    Results are pickled on the way from one process to another. They must not be compared by identity.

    ``use_threads``: Whether threads may run ``function`` if there are no workers. If not, the items are done one after
        the other.
    """
    every = list(items)
    if _TEAM is not None:
        return _TEAM.map(function, every)
    return thread_map(function, every) if use_threads else list(map(function, every))


def agreed(question: Callable[[], bool]) -> bool:
    """The answer of the first process, in all copies, which have to ask at the same place; not inside of a map."""
    return question() if _TEAM is None or _TEAM.is_busy else _TEAM.share(question)


@contextlib.contextmanager
def forked_workers(*, enabled: bool = True) -> Iterator[bool]:
    """Run the block in copies of this process too; true in the original process.

    The copies end with the block. There are none if ``enabled`` is false, on systems other than Linux, without a free
    core, or outside the main thread.
    """
    if not enabled or _TEAM is not None or not can_fork():
        yield True
        return
    workers = _start_workers(min(core_count() - 1, _MAX_WORKERS))
    try:
        yield workers is not None
    finally:
        if workers is None:
            os._exit(0)
        _leave_team()
        for worker in workers:
            kill_child(worker)


def can_fork() -> bool:
    """Whether this process can be copied: on Linux, from the main thread, with a free core."""
    in_main_thread = threading.current_thread() is threading.main_thread()
    return platform.system() == "Linux" and core_count() > 1 and in_main_thread


def fork_process() -> int:
    """Fork this process: the process number of the copy, 0 in the copy.

    Raises OSError if the system has no room for another process.
    """
    with warnings.catch_warnings():
        # Other threads wait for work meanwhile. They hold no lock that the copy needs.
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def silence_child() -> None:
    """In a copy: restore the default signal handlers, and connect the standard streams to nowhere."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    null = os.open(os.devnull, os.O_RDWR)
    for standard in range(3):
        os.dup2(null, standard)


def kill_child(process: int) -> None:
    """Kill the copy with this process number, and wait for its end."""
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)


class ForkedCall(Generic[Result]):
    """A call of ``function`` in a copy of this process, which meanwhile goes on.

    The result is pickled. It is None if the process cannot be copied, or if ``function`` fails.
    """

    def __init__(self, function: Callable[[], Result]) -> None:
        from multiprocessing import Pipe

        self._child: int | None = None
        self._pipe: Connection | None = None
        if not can_fork():
            return
        reads, writes = Pipe(duplex=False)
        with writes:
            try:
                self._child = fork_process()
            except OSError:
                reads.close()
                return
            if self._child == 0:
                try:
                    reads.close()
                    silence_child()
                    writes.send(function())
                finally:
                    os._exit(0)
        self._pipe = reads

    @property
    def is_running(self) -> bool:
        """Whether a copy was started, and its result was not fetched yet."""
        return self._pipe is not None

    def result(self) -> Result | None:
        """Wait for the result."""
        if self._pipe is None:
            return None
        result: Result | None = None
        with contextlib.suppress(EOFError, OSError, pickle.UnpicklingError):
            result = self._pipe.recv()
        self.stop()
        return result

    def stop(self) -> None:
        """End the copy, finished or not."""
        if self._pipe is None or self._child is None:
            return
        self._pipe.close()
        self._pipe = None
        kill_child(self._child)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def _start_workers(count: int) -> list[int] | None:
    """Fork up to ``count`` workers: their process numbers, None in a worker."""
    from multiprocessing import Pipe

    indices, connections, workers = os.pipe(), list["Connection"](), list[int]()
    for _ in range(count):
        ours, theirs = Pipe()
        try:
            worker = fork_process()
        except OSError:
            ours.close()
            theirs.close()
            break
        if worker == 0:
            for connection in (ours, *connections):
                connection.close()
            os.close(indices[1])
            silence_child()
            _join_team(_Team(indices[0], None, [theirs]))
            return None
        theirs.close()
        connections.append(ours)
        workers.append(worker)
    team = _Team(indices[0], indices[1], connections)
    if workers:
        _join_team(team)
    else:
        team.close()
    return workers


@dataclass(eq=False)
class _Team:
    """One process among those that share the items of a map."""

    indices: int  #: Pipe end from which every process reads the index of its next item.
    index_writer: int | None  #: Pipe end to which the first process writes all indices; None in a worker.
    connections: Sequence[Connection]  #: Those to the workers, or the one to the first process.
    is_busy: bool = False  #: Whether this process is doing its part of a map.
    #: The environment's limit on cores before. In a team each process has one core.
    cores_before: str | None = field(default_factory=lambda: os.environ.get(CORES_VARIABLE))

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """``function`` of each item. A map inside ``function`` is not shared, nor is a single item."""
        if self.is_busy or len(items) < 2:
            return list(map(function, items))
        self.is_busy = True
        done: dict[int, Result] = {}
        try:
            if self.index_writer is not None:
                ends = [_NO_ITEM] * (1 + len(self.connections))
                os.write(self.index_writer, b"".join(map(_INDEX.pack, (*range(len(items)), *ends))))
            while True:
                # Index of an item that no process has taken yet.
                data = os.read(self.indices, _INDEX.size)
                if not data:
                    raise EOFError
                (index,) = _INDEX.unpack(data)
                if index == _NO_ITEM:
                    break
                done[index] = function(items[index])
            self._exchange(done)
        except BaseException as error:
            if self.index_writer is None:
                os._exit(1)
            _leave_team()
            if not isinstance(error, OSError | EOFError):
                raise
        finally:
            self.is_busy = False
        # Items that a killed worker had taken are done here.
        return [done[index] if index in done else function(item) for index, item in enumerate(items)]

    def share(self, question: Callable[[], bool]) -> bool:
        """The answer of the first process, sent to all others."""
        if self.index_writer is None:
            (first,) = self.connections
            try:
                return bool(first.recv())
            except (OSError, EOFError):
                os._exit(1)
        answer = question()
        try:
            for connection in self.connections:
                connection.send(answer)
        except OSError:
            _leave_team()  # a worker was killed
        return answer

    def _exchange(self, done: dict[int, Any]) -> None:
        """Complete ``done`` in every process. The first process collects all results and sends them out."""
        if self.index_writer is None:
            (first,) = self.connections
            first.send(done)
            done.update(first.recv())
            return
        for connection in self.connections:
            done.update(connection.recv())
        for connection in self.connections:
            connection.send(done)

    def close(self) -> None:
        """Close all pipe ends. A process that waits at another end gets an `EOFError`."""
        for connection in self.connections:
            connection.close()
        os.close(self.indices)
        if self.index_writer is not None:
            os.close(self.index_writer)


_TEAM: _Team | None = None


def _join_team(team: _Team) -> None:
    global _TEAM  # noqa: PLW0603 - a process is in one team
    _TEAM = team
    os.environ[CORES_VARIABLE] = "1"


def _leave_team() -> None:
    """Go on alone, with all cores."""
    global _TEAM  # noqa: PLW0603 - as above
    if _TEAM is None:
        return
    _TEAM.close()
    del os.environ[CORES_VARIABLE]
    if _TEAM.cores_before is not None:
        os.environ[CORES_VARIABLE] = _TEAM.cores_before
    _TEAM = None
