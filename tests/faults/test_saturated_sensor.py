"""Readings clipped at a bound."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.faults.base import SignalData
from rovid.faults.saturated_sensor import DETECTORS
from tests.conftest import slow
from tests.faults.drives import drives, found, undamaged


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_clipped_heading_is_left_out(seed: int, tmp_path: Path) -> None:
    drive = dict(drives(seed, noise=0.05))["sine 0.5"]
    heading = drive.heading % 360.0
    bound = float(np.percentile(heading, 70.0))
    trial = drive.trial(tmp_path, heading=np.minimum(heading, bound))
    (fault,) = found(trial, "saturated_sensor")
    assert fault.size == pytest.approx(np.deg2rad(bound), abs=1e-5)
    assert trial.measured.sum() == np.count_nonzero(heading < np.round(bound, 4))
    assert not found(trial, "heading_gaps")  # They were logged.


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_clipped_rate_is_left_out(side: float) -> None:
    time: FloatArray = np.linspace(0.0, 99.95, 2000)
    rate = 2.0 * np.sin(time / 3.0) + np.random.default_rng(4).normal(0.0, 0.01, 2000)
    clipped = side * np.minimum(side * rate, 1.5)
    data = SignalData(log="a", name="yaw rate", time=time, values=clipped, period=np.inf, unit="rad/s")
    (detection,) = DETECTORS["signal"][0](data)
    assert len(detection.repair(data).time) == np.count_nonzero(side * rate < 1.5)
    assert "85.9437 deg/s" in detection.fault.text


def test_a_rate_clipped_on_both_sides_is_left_out() -> None:
    time: FloatArray = np.linspace(0.0, 99.95, 2000)
    rate = 2.0 * np.sin(time / 3.0) + np.random.default_rng(4).normal(0.0, 0.01, 2000)
    data = SignalData(log="a", name="yaw rate", time=time, values=rate.clip(-1.5, 1.5), period=np.inf, unit="rad/s")
    above, below = DETECTORS["signal"][0](data)
    assert (above.fault.size, below.fault.size) == (1.5, -1.5)


@pytest.mark.parametrize("seed", [5, slow(6), slow(7)])
def test_undamaged_logs_are_not_clipped(seed: int, tmp_path: Path) -> None:
    assert not [name for name, trial in undamaged(seed, tmp_path) if found(trial, "saturated_sensor")]


def test_a_frozen_sensor_is_not_clipped(tmp_path: Path) -> None:
    drive = dict(drives(9))["sine 5.0"]
    heading = drive.heading - drive.heading.min() + 10.0
    heading[300:340] = heading[300]
    assert not found(drive.trial(tmp_path, heading=heading), "saturated_sensor")


def test_a_rate_clipped_once_on_each_side_at_the_same_limit_is_left_out() -> None:
    """A turn to starboard and a turn to port: half of the readings repeat the one before."""
    time: FloatArray = np.linspace(0.0, 59.95, 1200)
    rate = 2.0 * np.sin(time * 2.0 * np.pi / 60.0) + np.random.default_rng(4).normal(0.0, 0.01, 1200)
    data = SignalData(log="a", name="yaw rate", time=time, values=rate.clip(-0.9, 0.9), period=np.inf, unit="rad/s")
    assert [detection.fault.size for detection in DETECTORS["signal"][0](data)] == [0.9, -0.9]


def _coarse(*, clipped: bool, settling: float = 3.0, step: float = 0.1) -> list[float | None]:
    """Bounds that are found in a heading with a resolution of ``step`` in deg; it turns and rests both ways."""
    time: FloatArray = np.arange(0.0, 120.0, 0.2)
    target = np.select([time < 5.0, time < 35.0, time < 60.0, time < 95.0], [0.0, 4.0, 0.0, -4.0], 0.0)
    rate = np.zeros(len(time))
    for k in range(1, len(time)):
        rate[k] = target[k] + (rate[k - 1] - target[k]) * np.exp(-0.2 / settling)
    heading = np.cumsum(0.2 * rate) + np.random.default_rng(3).normal(0.0, 0.02, len(time))
    values = np.round(np.minimum(heading, 60.0) if clipped else heading, 1) if step == 0.1 else np.round(heading)
    data = SignalData(log="a", name="heading", time=time, values=np.deg2rad(values), period=2.0 * np.pi, unit="rad")
    return [detection.fault.size for detection in DETECTORS["signal"][0](data)]


def test_a_coarse_heading_that_stops_within_a_reading_is_clipped() -> None:
    assert _coarse(clipped=True) == [pytest.approx(np.deg2rad(60.0))]


@pytest.mark.parametrize("settling", [0.05, 0.5, 3.0])
@pytest.mark.parametrize("step", [0.1, 1.0])
def test_a_coarse_heading_at_rest_is_not_clipped(settling: float, step: float) -> None:
    """Also where the vehicle is faster than the readings, and stops within one."""
    assert not _coarse(clipped=False, settling=settling, step=step)
