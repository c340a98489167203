"""RMS values, blocks and scales of the data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.estimate.dataset import effect_scales, rms, rms_nonzero
from rovid.estimate.filter_data import InnovationData
from tests import synthetic
from tests.synthetic import VEHICLE, clock, trial

TIME = synthetic.clock(300.0)
RUNS = [synthetic.run(TIME, torque) for torque in (np.full(len(TIME), 100.0), np.where(TIME < 150.0, 0.0, -200.0))]
READINGS = InnovationData(RUNS, synthetic.LOGGED, synthetic.ROSUB)


def test_the_rms_torque_is_that_of_nonzero_torque() -> None:
    acting = np.concatenate([run.torque[run.torque != 0.0] for run in RUNS])
    assert READINGS.rms_torque == pytest.approx(np.sqrt(np.mean(acting**2)))


def test_each_drag_scale_alone_gives_the_total_drag() -> None:
    quadratic, linear = READINGS.drag_scale
    braked = synthetic.ROSUB.drag(np.array(READINGS.rms_rate))
    assert quadratic * READINGS.rms_rate**2 == pytest.approx(braked)
    assert linear * READINGS.rms_rate == pytest.approx(braked)


def test_no_block_spans_two_runs() -> None:
    assert len(READINGS.run_index) == len(READINGS.block_index) == 2 * (len(TIME) - 1)
    for block in np.unique(READINGS.block_index):
        inside = READINGS.block_index == block
        assert len(set(READINGS.run_index[inside])) == 1
        assert np.ptp(np.tile(TIME[1:], 2)[inside]) <= READINGS.block_seconds


def test_the_position_noise_has_a_floor() -> None:
    # The synthetic headings have no noise.
    assert READINGS.position_noise > 0.0


SHORT = clock(100.0)
TRIAL = trial(SHORT, np.where(SHORT < 50.0, 2.0, -4.0))


def test_rms_ignores_nan_and_is_never_zero() -> None:
    assert rms([np.array([3.0, np.nan]), np.array([-3.0])]) == 3.0
    assert rms([np.zeros(3)]) > 0.0
    assert rms_nonzero(np.array([0.0, 0.0, 4.0, -4.0])) == 4.0
    assert rms_nonzero(np.zeros(3)) == 1.0


def test_scales_are_those_of_commands_speeds_and_hours() -> None:
    logged = replace(TRIAL, campaign_time=3500.0, extras={"surge_velocity": np.full(len(SHORT), -2.0)})
    scales = effect_scales([TRIAL, logged], VEHICLE, 100.0, 0.1)
    assert scales.command == 4.0
    assert scales.surge == 2.0
    assert scales.sway == 1.0
    assert scales.longest == pytest.approx(100.0 / 3600.0)
    assert scales.day == pytest.approx(1.0)
    # 400 N of 500 N.
    assert scales.load == pytest.approx(0.8)


def test_without_actuators_there_is_no_load() -> None:
    scales = effect_scales([TRIAL], None, 100.0, 0.1)
    assert scales.load == 1.0
    assert scales.wash == scales.sqrt_thrust == 10.0
