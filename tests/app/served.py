"""`rovid open` in a process of its own, and requests by another program of this machine."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

ROOT = Path(__file__).parents[2]
_PATIENCE = 60.0  # s; a busy machine


@dataclass(frozen=True)
class Answer:
    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def document(self) -> Any:
        assert self.status == 200, self.body
        return json.loads(self.body)

    @property
    def error(self) -> str:
        assert self.status == 400, self.body
        return str(json.loads(self.body)["error"])


@dataclass
class Served:
    process: subprocess.Popen[str]
    address: str
    said: Path

    @property
    def port(self) -> int:
        return urlsplit(self.address).port or 0

    @property
    def token(self) -> str:
        return urlsplit(self.address).path.strip("/")

    def ask(
        self, target: str, method: str = "GET", headers: Mapping[str, str] | None = None, body: bytes | None = None
    ) -> Answer:
        """Request ``target`` unchanged, from its first slash on."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=_PATIENCE)
        with contextlib.closing(connection):
            connection.request(method, target, body=body, headers=dict(headers or {}))
            answer = connection.getresponse()
            return Answer(answer.status, dict(answer.getheaders()), answer.read())

    def get(self, path: str, *pairs: tuple[str, str]) -> Answer:
        return self.ask(f"/{self.token}/{path}{'?' * bool(pairs)}{urlencode(pairs)}")

    def post(self, path: str, document: object) -> Answer:
        headers = {"Content-Type": "application/json", "Origin": f"http://127.0.0.1:{self.port}"}
        return self.ask(f"/{self.token}/api/{path}", "POST", headers, json.dumps(document).encode())

    def upload(self, name: str, data: bytes, folder: str = "") -> Answer:
        asked = urlencode({"name": name, "folder": folder})
        return self.ask(f"/{self.token}/api/upload?{asked}", "POST", {}, data)

    def until(self, *states: str) -> Any:
        """The job's document once its state is one of ``states``."""
        stop = time.monotonic() + 4 * _PATIENCE
        while (now := self.get("api/progress").document)["state"] not in states:
            assert time.monotonic() < stop, now
            time.sleep(0.1)
        return now

    def end(self, number: int = signal.SIGINT) -> int:
        """End the process by a signal, as Ctrl-C does, and return its status."""
        self.process.send_signal(number)
        return self.process.wait(_PATIENCE)


@contextlib.contextmanager
def served(top: Path, *logs: str, temporary: Path | None = None) -> Iterator[Served]:
    """The server, started in the folder ``top``, with the folder ``temporary`` for temporary files."""
    settings = {} if temporary is None else {"TMPDIR": str(temporary)}
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    said = top.parent / f"{top.name}-said.txt"
    with (
        said.open("w") as stderr,
        subprocess.Popen(
            [sys.executable, "-m", "rovid", "open", *logs, "--no-browser", "--json"],
            cwd=top,
            env={**os.environ, "PYTHONPATH": path, **settings},
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
        ) as process,
    ):
        try:
            assert process.stdout is not None
            text = ""
            while not text.endswith("}\n"):
                line = process.stdout.readline()
                assert line, said.read_text()
                text += line
            yield Served(process, json.loads(text)["address"], said)
        finally:
            process.kill()
