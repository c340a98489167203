"""Cleaning a heading: what is no measurement goes and is counted, what is one stays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.readers.cleaning import clean
from rovid.trial.trial import Remark

RNG = np.random.default_rng(3)


Cleaned = tuple[FloatArray, list[Remark]]


def cleaned(time: FloatArray, degrees: FloatArray) -> Cleaned:
    return clean(time, np.deg2rad(degrees))


def counts(done: Cleaned) -> dict[str, int]:
    return {remark.kind: remark.count for remark in done[1]}


def course(rates: Sequence[tuple[float, float]], interval: float, start: float = 10.0) -> tuple[FloatArray, FloatArray]:
    """(time, unwrapped deg) of (seconds, deg/s) pieces with hard starts and stops."""
    rate = np.concatenate([np.full(round(seconds / interval), value) for seconds, value in rates])
    return np.arange(len(rate) + 1.0) * interval, start + np.concatenate(([0.0], np.cumsum(rate * interval)))


FAST = [(5, 0), (3, 60), (5, 0), (2, -60), (0.4, 60), (3, -60), (5, 0), (0.3, 60), (4, 0), (20, 5), (10, -30), (5, 0)]
WRAPS = {
    "0..360": lambda psi: psi % 360.0,
    "-180..180": lambda psi: (psi + 180.0) % 360.0 - 180.0,
    "unwrapped": lambda psi: psi,
    "turned round": lambda psi: -psi % 360.0,
}


@pytest.mark.parametrize("wrapped", WRAPS)
@pytest.mark.parametrize("interval", [0.02, 0.05, 0.1, 0.2, 1.0])
@pytest.mark.parametrize("noise", [0.0, 0.01, 0.5])
@pytest.mark.parametrize("resolution", [0.0, 0.1])
def test_clean_data_lose_nothing(wrapped: str, interval: float, noise: float, resolution: float) -> None:
    """60 deg/s with hard starts and stops, at every usual rate, noise and rounding."""
    time, psi = course(FAST, interval)
    psi = psi + RNG.normal(0.0, noise, len(psi)) if noise else psi
    psi = np.round(psi / resolution) * resolution if resolution else psi
    done = cleaned(time, WRAPS[wrapped](psi))
    assert counts(done) == {}
    expected = -psi if wrapped == "turned round" else psi
    off = np.rad2deg(done[0]) - expected
    # whole turns at the start are free, and none is added later
    np.testing.assert_allclose(off, off[0], atol=1e-6)


@pytest.mark.parametrize("period", [0.4, 0.8, 2.0, 7.0])
@pytest.mark.parametrize("interval", [0.05, 0.1, 0.2])
def test_waves_lose_nothing(period: float, interval: float) -> None:
    """A burst of fast oscillation in a quiet log is motion, near the limit of the sampling too."""
    time = np.arange(0.0, 250.0, interval)
    phase = 2.0 * np.pi * (time - 50.0) / period
    psi = 90.0 + 3.0 * np.sin(phase) * ((phase > 0.0) & (phase < 40.0 * np.pi))
    assert counts(cleaned(time, psi)) == {}


@pytest.mark.parametrize("jitter", [0.2, 0.45])
def test_jittered_sampling_loses_nothing(jitter: float) -> None:
    time = np.arange(0.0, 60.0, 0.1)
    time[1:-1] += RNG.uniform(-jitter, jitter, len(time) - 2) * 0.1
    assert counts(cleaned(time, (60.0 * time) % 360.0)) == {}


def test_coarse_compass_at_rest_and_slowly_turning_loses_nothing() -> None:
    time, psi = course([(30, 0), (60, 0.3), (30, 0), (20, 8), (30, 0)], 0.05)
    assert counts(cleaned(time, np.round(psi + RNG.normal(0, 0.2, len(psi))) % 360)) == {}


@pytest.mark.parametrize("length", [1, 2, 3])
@pytest.mark.parametrize("size", [1.0, 5.0, 40.0, 170.0, -179.0, 200.0])
@pytest.mark.parametrize("rate", [0.0, 7.0, 60.0])
def test_spikes_go(length: int, size: float, rate: float) -> None:
    time, psi = course([(20, rate)], 0.05)
    psi = psi + RNG.normal(0.0, 0.01, len(psi))
    spiked = psi.copy()
    for at in (60, 150, 152 + length, 300):
        spiked[at : at + length] += size
    done = cleaned(time, spiked % 360.0)
    good = np.isfinite(done[0])
    assert counts(done)["outlier"] == (~good).sum() >= 4 * length
    assert (~good).sum() <= 5 * length + 2, "hardly any good sample went"
    off = np.rad2deg(done[0][good]) - psi[good]
    np.testing.assert_allclose(off, off[0], atol=1e-6)  # no false turn


def test_random_garbage_makes_no_false_turn() -> None:
    time, psi = course([(100, 9)], 0.05)
    spiked = psi.copy()
    at = RNG.choice(np.arange(5, 1990, 10), 60, replace=False)
    spiked[at] = RNG.uniform(0, 360, 60)
    done = cleaned(time, spiked % 360.0)
    good = np.isfinite(done[0])
    assert good.sum() >= 1930
    np.testing.assert_allclose(np.rad2deg(done[0][good]), psi[good], atol=0.6)


@pytest.mark.parametrize("end", ["first", "last"])
@pytest.mark.parametrize("length", [1, 3])
def test_spikes_at_the_ends_go(end: str, length: int) -> None:
    time, psi = course([(20, 7)], 0.05, start=100.0)
    psi = psi + RNG.normal(0.0, 0.01, len(psi))
    psi[:length] = 0.0 if end == "first" else psi[:length]
    psi[-length:] = 0.0 if end == "last" else psi[-length:]
    done = cleaned(time, psi)
    assert counts(done) == {"outlier": length}


@pytest.mark.parametrize("length", [2, 9, 50])
def test_zeros_before_the_first_fix_go(length: int) -> None:
    time, psi = course([(20, 7)], 0.05, start=100.0)
    psi[:length] = 0.0
    done = cleaned(time, psi)
    assert np.isnan(done[0][:length]).all()
    assert np.isfinite(done[0][length:]).all()


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_frozen_stretch_goes(noise: float) -> None:
    time, psi = course([(10, 0), (30, 9), (10, 0)], 0.05)
    psi = psi + RNG.normal(0.0, noise, len(psi))
    frozen = psi.copy()
    frozen[300:360] = frozen[300]
    done = cleaned(time, frozen % 360.0)
    assert counts(done)["frozen"] == 59
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(done[0])), np.arange(301, 360))
    off = np.rad2deg(done[0]) - psi
    np.testing.assert_allclose(off[np.isfinite(off)], 0.0, atol=1e-6)


def test_a_dropout_to_one_value_goes() -> None:
    time, psi = course([(40, 9)], 0.05)
    psi[200:207] = -1.0
    done = cleaned(time, psi % 360.0)
    assert np.isnan(done[0][200:207]).all()
    assert np.isfinite(np.delete(done[0], np.arange(200, 207))).all()


@pytest.mark.parametrize("held", [2, 3, 5])
def test_held_repeats_go(held: int) -> None:
    time, psi = course([(10, 0), (60, 9), (10, 0), (30, -4)], 0.05)
    slow = np.round(psi + RNG.normal(0.0, 0.01, len(psi)), 3)[::held]
    logged = np.repeat(slow, held)[: len(time)]
    done = cleaned(time[: len(logged)], logged % 360.0)
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(done[0])), np.arange(0, len(logged), held))
    assert counts(done)["repeated"] == len(logged) - len(range(0, len(logged), held))


def test_held_repeats_of_an_uneven_ratio_go() -> None:
    """100 Hz of rows, 30 Hz of sensor: runs of three and four."""
    rows = np.arange(0.0, 60.0, 0.01)
    reading = np.floor(rows * 30.0 + 1e-9)
    psi = 20.0 + 9.0 * reading / 30.0 + RNG.normal(0.0, 0.01, 2000)[reading.astype(int)]
    done = cleaned(rows, psi % 360.0)
    first = np.concatenate(([True], np.diff(reading) > 0))
    np.testing.assert_array_equal(np.isfinite(done[0]), first)


def test_gaps_are_left_open() -> None:
    time, psi = course([(60, 9)], 0.05)
    keep = np.ones(len(time), dtype=bool)
    keep[200:300] = keep[700:716] = False
    done = cleaned(time[keep], psi[keep] % 360.0)
    assert not done[1]
    np.testing.assert_allclose(np.rad2deg(done[0]), psi[keep], atol=1e-6)


@pytest.mark.parametrize("rate", [25.0, -60.0])
@pytest.mark.parametrize("seconds", [8, 30])
def test_whole_turns_in_a_gap_follow_the_rate(rate: float, seconds: int) -> None:
    time, psi = course([(20, rate), (seconds, rate), (20, rate)], 0.05)
    psi = psi + RNG.normal(0.0, 0.01, len(psi))
    keep = (time < 20.0) | (time > 20.0 + seconds)
    done = cleaned(time[keep], psi[keep] % 360.0)
    off = np.rad2deg(done[0]) - psi[keep]
    np.testing.assert_allclose(off, off[0], atol=1e-6)


def test_turns_that_nobody_can_know_are_said() -> None:
    time, psi = course([(20, 30), (30, 30), (20, -5)], 0.05)
    keep = (time < 20.0) | (time > 50.0)
    done = cleaned(time[keep], psi[keep] % 360.0)
    assert "not certain" in done[1][0].text


def test_an_unwrapped_log_is_believed_across_a_gap() -> None:
    time, psi = course([(40, 9), (60, 30), (40, -5)], 0.05)
    keep = (time < 40.0) | (time > 100.0)
    done = cleaned(time[keep], psi[keep])
    np.testing.assert_allclose(np.rad2deg(done[0]), psi[keep], atol=1e-6)


def test_noise_at_the_wrap_makes_no_turn() -> None:
    time = np.arange(0.0, 60.0, 0.05)
    psi = RNG.normal(0.0, 0.3, len(time))
    done = cleaned(time, psi % 360.0)
    assert counts(done) == {}
    assert np.ptp(done[0]) < 0.1


def test_a_sensor_that_dies_is_left_out_to_the_end() -> None:
    time, psi = course([(5, 0), (10, 8), (5, 0), (10, -5)], 0.1)
    noisy = psi + RNG.normal(0.0, 0.02, len(psi))
    dead = np.where(time < time[-1] - 4.0, noisy, 0.0)
    done = cleaned(time, dead)
    assert np.isnan(done[0][time > time[-1] - 3.95]).all()
    assert np.isfinite(done[0][time < time[-1] - 4.05]).all()
    assert counts(done) == {"frozen": int(np.sum(dead == 0.0))}
    # A vehicle that stops is none.
    assert counts(cleaned(*course([(10, 8), (5, 0)], 0.1))) == {}


def test_the_value_of_dropouts_is_left_out_where_the_path_is_near_it() -> None:
    """A sensor that sends 0 for no reading does so near north, too, by less than a vehicle can move at 2 Hz."""
    time, path = course([(80, 4), (40, -3), (80, 5)], 0.5)
    degrees = np.round((path + RNG.normal(0.0, 0.05, len(path))) % 360.0, 2)
    lost = RNG.choice(np.arange(5, len(time) - 5), 12, replace=False)
    near = np.flatnonzero(np.abs((path + 180.0) % 360.0 - 180.0 - 3.0) < 1.0)[:2]
    degrees[[*lost, *near]] = 0.0
    position, remarks = cleaned(time, degrees)
    assert np.isnan(position[near]).all()
    assert {remark.kind for remark in remarks} == {"outlier"}
    measured = np.isfinite(position)
    np.testing.assert_allclose(np.rad2deg(position)[measured], path[measured], atol=0.5)
