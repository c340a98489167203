"""Stamps repeated because the clock was rounded or read too rarely, and readings stored twice."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from tests.faults.clocks import clock, examined, motion


@pytest.mark.parametrize("interval", [0.05, 0.1, 0.13, 0.4])
@pytest.mark.parametrize("begin", [0.0, 0.37])
def test_whole_seconds_are_spread(interval: float, begin: float) -> None:
    time, heading, command = motion(1, interval=interval)
    data, (fault,) = examined(clock(np.floor(time + begin), heading=heading, fore=command))
    assert (fault.fault, fault.logs) == ("repeated_stamps", ("run.csv",))
    error = data.time - time - begin
    assert np.abs(error - np.median(error)).max() < 1.1 * interval
    assert np.all(np.diff(data.time) > 0.0)


def test_milliseconds_of_a_fast_sensor_are_spread() -> None:
    time, heading, command = motion(1, interval=0.7e-3)
    data, (fault,) = examined(clock(np.floor(time * 1e3) * 1e-3, heading=heading, fore=command))
    assert fault.fault == "repeated_stamps"
    assert np.abs(data.time - time).max() < 1.5e-3


@pytest.mark.parametrize("interval", [0.0499, 0.031, 0.06, 0.07, 0.08])
def test_rounded_stamps_of_a_regular_clock_are_exact(interval: float) -> None:
    time, heading, command = motion(3, interval=interval)
    data, (fault,) = examined(clock(np.round(time, 1), heading=heading, fore=command))
    assert fault.fault == "repeated_stamps"
    error = data.time - time
    # A common offset of half a step of the rounding is not known. Rounding that nearly repeats tilts the line a little.
    assert np.ptp(error) < 0.15 * interval
    assert np.abs(error).max() < 0.05


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
def test_stale_stamps_are_spread(seed: int, share: float) -> None:
    time, heading, command = motion(seed)
    stale = np.random.default_rng(seed).random(len(time)) < share
    stale[[0, 1, -1]] = False
    damaged = time[np.maximum.accumulate(np.where(stale, 0, np.arange(len(time))))]
    data, (fault,) = examined(clock(damaged, heading=heading, fore=command))
    assert fault.fault == "repeated_stamps"
    assert f" {stale.sum()} times" in fault.text
    np.testing.assert_allclose(data.time, time, atol=1e-9)


@pytest.mark.parametrize("share", [0.1, 0.25])
def test_stamps_of_the_reading_before_are_late_by_one_interval(share: float) -> None:
    """Two such readings in a row leave a stamp that is late and not repeated."""
    time, heading, command = motion(2)
    late = np.random.default_rng(2).random(len(time)) < share
    late[[0, -1]] = False
    data, (fault,) = examined(clock(np.where(late, np.roll(time, 1), time), heading=heading, fore=command))
    assert fault.fault == "repeated_stamps"
    np.testing.assert_allclose(data.time, time, atol=1e-9)


def test_readings_stored_twice_are_not_spread() -> None:
    time, heading, command = motion(1)
    rows = np.sort(np.append(np.arange(len(time)), np.arange(10, 1000, 7)))
    data, faults = examined(clock(time[rows], heading=heading[rows], fore=command[rows]))
    assert faults == ()
    np.testing.assert_array_equal(data.time, time[rows])


def test_readings_in_a_hurry_are_not_spread() -> None:
    time, heading, command = motion(1)
    rows = np.sort(np.append(np.arange(len(time)), np.arange(10, 1000, 7)))
    heading = heading[rows] + np.random.default_rng(1).normal(0.0, 0.05, len(rows))
    assert examined(clock(time[rows], heading=heading, fore=command[rows]))[1] == ()


def test_rows_with_one_signal_each_are_not_spread() -> None:
    time, heading, command = motion(1)
    stamps, empty = np.repeat(time, 2), np.full(len(time), np.nan)
    headings, commands = np.column_stack((heading, empty)).ravel(), np.column_stack((empty, command)).ravel()
    assert examined(clock(stamps, heading=headings, fore=commands))[1] == ()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("stamps", [np.zeros(8), np.repeat([0.0, 5.0, 0.0], 3), np.repeat([0.0, 5.0, 0.0, 5.0], 2)])
@pytest.mark.parametrize("slope", [0.0, 1.0])
def test_stamps_that_stand_still_or_go_back_and_forth_do_no_harm(stamps: FloatArray, slope: float) -> None:
    values = slope * np.arange(float(len(stamps)))
    data, _ = examined(clock(stamps, heading=values, fore=values))
    assert np.isfinite(data.time).all()
