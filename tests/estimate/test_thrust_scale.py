"""Scale of thrust from made-up pulls, lifts and steps of inertia: unbiased, with intervals that hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rovid.core.errors import DataError
from rovid.estimate.thrust_curve import ThrustScale, scale_from_lifts, scale_from_pulls, scale_from_step

TRUE, REFERENCE = 1.13, 0.01
Made = Callable[[np.random.Generator], ThrustScale]


def pull(draw: np.random.Generator) -> ThrustScale:
    """Five levels, 4 N of scatter, and a balance that is off by 1 %."""
    curve = np.array([40.0, 80.0, 120.0, 160.0, 200.0])
    balance = 1.0 + REFERENCE * draw.standard_normal()
    return scale_from_pulls(curve, balance * (TRUE * curve + draw.normal(0.0, 4.0, 5)), REFERENCE)


def lift(draw: np.random.Generator) -> ThrustScale:
    """Four hovers of each of two weights, whose commands scatter by 3 N."""
    stated = np.repeat([100.0, 150.0], 4)
    weight = stated * (1.0 + REFERENCE * draw.standard_normal())
    return scale_from_lifts(weight / TRUE + draw.normal(0.0, 3.0, 8), stated, REFERENCE)


def step(draw: np.random.Generator) -> ThrustScale:
    """400 kg m^2 added to 5000, fitted within 8."""
    before, after = (
        draw.normal(true / TRUE, 8.0) for true in (5000.0, 5000.0 + 400.0 * (1.0 + REFERENCE * draw.standard_normal()))
    )
    return scale_from_step((before, 8.0), (after, 8.0), 400.0, REFERENCE)


@pytest.mark.parametrize("made", [pull, lift, step])
def test_intervals_hold_and_the_scale_is_unbiased(made: Made) -> None:
    draw = np.random.default_rng(57)
    scales = [made(draw) for _ in range(1000)]
    held = np.mean([low < TRUE < high for low, high in (scale.interval() for scale in scales)])
    assert 0.93 <= held <= 0.97  # the promise; 1000 draws give 0.95 within 0.007
    values = np.array([scale.value for scale in scales])
    errors = np.array([scale.standard_error for scale in scales])
    assert abs(values.mean() - TRUE) < 4.0 * values.std() / np.sqrt(len(values)) + 0.001 * TRUE  # of second order
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(
        values.std(), rel=0.1
    )  # the error of a deviation of 1000 is 2 %


def test_tests_that_decide_nothing_are_refused() -> None:
    with pytest.raises(DataError, match="2 readings; at least 3"):
        scale_from_pulls(np.ones(2), np.ones(2), 0.0)
    with pytest.raises(DataError, match="does not act in the sense"):
        scale_from_pulls(np.ones(3), -np.ones(3), 0.0)
    with pytest.raises(DataError, match="does not act in the sense"):
        scale_from_lifts(np.zeros(3), np.zeros(3), 0.0)
    with pytest.raises(DataError, match=r"grew by 10 ± 14"):
        scale_from_step((5000.0, 10.0), (5010.0, 10.0), 400.0, 0.0)
