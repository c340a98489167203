"""A command that runs beside the page: told step by step, and cancelled when asked."""

from __future__ import annotations

import contextlib
import json
import os
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

_PATIENCE = 5.0  # s, until what does not end is killed


@dataclass(kw_only=True)
class Job:
    """One run of ``rovid`` with ``arguments`` in ``folder``.

    Attributes
    ----------
    key
        By which its page is asked for.
    steps
        What it said that it does, each with the s after which it said so.
    """

    arguments: tuple[str, ...]
    folder: Path
    key: str = field(default_factory=lambda: secrets.token_hex(8))
    steps: list[tuple[float, str]] = field(default_factory=list)
    state: Literal["running", "done", "failed", "cancelled"] = "running"
    error: str = ""
    result: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Begin."""
        self._began = time.monotonic()
        self._ended = 0.0
        environment = {**os.environ, "ROVID_PROGRESS": "lines", "PYTHONIOENCODING": "utf-8"}
        # A log folder may hold a file that is called as a module.
        environment["PYTHONSAFEPATH"] = "1"
        # A group of its own: what it begins in turn ends with it, and a Ctrl-C is for us to pass on.
        own: dict[str, Any] = {"start_new_session": True} if os.name == "posix" else {}
        self.process = subprocess.Popen(  # noqa: S603 - our own program, and names of logs
            [sys.executable, "-m", "rovid", *self.arguments, "--json"],
            cwd=self.folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            **own,
        )
        self._watch = threading.Thread(target=self._follow, daemon=True)
        self._watch.start()

    @property
    def seconds(self) -> float:
        """How long it takes, or took."""
        return (self._ended or time.monotonic()) - self._began

    def cancel(self) -> None:
        """End it, with whatever it has begun."""
        if self.state == "running":
            self.state = "cancelled"
        self._signal(signal.SIGTERM)
        try:
            self.process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._signal(getattr(signal, "SIGKILL", signal.SIGTERM))
        else:
            # Its own workers may have outlived it.
            self._signal(getattr(signal, "SIGKILL", signal.SIGTERM))
        self.process.wait()
        self._watch.join(_PATIENCE)

    def document(self) -> dict[str, Any]:
        """How far it is."""
        return {
            "key": self.key,
            "state": self.state,
            "seconds": round(self.seconds, 1),
            "steps": [{"after": round(after, 1), "text": text} for after, text in self.steps],
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
        said: list[str] = []
        process = self.process
        if process.stdout is None or process.stderr is None:
            raise RuntimeError("no pipes")
        printed: list[str] = []
        reader = threading.Thread(target=_read, args=(process.stdout, printed), daemon=True)
        reader.start()
        for line in process.stderr:
            said.append(line.rstrip())
            if said[-1].endswith("…"):
                # Behind a colon stands what of it is at work.
                _, _, step = said[-1].rpartition("): ")
                self.steps.append((self.seconds, step))
        code = process.wait()
        reader.join()
        for stream in (process.stdout, process.stderr):
            stream.close()
        self._ended = time.monotonic()
        if self.state == "cancelled":
            return
        if code == 0:
            self.result = json.loads("".join(printed) or "{}")
            self.state = "done"
            return
        told = [line for line in said if line.startswith("rovid: ")]
        self.error = told[-1].removeprefix("rovid: ") if told else "\n".join([*said[-3:], f"It ended with {code}."])
        self.state = "failed"


def _read(stream: IO[str], into: list[str]) -> None:
    into.append(stream.read())


@dataclass(kw_only=True)
class JobQueue:
    """The runs of one page, one at a time."""

    current: Job | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def start(self, arguments: Sequence[str], folder: Path) -> Job:
        """Begin one; what still runs is cancelled."""
        with self._lock:
            self.close()
            self.current = Job(arguments=tuple(arguments), folder=folder)
            return self.current

    def close(self) -> None:
        """End what runs."""
        if self.current is not None and self.current.state == "running":
            self.current.cancel()
