"""A second Python process that does some of the work, and says when each part of it is done."""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
import threading
from collections.abc import Iterable


class BackgroundCompiler:
    """Runs ``code``, with what it imports from where this process has it; it ends no later than this one.

    The ``code`` hands `say` the names of the parts, which are ``parts``.
    """

    def __init__(self, code: str, parts: Iterable[str]) -> None:
        self._done = {part: threading.Event() for part in parts}
        self._process = subprocess.Popen(  # noqa: S603 - Python itself
            [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; {code}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        atexit.register(self.stop)

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    def _listen(self) -> None:
        with self._process as process:
            for line in process.stdout or ():
                if (part := line.strip()) in self._done:
                    self._done[part].set()
        # Nothing more is to be waited for, done or not.
        for done in self._done.values():
            done.set()

    def has_done(self, part: str) -> bool:
        """Whether nothing is to be waited for, or no more."""
        return part not in self._done or self._done[part].is_set()

    def wait_for(self, part: str, patience: float) -> None:
        """Until it is done, or never will be; for as many seconds of ``patience`` at most."""
        if not self.has_done(part):
            self._done[part].wait(patience)

    def stop(self) -> None:
        """End it, whatever it is at."""
        self._process.kill()
        self._listener.join()


def report_done(parts: Iterable[str]) -> None:
    """In the second process: say of each of ``parts`` that it is done, and end when the first process does."""
    threading.Thread(target=_end_with_the_first, daemon=True).start()
    for part in parts:
        sys.stdout.write(f"{part}\n")
        sys.stdout.flush()


def _end_with_the_first() -> None:
    # Nothing is ever written there.
    sys.stdin.read()
    os._exit(1)
