"""What is said of a clock: sure or not, before or after, and what is to be set."""

from __future__ import annotations

import pytest

from rovid.preflight.clock_report import ClockOffset, ClockOffsets


@pytest.mark.parametrize(
    ("offset", "by", "certain", "said"),
    [
        (-0.5, "", True, "answers 0.5000 ± 0.0200 s before the commands in thr, which cannot be"),
        (0.5, "", False, "No log tells which"),
        (0.05, "", False, "at once"),
        (0.5, "yaw against heading", True, "0.5000 ± 0.0200 s behind, by yaw against heading in both files"),
        (-0.05, "yaw", False, "0.0500 ± 0.0200 s ahead"),
    ],
)
def test_a_clock_in_words(offset: float, by: str, certain: bool, said: str) -> None:
    clock = ClockOffset(name="thr", offset=offset, error=0.02, by=by)
    assert clock.certain is certain
    assert said in clock.text


def test_what_is_set_adds_to_what_is_given() -> None:
    clock = ClockOffset(name="a b.csv", offset=0.2, error=0.01, drift=30.0, drift_error=2.0, by="yaw", given=(1.0, 5.0))
    assert clock.join_settings == {"offset": '"a b.csv" = 1.2000', "drift": '"a b.csv" = 35.00'}


def test_what_is_alike_is_said_once() -> None:
    late = [ClockOffset(name=f"{number}.csv", offset=0.5 + 0.1 * number, error=0.02) for number in range(12)]
    early = ClockOffset(name="x.csv", offset=-1.0, error=0.02)
    clocks = ClockOffsets(offsets=(*late, early), lag=0.3)
    assert clocks.groups == [tuple(late), (early,)]
    words = clocks.text(late)
    assert "Beside it the thrusters lag by 0.3 s" in words
    assert "1.csv 0.6000 ± 0.0200" in words
    assert "and 3 more" in words
