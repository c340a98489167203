"""Single stamps far from their neighbours."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from tests.faults.clocks import clock, examined, motion
from tests.readers.channels import HEADING, TIME, trial_of

WILD: dict[str, tuple[list[int], FloatArray]] = {
    "far ahead": ([200], np.array([4294947.0])),
    "a little ahead": ([200], np.array([0.7])),
    "behind": ([300], np.array([-20.0])),
    "three in a row": ([50, 51, 52], np.array([-1.0, -1.0, -1.0])),
    "two places": ([50, 900], np.array([1e6, -1e6])),
    "first ahead": ([0], np.array([5.0])),
    "last ahead by years": ([-1], np.array([1e8])),
    "last behind": ([-1], np.array([-3.0])),
}


@pytest.mark.parametrize("case", WILD)
@pytest.mark.parametrize("interval", [0.02, 0.1, 1.0])
def test_wild_stamps_are_left_out(case: str, interval: float) -> None:
    rows, offsets = WILD[case]
    time, heading, command = motion(1, interval=interval)
    damaged = time.copy()
    damaged[rows] += offsets * interval / 0.1
    data, (fault,) = examined(clock(damaged, heading=heading, fore=command))
    good = np.delete(np.arange(len(time)), rows)
    np.testing.assert_array_equal(data.rows, good)
    np.testing.assert_array_equal(data.time, time[good])
    assert (fault.fault, fault.remedy, len(fault.at)) == ("wild_stamp", "left_out", len(rows))
    assert fault.size is not None
    assert fault.standard_error is not None
    worst = float(damaged[rows][np.argmax(np.abs(offsets))] - time[rows][np.argmax(np.abs(offsets))])
    assert abs(fault.size - worst) < 4.0 * fault.standard_error
    np.testing.assert_allclose(np.sort(fault.at), np.sort(time[rows]), atol=3.0 * interval)


@pytest.mark.parametrize("count", [1, 5])
@pytest.mark.parametrize("epoch", [0.0, 946684800.0])
def test_stamps_before_the_clock_was_set_are_left_out(epoch: float, count: int) -> None:
    time, heading, command = motion(1)
    damaged = 1.77e9 + time
    damaged[:count] = epoch + time[:count]
    data, (fault,) = examined(clock(damaged, heading=heading, fore=command))
    assert fault.fault == "wild_stamp"
    np.testing.assert_array_equal(data.rows, np.arange(count, len(time)))


@pytest.mark.parametrize(("count", "found"), [(1, ["wild_stamp"]), (2, ["lost_rows"])])
def test_a_single_stamp_of_zero_is_no_test_before_a_pause(count: int, found: list[str]) -> None:
    time, heading, command = motion(1)
    damaged = time + np.where(np.arange(len(time)) < count, 0.0, 35.0) - time[0]
    data, faults = examined(clock(damaged, heading=heading, fore=command))
    assert [fault.fault for fault in faults] == found
    assert len(data.time) == len(time) - (found == ["wild_stamp"])


def test_a_single_negative_stamp_is_no_test_before_a_pause() -> None:
    time, heading, command = motion(1)
    time[0] = -1000.0
    data, (fault,) = examined(clock(time, heading=heading, fore=command))
    assert (fault.fault, len(data.time)) == ("wild_stamp", len(time) - 1)


@pytest.mark.parametrize("interval", [0.02, 0.1, 1.0])
@pytest.mark.parametrize("step", [0.3, 0.5, 1.0, 2.5, 30.0])
def test_a_clock_set_back_is_not_wild(step: float, interval: float) -> None:
    time, heading, command = motion(1, interval=interval)
    time[500:] -= step
    _, faults = examined(clock(time, heading=heading, fore=command))
    assert not [fault for fault in faults if fault.fault == "wild_stamp"]


@pytest.mark.parametrize("seed", range(5))
def test_messages_stored_late_are_not_wild(seed: int) -> None:
    time, heading, _ = motion(seed)
    order = np.argsort(np.arange(len(time)) + np.random.default_rng(seed).uniform(0.0, 4.0, len(time)))
    data = replace(clock(time[order], heading=heading[order]), sortable=True)
    assert examined(data)[1] == ()


def test_an_inserted_message_is_left_out(tmp_path: Path) -> None:
    time, heading = np.insert(TIME, 201, 5e11), np.insert(HEADING % 360.0, 201, 17.0)
    trial = trial_of(tmp_path, heading=(time, heading), fore=([0.0], [1.0]))
    assert [fault.fault for fault in trial.faults] == ["wild_stamp"]
    assert "at message 202" in trial.faults[0].text
    np.testing.assert_array_equal(trial.time[trial.measured], TIME)
