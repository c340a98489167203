"""What a campaign lacks for a diagnosis."""

from __future__ import annotations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.diagnose.data_requirements import missing_data
from rovid.signals.preprocessing import Run
from tests import synthetic

TIME = synthetic.clock(120.0)
CUTOFF = 1.0
PUSHED = np.where(TIME < 60.0, 100.0, -100.0)


def runs_of(torque: FloatArray, disturbance: FloatArray | None = None) -> list[Run]:
    noise = 1e-4 * np.random.default_rng(1).normal(size=len(TIME))
    return [synthetic.run(TIME, torque, disturbance=disturbance, noise=noise) for _ in range(4)]


def test_runs_that_are_pushed_and_move_lack_nothing() -> None:
    assert missing_data(runs_of(PUSHED), CUTOFF) == ""


def test_two_short_trials_are_too_few() -> None:
    said = missing_data(runs_of(PUSHED)[:2], CUTOFF)
    assert "too few trials (2, 240 s in all)" in said
    assert "Record more runs" in said


def test_a_motion_that_no_thruster_made_cannot_be_explained() -> None:
    drift = runs_of(np.zeros(len(TIME)), disturbance=PUSHED)
    assert "no thruster ever runs" in missing_data(drift, CUTOFF)


def test_a_vehicle_that_never_turns_is_told_from_one_that_is_not_pushed() -> None:
    stuck = runs_of(PUSHED, disturbance=-PUSHED)
    assert "the vehicle never turns" in missing_data(stuck, CUTOFF)
