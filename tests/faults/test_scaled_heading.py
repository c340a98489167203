"""A heading of another scale, and a gyro that contradicts the heading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.faults.base import RunsData, SignalData, examine
from rovid.faults.scaled_heading import DETECTORS
from rovid.trial.fault import Fault, FaultOverrides
from tests.faults.days import day
from tests.synthetic import LOGGED

TURN = 2.0 * np.pi


def faults(values: FloatArray, interval: float = 0.1) -> tuple[Fault, ...]:
    time = interval * np.arange(len(values), dtype=np.float64)
    data = SignalData(log="a.csv", name="heading", time=time, values=values, period=TURN, unit="rad")
    return examine(DETECTORS["signal"], data, FaultOverrides())[1]


def turning(rng: np.random.Generator, rate: float = 0.3, count: int = 2000) -> FloatArray:
    """(n,) rad, unwrapped: a turn of about ``rate`` rad/s at 10 Hz, with noise and rounding to 0.1 deg."""
    speed = rate * (1.0 + 0.3 * np.sin(np.arange(count) / 90.0))
    noisy = rng.uniform(0.0, TURN) + np.cumsum(0.1 * speed) + rng.normal(0.0, 2e-4, count)
    return np.asarray(np.deg2rad(np.round(np.rad2deg(noisy), 1)))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("rate", [0.1, -0.8])
@pytest.mark.parametrize("scale", [0.5, 400 / 360, 1 / 360, 2.0, 0.9])
@pytest.mark.parametrize("centre", [0.0, 0.5 * TURN])
def test_another_period_is_named_and_stops(scale: float, rate: float, centre: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    (fault,) = faults(scale * (np.mod(turning(rng, rate, 6000), TURN) - centre))
    assert fault.stops
    assert fault.size == pytest.approx(scale, rel=0.01)
    assert fault.logs == ("a.csv",)


@pytest.mark.parametrize("scale", [100.0, 65536 / 360])
def test_one_wrap_of_a_known_count_is_enough(scale: float) -> None:
    """As of MAVLink, in hundredths of a degree, or of a sensor with 16 bits."""
    (fault,) = faults(scale * np.mod(turning(np.random.default_rng(6), 0.03, 2200), TURN))
    assert fault.stops
    assert fault.size == pytest.approx(scale, rel=0.01)
    assert ('unit = "0.01 deg"' in fault.text) == (scale == 100.0)


@pytest.mark.parametrize("begin", [0.0, -0.25 * TURN])
def test_one_wrap_between_the_ends_of_a_half_turn_is_enough(begin: float) -> None:
    """Short logs wrap once. A sensor that resets by half a turn does it anywhere."""
    heading = turning(np.random.default_rng(2), 0.02)
    once = heading - heading[1000]
    (fault,) = faults(np.mod(1.7 * once, TURN) * 0.5 + begin)
    assert fault.size == pytest.approx(0.5, rel=0.01)
    assert not faults(np.where(np.arange(len(once)) < 1000, once, once + 0.5 * TURN) + 1.0)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("rate", [0.0, 0.1, -0.8, 8.0])
def test_a_heading_gives_nothing(rate: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    heading = turning(rng, rate)
    assert not faults(np.mod(heading, TURN))
    assert not faults(np.mod(heading, TURN) - 0.5 * TURN)
    assert not faults(np.mod(heading[::10], TURN), interval=1.0)
    # A swing, with spikes to zero and with a step.
    swing = 1.0 + 0.5 * np.sin(np.arange(2000) / 50.0)
    assert not faults(np.where(rng.uniform(size=2000) < 0.003, 0.0, swing))
    assert not faults(swing + np.where(np.arange(2000) > 700, 2.0, 0.0))


def test_a_clipped_heading_is_no_scaled_one() -> None:
    assert not faults(np.minimum(np.mod(turning(np.random.default_rng(0)), TURN), 0.5 * TURN))


@pytest.mark.parametrize(("gain", "found"), [(0.5, 1), (57.3, 1), (1.3, 1), (1.05, 0), (1.0, 0)])
def test_a_gyro_of_another_scale_stops(gain: float, found: int) -> None:
    runs = day("large", 0)
    runs = [replace(run, rates=replace(run.rates, gyro_gain=gain * (1.0 + 0.01 * k))) for k, run in enumerate(runs)]
    every = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())[1]
    assert len(every) == found
    assert all(fault.stops and fault.size == pytest.approx(gain, rel=0.1) for fault in every)
    assert not examine(DETECTORS["runs"], RunsData(runs=day("large", 0), vehicle=LOGGED), FaultOverrides())[1]
