"""The odds that a cause acts."""

from __future__ import annotations

import math

import pytest

from rovid.diagnose.posterior import ESTABLISHED, POSSIBLE, posterior_probability, recalibrated, stand_in_cap


@pytest.mark.parametrize(
    ("worths", "alike", "least", "most"),
    [
        ({}, (), 0.0, 0.0),
        ({"a": 0.0}, ("a",), 0.49, 0.51),
        ({"a": 10.0, "b": 10.0}, ("a",), 0.49, 0.51),
        ({"a": 10.0, "b": 10.0}, ("a", "b"), 0.95, 0.98),
        ({"a": 3.0} | {f"other {k}": -2.0 for k in range(20)}, ("a",), 0.44, 0.48),
        ({"a": 1e4}, ("a",), 0.95, 0.98),
        ({"a": -1e4}, ("a",), 0.0, 1e-9),
    ],
)
def test_odds(worths: dict[str, float], alike: tuple[str, ...], least: float, most: float) -> None:
    found = posterior_probability(worths, alike, len(worths))
    assert least <= found <= most
    assert math.isfinite(found)


@pytest.mark.parametrize(("white", "least", "enough"), [(False, 19.0, 21.0), (True, 12.0, 14.0)])
def test_what_gains_little_is_no_surer_than_its_stand_ins_are_rare(white: bool, least: float, enough: float) -> None:
    def sure(gain: float) -> float:
        return stand_in_cap(gain, gain, white=white)

    assert sure(6.0) == pytest.approx(0.5)
    assert sure(least) < ESTABLISHED <= sure(enough)
    assert sure(-1e6) < 1e-6
    assert sure(1e6) == sure(2e6) < 0.98
    assert posterior_probability({"a": least}, ("a",), 1, cap=sure(least)) == sure(least)


def test_where_innovations_are_white_the_lesser_gain_counts() -> None:
    assert stand_in_cap(30.0, 6.0, white=True) == stand_in_cap(6.0, 30.0, white=True) == pytest.approx(0.5)
    assert stand_in_cap(30.0, 6.0, white=False) > ESTABLISHED


@pytest.mark.parametrize("white", [True, False])
def test_odds_that_are_said_keep_their_order_and_what_is_established(white: bool) -> None:
    said = [recalibrated(sure, white=white) for sure in (0.0, 1e-3, 0.05, 0.3, 0.5, 0.8, ESTABLISHED, 0.97, 1.0)]
    assert said == sorted(said)
    assert (said[0], said[-1]) == (0.0, 1.0)
    assert recalibrated(ESTABLISHED, white=white) >= ESTABLISHED
    assert recalibrated(0.93, white=white) < ESTABLISHED
    assert recalibrated(1e-3, white=white) < POSSIBLE


def test_a_likelihood_is_taken_at_its_word_where_innovations_are_white() -> None:
    assert recalibrated(0.15, white=True) == 0.15
    assert recalibrated(0.15, white=False) > 0.3
