"""Forked workers that share a map, and calls in a forked copy."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from rovid.core import spmd as module
from rovid.core.array_types import FloatArray
from rovid.core.spmd import ForkedCall, forked_workers, parallel_map
from rovid.core.threads import CORES_VARIABLE, core_count

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="rovid forks on Linux only")


@pytest.fixture(autouse=True)
def three_cores(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Three cores on any machine. No child process is left after a test."""
    monkeypatch.setattr(module, "core_count", lambda: 3)
    before = _children()
    yield
    assert _children() == before


def test_results_come_in_order_from_several_processes() -> None:
    with forked_workers():
        result = parallel_map(lambda number: (number**2, _slowly(os.getpid())), range(30))
    assert [square for square, _ in result] == [number**2 for number in range(30)]
    assert len({process for _, process in result}) == 3


def test_all_processes_have_the_same_state_after_a_map() -> None:
    with forked_workers():
        total = np.zeros(3)
        for turn in range(20):
            total = total + sum(parallel_map(partial(_three, turn), range(7)))
    assert total.tolist() == [21.0 * sum(range(20))] * 3


def test_a_map_inside_a_map_is_not_shared() -> None:
    with forked_workers():
        result = parallel_map(lambda _: parallel_map(lambda __: _slowly(os.getpid()), range(4)), range(6))
    assert all(len(set(processes)) == 1 for processes in result)


def test_without_threads_and_workers_items_are_done_one_after_the_other() -> None:
    result = parallel_map(lambda _: (_slowly(os.getpid()), threading.get_ident()), range(6), use_threads=False)
    assert set(result) == {(os.getpid(), threading.get_ident())}
    with forked_workers():
        assert len(set(parallel_map(lambda _: _slowly(os.getpid()), range(30), use_threads=False))) == 3


def test_only_the_original_process_goes_on_after_the_block(tmp_path: Path) -> None:
    with forked_workers() as is_first:
        (tmp_path / f"{os.getpid()} {is_first}").touch()
        parallel_map(_slowly, range(9))
    (tmp_path / f"after {os.getpid()}").touch()
    names = sorted(path.name.split()[1] for path in tmp_path.iterdir() if not path.name.startswith("after"))
    assert names == ["False", "False", "True"]
    assert [path.name for path in tmp_path.glob("after*")] == [f"after {os.getpid()}"]


def test_each_process_has_one_core_inside_the_block(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CORES_VARIABLE, "3")
    with forked_workers():
        assert core_count() == 1
    assert os.environ[CORES_VARIABLE] == "3"


def test_items_of_a_killed_worker_are_done_by_the_original_process() -> None:
    first = os.getpid()

    def deadly(number: int) -> int:
        if os.getpid() != first and number > 5:
            os.kill(os.getpid(), signal.SIGKILL)
        return _slowly(number)

    before = os.environ.get(CORES_VARIABLE)
    with forked_workers():
        assert parallel_map(deadly, range(20)) == list(range(20))
        # Alone from here on, with all cores.
        assert os.environ.get(CORES_VARIABLE) == before
        assert {process for _, process in enumerate(parallel_map(lambda _: os.getpid(), range(9)))} == {first}


def test_without_room_for_workers_the_block_runs_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_room() -> int:
        raise BlockingIOError

    monkeypatch.setattr(os, "fork", no_room)
    before = os.environ.get(CORES_VARIABLE)
    with forked_workers() as is_first:
        assert is_first
        assert os.environ.get(CORES_VARIABLE) == before
        assert parallel_map(abs, [-1, 2, -3]) == [1, 2, 3]


def test_an_error_in_a_map_is_raised() -> None:
    def failing(number: int) -> int:
        return 1 // _slowly(number)

    before = os.environ.get(CORES_VARIABLE)
    with pytest.raises(ZeroDivisionError), forked_workers():
        parallel_map(failing, [3, 2, 1, 0, 1, 2, 3, 4, 5])
    assert os.environ.get(CORES_VARIABLE) == before


def test_the_block_goes_on_after_an_error_is_caught() -> None:
    result = []
    with forked_workers():
        try:
            parallel_map(lambda number: 1 // _slowly(number), range(-4, 5))
        except ZeroDivisionError:
            result = parallel_map(abs, [-1, 2])
    assert result == [1, 2]


def test_workers_end_with_a_killed_process(tmp_path: Path) -> None:
    code = (
        "import os, time\n"
        "from rovid.core import spmd as m\n"
        "m.core_count = lambda: 2\n"
        "with m.forked_workers() as first:\n"
        f"    open({str(tmp_path)!r} + '/' + str(os.getpid()), 'w').close()\n"
        "    while True:\n"
        "        m.parallel_map(lambda _: time.sleep(0.01), range(4))\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code])
    try:
        assert _soon(lambda: len(list(tmp_path.iterdir())) == 2)
    finally:
        process.kill()
        process.wait()
    workers = [int(path.name) for path in tmp_path.iterdir() if int(path.name) != process.pid]
    assert _soon(lambda: not any(map(_runs, workers)))


def test_no_workers_outside_the_main_thread_or_without_a_core(monkeypatch: pytest.MonkeyPatch) -> None:
    before, found = _children(), list[list[str]]()

    def ask() -> None:
        with forked_workers():
            found.append(_children())

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    monkeypatch.setattr(module, "core_count", lambda: 1)
    ask()
    assert found == [before, before]


def test_a_result_of_any_size_comes_from_another_process() -> None:
    with ForkedCall(lambda: (os.getpid(), np.arange(1e6))) as ahead:
        result = ahead.result()
    assert result is not None
    process, numbers = result
    assert process != os.getpid()
    assert numbers[-1] == 999_999.0


def fails() -> None:
    raise RuntimeError


def is_killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def leaves() -> None:
    sys.exit(2)


def cannot_be_pickled() -> object:
    return lambda: None


@pytest.mark.parametrize("function", [fails, is_killed, leaves, cannot_be_pickled])
def test_a_call_that_fails_has_no_result(function: Callable[[], object], capfd: pytest.CaptureFixture[str]) -> None:
    with ForkedCall(function) as ahead:
        assert ahead.result() is None
    assert capfd.readouterr() == ("", "")


def test_a_stopped_call_ends_and_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    def long() -> None:
        os.write(1, b"said")
        time.sleep(60.0)

    begun, before = time.monotonic(), _children()
    with ForkedCall(long) as ahead:
        assert len(_children()) == len(before) + 1
    assert ahead.result() is None
    ahead.stop()
    assert time.monotonic() - begun < 30.0
    assert capfd.readouterr() == ("", "")


def test_no_call_without_a_free_core_without_room_or_outside_the_main_thread(monkeypatch: pytest.MonkeyPatch) -> None:
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
    monkeypatch.setattr(module, "core_count", lambda: 1)
    ask()
    assert found == [None, None, None]


def _three(turn: int, number: int) -> FloatArray:
    return np.full(3, 1.0 * number * turn)


def _slowly(number: int) -> int:
    """``number``, after a delay that lets other processes take items."""
    time.sleep(0.005)
    return number


def _children() -> list[str]:
    return Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split()


def _runs(process: int) -> bool:
    status = Path(f"/proc/{process}/stat")
    return status.exists() and status.read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"


def _soon(condition: object) -> bool:
    until = time.monotonic() + 20.0
    while time.monotonic() < until:
        if condition():  # type: ignore[operator]  # a function of nothing
            return True
        time.sleep(0.02)
    return False
