"""Readings in packs, stamped on arrival."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray, IntArray
from tests.faults.clocks import clock, examined, motion


def packs(time: FloatArray, lasts: IntArray, within: float) -> FloatArray:
    """Stamps of readings that are sent with the last one of their pack, ``within`` s apart."""
    rows = np.arange(len(time))
    pack = np.searchsorted(lasts, rows)
    begins = np.concatenate(([-1], lasts[:-1]))
    return time[lasts[pack]] + within * (rows - begins[pack] - 1)


@pytest.mark.parametrize("size", [3, 5, 12, 20])
@pytest.mark.parametrize("interval", [0.01, 0.1, 0.5])
@pytest.mark.parametrize("share", [0.0, 0.02])
def test_packs_are_spread(size: int, interval: float, share: float) -> None:
    time, heading, command = motion(1, interval=interval)
    lasts = np.append(np.arange(size - 1, len(time) - 1, size), len(time) - 1)
    stamps = packs(time, lasts, share * interval)
    data, (fault,) = examined(clock(stamps, heading=heading, fore=command))
    assert fault.fault == "arrival_bursts"
    assert f"packs of {size} readings" in fault.text
    assert fault.size is not None
    assert fault.standard_error is not None
    assert abs(fault.size - interval) < 4.0 * fault.standard_error
    np.testing.assert_allclose(np.diff(data.time), interval, rtol=0.02)
    np.testing.assert_allclose(data.time, time, atol=0.02 * interval)


@pytest.mark.parametrize("seed", range(5))
def test_packs_of_changing_length_that_arrive_late(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time, heading, command = motion(seed)
    lasts = np.cumsum(rng.integers(4, 8, 300)) - 1
    lasts = np.append(lasts[lasts < len(time) - 1], len(time) - 1)
    stamps = packs(time, lasts, 1e-3) + np.repeat(rng.uniform(0.0, 0.05, len(lasts)), np.diff(lasts, prepend=-1))
    data, (fault,) = examined(clock(stamps, heading=heading, fore=command))
    assert fault.fault == "arrival_bursts"
    # One common delay stays: all readings have it.
    error = data.time - time
    assert np.std(error) < 0.02


def test_a_command_sent_three_times_at_each_step_is_no_pack() -> None:
    stamps = np.repeat(np.arange(100) * 4.0, 3) + np.tile([0.0, 0.01, 0.02], 100)
    command = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, 100), 3)
    assert examined(clock(stamps, fore=command))[1] == ()


def test_packs_of_an_irregular_sensor_are_not_spread() -> None:
    rng = np.random.default_rng(1)
    stamps = np.repeat(np.cumsum(rng.uniform(0.05, 3.0, 200)), 4) + np.tile(np.arange(4) * 1e-3, 200)
    _, heading, _ = motion(1, count=800)
    assert examined(clock(stamps, heading=heading))[1] == ()
