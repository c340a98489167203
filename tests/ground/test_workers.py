"""Work spread over the cores."""

from __future__ import annotations

import threading
import time

import pytest

from rovid.ground.workers import spread


def test_results_stand_in_the_order_of_what_they_are_of() -> None:
    def late(number: int) -> int:
        # The first is done last.
        time.sleep(0.01 * (5 - number))
        return number**2

    assert spread(late, range(5)) == [0, 1, 4, 9, 16]


def test_a_worker_spreads_nothing_further() -> None:
    def inner(_: int) -> set[str]:
        return set(spread(lambda _: threading.current_thread().name, range(20)))

    # Each worker did all of its own work.
    assert all(len(names) == 1 for names in spread(inner, range(4)))


def test_a_failure_comes_back() -> None:
    with pytest.raises(ZeroDivisionError):
        spread(lambda number: 1 // number, [1, 0])
