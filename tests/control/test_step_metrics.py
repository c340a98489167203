"""Metrics of a manoeuvre."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rovid.control.closed_loop import limit_cycle


def test_a_limit_cycle_is_distinguished_from_a_decaying_oscillation() -> None:
    time = np.arange(0.0, 300.0, 0.1)
    found = limit_cycle(time, 120.0 + 0.5 * np.sin(time))
    assert found is not None
    assert (found.amplitude_deg, found.period_s) == pytest.approx((0.5, 2.0 * math.pi), rel=2e-2)
    assert limit_cycle(time, 120.0 + 20.0 * np.exp(-time / 40.0) * np.sin(time)) is None
    assert limit_cycle(time, np.full(len(time), 120.0)) is None
