"""Steady states out of holds, and how sure their means are."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.estimate.steady_points import long_run_variance


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
def test_long_run_variance_of_an_autoregression(memory: float) -> None:
    rng = np.random.default_rng()
    estimates = []
    for _ in range(200):
        noise = rng.normal(size=400)
        values = np.empty(400)
        values[0] = noise[0] / np.sqrt(1 - memory**2)
        for k in range(1, 400):
            values[k] = memory * values[k - 1] + noise[k]
        estimates.append(long_run_variance(values - values.mean()))
    expected = 1.0 / (1.0 - memory) ** 2
    assert np.mean(estimates) == pytest.approx(expected, rel=0.15)  # first-order bias at n = 400 is a few percent
