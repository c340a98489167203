from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.trial.rates import (
    ZeroPhaseFilter,
    _convolve,
    cell_averages,
    choose_cutoff,
    compute_rates,
    resample,
    white_noise,
)
from rovid.trial.trial import Trial

PERIOD = 0.05
TIME = np.arange(0.0, 300.0, PERIOD)


def trial(
    heading: FloatArray, time: FloatArray = TIME, *, roll: FloatArray | None = None, pitch: FloatArray | None = None
) -> Trial:
    commands = np.zeros((len(time), 1))
    return Trial(name="t", path=Path("t"), time=time, position=heading, commands=commands, roll=roll, pitch=pitch)


@pytest.mark.parametrize("cutoff", [0.2, 0.5, 2.0])
def test_filter_is_exact_on_ramp_and_parabola(cutoff: float) -> None:
    kernel = ZeroPhaseFilter.design(period=PERIOD, cutoff=cutoff)
    parabola = 0.3 * TIME**2 - 2.0 * TIME + 400.0
    inside = np.isfinite(kernel.rate(parabola))
    # Round-off of a heading of 27 000 rad, differentiated twice at 20 Hz.
    assert kernel.rate(parabola)[inside] == pytest.approx((0.6 * TIME - 2.0)[inside], abs=1e-7)
    assert kernel.acceleration(parabola)[inside] == pytest.approx(0.6, abs=1e-6)


def test_a_filter_is_a_convolution_whatever_the_length() -> None:
    kernel = np.array([0.25, 0.5, 0.25])
    for count in (3, 8, 23, 97, 1000, 1025):
        values = np.random.default_rng(count).normal(size=count)
        found = _convolve(values, kernel)
        np.testing.assert_allclose(found[1:-1], np.convolve(values, kernel, mode="valid"), atol=1e-12)
        assert np.isnan(found[[0, -1]]).all()


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0, 1.5])
def test_value_rate_and_acceleration_are_passed_alike(share: float) -> None:
    kernel = ZeroPhaseFilter.design(period=PERIOD, cutoff=1.0)
    omega = 2 * np.pi * share
    wave = np.exp(1j * omega * TIME)

    def gain(through: object) -> complex:
        assert callable(through)
        return complex(np.nanmean((through(wave.real) + 1j * through(wave.imag)) / wave))

    value = gain(kernel.smooth)
    # Eighth-order differences at a twentieth of the sampling rate, and no phase.
    assert gain(kernel.rate) / (1j * omega) == pytest.approx(value, rel=1e-5, abs=1e-8)
    assert -gain(kernel.acceleration) / omega**2 == pytest.approx(value, rel=1e-5, abs=1e-8)
    assert abs(value.imag) < 1e-12


def test_held_torque_keeps_step_with_the_heading_it_drives() -> None:
    # Acceleration equal to a held torque: exactly what a vehicle of inertia 1 without drag does.
    torque = np.sign(np.sin(2 * np.pi * TIME / 40.0))
    rate = np.concatenate(([0.0], np.cumsum(torque[:-1]) * PERIOD))
    heading = np.concatenate(([0.0], np.cumsum(rate[:-1] * PERIOD + 0.5 * torque[:-1] * PERIOD**2)))
    record = trial(heading)
    rates = compute_rates(record, cutoff=0.5)
    drive = rates.filter_held(record, torque)
    both = rates.valid & np.isfinite(drive)
    assert drive[both] == pytest.approx(rates.acceleration[both], abs=2e-3)  # a step sampled at 20 Hz


def test_stated_noise_is_the_noise_that_comes_out() -> None:
    sigma = np.deg2rad(0.01)
    noise = np.random.default_rng().normal(0.0, sigma, len(TIME))
    rates = compute_rates(trial(0.1 * TIME + noise), cutoff=1.0)
    assert rates.position_noise == pytest.approx(sigma, rel=0.1)  # 6000 samples, robust estimate
    assert np.nanstd(rates.rate) == pytest.approx(rates.rate_noise, rel=0.2)  # 300 s of noise of 1 Hz
    assert np.nanstd(rates.acceleration) == pytest.approx(rates.acceleration_noise, rel=0.2)


