"""Numbers as they are printed."""

from __future__ import annotations

import math

import pytest

from rovid.ground.numbers import plus_minus


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [
        (3610.38, 315.4, "3610 ± 315"),
        (103.138, 61.29, "103 ± 61"),
        (5056.93, 0.155, "5056.930 ± 0.155"),
        (0.1234567, 0.00456, "0.1235 ± 0.0046"),
        (123456.0, 45678.0, "123000 ± 46000"),
        (2.5, math.nan, "2.5"),
    ],
)
def test_values_are_rounded_to_their_uncertainty(value: float, error: float, expected: str) -> None:
    assert plus_minus(value, error) == expected
