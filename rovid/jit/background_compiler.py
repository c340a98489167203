"""A second Python process that compiles, and reports each function that is finished."""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
import threading
from collections.abc import Iterable


class BackgroundCompiler:
    """Runs ``code`` in a second process with the import paths of this one, and ends it with this one.

    Parameters
    ----------
    code
        Python code that passes the names of finished parts to `report_done`.
    parts
        Names of all parts.
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
        """Number of the second process."""
        return self._process.pid

    def _listen(self) -> None:
        with self._process as process:
            for line in process.stdout or ():
                if (part := line.strip()) in self._done:
                    self._done[part].set()
        # The process has ended: there is nothing more to wait for.
        for done in self._done.values():
            done.set()

    def is_done(self, part: str) -> bool:
        """Whether a part is finished, is not among the parts, or will never be finished."""
        return part not in self._done or self._done[part].is_set()

    def wait_for(self, part: str, timeout: float) -> None:
        """Wait until `is_done`, for ``timeout`` in s at most."""
        if not self.is_done(part):
            self._done[part].wait(timeout)

    def stop(self) -> None:
        """End the second process."""
        self._process.kill()
        self._listener.join()


def report_done(parts: Iterable[str]) -> None:
    """In the second process: report each of ``parts`` as finished, and end when the first process ends."""
    threading.Thread(target=_end_with_first_process, daemon=True).start()
    for part in parts:
        sys.stdout.write(f"{part}\n")
        sys.stdout.flush()


def _end_with_first_process() -> None:
    # The first process never writes: the read returns when that process has ended.
    sys.stdin.read()
    os._exit(1)
