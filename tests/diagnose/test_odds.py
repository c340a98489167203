"""The odds that a cause acts."""

from __future__ import annotations

import math

import pytest

from rovid.diagnose.odds import confidence


@pytest.mark.parametrize(
    ("worths", "alike", "least", "most"),
    [
        ({}, (), 0.0, 0.0),
        ({"a": math.log(2.0)}, ("a",), 0.49, 0.51),
        ({"a": 10.0, "b": 10.0}, ("a",), 0.49, 0.51),
        ({"a": 10.0, "b": 10.0}, ("a", "b"), 0.95, 0.98),
        ({"a": 3.0} | {f"other {k}": -2.0 for k in range(20)}, ("a",), 0.27, 0.32),
        ({"a": 1e4}, ("a",), 0.95, 0.98),
        ({"a": -1e4}, ("a",), 0.0, 1e-9),
    ],
)
def test_odds(worths: dict[str, float], alike: tuple[str, ...], least: float, most: float) -> None:
    found = confidence(worths, alike, len(worths))
    assert least <= found <= most
    assert math.isfinite(found)
