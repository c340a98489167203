"""Initial rates."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.model.ode import initial_rate
from tests.synthetic import clock, trial


@pytest.mark.parametrize("source", ["heading", "gyro"])
def test_the_initial_rate_from_positions(source: str) -> None:
    time = clock(10.0)
    heading = 0.2 * time + 0.03 * time**2
    gyro = 0.2 + 0.06 * time
    log = trial(time, np.zeros(len(time)), heading, rate=gyro if source == "gyro" else None)
    # The gyro's first five samples are averaged: 0.1 s of 0.06 rad/s^2 on.
    assert initial_rate(log) == pytest.approx(0.2, abs=1e-9 if source == "heading" else 0.0061)


def test_the_initial_rate_from_the_gyro() -> None:
    time = clock(20.0)
    gyro = np.where(time < 0.8, np.nan, 0.3)
    late = trial(time, np.zeros(len(time)), 0.3 * time, rate=gyro)
    assert initial_rate(late) == pytest.approx(0.3)
