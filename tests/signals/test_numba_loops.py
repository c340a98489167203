"""Compiled loops over samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from rovid.signals.numba_loops import find_constant_runs, first_order_sum


def test_a_run_ends_where_one_column_leaves_its_tolerance() -> None:
    values = np.array([[0.0, 5.0], [0.1, 5.0], [0.1, 6.0], [0.2, 6.0], [0.3, 6.0]])
    assert find_constant_runs(values, np.array([0.15, 0.5])).tolist() == [0.0, 2.0, 4.0]


def test_a_slow_ramp_is_no_single_run() -> None:
    ramp = np.linspace(0.0, 1.0, 101)[:, None]
    starts = find_constant_runs(ramp, np.array([0.1])).astype(int)
    assert len(starts) > 8
    for first, stop in zip(starts, [*starts[1:], len(ramp)], strict=True):
        assert np.ptp(ramp[first:stop]) <= 0.1


def test_a_constant_series_is_one_run() -> None:
    assert find_constant_runs(np.zeros((7, 2)), np.zeros(2)).tolist() == [0.0]


@pytest.mark.parametrize("fade", [0.0, 0.9, -0.5, 1.0])
@pytest.mark.parametrize("count", [0, 1, 500])
def test_the_first_order_sum_equals_lfilter(fade: float, count: int) -> None:
    values = np.random.default_rng().normal(size=count)
    wanted = lfilter([1.0], [1.0, -fade], values)
    np.testing.assert_allclose(first_order_sum(values, fade), wanted, rtol=1e-12, atol=1e-12)
