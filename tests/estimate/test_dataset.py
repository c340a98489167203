"""What every record of runs knows of them: the sizes in use, and which innovation is of which stretch of time."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.estimate.filter_data import InnovationData
from tests import synthetic

TIME = synthetic.clock(300.0)
RUNS = [synthetic.run(TIME, torque) for torque in (np.full(len(TIME), 100.0), np.where(TIME < 150.0, 0.0, -200.0))]
READINGS = InnovationData(RUNS, synthetic.LOGGED, synthetic.ROSUB)


def test_the_torque_in_use_is_of_where_there_is_any() -> None:
    acting = np.concatenate([run.torque[run.torque != 0.0] for run in RUNS])
    assert READINGS.rms_torque == pytest.approx(np.sqrt(np.mean(acting**2)))


def test_either_drag_alone_would_brake_as_both_do() -> None:
    quadratic, linear = READINGS.drag_scale
    braked = synthetic.ROSUB.drag(np.array(READINGS.rms_rate))
    assert quadratic * READINGS.rms_rate**2 == pytest.approx(braked)
    assert linear * READINGS.rms_rate == pytest.approx(braked)


def test_no_stretch_of_time_is_of_two_runs() -> None:
    assert len(READINGS.run_index) == len(READINGS.block_index) == 2 * (len(TIME) - 1)
    for block in np.unique(READINGS.block_index):
        inside = READINGS.block_index == block
        assert len(set(READINGS.run_index[inside])) == 1
        assert np.ptp(np.tile(TIME[1:], 2)[inside]) <= READINGS.block_seconds


def test_no_heading_is_known_better_than_a_compass_could() -> None:
    # These have no noise at all.
    assert READINGS.position_noise > 0.0
