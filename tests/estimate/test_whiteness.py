"""Whether innovations are white, and what they gain by being whitened."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

from rovid.estimate.whiteness import is_white, whitening_gain


@pytest.mark.parametrize("name", ["coloured", "spiky"])
def test_what_is_not_white_is_seen(name: str) -> None:
    rng = np.random.default_rng()
    white = rng.normal(size=20_000)
    series = {
        "coloured": white[1:] + 0.1 * white[:-1],
        "spiky": np.where(rng.random(20_000) < 0.005, 20.0, 1.0) * white,
    }[name]
    assert not is_white([series])


def test_white_is_seldom_called_coloured() -> None:
    rng = np.random.default_rng()
    trials = rng.normal(size=(200, 25, 200))
    # One in a thousand expected: more than three of 200 happens once in 15 000 runs.
    assert sum(not is_white(list(series)) for series in trials) <= 3


def test_whitening_gains_what_an_autoregression_does() -> None:
    """Of a first-order autoregression of unit variance: half the count times -log(1 - a^2)."""
    rng, memory, count = np.random.default_rng(3), 0.6, 20000
    noise = rng.normal(size=count) * math.sqrt(1.0 - memory**2)
    series = signal.lfilter([1.0], [1.0, -memory], noise)
    assert whitening_gain([series]) == pytest.approx(-0.5 * count * math.log(1.0 - memory**2), rel=0.03)
    assert whitening_gain([rng.normal(size=count)]) < 30.0
    assert whitening_gain([np.zeros(50)]) == 0.0
    assert math.isfinite(whitening_gain([np.ones(50)]))