def test_a_gap_stays_a_gap() -> None:
    heading = 0.1 * TIME
    gap = (TIME > 100.0) & (TIME < 110.0)
    keep = ~gap
    record = trial(heading[keep], TIME[keep])
    rates = compute_rates(record, cutoff=0.5)
    inside = (rates.time > 100.0) & (rates.time < 110.0)
    assert not rates.valid[inside].any()
    assert rates.valid.sum() > 0.9 * keep.sum()
    assert np.nanmax(np.abs(rates.rate - 0.1)) < 1e-9


def test_jitter_does_not_shift_the_rate() -> None:
    rng = np.random.default_rng()
    jittered = np.sort(TIME + rng.uniform(-0.01, 0.01, len(TIME)))
    rates = compute_rates(trial(np.sin(0.3 * jittered), jittered), cutoff=1.0)
    expected = 0.3 * np.cos(0.3 * rates.time)
    # Linear interpolation over 50 ms of a wave of 0.09 rad/s^2 misses by 3e-5 rad, 1 Hz cut-off.
    assert np.nanmax(np.abs(rates.rate - expected)) < 3e-4


def test_tilt_turns_the_heading_rate_into_the_body_rate() -> None:
    body_rate, roll, pitch = 0.2, np.deg2rad(20.0), np.deg2rad(-15.0)
    # Constant tilt: psidot = r / (cos(phi) cos(theta)).
    heading = body_rate / (np.cos(roll) * np.cos(pitch)) * TIME
    tilted = trial(heading, roll=np.full(len(TIME), roll), pitch=np.full(len(TIME), pitch))
    rates = compute_rates(tilted, cutoff=0.5)
    assert np.nanmean(rates.rate) == pytest.approx(body_rate, rel=1e-9)


def test_moving_tilt_against_the_rotation_matrix() -> None:
    # Body rate from R^T dR/dt of the Euler rotation itself, not from the transform under test.
    roll, pitch = 0.3 * np.sin(0.2 * TIME), 0.2 * np.cos(0.15 * TIME)
    heading = 0.1 * TIME + 0.3 * np.sin(0.1 * TIME)
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_euler("ZYX", np.column_stack((heading, pitch, roll))).as_matrix()
    rate_matrix = np.einsum("nji,njk->nik", attitude, np.gradient(attitude, TIME, axis=0))
    rates = compute_rates(trial(heading, roll=roll, pitch=pitch), cutoff=2.0)
    inner = slice(100, -100)
    assert rates.rate[inner] == pytest.approx(rate_matrix[inner, 1, 0], abs=1e-4)  # second-order gradient


def test_cutoff_follows_the_noise() -> None:
    rng = np.random.default_rng(5)
    motion = 0.3 * np.sin(2 * np.pi * TIME / 10.0) + 0.05 * np.sin(2 * np.pi * TIME / 2.0)
    quiet, loud = (choose_cutoff([trial(motion + rng.normal(0, s, len(TIME)))]) for s in (1e-6, 3e-3))
    assert quiet > loud
    assert loud > 0.1


def test_cell_averages_of_a_held_signal_are_exact() -> None:
    time = np.array([0.0, 0.3, 0.4, 1.0, 2.0])
    values = np.array([1.0, 3.0, -1.0, 2.0, 9.0])
    # Around 0.5, half a second each way: 0.05 s of 1, 0.1 s of 3, 0.6 s of -1, over 0.75 s.
    assert cell_averages(time, values, np.array([0.5, 1.0]))[0] == pytest.approx((0.05 * 1 + 0.1 * 3 + 0.35 * -1) / 0.5)


def test_white_noise_ignores_motion_and_spikes() -> None:
    rng = np.random.default_rng()
    values = 0.2 * TIME + np.sin(TIME) + rng.normal(0, 1e-4, len(TIME))
    values[::100] += 0.1
    assert white_noise(values) == pytest.approx(1e-4, rel=0.15)  # 6000 samples, one in 100 bad


def test_a_trial_shorter_than_the_filter_is_refused() -> None:
    with pytest.raises(DataError, match="shorter than the filter"):
        compute_rates(trial(0.1 * TIME[:40], TIME[:40]), cutoff=0.1)


def test_resample_bridges_a_lost_sample_but_not_a_gap() -> None:
    keep = np.ones(len(TIME), dtype=bool)
    keep[50] = False
    keep[100:140] = False
    out = resample(trial(TIME[keep], TIME[keep]), TIME[keep], TIME)
    assert out[50] == pytest.approx(TIME[50])
    assert np.isnan(out[101:139]).all()
