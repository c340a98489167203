"""Holds, sines and releases of a trial."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from rovid.core.array_types import FloatArray
from rovid.trial.numba_loops import find_constant_runs, first_order_sum
from rovid.trial.segments import MIN_HOLD, Hold, SineRun, coarse_text, find_holds, find_sines, resolution
from tests.synthetic import LOGGED, VEHICLE, clock, trial


def test_a_run_ends_where_one_column_leaves_its_tolerance() -> None:
    values = np.array([[0.0, 5.0], [0.1, 5.0], [0.1, 6.0], [0.2, 6.0], [0.3, 6.0]])
    assert find_constant_runs(values, np.array([0.15, 0.5])).tolist() == [0.0, 2.0, 4.0]


def test_a_slow_ramp_is_no_single_run() -> None:
    ramp = np.linspace(0.0, 1.0, 101)[:, None]
    starts = find_constant_runs(ramp, np.array([0.1])).astype(int)
    assert len(starts) > 8
    for first, stop in zip(starts, [*starts[1:], len(ramp)], strict=True):
        assert np.ptp(ramp[first:stop]) <= 0.1


def test_a_constant_series_is_one_run() -> None:
    assert find_constant_runs(np.zeros((7, 2)), np.zeros(2)).tolist() == [0.0]


@pytest.mark.parametrize("fade", [0.0, 0.9, -0.5, 1.0])
@pytest.mark.parametrize("count", [0, 1, 500])
def test_the_first_order_sum_equals_lfilter(fade: float, count: int) -> None:
    values = np.random.default_rng().normal(size=count)
    wanted = lfilter([1.0], [1.0, -fade], values)
    np.testing.assert_allclose(first_order_sum(values, fade), wanted, rtol=1e-12, atol=1e-12)


CUTOFF = 0.75  # Hz


def steps(*pieces: tuple[float, float], rate: float = 20.0) -> FloatArray:
    """Piecewise constant command from (level, seconds) pairs."""
    return np.concatenate([*(np.full(round(seconds * rate), level) for level, seconds in pieces), [pieces[-1][0]]])


def holds(command: FloatArray, *, logged: bool = False) -> list[Hold]:
    log = trial(np.arange(len(command)) / 20.0, command)
    vehicle = LOGGED if logged else VEHICLE
    return find_holds(log, vehicle, vehicle.torque(log), CUTOFF)


def sines(torque: FloatArray, rate: float = 20.0) -> list[SineRun]:
    return find_sines(trial(np.arange(len(torque)) / rate, torque), torque)


def wave(amplitude: float, period: float, cycles: int, *, rate: float = 20.0, bias: float = 0.0) -> FloatArray:
    return np.asarray(bias + amplitude * np.sin(2.0 * np.pi * np.arange(round(period * cycles * rate)) / rate / period))


@pytest.mark.parametrize(
    ("pieces", "expected"),
    [
        (((1.0, 20.0),), [(0.0, 20.0, 1.0)]),
        (((1.0, 20.0), (-2.0, 30.0)), [(0.0, 20.0, 1.0), (20.0, 50.0, -2.0)]),
        (((0.0, 4.0), (1.5, 20.0), (0.0, 4.0)), [(4.0, 24.0, 1.5)]),
        (((1.0, MIN_HOLD / CUTOFF - 0.1), (2.0, 20.0)), [(7.9, 27.9, 2.0)]),
        (((1.0, 5.0), (2.0, 5.0), (3.0, 5.0)), []),
    ],
    ids=["one", "two", "between rests", "too short", "none"],
)
def test_holds_begin_and_end_with_their_command(
    pieces: tuple[tuple[float, float], ...], expected: list[tuple[float, float, float]]
) -> None:
    found = [(hold.start, hold.stop, float(hold.command[0])) for hold in holds(steps(*pieces))]
    assert found == [pytest.approx(row) for row in expected]


def test_a_12_bit_output_that_flickers_is_held_and_its_torque_unspoilt() -> None:
    rng = np.random.default_rng(seed := int(np.random.default_rng().integers(10**6)))
    print(f"seed {seed}")
    flicker = 20.0 / 4096 * rng.integers(-1, 2, 601)
    (hold,) = holds(np.asarray(1.5 + flicker, dtype=np.float64))
    assert hold.duration == pytest.approx(30.0)
    assert hold.torque == pytest.approx(150.0, abs=0.5)  # the median is within one bit, 0.49 N m


def test_a_ramp_is_no_hold() -> None:
    assert holds(clock(60.0) / 10.0 - 3.0) == []  # 0.1 V/s: within the tolerance of 0.05 V for half a second


def test_a_logged_torque_is_held_within_its_own_size() -> None:
    (hold,) = holds(np.concatenate((np.full(400, 100.0), np.full(401, 101.0))), logged=True)
    assert hold.duration == pytest.approx(40.0)
    assert len(holds(np.concatenate((np.full(400, 100.0), np.full(401, 110.0))), logged=True)) == 2


@pytest.mark.parametrize(
    ("torque", "expected"),
    [
        (wave(100.0, 20.0, 6), [(0.0, 6)]),
        (np.concatenate((np.zeros(80), wave(100.0, 20.0, 6), np.zeros(200))), [(4.0, 6)]),
        (np.concatenate((wave(100.0, 20.0, 5), wave(100.0, 40.0, 4))), [(0.0, 5), (100.0, 4)]),
        (np.concatenate((wave(100.0, 20.0, 5), wave(50.0, 20.0, 5))), [(0.0, 5), (100.0, 5)]),
    ],
    ids=["whole log", "between rests", "period changes", "amplitude changes"],
)
def test_sines_are_cut_to_whole_periods(torque: FloatArray, expected: list[tuple[float, int]]) -> None:
    found = [(run.start, run.cycles) for run in sines(torque)]
    assert [cycles for _, cycles in found] == [cycles for _, cycles in expected]
    # A crossing lies between two samples, and the torque of a sample that is zero belongs to neither side.
    assert [start for start, _ in found] == [pytest.approx(start, abs=0.11) for start, _ in expected]


@pytest.mark.parametrize("period", [3.0, 20.0, 160.0])
@pytest.mark.parametrize("rate", [5.0, 20.0, 100.0])
def test_period_and_amplitude_are_found_at_every_rate(period: float, rate: float) -> None:
    (run,) = sines(wave(70.0, period, 4, rate=rate), rate)
    assert run.period == pytest.approx(period, abs=1.0 / rate)
    assert run.amplitude == pytest.approx(70.0, rel=0.06)  # five samples a radian at the least miss the crest by that
    assert run.stop - run.start == pytest.approx(run.cycles * run.period)


@pytest.mark.parametrize(
    "torque",
    [
        np.tile(steps((100.0, 10.0), (-100.0, 10.0))[:-1], 6),
        wave(100.0, 20.0, 1),
        wave(100.0, 20.0, 6, bias=150.0),
        np.zeros(2000),
        np.full(2000, 100.0),
    ],
    ids=["square wave", "one period", "never reverses", "idle", "held"],
)
def test_other_waveforms_are_no_sine(torque: FloatArray) -> None:
    assert sines(torque) == []


def test_equal_volts_on_a_thruster_weaker_in_reverse_are_a_sine() -> None:
    # Thrust as the square beyond a dead zone of 0.3 V, 9.4 forward against 5.3 in reverse.
    volts = wave(1.5, 40.0, 5)
    beyond = np.maximum(np.abs(volts) - 0.3, 0.0) ** 2
    (run,) = sines(beyond * np.where(volts > 0.0, 9.4, -5.3))
    assert run.cycles == 5
    assert run.period == pytest.approx(40.0, abs=0.1)


def test_a_hold_may_follow_a_sine_in_one_log() -> None:
    torque = np.concatenate((wave(100.0, 20.0, 5), np.full(1200, 80.0), wave(100.0, 40.0, 5), np.full(1200, -80.0)))
    assert [run.cycles for run in sines(torque)] == [5, 5]
    assert [hold.torque for hold in holds(torque, logged=True)] == [80.0, -80.0]


def test_holds_of_a_long_sine_are_only_its_crests() -> None:
    # Within half a percent of the bench range the crest of a slow sine is held: it is for the trend test to refuse.
    log = trial(clock(640.0), np.append(wave(2.0, 160.0, 4), 0.0))
    for hold in find_holds(log, VEHICLE, VEHICLE.torque(log), CUTOFF):
        assert abs(hold.command[0]) > 1.9
        assert hold.duration < 13.0  # 2 acos(1 - 0.05/2)/w = 11.4 s


def test_the_step_of_rounded_readings() -> None:
    time = np.linspace(0.0, 60.0, 1201)
    angle = 40.0 * np.sin(0.2 * time)
    for step in (0.01, 1.0, 5.0):
        assert resolution(np.deg2rad(step * np.round(angle / step))) == pytest.approx(np.deg2rad(step))
    assert resolution(np.deg2rad(angle)) == 0.0
    assert resolution(np.ones(100)) == 0.0


def test_coarse_readings_are_named_unless_a_gyro_is_logged() -> None:
    time = np.linspace(0.0, 60.0, 1201)
    heading = np.deg2rad(5.0 * np.round(8.0 * np.sin(0.2 * time)))
    coarse, fine = trial(time, time, heading, name="a.csv"), trial(time, time, np.deg2rad(np.round(time)), name="b.csv")
    assert coarse_text([coarse, fine]) == "the heading of a.csv is rounded to steps of 5 deg"
    assert not coarse_text([replace(coarse, rate=np.ones(len(time))), fine])
