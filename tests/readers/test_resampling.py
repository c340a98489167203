"""Signals on their own clocks, put on the time base."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import LogError
from tests.readers.channels import HEADINGS, TIME, trial_of
from tests.readers.logs import kinds


def test_missing_commands_hold(tmp_path: Path) -> None:
    command = (TIME, np.where(np.arange(400) % 2, np.nan, np.where(TIME < 5, 1.0, 2.0)))
    trial = trial_of(tmp_path, heading=HEADINGS, fore=command)
    assert kinds(trial) == {"missing": 200}
    assert "held" in trial.remarks[0].text
    with pytest.raises(LogError, match="holds no number"):
        trial_of(tmp_path, heading=HEADINGS, fore=(TIME, np.full(400, np.nan)))


def test_continuous_signals_are_interpolated_within_gaps(tmp_path: Path) -> None:
    other = np.arange(-0.02, 20.0, 0.1)
    other = other[(other < 5.0) | (other > 8.0)]
    trial = trial_of(
        tmp_path,
        heading=HEADINGS,
        fore=([0.0], [1.0]),
        yaw_rate=(other, np.deg2rad(8.0 + 0.0 * other)),
        roll=(other, (178.0 + 0.2 * other + 180.0) % 360.0 - 180.0),
        pitch=(TIME, np.where(TIME < 1.0, np.nan, 3.0)),
    )
    assert trial.roll is not None
    assert trial.rate is not None
    assert trial.pitch is not None
    hole = (trial.time > 4.99) & (trial.time < 8.07)
    assert np.isnan(trial.roll[hole]).all()
    assert np.isfinite(trial.roll[~hole & (trial.time < 19.9)]).all()
    wrapped = (np.rad2deg(trial.roll) + 360.0) % 360.0
    np.testing.assert_allclose(
        wrapped[~hole & (trial.time < 19.9)], 178.0 + 0.2 * trial.time[~hole & (trial.time < 19.9)]
    )
    np.testing.assert_allclose(np.deg2rad(8.0), trial.rate[~hole & (trial.time < 19.9)])
    assert np.isnan(trial.pitch[trial.time < 0.99]).all()
    assert kinds(trial) == {"missing": 20}


def test_extras_are_held(tmp_path: Path) -> None:
    trial = trial_of(tmp_path, heading=HEADINGS, fore=([0.0], [1.0]), supply=([1.0, 10.0], [48.0, 47.0]))
    supply = trial.extras["supply"]
    assert np.isnan(supply[trial.time < 0.99]).all()
    assert set(supply[trial.time > 0.99]) == {48.0, 47.0}
    empty = trial_of(tmp_path, heading=HEADINGS, fore=([0.0], [1.0]), supply=([1.0], [np.nan]))
    assert np.isnan(empty.extras["supply"]).all()
