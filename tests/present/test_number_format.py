"""Numbers as a reader wants them."""

from __future__ import annotations

import math

import pytest

from rovid.present.number_format import (
    DASH,
    align_decimal_points,
    as_sentence,
    equal_decimals,
    format_number,
    parameter_title,
    same_decimals,
    unit_symbol,
)

FIGURE, POINT = "\u2007", "\u2008"


def test_numbers_that_are_not_there_are_a_dash() -> None:
    assert [format_number(value) for value in (None, math.nan, math.inf)] == [DASH] * 3
    assert format_number(0.25, ".1f") == "0.2"


def test_column_takes_its_decimals_from_the_middle() -> None:
    assert equal_decimals([0.00181, 0.0037, 0.0014], 2) == ["0.0018", "0.0037", "0.0014"]
    assert equal_decimals([3490.3, 3506.1], 4) == ["3490", "3506"]
    assert equal_decimals([None, math.nan, 0.0], 2) == [DASH, DASH, "0.0"]


def test_points_and_signs_stand_in_line() -> None:
    assert align_decimal_points(["1.25", "10"]) == ["1.25", f"10{POINT}{FIGURE}{FIGURE}"]
    pairs = align_decimal_points(["5047.0 ± 15.3", "2530 ± 570", DASH])
    assert pairs[2] == DASH
    assert [text.find("±") for text in pairs[:2]] == [7, 7]
    assert len(pairs[0]) == len(pairs[1])


def test_alignment_adds_nothing_but_space() -> None:
    texts = ["-0.12 ± 0.3", "7", DASH, "1e-05"]
    assert [text.translate({0x2007: None, 0x2008: None}) for text in align_decimal_points(texts)] == texts


@pytest.mark.parametrize(("value", "text", "wanted"), [(12.345, "10.2 ± 0.3", "12.3"), (3029.4, "5980 ± 1500", "3029")])
def test_interval_has_the_decimals_of_its_value(value: float, text: str, wanted: str) -> None:
    assert same_decimals(text, value) == wanted


def test_messages_become_sentences() -> None:
    assert as_sentence("no held command was found") == "No held command was found."
    assert (
        as_sentence("linear_drag cannot be told from zero: 3 kg m^2.")
        == "Linear drag cannot be told from zero: 3 kg m²."
    )
    assert as_sentence("hold_3.csv: lasts 2 s.") == "hold_3.csv: lasts 2 s."
    assert as_sentence("") == ""
    assert as_sentence("sway.linear_drag hides yaw.inertia, R^2 0.9") == "Sway linear drag hides yaw inertia, R² 0.9."


def test_names_and_units_are_for_people() -> None:
    assert parameter_title("quadratic_drag") == "quadratic drag DQ"
    assert parameter_title("thruster_lag.time_constant") == "thruster lag: time constant"
    assert unit_symbol("N m s^2/rad^2") == "N m s²/rad²"
    assert unit_symbol("s") == "s"
    assert unit_symbol("N m s^2/(m rad) per kg m^2") == "N m s²/(m rad) per kg m²"
