"""A command in a process of its own, forked from one in which everything is imported and compiled already."""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.torture.commands import Done, Failure, run

# What changes a folder; each time is a moment to be killed at.
_STEPS = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate", "open"}
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
_HUNG = 600.0  # s on the clock, for who waits for a lock does no work; the machine may have other work


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a command ended; ``done`` None: it was killed."""

    done: Done | None
    seconds: float


class Apart:
    """`rovid` with ``arguments`` in ``folder``; ``first`` is done in the new process before it."""

    def __init__(self, arguments: Sequence[str], folder: Path, first: Callable[[], None] = lambda: None) -> None:
        self._since = time.perf_counter()
        self._answer, sending = os.pipe()
        self.process = os.fork()
        if not self.process:
            _child(arguments, folder, first, sending)
        os.close(sending)

    def kill(self) -> None:
        """Without warning."""
        os.kill(self.process, signal.SIGKILL)

    def ended(self) -> Ended:
        """Wait for it."""
        text, hung = b"", False
        while True:
            left = self._since + _HUNG - time.perf_counter()
            if not hung and not select.select([self._answer], [], [], max(left, 0.0))[0]:
                hung = True
                self.kill()
            part = os.read(self._answer, 1 << 16)
            if not part:
                break
            text += part
        os.close(self._answer)
        _, status = os.waitpid(self.process, 0)
        seconds = time.perf_counter() - self._since
        if hung or (not text and not os.WIFSIGNALED(status)):
            what = Failure(kind="hang" if hung else "crash", where=f"status {status}")
            return Ended(done=Done(code=1, out="", err="", failures=(what,)), seconds=seconds)
        if os.WIFSIGNALED(status):
            return Ended(done=None, seconds=seconds)
        document = json.loads(text)
        failures = tuple(Failure(**one) for one in document.pop("failures"))
        return Ended(done=Done(**document, failures=failures), seconds=seconds)


def _child(arguments: Sequence[str], folder: Path, first: Callable[[], None], sending: int) -> None:
    try:
        # What libraries print does not belong among the failures.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        first()
        with os.fdopen(sending, "w") as stream:
            json.dump(asdict(run(arguments, folder)), stream)
    except BaseException:  # noqa: BLE001 - no way leads back into the parent's code
        traceback.print_exc()
    finally:
        os._exit(0)


def steps_in(folder: Path, each: Callable[[], None]) -> Callable[[], None]:
    """Have ``each`` called just before anything in ``folder`` changes, by this process and not by its helpers."""
    own = os.fspath(folder.resolve()) + os.sep

    def watch() -> None:
        process = os.getpid()

        def hook(event: str, arguments: tuple[object, ...]) -> None:
            if event not in _STEPS or os.getpid() != process:
                return
            places = arguments[:2]
            if event == "open":
                path, _, flags = arguments
                places = (path,) if isinstance(flags, int) and flags & _WRITING else ()
            paths = [os.fspath(one) for one in places if isinstance(one, str | os.PathLike)]
            if any(os.path.join(own, path).startswith(own) for path in paths):  # noqa: PTH118 - at every event
                each()

        sys.addaudithook(hook)

    return watch
