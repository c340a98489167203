"""Copies of a process that go in step with it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from rovid.core import fork
from rovid.core import spmd as module
from rovid.core.array_types import FloatArray
from rovid.core.spmd import forked_workers, parallel_map
from rovid.core.threads import CORES_VARIABLE, core_count

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="there are copies on Linux alone")


@pytest.fixture(autouse=True)
def three_cores(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Whatever the machine has; and no copy is left."""
    for each in (module, fork):
        monkeypatch.setattr(each, "cores", lambda: 3)
    before = _children()
    yield
    assert _children() == before


def test_all_results_come_in_order_from_several_processes() -> None:
    with forked_workers():
        told = parallel_map(lambda number: (number**2, _slowly(os.getpid())), range(30))
    assert [square for square, _ in told] == [number**2 for number in range(30)]
    assert len({process for _, process in told}) == 3


def test_what_follows_is_the_same_in_all_and_may_be_shared_again() -> None:
    with forked_workers():
        total = np.zeros(3)
        for turn in range(20):
            total = total + sum(parallel_map(partial(_three, turn), range(7)))
    assert total.tolist() == [21.0 * sum(range(20))] * 3


def test_shared_within_shared_stays_where_it_is() -> None:
    with forked_workers():
        told = parallel_map(lambda _: parallel_map(lambda __: _slowly(os.getpid()), range(4)), range(6))
    assert all(len(set(processes)) == 1 for processes in told)


def test_what_threads_cannot_do_is_done_one_after_the_other() -> None:
    told = parallel_map(lambda _: (_slowly(os.getpid()), threading.get_ident()), range(6), among_threads=False)
    assert set(told) == {(os.getpid(), threading.get_ident())}
    with forked_workers():
        assert len(set(parallel_map(lambda _: _slowly(os.getpid()), range(30), among_threads=False))) == 3


def test_only_the_first_process_goes_on(tmp_path: Path) -> None:
    with forked_workers() as is_first:
        (tmp_path / f"{os.getpid()} {is_first}").touch()
        parallel_map(_slowly, range(9))
    (tmp_path / f"after {os.getpid()}").touch()
    names = sorted(path.name.split()[1] for path in tmp_path.iterdir() if not path.name.startswith("after"))
    assert names == ["False", "False", "True"]
    assert [path.name for path in tmp_path.glob("after*")] == [f"after {os.getpid()}"]


def test_cores_are_its_own_inside_and_all_of_them_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CORES_VARIABLE, "3")
    with forked_workers():
        assert core_count() == 1
    assert os.environ[CORES_VARIABLE] == "3"


def test_what_a_killed_copy_had_taken_is_done_here() -> None:
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


def test_where_there_is_no_room_for_copies_it_goes_on_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_room() -> int:
        raise BlockingIOError

    monkeypatch.setattr(os, "fork", no_room)
    before = os.environ.get(CORES_VARIABLE)
    with forked_workers() as is_first:
        assert is_first
        assert os.environ.get(CORES_VARIABLE) == before
        assert parallel_map(abs, [-1, 2, -3]) == [1, 2, 3]


def test_an_error_ends_it_as_it_would_without_copies() -> None:
    def failing(number: int) -> int:
        return 1 // _slowly(number)

    before = os.environ.get(CORES_VARIABLE)
    with pytest.raises(ZeroDivisionError), forked_workers():
        parallel_map(failing, [3, 2, 1, 0, 1, 2, 3, 4, 5])
    assert os.environ.get(CORES_VARIABLE) == before


def test_an_error_that_is_mended_leaves_it_going() -> None:
    told = []
    with forked_workers():
        try:
            parallel_map(lambda number: 1 // _slowly(number), range(-4, 5))
        except ZeroDivisionError:
            told = parallel_map(abs, [-1, 2])
    assert told == [1, 2]


def test_copies_end_with_a_process_that_is_killed(tmp_path: Path) -> None:
    code = (
        "import os, time\n"
        "from rovid.core import fork, spmd as m\n"
        "fork.cores = m.cores = lambda: 2\n"
        "with m.in_step() as first:\n"
        f"    open({str(tmp_path)!r} + '/' + str(os.getpid()), 'w').close()\n"
        "    while True:\n"
        "        m.shared(lambda _: time.sleep(0.01), range(4))\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code])
    try:
        assert _soon(lambda: len(list(tmp_path.iterdir())) == 2)
    finally:
        process.kill()
        process.wait()
    copies = [int(path.name) for path in tmp_path.iterdir() if int(path.name) != process.pid]
    assert _soon(lambda: not any(map(_runs, copies)))


def test_there_are_none_beside_other_threads_or_without_a_core(monkeypatch: pytest.MonkeyPatch) -> None:
    before, found = _children(), list[list[str]]()

    def ask() -> None:
        with forked_workers():
            found.append(_children())

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    monkeypatch.setattr(fork, "cores", lambda: 1)
    ask()
    assert found == [before, before]


def _three(turn: int, number: int) -> FloatArray:
    return np.full(3, 1.0 * number * turn)


def _slowly(number: int) -> int:
    """So slowly that others have their turn."""
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
