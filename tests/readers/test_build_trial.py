"""One trial from channels on their own clocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from tests.readers.channels import HEADING, HEADINGS, TIME, trial_of
from tests.readers.logs import csv_text, kinds, read_csv, standard


def test_the_base_is_headings_and_changes(tmp_path: Path) -> None:
    command = ([-1.0, 0.013, 1.0, 3.51, 3.7, 25.0], [1.0, 1.0, 2.0, 3.0, 3.0, 9.0])
    trial = trial_of(tmp_path, heading=HEADINGS, fore=command)
    np.testing.assert_allclose(trial.time, np.union1d(TIME, [3.51]))  # at 1.0 both, after the end none
    assert trial.measured.sum() == 400
    assert trial.commands[trial.time < 0.99].max() == 1.0
    assert trial.commands[np.searchsorted(trial.time, 3.51), 0] == 3.0
    assert trial.remarks == ()


def test_it_begins_when_every_command_is_known(tmp_path: Path) -> None:
    trial = trial_of(tmp_path, heading=HEADINGS, fore=([2.03, 5.0], [1.0, 2.0]))
    assert trial.time[0] == 0.0
    assert trial.measured[0]
    assert trial.duration == pytest.approx(TIME[-1] - 2.05)
    (remark,) = trial.remarks
    assert (remark.kind, remark.count) == ("start", 41)
    assert "2.0 s" in remark.text


def test_a_command_that_comes_too_late(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="0 heading readings come after every command is known"):
        trial_of(tmp_path, heading=HEADINGS, fore=([50.0], [1.0]))


def test_a_number_that_signals_is_missing(tmp_path: Path) -> None:
    def damaged(values: FloatArray) -> FloatArray:
        broken = values.copy()
        broken.view(np.uint64)[100] = 0x7FF0_0000_0000_0001
        return broken

    trial = trial_of(
        tmp_path,
        heading=(TIME, damaged(HEADING % 360.0)),
        fore=(TIME, damaged(np.ones(400))),
        yaw_rate=(TIME, damaged(np.full(400, 0.14))),
        roll=(TIME, damaged(np.full(400, 3.0))),
    )
    assert trial.measured.sum() == 399
    assert kinds(trial)["missing"] >= 1


@pytest.mark.parametrize(("scale", "words"), [(1e3, "50 s apart"), (1e-3, "5e-05 s apart")])
def test_time_in_a_wrong_unit_is_refused(scale: float, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=f"{words}.*unit = .s.*time"):
        read_csv(tmp_path, csv_text(standard(time_s=TIME * scale), form=".7f"))


@pytest.mark.parametrize(
    ("heading", "words"),
    [
        (np.full(400, 123.4), "never changes"),
        (np.full(400, np.nan), "holds 0 heading readings"),
        (np.where(np.arange(400) < 9, HEADING, np.nan), "holds 9 heading readings"),
    ],
)
def test_no_heading(heading: FloatArray, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=words):
        read_csv(tmp_path, csv_text(standard(heading_deg=heading)))


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
