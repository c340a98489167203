"""What a copy of a process works out ahead."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from rovid.core import fork as module
from rovid.core.fork import ForkedCall

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="there are copies on Linux alone")


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Whatever the machine has; and no copy is left."""
    monkeypatch.setattr(module, "cores", lambda: 2)
    before = children()
    yield
    assert children() == before


def children() -> list[str]:
    return Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split()


def test_it_is_told_from_another_process_however_long_it_is() -> None:
    with ForkedCall(lambda: (os.getpid(), np.arange(1e6))) as ahead:
        told = ahead.result()
    assert told is not None
    process, numbers = told
    assert process != os.getpid()
    assert numbers[-1] == 999_999.0


def fails() -> None:
    raise RuntimeError


def is_killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def leaves() -> None:
    sys.exit(2)


def cannot_be_told() -> object:
    return lambda: None


@pytest.mark.parametrize("function", [fails, is_killed, leaves, cannot_be_told])
def test_of_one_that_fails_nothing_is_told(function: Callable[[], object], capfd: pytest.CaptureFixture[str]) -> None:
    with ForkedCall(function) as ahead:
        assert ahead.result() is None
    assert capfd.readouterr() == ("", "")


def test_it_ends_with_who_asks_and_says_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    def long() -> None:
        os.write(1, b"said")
        time.sleep(60.0)

    begun, before = time.monotonic(), children()
    with ForkedCall(long) as ahead:
        assert len(children()) == len(before) + 1
    assert ahead.result() is None
    ahead.stop()
    assert time.monotonic() - begun < 30.0
    assert capfd.readouterr() == ("", "")


def test_without_a_free_core_or_room_or_beside_the_main_thread_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[object] = []

    def ask() -> None:
        with ForkedCall(lambda: 1) as ahead:
            found.append(ahead.result())

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()

    def no_room() -> int:
        raise BlockingIOError

    with monkeypatch.context() as patched:
        patched.setattr(os, "fork", no_room)
        ask()
    monkeypatch.setattr(module, "cores", lambda: 1)
    ask()
    assert found == [None, None, None]
