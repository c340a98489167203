"""Headless Chromium driven over a pipe by the DevTools protocol: no package, no port, no network."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import select
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_PATIENCE = 60.0  # s; a page of 8 MB on a busy machine


def find_chromium() -> str | None:
    """Where it is; None where there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Tab:
    """One page: what it said on its console, what it asked of the network, and its own answers."""

    def __init__(self, reader: int, writer: int) -> None:
        self._reader, self._writer = reader, writer
        self._bytes, self._count, self._session = b"", 0, ""
        self.complaints: list[str] = []
        self.requests: list[str] = []

    def attach(self) -> None:
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its result."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._writer, json.dumps(message).encode() + b"\0")
        while (answer := self._next()).get("id") != self._count:
            pass
        assert "error" not in answer, answer
        result: dict[str, Any] = answer["result"]
        return result

    def open(self, page: Path) -> None:
        self.call("Page.navigate", url=page.resolve().as_uri())
        self.until("document.readyState === 'complete'")

    def ask(self, expression: str) -> Any:
        """The value of a JavaScript expression."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, condition: str) -> None:
        stop = time.monotonic() + _PATIENCE
        while not self.ask(condition):
            assert time.monotonic() < stop, condition
            time.sleep(0.02)

    def key(self, key: str, *, shift: bool = False) -> None:
        # Chromium wants the old key codes for what a select element does by itself.
        code = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40}.get(key, 0)
        text = {"text": key} if len(key) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            typed = text if kind == "keyDown" else {}
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, modifiers=8 * shift, **typed
            )

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, start: tuple[float, float], stop: tuple[float, float], *, shift: bool = False) -> None:
        pressed: dict[str, Any] = {"button": "left", "buttons": 1, "modifiers": 8 * shift}
        self.mouse("mouseMoved", *start)
        self.mouse("mousePressed", *start, clickCount=1, **pressed)
        for part in (0.25, 0.5, 0.75, 1.0):
            x, y = (a + part * (b - a) for a, b in zip(start, stop, strict=True))
            self.mouse("mouseMoved", x, y, **pressed)
        self.mouse("mouseReleased", *stop, clickCount=1, **pressed)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._bytes:
            assert select.select([self._reader], [], [], _PATIENCE)[0], "Chromium does not answer"
            part = os.read(self._reader, 1 << 20)
            assert part, "Chromium has ended"
            self._bytes += part
        text, _, self._bytes = self._bytes.partition(b"\0")
        message: dict[str, Any] = json.loads(text)
        self._listen(message.get("method", ""), message.get("params", {}))
        return message

    def _listen(self, method: str, event: dict[str, Any]) -> None:
        if method in {"Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded"}:
            self.complaints.append(json.dumps(event))
        if method == "Network.requestWillBeSent":
            self.requests.append(event["request"]["url"])


@contextlib.contextmanager
def chromium(profile: Path, *arguments: str) -> Iterator[Tab]:
    """A tab of a fresh Chromium with an empty profile."""
    program = find_chromium()
    assert program is not None
    command_in, writer = os.pipe()
    reader, command_out = os.pipe()
    # Chromium reads commands from descriptor 3 and answers on 4; numbers from 10 on cannot be either of them.
    ours = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (command_in, writer, reader, command_out)]
    for end in (command_in, writer, reader, command_out):
        os.close(end)
    command_in, writer, reader, command_out = ours
    flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", f"--user-data-dir={profile}"]
    process = os.posix_spawn(
        program,
        [program, *flags, *arguments],
        os.environ,
        file_actions=[
            (os.POSIX_SPAWN_DUP2, command_in, 3),
            (os.POSIX_SPAWN_DUP2, command_out, 4),
            (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0),
            (os.POSIX_SPAWN_OPEN, 2, os.devnull, os.O_WRONLY, 0),
        ],
        setpgroup=0,
    )
    os.close(command_in)
    os.close(command_out)
    try:
        tab = Tab(reader, writer)
        tab.attach()
        yield tab
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process, signal.SIGKILL)
        os.waitpid(process, 0)
        os.close(reader)
        os.close(writer)
