"""Gain of waves that its scatter over time supports."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rovid.diagnose.wave_test import supported_gain


def test_a_gain_that_never_scatters_is_supported_far_beyond_one_that_does() -> None:
    steady = np.tile([0.9, 1.1], 50)
    rare = np.zeros(100)
    rare[40] = 100.0
    assert supported_gain(steady) > 100.0
    assert supported_gain(rare) == pytest.approx(0.5, abs=0.05)
    assert supported_gain(-steady) < -100.0


@pytest.mark.parametrize("autocorrelation", [0.0, 0.5, -0.3])
def test_chance_gains_support_as_much_as_theory_says(autocorrelation: float) -> None:
    """Twice the supported gain of gains with the mean 0 follows chi-square with one degree of freedom: mean 1."""
    random = np.random.default_rng(1)
    supported = []
    for _ in range(2000):
        gains = random.standard_normal(150)
        for at in range(1, len(gains)):
            gains[at] += autocorrelation * gains[at - 1]
        supported.append(abs(supported_gain(gains)))
    mean = 2.0 * float(np.mean(supported))
    # Negative autocorrelation is not used, so less is supported than could be.
    assert mean < 1.35
    assert mean > 0.85 or autocorrelation < 0.0


def test_correlated_gains_support_no_more_than_their_longer_blocks() -> None:
    """Each gain four times in a row is no more evidence than one gain."""
    once = np.random.default_rng(2).standard_normal(60) + 1.0
    in_long_blocks, repeated = supported_gain(once), supported_gain(np.repeat(once, 4) / 4.0)
    assert in_long_blocks == pytest.approx(0.5 * 60 * math.log1p(once.sum() ** 2 / (60 * 60 * once.var(ddof=1))), 0.2)
    assert repeated < 1.5 * in_long_blocks


@pytest.mark.parametrize("gains", [[], [3.0]])
def test_fewer_than_two_blocks_support_nothing(gains: list[float]) -> None:
    assert supported_gain(np.array(gains)) == 0.0
