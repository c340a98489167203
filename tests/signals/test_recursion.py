"""The recursion is the filter of scipy.signal."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from rovid.signals.recursion import first_order_sum


@pytest.mark.parametrize("fade", [0.0, 0.9, -0.5, 1.0])
@pytest.mark.parametrize("count", [0, 1, 500])
def test_each_has_what_is_left_of_those_before(fade: float, count: int) -> None:
    values = np.random.default_rng().normal(size=count)
    wanted = lfilter([1.0], [1.0, -fade], values)
    np.testing.assert_allclose(first_order_sum(values, fade), wanted, rtol=1e-12, atol=1e-12)
