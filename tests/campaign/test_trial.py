"""Trials: arrays of one length, that nobody changes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.campaign.test_vehicle import CURVE
from tests.synthetic import clock, trial


def test_a_trial_whose_arrays_differ_in_length_is_a_mistake() -> None:
    time = clock(1.0)
    for heading, command in ((time[1:], time), (time, time[1:])):
        with pytest.raises(ValueError, match="log"):
            trial(time, command, heading)


def test_arrays_are_read_only() -> None:
    record = trial(clock(1.0), np.zeros(21))
    for array in (record.time, record.position, record.commands, CURVE.thrust):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
