"""What the logs hold, laid out for the filter."""

from __future__ import annotations

import math

import pytest

from rovid.effects import effect_named
from rovid.identify.innovations import Likelihood
from rovid.identify.records import Records
from tests import synthetic
from tests.predictions import TIME, TORQUE


def test_nothing_swings_faster_than_readings_show() -> None:
    records = Records([synthetic.run(TIME, TORQUE)], synthetic.LOGGED, synthetic.ROSUB, interval=1.0)
    likelihood = Likelihood(records, 0.05, (effect_named("wave_torque"),))
    highest = likelihood.high[likelihood.base + 1]
    assert highest == pytest.approx(math.pi)
    starts = likelihood.starts()
    assert all(start[1] <= highest for start in starts)
    assert len({tuple(start) for start in starts}) == len(starts) < len(effect_named("wave_torque").starts)
