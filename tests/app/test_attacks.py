"""Attacks on a running page: by other programs, by a report from elsewhere, and what is left after a signal."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import time
from pathlib import Path

import pytest

from rovid.app.access import MOST_CONNECTIONS
from tests.app.conftest import DAY, logs_into
from tests.app.served import Served, served
from tests.app.test_jobs import group
from tests.conftest import slow

_MANY = 300  # connections


def test_unfinished_requests_of_others_do_not_shut_the_user_out(server: Served) -> None:
    """Neither silence, nor half a head, nor a body without an end; and nothing is printed for them."""
    head = f"POST /no/api/draft HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n"
    beginnings = ("", "GET /", head, f"{head}Content-Length: 1000000\r\n\r\nhalf", f"{head}X: {'y' * 70_000}")
    with contextlib.ExitStack() as stack:
        for number in range(_MANY):
            attacker = stack.enter_context(socket.create_connection(("127.0.0.1", server.port), 10.0))
            with contextlib.suppress(ConnectionError):
                attacker.sendall(beginnings[number % len(beginnings)].encode())
        began = time.monotonic()
        assert server.get("api/start").status == 200
        assert time.monotonic() - began < 5.0  # s; a busy machine
        connected = Path(f"/proc/{server.process.pid}/fd")
        if connected.is_dir():
            open_now = [str(each.readlink()) for each in connected.iterdir() if each.is_symlink()]
            assert sum("socket" in each for each in open_now) < MOST_CONNECTIONS + 10
    # The user's own browser goes away in the midst of a request.
    with socket.create_connection(("127.0.0.1", server.port), 10.0) as browser:
        browser.sendall(head.replace("/no/", f"/{server.token}/").encode() + b"Content-Length: 9\r\n\r\n{")
    assert server.get("api/start").status == 200
    assert server.said.read_text() == ""


@pytest.fixture
def running(tmp_path: Path) -> tuple[Path, Path]:
    """A folder with logs and a rovid.toml, and one for temporary files."""
    logs_into(tmp_path / "top" / "day")
    shutil.copy(DAY / "rovid.toml", tmp_path / "top" / "day")
    (temporary := tmp_path / "temporary").mkdir()
    return tmp_path / "top", temporary


def job_of(server: Served) -> int:
    """Start a report, and return its process group."""
    server.post("run", {"logs": ["day"]})
    threads = Path(f"/proc/{server.process.pid}/task").glob("*/children")
    (child,) = (int(child) for thread in threads for child in thread.read_text().split())
    assert os.getpgid(child) == child
    return child


def is_over(number: int) -> bool:
    stop = time.monotonic() + 20.0
    while group(number):
        if time.monotonic() > stop:
            return False
        time.sleep(0.05)
    return True


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="processes are counted by /proc")
@pytest.mark.parametrize("name", ["SIGTERM", slow("SIGINT"), slow("SIGHUP")])
def test_a_signal_ends_the_report_and_removes_temporary_files(running: tuple[Path, Path], name: str) -> None:
    top, temporary = running
    with served(top, "day", temporary=temporary) as server:
        assert list(temporary.glob("rovid-open-*"))
        number = job_of(server)
        assert group(number)
        assert server.end(getattr(signal, name)) == 0
        assert is_over(number)
        assert server.said.read_text() == ""
    assert list(temporary.iterdir()) == []
    assert not (top / "day" / "report").exists()


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="processes are counted by /proc")
def test_the_next_start_clears_what_a_killed_page_left(running: tuple[Path, Path]) -> None:
    top, temporary = running
    with served(top, "day", temporary=temporary) as server:
        number = job_of(server)
        with socket.create_connection(("127.0.0.1", server.port), 10.0) as half:
            head = f"POST /{server.token}/api/upload?name=a.csv HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n"
            half.sendall(f"{head}Content-Length: 9\r\n\r\n1".encode())
            stop = time.monotonic() + 20.0
            while not list(top.glob("logs_*/.rovid-upload-*")):
                assert time.monotonic() < stop
                time.sleep(0.02)
            assert server.end(signal.SIGKILL) == -signal.SIGKILL
        assert is_over(number)
    (left,) = temporary.glob("rovid-open-*")
    # Another page that runs keeps its folder.
    with served(top, temporary=temporary) as first, served(top, temporary=temporary) as second:
        assert not left.exists()
        assert [path.name for path in top.iterdir()] == ["day"]
        assert len(list(temporary.glob("rovid-open-*"))) == 2
        assert (first.end(), second.end()) == (0, 0)
    assert list(temporary.iterdir()) == []
