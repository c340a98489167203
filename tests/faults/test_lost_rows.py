"""Rows lost at random, and regular or irregular clocks that lose none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import BoolArray, FloatArray
from rovid.faults.base import ClockData, ClocksData, detectors_at, examine
from rovid.trial.fault import FaultOverrides
from rovid.trial.preprocessing import split
from tests.faults.clocks import COMMANDS, TIME_CONSTANTS, clock, examined, motion, undamaged
from tests.faults.drives import drives


@pytest.mark.parametrize("share", [0.08, 0.15, 0.3])
@pytest.mark.parametrize("lag", TIME_CONSTANTS)
@pytest.mark.parametrize("kind", COMMANDS)
def test_lost_rows_are_counted(kind: str, lag: float, share: float) -> None:
    time, heading, command = motion(3, kind=kind, lag=lag)
    kept = np.random.default_rng(5).random(len(time)) > share
    kept[[0, -1]] = True
    data, (fault,) = examined(clock(time[kept], heading=heading[kept], fore=command[kept]))
    assert (fault.fault, fault.logs, fault.remedy) == ("lost_rows", ("run.csv",), "unknown")
    assert fault.size == pytest.approx(1.0 - kept.mean(), abs=1e-9)
    assert fault.size is not None
    assert fault.standard_error is not None
    assert abs(fault.size - share) < 4.0 * fault.standard_error
    begins, ends = np.array(data.unknown).T
    inside = (time[~kept][:, np.newaxis] > begins) & (time[~kept][:, np.newaxis] < ends)
    assert np.all(inside.sum(axis=1) == 1)  # Each lost row lies in one hole.
    assert not np.any((time[kept][:, np.newaxis] > begins + 1e-9) & (time[kept][:, np.newaxis] < ends - 1e-9))


def test_lost_messages_of_a_topic_without_commands_need_no_remedy() -> None:
    time, heading, _ = motion(3)
    kept = np.random.default_rng(5).random(len(time)) > 0.15
    data, (fault,) = examined(clock(time[kept], heading=heading[kept]))
    assert (fault.fault, fault.remedy, data.unknown) == ("lost_rows", "none", ())


def late(time: FloatArray) -> FloatArray:
    """One reading in twenty comes almost an interval late."""
    return time + np.where(np.random.default_rng(1).random(len(time)) < 0.05, 0.09, 0.0)


def gps(time: FloatArray) -> FloatArray:
    """Irregular intervals."""
    return np.cumsum(np.random.default_rng(1).uniform(0.03, 0.3, len(time)))


CLOCKS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "regular": lambda time: time,
    "1 Hz": lambda time: 10.0 * time,
    "epoch": lambda time: 1.7e9 + time,
    "rounded": lambda time: np.round(0.613 * time, 3),
    "every third tick": lambda time: np.cumsum(np.resize([0.05, 0.05, 0.1], len(time))),
    "jitter": lambda time: time + np.random.default_rng(1).normal(0.0, 0.01, len(time)).clip(-0.04, 0.04),
    "random intervals": lambda time: np.cumsum(np.random.default_rng(1).exponential(0.1, len(time)) + 1e-3),
    "late": late,
    "GPS": gps,
}


@pytest.mark.parametrize("name", CLOCKS)
@pytest.mark.parametrize("lag", TIME_CONSTANTS)
@pytest.mark.parametrize("kind", COMMANDS)
def test_undamaged_clocks_have_no_fault(kind: str, lag: float, name: str) -> None:
    assert undamaged(2, lag, kind, CLOCKS[name]) == ()


def test_topics_published_on_change_lose_nothing() -> None:
    time, _, command = motion(4, kind="telegraph", lag=0.3)
    changed = np.concatenate(([True], np.diff(command) != 0.0))
    assert changed.sum() > 50
    assert examined(clock(time[changed], fore=command[changed]))[1] == ()
    _, heading, _ = motion(4, kind="sine", lag=8.0, noise=0.0)
    rounded = np.round(heading / 0.5) * 0.5
    changed = np.concatenate(([True], np.diff(rounded) != 0.0))
    assert examined(clock(time[changed], heading=rounded[changed]))[1] == ()


@pytest.mark.parametrize("seed", range(20))
def test_a_usual_loss_is_no_fault(seed: int) -> None:
    time, heading, command = motion(seed)
    kept = np.random.default_rng(seed).random(len(time)) > 0.03
    assert examined(clock(time[kept], heading=heading[kept], fore=command[kept]))[1] == ()


def test_few_rows_of_a_short_log_are_named() -> None:
    """Three holes of three rows."""
    time, heading, command = motion(4)
    kept = np.ones(150, dtype=bool)
    for at in (31, 62, 118):
        kept[at : at + 3] = False
    _, (fault,) = examined(clock(time[:150][kept], heading=heading[:150][kept], fore=command[:150][kept]))
    assert fault.size == pytest.approx(9.0 / 150.0)


@pytest.mark.parametrize("rows", [15, 40])
def test_a_gap_is_a_pause_of_the_recording_from_twenty_intervals_on(rows: int) -> None:
    time, heading, command = motion(4)
    kept = np.ones(len(time), dtype=bool)
    for at in range(100, 1000, 150):
        kept[at : at + rows] = False
    data, faults = examined(clock(time[kept], heading=heading[kept], fore=command[kept]))
    if rows < 20:
        assert faults == ()
        return
    (fault,) = faults
    assert (fault.fault, fault.remedy, len(data.unknown), len(fault.at)) == ("lost_rows", "cut", 6, 6)
    assert fault.size == pytest.approx(6 * 0.1 * (rows + 1))


def test_a_log_is_cut_at_a_pause_that_is_no_gap_of_the_heading(tmp_path: Path) -> None:
    _, drive = next(drives(1))
    paused = replace(drive, time=drive.time + np.where(np.arange(len(drive.time)) >= 300, 100.0, 0.0))
    trial = paused.trial(tmp_path)
    (fault,) = (fault for fault in trial.faults if fault.fault in {"lost_rows", "heading_gaps", "clock_step"})
    assert fault.fault in {"lost_rows", "clock_step"}  # The drive runs on over the pause, as with a clock set ahead.
    assert [len(part.time) for part in split(trial)] == [300, 300]


def test_a_table_that_joins_sensors_loses_no_rows() -> None:
    # Commands at 50 Hz, a heading and a speed at 20 Hz, each with rows of its own.
    stamps = [0.0099 + 0.02 * np.arange(3000), 0.05 * np.arange(1200), 0.02 + 0.05 * np.arange(1200)]
    time: FloatArray = np.unique(np.round(np.concatenate(stamps), 4)).astype(np.float64)
    assert examined(sparse(time, np.isin(time, np.round(stamps[1], 4))))[1] == ()


def test_a_table_with_a_slow_sensor_may_lose_rows() -> None:
    time: FloatArray = 0.02 * np.arange(6000, dtype=np.float64)
    slow, kept = np.arange(len(time)) % 5 == 0, np.random.default_rng(2).random(len(time)) > 0.12
    (fault,) = examined(sparse(time[kept], slow[kept]))[1]
    assert fault.fault == "lost_rows"


def sparse(time: FloatArray, has_heading: BoolArray) -> ClockData:
    noise = np.random.default_rng(3).normal(0.0, 0.01, len(time))
    heading = np.where(has_heading, 1.0 + 0.3 * time + noise, np.nan)
    command: FloatArray = np.round(np.sin(0.3 * np.floor(time / 2.0)), 2).astype(np.float64)
    return clock(time, heading=heading, fore=command)


@pytest.mark.parametrize(("interval", "late"), [(0.1, 0.003), (0.4, 0.1)])
def test_a_pause_that_topics_have_in_common_is_cut(interval: float, late: float) -> None:
    clocks = np.arange(0.0, 60.0, 0.05), np.arange(late, 60.0, interval)
    paused = [time[(time < 20.0) | (time > 30.0)] for time in clocks]
    data = ClocksData(log="a.mcap", measured=paused[0], commands=(paused[1],))
    (kind,) = detectors_at("clocks")
    cut, (fault,) = examine([kind], data, FaultOverrides())
    assert (fault.fault, fault.remedy, fault.logs) == ("lost_rows", "cut", ("a.mcap",))
    np.testing.assert_allclose(cut.unknown, [(paused[0][paused[0] < 20.0][-1], 30.05)], atol=0.06)
    # Commands that are logged more often than the motion end, and begin again, within its interval.
    often = np.arange(0.0, 60.0, 0.01)
    often = often[(often < 19.995) | (often > 30.005)]
    assert examine([kind], replace(data, commands=(often,)), FaultOverrides())[1]
    # A heading that is absent while commands go on is a gap; so may be one next to commands on change.
    going_on = replace(data, commands=(np.arange(0.0, 60.0, interval),))
    on_change = replace(data, commands=(np.cumsum(np.random.default_rng(0).exponential(3.0, 25)),))
    assert not examine([kind], going_on, FaultOverrides())[1]
    assert not examine([kind], on_change, FaultOverrides())[1]
