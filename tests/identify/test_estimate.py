"""What an estimate says of its parameters."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.identify.estimate import Estimate


def test_interval_uses_students_t() -> None:
    estimate = Estimate(
        names=("inertia",),
        values=np.array([10.0]),
        covariance=np.array([[4.0]]),
        degrees_of_freedom=3.0,
        method="m",
        samples=5,
    )
    # t of 0.975 at 3 degrees of freedom is 3.182.
    assert estimate.interval("inertia") == pytest.approx((10 - 6.365, 10 + 6.365), abs=1e-3)
