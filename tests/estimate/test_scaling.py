"""The units in which a fit searches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.estimate.scaling import effect_scales, rms, rms_nonzero
from tests.synthetic import VEHICLE, clock, trial

TIME = clock(100.0)
TRIAL = trial(TIME, np.where(TIME < 50.0, 2.0, -4.0))


def test_the_usual_size_is_of_what_is_known_and_never_nothing() -> None:
    assert rms([np.array([3.0, np.nan]), np.array([-3.0])]) == 3.0
    assert rms([np.zeros(3)]) > 0.0
    assert rms_nonzero(np.array([0.0, 0.0, 4.0, -4.0])) == 4.0
    assert rms_nonzero(np.zeros(3)) == 1.0


def test_scales_are_those_of_commands_speeds_and_hours() -> None:
    logged = replace(TRIAL, campaign_time=3500.0, extras={"surge_velocity": np.full(len(TIME), -2.0)})
    scales = effect_scales([TRIAL, logged], VEHICLE, 100.0, 0.1, has_actuators=True)
    assert scales.command == 4.0
    assert scales.surge == 2.0
    assert scales.sway == 1.0
    assert scales.longest == pytest.approx(100.0 / 3600.0)
    assert scales.day == pytest.approx(1.0)
    # 400 N of 500 N.
    assert scales.load == pytest.approx(0.8)


def test_a_vehicle_that_nothing_drives_has_no_load() -> None:
    scales = effect_scales([TRIAL], None, 100.0, 0.1, has_actuators=False)
    assert scales.load == 1.0
    assert scales.wash == scales.sqrt_thrust == 10.0
