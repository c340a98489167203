"""Whether a cause has one size, whatever tells it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.diagnose.effect_size import has_consistent_size
from tests.predictions import TIME, fitted, records


def test_a_cause_that_acts_has_one_size() -> None:
    found, near = fitted("bias_torque", records(disturbance=np.full(len(TIME), 8.0)))
    assert has_consistent_size(found, near, found.effects[0])


def test_a_size_that_only_predictions_show_is_told() -> None:
    found, near = fitted("bias_torque", records(disturbance=np.full(len(TIME), 8.0)))
    at = len(found.common_coordinates)
    twice = found.x.copy()
    twice[at] *= 2.0
    assert not has_consistent_size(replace(found, x=twice), near, found.effects[0])
    turned = found.x.copy()
    turned[at] *= -1.0
    assert not has_consistent_size(replace(found, x=turned), near, found.effects[0])
