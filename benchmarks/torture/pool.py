"""Workers that may die, and what is done with what they were at: it counts, and the next input goes to a new one."""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import queue
import resource
import shutil
import signal
import tempfile
import threading
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TextIO

from benchmarks.torture.commands import CUT, MEMORY, Failure, Input, Place, Result, located, peak, resident

# s of work that an input may take, and how much longer on the clock: others may be at work on the machine.
LONGEST, _WAITED = 10.0, 3.0
# A process ends when it has grown by this: what is leaked slowly is no failure of the input that comes last.
_GROWN = 150_000_000
# Far beyond what is a failure: the machine has other work.
_ROOM = 4_000_000_000
_LARGEST_FILE = 200_000_000
_NICE = 10
_STACK, _PRINTED = "stack", "printed"
# Work in memory: a disk would be most of the time.
_MEMORY_DISK = Path("/dev/shm")  # noqa: S108 - the folders in it are made by tempfile
# Started from a process that has imported everything already, and no threads yet.
_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(["benchmarks.torture.commands"])


@dataclass(frozen=True, kw_only=True)
class Batch:
    """Inputs of one format and command: cuts of ``numbers`` bytes, or the mutations of these numbers."""

    format: str
    command: str
    cut: bool
    numbers: range

    def __str__(self) -> str:
        ends = f"{self.numbers.start}-{self.numbers.stop}-{self.numbers.step}"
        return f"{self.format}:{self.command}:{CUT if self.cut else ''}{ends}"

    def inputs(self) -> list[Input]:
        """One by one."""
        mark = CUT if self.cut else ""
        return [Input(format=self.format, command=self.command, number=f"{mark}{number}") for number in self.numbers]


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A batch and what came of its inputs."""

    batch: Batch
    results: Sequence[Result]
    seconds: float


class BrokenError(Exception):
    """The torture itself does not work."""


def tried(
    batches: Sequence[Batch], *, seed: int, jobs: int, longest: float = LONGEST, kind: type[Place] = Place
) -> Iterator[Tried]:
    """Every batch, in the order in which they are done.

    Parameters
    ----------
    longest
        s that an input may take.
    kind
        What tries it.
    """
    todo: queue.SimpleQueue[Batch] = queue.SimpleQueue()
    for batch in batches:
        todo.put(batch)
    done: queue.SimpleQueue[Tried | Exception] = queue.SimpleQueue()
    with tempfile.TemporaryDirectory(dir=_MEMORY_DISK if _MEMORY_DISK.is_dir() else None, prefix="torture-") as root:
        for number in range(jobs):
            work = Path(root) / str(number)
            threading.Thread(target=_served, args=(todo, done, _Keeper(work, seed, longest, kind)), daemon=True).start()
        for _ in batches:
            one = done.get()
            if isinstance(one, Exception):
                raise one
            yield one


def _served(todo: queue.SimpleQueue[Batch], done: queue.SimpleQueue[Tried | Exception], keeper: _Keeper) -> None:
    try:
        while True:
            batch = todo.get_nowait()
            begun = time.perf_counter()
            results = keeper.results(batch.inputs())
            done.put(Tried(batch=batch, results=results, seconds=time.perf_counter() - begun))
    except queue.Empty:
        keeper.end()
    except Exception as error:  # noqa: BLE001 - the main thread raises it
        done.put(error)


class _Keeper:
    """Keep one worker, and replace a dead worker."""

    def __init__(self, root: Path, seed: int, longest: float, kind: type[Place]) -> None:
        self.root, self.seed, self.longest, self.kind = root, seed, longest, kind
        self._worker: tuple[multiprocessing.process.BaseProcess, Connection] | None = None

    def results(self, inputs: Sequence[Input]) -> list[Result]:
        """One result for each input, even if an input ends the worker."""
        found: list[Result] = []
        while len(found) < len(inputs):
            process, connection = self._worker = self._worker or self._started()
            try:
                connection.send(inputs[len(found) :])
                while len(found) < len(inputs):
                    answer: Result | str | None = connection.recv()
                    if answer is None:  # it has grown, and goes
                        self.end()
                        break
                    if isinstance(answer, str):
                        raise BrokenError(answer)
                    found.append(answer)
            except (EOFError, ConnectionError):
                process.join()
                found.append(self._post_mortem(process.exitcode))
                self.end()
        return found

    def _started(self) -> tuple[multiprocessing.process.BaseProcess, Connection]:
        shutil.rmtree(self.root, ignore_errors=True)
        self.root.mkdir()
        here, there = _CONTEXT.Pipe()
        process = _CONTEXT.Process(
            target=_work, args=(there, self.root, self.seed, self.longest, self.kind), daemon=True
        )
        process.start()
        there.close()
        return process, here

    def end(self) -> None:
        """Let the worker go."""
        if self._worker is not None:
            process, connection = self._worker
            connection.close()
            process.join()
            self._worker = None

    def _post_mortem(self, code: int | None) -> Result:
        """What a worker was at when it died."""
        stack = (self.root / _STACK).read_text(errors="replace")
        hung = "Timeout (" in stack or code == -signal.SIGPROF
        kind = "hang" if hung else "crash"
        named = signal.Signals(-code).name if code is not None and code < 0 else f"exit {code}"
        where = located(stack) or ("" if hung else named)
        text = f"more than {self.longest:g} s" if hung else named
        return Result(
            code=1, seconds=self.longest if hung else 0.0, failures=(Failure(kind=kind, where=where, text=text),)
        )


# In the worker


def _work(connection: Connection, root: Path, seed: int, longest: float, kind: type[Place]) -> None:
    """Try what is sent, one by one, until there is no more or too much memory is in use."""
    os.nice(_NICE)
    with (root / _STACK).open("w") as stack, (root / _PRINTED).open("w") as printed:
        # What a library prints by itself goes where it is seen.
        os.dup2(printed.fileno(), 1)
        os.dup2(printed.fileno(), 2)
        faulthandler.enable(stack)
        # Says where it is, and ends as without it.
        faulthandler.register(signal.SIGPROF, file=stack, chain=True)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (_LARGEST_FILE, _LARGEST_FILE))
        try:
            _serve(connection, kind(root / "work"), seed, longest, stack)
        except EOFError:  # nothing more to do
            pass
        except Exception:  # noqa: BLE001 - it is raised where the worker was started
            connection.send(traceback.format_exc())


def _serve(connection: Connection, place: Place, seed: int, longest: float, stack: TextIO) -> None:
    whole: set[tuple[str, str]] = set()
    while True:
        inputs: Sequence[Input] = connection.recv()
        for one in inputs:
            if (one.format, one.command) not in whole:
                place.whole(one.format, one.command)
                whole.add((one.format, one.command))
                base = _bounded()
        for one in inputs:
            # A high peak would hide those of the inputs to come.
            if resident() > base + _GROWN or peak() > base + MEMORY:
                connection.send(None)
                return
            signal.setitimer(signal.ITIMER_PROF, longest)
            faulthandler.dump_traceback_later(_WAITED * longest, exit=True, file=stack)
            result = place.tried(one, seed)
            faulthandler.cancel_dump_traceback_later()
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            connection.send(result)


def _bounded() -> int:
    """The memory that is in use, beyond which little more is given from now on."""
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + _ROOM, resource.RLIM_INFINITY))
    return resident()
