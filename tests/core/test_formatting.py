"""Numbers as they are printed."""

from __future__ import annotations

import math

import pytest

from rovid.core.formatting import plus_minus, round_to_error, significant


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [
        (3610.38, 315.4, "3610 ± 320"),
        (103.138, 61.29, "103 ± 61"),
        (5056.93, 0.156, "5056.93 ± 0.16"),
        (0.1234567, 0.00456, "0.1235 ± 0.0046"),
        (123456.0, 45678.0, "123000 ± 46000"),
        (0.5, 0.0996, "0.50 ± 0.10"),
        (2.5, math.nan, "2.500"),
    ],
)
def test_values_are_rounded_to_their_uncertainty(value: float, error: float, expected: str) -> None:
    assert plus_minus(value, error) == expected


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [
        (-0.0312, 0.004, "-0.0312"),
        (-0.0312, 0.04, "-0.031"),
        (-0.0004, 0.2, "0.00"),
        (212.53, 0.9, "212.53"),
        (212.53, 45.0, "213"),
        (0.031, math.nan, "0.03100"),
    ],
)
def test_what_is_small_is_rounded_to_its_uncertainty_too(value: float, error: float, expected: str) -> None:
    assert round_to_error(value, error) == expected


@pytest.mark.parametrize(
    ("value", "digits", "expected"),
    [
        (0.002, 2, "0.0020"),
        (0.0996, 2, "0.10"),
        (12.34, 2, "12"),
        (1234.0, 2, "1200"),
        (-0.03, 1, "-0.03"),
        (0.0, 3, "0"),
        (1.234e-9, 2, "1.2e-09"),
        (12345678.0, 3, "1.23e+07"),
        (math.inf, 3, "inf"),
    ],
)
def test_digits_that_count_are_all_there(value: float, digits: int, expected: str) -> None:
    assert significant(value, digits) == expected
