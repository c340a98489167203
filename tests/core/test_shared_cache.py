"""What was worked out lately."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.threads import SizedCache

ROOM = 80  # bytes, of ten numbers


def counted(made: list[str], key: str, count: int) -> FloatArray:
    made.append(key)
    return np.full(count, float(len(made)))


def test_the_same_is_not_made_twice() -> None:
    recent, made = SizedCache(ROOM), list[str]()
    first, again = (recent.get_or_make("a", lambda: counted(made, "a", 3)) for _ in range(2))
    assert again is first
    assert made == ["a"]


def test_what_was_asked_for_longest_ago_goes_first() -> None:
    recent, made = SizedCache(ROOM), list[str]()
    for key in ("a", "b", "a", "c", "a", "b"):
        recent.get_or_make(key, lambda key=key: counted(made, key, 4))  # type: ignore[misc]  # bound at once
    # Two have room: c took the place of b, and b then that of c.
    assert made == ["a", "b", "c", "b"]


def test_what_has_no_room_at_all_is_not_kept_and_drives_nothing_out() -> None:
    recent, made = SizedCache(ROOM), list[str]()
    for key in ("small", "large", "large", "small"):
        recent.get_or_make(key, lambda key=key: counted(made, key, 50 if key == "large" else 1))  # type: ignore[misc]  # as above
    assert made == ["small", "large", "large"]


def test_of_what_is_asked_for_in_turn_some_is_always_still_there() -> None:
    turns, asked = 40, "abcdefghijklmno"
    kept, latest = list[str](), list[str]()
    for made, recent in ((kept, SizedCache(ROOM, evict_randomly=True)), (latest, SizedCache(ROOM))):
        for key in asked * turns:
            recent.get_or_make(key, lambda key=key, made=made: counted(made, key, 1))  # type: ignore[misc]  # as above
    # Ten of fifteen have room: each is gone when its turn comes, if what has not been asked for the longest goes.
    assert len(latest) == len(asked) * turns
    assert len(kept) < 0.8 * len(latest)


def test_the_latest_of_what_is_asked_for_in_turn_is_kept_however_large() -> None:
    recent, made = SizedCache(ROOM, evict_randomly=True), list[str]()
    for key in ("a", "a", "b", "b"):
        recent.get_or_make(key, lambda key=key: counted(made, key, 50))  # type: ignore[misc]  # as above
    assert made == ["a", "b"]


def test_a_failure_leaves_nothing_behind() -> None:
    recent = SizedCache(ROOM)
    with pytest.raises(ZeroDivisionError):
        recent.get_or_make("a", lambda: np.ones(1 // 0))
    assert recent.get_or_make("a", lambda: np.ones(1)) == 1.0
