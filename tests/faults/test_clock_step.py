"""Clocks set back or ahead while they recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.faults.clocks import COMMANDS, TIME_CONSTANTS, clock, examined, motion
from tests.readers.channels import HEADINGS, TIME, trial_of


@pytest.mark.parametrize("size", [-0.3, -0.8, -60.0, -1e4, -3e7, 1e4, 1.7e9])
@pytest.mark.parametrize("lag", TIME_CONSTANTS)
@pytest.mark.parametrize("kind", COMMANDS)
def test_steps_back_and_leaps_are_taken_out(kind: str, lag: float, size: float) -> None:
    time, heading, command = motion(7, kind=kind, lag=lag)
    row = 200 + 70 * len(kind)
    damaged = time.copy()
    damaged[row:] += size
    data, (fault,) = examined(clock(damaged, heading=heading, fore=command))
    assert (fault.fault, fault.remedy, fault.unit) == ("clock_step", "cut", "s")
    assert fault.size is not None
    assert fault.standard_error is not None
    assert abs(fault.size - size) < 4.0 * fault.standard_error
    assert list(fault.at) == pytest.approx([time[row - 1]], abs=1e-6)
    np.testing.assert_allclose(data.time, time, atol=1e-6)
    assert time[row - 1] < data.cuts[0] < time[row]


def ahead(seed: int, kind: str, size: float, count: int = 1200) -> bool:
    """Whether a step ahead of ``size`` s is found, and found right, in a log of ``count`` readings."""
    time, heading, command = motion(seed, kind=kind, count=count)
    row = int(np.random.default_rng(seed).integers(count // 12, count - count // 12))
    damaged = time.copy()
    damaged[row:] += size
    data, faults = examined(clock(damaged, heading=heading, fore=command))
    steps = [fault for fault in faults if fault.fault == "clock_step"]
    if not steps:
        return False
    (fault,) = steps
    assert fault.size is not None
    assert fault.standard_error is not None
    assert abs(fault.size - size) < 4.0 * fault.standard_error
    np.testing.assert_allclose(data.time, time, atol=1e-6)
    return True


@pytest.mark.parametrize("kind", ["steps", "sine", "telegraph"])
def test_steps_ahead_of_a_moving_vehicle_are_found(kind: str) -> None:
    # Measured: 80 to 90 %. At rest, and where rates change in a reading, a step cannot be told from a gap.
    assert np.mean([ahead(seed, kind, size) for seed in range(10) for size in (1.0, 7.3, 40.0)]) > 0.6


def test_steps_ahead_are_found_in_short_logs() -> None:
    """The lines of 180 readings are too few to count those that meet by chance. Measured: 18 of 24."""
    found = [ahead(seed, kind, 5.0, 180) for seed in range(8) for kind in ("steps", "sine", "telegraph")]
    assert np.mean(found) > 0.6


def test_gaps_in_which_time_passed_are_no_steps_in_short_logs() -> None:
    found = 0
    for seed in range(60):
        time, heading, command = motion(seed, kind=COMMANDS[seed % 5], lag=TIME_CONSTANTS[seed % 3], count=260)
        kept = np.r_[0:100, 100 + 8 + seed : 260]
        _, faults = examined(clock(time[kept], heading=heading[kept], fore=command[kept]))
        found += any(fault.fault == "clock_step" for fault in faults)
    assert found <= 4  # As below.


def test_gaps_in_which_time_passed_are_no_steps() -> None:
    found = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        time, heading, command = motion(seed, kind=COMMANDS[seed % 5], lag=TIME_CONSTANTS[seed % 3], count=2000)
        first, lost = int(rng.integers(100, 1300)), int(np.exp(rng.uniform(np.log(4.0), np.log(600.0))))
        kept = np.r_[0:first, first + lost : 2000]
        _, faults = examined(clock(time[kept], heading=heading[kept], fore=command[kept]))
        found += any(fault.fault == "clock_step" for fault in faults)
    assert found <= 4  # 1 in 50 gaps; more than 4 of 60 come in 1 of 150 trials.


def test_two_steps_are_both_taken_out() -> None:
    time, heading, command = motion(3)
    damaged = time.copy()
    damaged[300:] -= 2.0
    damaged[700:] -= 0.5
    data, faults = examined(clock(damaged, heading=heading, fore=command))
    assert [round(fault.size or 0.0, 3) for fault in faults] == [-2.0, -0.5]
    assert [round(fault.at[0], 3) for fault in faults] == [29.9, 69.9]
    np.testing.assert_allclose(data.time, time, atol=1e-6)


@pytest.mark.parametrize("count", [1, 3, 8])
def test_messages_stored_late_are_no_step(count: int) -> None:
    time, heading, _ = motion(3, interval=0.05)
    order = np.arange(len(time))
    order[400 : 400 + 2 * count] = np.roll(order[400 : 400 + 2 * count], count)
    data = replace(clock(time[order], heading=heading[order]), sortable=True)
    assert examined(data)[1] == ()


@pytest.mark.parametrize("size", [-0.8, -30.0, 1.7e8])
def test_all_clocks_of_a_host_step_together(size: float, tmp_path: Path) -> None:
    stamps = np.where(TIME >= 10.0, TIME + size, TIME)
    sent = np.arange(0.02, 19.9, 0.2)
    changes = np.where(sent >= 10.0, sent + size, sent)
    trial = trial_of(tmp_path, heading=(stamps, HEADINGS[1]), fore=(changes, np.sin(sent)))
    steps = [fault for fault in trial.faults if fault.fault == "clock_step"]
    assert len(steps) == 1
    assert steps[0].size == pytest.approx(size, abs=0.01)
    assert "of log time" not in steps[0].text
    known = trial.time[trial.measured]
    np.testing.assert_allclose(known - known[-1], TIME[-len(known) :] - TIME[-1], atol=1e-6)
    at = np.searchsorted(sent, trial.time + 0.05 + 1e-6, side="right") - 1
    far = np.abs(trial.time - 9.95) > 0.3
    np.testing.assert_allclose(trial.commands[far, 0], np.sin(sent)[at][far], atol=0.05)


def test_a_step_of_the_commands_alone_names_their_clock(tmp_path: Path) -> None:
    sent = np.arange(0.0, 19.9, 0.1)
    trial = trial_of(tmp_path, heading=HEADINGS, fore=(np.where(sent > 8.0, sent - 0.5, sent), np.sin(sent)))
    (fault,) = [fault for fault in trial.faults if fault.fault == "clock_step"]
    assert "the clock of log time of /fore was set back by 0.50 s" in fault.text
