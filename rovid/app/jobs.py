"""A rovid command that runs next to the page and ends with it: its progress, its result and its cancellation."""

import contextlib
import json
import os
import re
import runpy
import secrets
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Literal

# Time in s between SIGTERM and SIGKILL.
PATIENCE = 5.0


def _end_with_the_page() -> None:
    """Wait for the end of standard input, then end this process and its copies."""
    while os.read(0, 1):
        pass
    if sys.platform == "win32":
        os.kill(os.getpid(), signal.SIGTERM)
    else:
        os.killpg(0, signal.SIGTERM)
        time.sleep(PATIENCE)
        os.killpg(0, signal.SIGKILL)


@dataclass(kw_only=True)
class Job:
    """One run of ``rovid`` with ``arguments`` in ``folder``."""

    arguments: tuple[str, ...]
    folder: Path
    key: str = field(default_factory=lambda: secrets.token_hex(8))  # Random identifier
    # Progress messages, each with its time in s since the start
    steps: list[tuple[float, str]] = field(default_factory=list)
    state: Literal["running", "done", "failed", "cancelled"] = "running"
    error: str = ""
    result: dict[str, Any] = field(default_factory=dict)  # The JSON document that the command printed

    def __post_init__(self) -> None:
        """Start the process."""
        self._began = time.monotonic()
        self._ended = 0.0
        # PYTHONSAFEPATH: a folder of logs may hold a file with the name of a module.
        settings = {"ROVID_PROGRESS": "lines", "PYTHONIOENCODING": "utf-8", "PYTHONSAFEPATH": "1"}
        self.process = subprocess.Popen(  # noqa: S603 - our own program, and names of logs
            [sys.executable, "-m", "rovid.app.jobs", *self.arguments, "--json"],
            cwd=self.folder,
            env={**os.environ, **settings},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            # A process group of its own, so that cancelling also ends the child processes, and Ctrl-C does not.
            start_new_session=os.name == "posix",
        )
        self._follower = threading.Thread(target=self._follow, daemon=True)
        self._follower.start()

    @property
    def seconds(self) -> float:
        """Run time in s."""
        return (self._ended or time.monotonic()) - self._began

    def cancel(self) -> None:
        """End the process and its child processes."""
        if self.state == "running":
            self.state = "cancelled"
        self._signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(PATIENCE)
        # Also after a regular end, because child processes may still run.
        self._signal(getattr(signal, "SIGKILL", signal.SIGTERM))
        self.process.wait()
        self._follower.join(PATIENCE)

    def document(self) -> dict[str, Any]:
        """Progress and result for the page."""
        return {
            "key": self.key,
            "state": self.state,
            "seconds": round(self.seconds, 1),
            "steps": [{"after": round(after, 1), "text": text} for after, text in self.steps],
            **counted(self.steps[-1][1] if self.steps else ""),
            "error": self.error,
            "warnings": self.result.get("warnings", []),
            "page": self.result.get("page"),
        }

    def _signal(self, number: int) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if os.name == "posix":
                os.killpg(self.process.pid, number)
            else:
                self.process.terminate()

    def _follow(self) -> None:
        process = self.process
        if process.stdin is None or process.stdout is None or process.stderr is None:
            raise RuntimeError("no pipes")
        printed: list[str] = []
        reader = threading.Thread(target=_read, args=(process.stdout, printed), daemon=True)
        reader.start()
        lines: list[str] = []
        for line in process.stderr:
            lines.append(line.rstrip())
            if lines[-1].endswith("…"):
                # The text after the colon is the current step.
                add_step(self.steps, self.seconds, lines[-1].rpartition("): ")[2])
        code = process.wait()
        reader.join()
        for stream in (process.stdin, process.stdout, process.stderr):
            stream.close()
        self._ended = time.monotonic()
        if self.state == "cancelled":
            return
        if code == 0:
            self.result = json.loads("".join(printed) or "{}")
            self.state = "done"
            return
        messages = [line.removeprefix("rovid: ") for line in lines if line.startswith("rovid: ")]
        self.error = messages[-1] if messages else "\n".join([*lines[-3:], f"The run ended with status {code}."])
        self.state = "failed"


# "Model with no effect: cause 3 of 9, about 5 s …"
_COUNT = re.compile(r"(?P<step>.*): \S+ (?P<done>\d+) of (?P<total>\d+), about .*")


def add_step(steps: list[tuple[float, str]], after: float, text: str) -> None:
    """Add a step that began ``after`` s, or change the text of the last one where that counts on: "cause 3 of 12"."""
    count = _COUNT.fullmatch(text)
    if count and steps and steps[-1][1].startswith((f"{count['step']}: ", f"{count['step']} …")):
        after, _ = steps.pop()
    steps.append((after, text))


def counted(text: str) -> dict[str, int]:
    """Number of done items of a step, and of all, where the ``text`` has them."""
    count = _COUNT.fullmatch(text)
    return {} if count is None else {"done": int(count["done"]) - 1, "total": int(count["total"])}


def _read(stream: IO[str], into: list[str]) -> None:
    into.append(stream.read())


@dataclass(kw_only=True)
class JobQueue:
    """The jobs of one page, one at a time."""

    current: Job | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def start(self, arguments: Sequence[str], folder: Path) -> Job:
        """Cancel the running job and start a new one."""
        with self._lock:
            self.close()
            self.current = Job(arguments=tuple(arguments), folder=folder)
            return self.current

    def close(self) -> None:
        """Cancel the running job."""
        if self.current is not None and self.current.state == "running":
            self.current.cancel()


if __name__ == "__main__":
    threading.Thread(target=_end_with_the_page, daemon=True).start()
    runpy.run_module("rovid", run_name="__main__", alter_sys=True)
