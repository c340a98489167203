"""The units in which a fit searches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.estimate.scaling import in_use, scales_of, usual
from tests.synthetic import VEHICLE, clock, trial

TIME = clock(100.0)
TRIAL = trial(TIME, np.where(TIME < 50.0, 2.0, -4.0))


def test_the_usual_size_is_of_what_is_known_and_never_nothing() -> None:
    assert usual([np.array([3.0, np.nan]), np.array([-3.0])]) == 3.0
    assert usual([np.zeros(3)]) > 0.0
    assert in_use(np.array([0.0, 0.0, 4.0, -4.0])) == 4.0
    assert in_use(np.zeros(3)) == 1.0


def test_scales_are_those_of_commands_speeds_and_hours() -> None:
    logged = replace(TRIAL, since=3500.0, extras={"surge_velocity": np.full(len(TIME), -2.0)})
    scales = scales_of([TRIAL, logged], VEHICLE, 100.0, 0.1, driven=True)
    assert scales.command == 4.0
    assert scales.surge == 2.0
    assert scales.sway == 1.0
    assert scales.longest == pytest.approx(100.0 / 3600.0)
    assert scales.day == pytest.approx(1.0)
    # 400 N of 500 N.
    assert scales.load == pytest.approx(0.8)


def test_a_vehicle_that_nothing_drives_has_no_load() -> None:
    scales = scales_of([TRIAL], None, 100.0, 0.1, driven=False)
    assert scales.load == 1.0
    assert scales.race == scales.root == 10.0
