"""The time that a computation may take, by a clock that the tests set."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rovid.core.budget import Budget
from rovid.core.spmd import forked_workers, parallel_map


@dataclass
class Clock:
    """A clock that moves when it is set, or by ``tick`` with each look at it."""

    now: float = 100.0
    tick: float = 0.0

    def __call__(self) -> float:
        self.now += self.tick
        return self.now


def test_a_budget_is_over_after_its_share() -> None:
    clock = Clock()
    budget = Budget(60.0, share=0.75, clock=clock)
    clock.now += 44.9
    assert not budget.is_over
    assert not budget.skips("waves")
    assert budget.not_tried == {}
    clock.now += 0.2
    assert budget.skips("waves")
    clock.now -= 40.0  # it stays over
    assert budget.skips("more effects")
    assert list(budget.not_tried) == ["waves", "more effects"]
    assert budget.use.not_tried == ("waves", "more effects")
    assert math.isclose(budget.use.used, 5.1, abs_tol=1e-9)


def test_without_seconds_there_is_no_end() -> None:
    clock = Clock()
    budget = Budget(clock=clock)
    clock.now += 1e9
    assert not budget.is_over


def test_what_is_left_is_told_not_more_than_once_a_second() -> None:
    clock, told = Clock(), list[str]()
    budget = Budget(60.0, clock=clock, report=told.append)
    for done in range(4):
        clock.now = 100.0 + 0.6 * done
        budget.tell("Model with no effect", done, 10, 100.0)
    assert told == ["Model with no effect: cause 3 of 10, about 5 s …"]


def test_all_copies_agree_on_the_end() -> None:
    # Each copy has a clock of its own, which moves with each look at it: alone, they would not agree.
    budget = Budget(10.0, share=1.0, clock=Clock(tick=1.0))
    with forked_workers() as is_first:
        if not is_first:
            budget.clock = Clock(now=-1e9)
        answers = [budget.is_over for _ in range(20)]
        shared = parallel_map(lambda _: tuple(answers), range(8))
    assert answers == sorted(answers)
    assert answers[0] is False
    assert answers[-1] is True
    assert set(shared) == {tuple(answers)}
