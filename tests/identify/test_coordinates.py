"""The scaled coordinates of a fit, and their bounds."""

from __future__ import annotations

import math

import pytest

from rovid.effects import effect_named
from rovid.identify.innovations import InnovationMisfit
from rovid.identify.readings import Readings
from tests import synthetic
from tests.predictions import TIME, TORQUE


def test_nothing_swings_faster_than_readings_show() -> None:
    records = Readings([synthetic.run(TIME, TORQUE)], synthetic.LOGGED, synthetic.ROSUB, interval=1.0)
    coordinates = InnovationMisfit(records, 0.05, (effect_named("wave_torque"),)).coordinates
    highest = coordinates.high[coordinates.before_effects + 1]
    assert highest == pytest.approx(math.pi)
    starts = coordinates.starts()
    assert all(start[1] <= highest for start in starts)
    assert len({tuple(start) for start in starts}) == len(starts) < len(effect_named("wave_torque").starts)
