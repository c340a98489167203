"""The scaled coordinates of a fit, and their bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from tests import synthetic
from tests.predictions import TIME, TORQUE


def test_what_swings_does_so_as_slowly_as_readings_and_as_fast_as_runs_show() -> None:
    records = InnovationData([synthetic.run(TIME[:500], TORQUE[:500])], synthetic.LOGGED, synthetic.ROSUB, interval=1.0)
    coordinates = InnovationLikelihood(records, 0.05, (effect_named("wave_torque"),)).parametrization
    highest = coordinates.high[coordinates.effects_begin + 1]
    assert highest == pytest.approx(math.pi)
    lowest = coordinates.low[coordinates.effects_begin + 1]
    assert lowest == pytest.approx(2.0 * math.pi / float(np.ptp(TIME[:500])))
    starts = coordinates.initial_values()
    assert all(lowest <= start[1] <= highest for start in starts)
    assert len({tuple(start) for start in starts}) == len(starts) < len(effect_named("wave_torque").initial_values)
