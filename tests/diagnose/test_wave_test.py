"""Gain of waves that its scatter over time supports."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from rovid.diagnose import wave_test
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.wave_test import PowerOfWaves, WaveTest, power_of_waves, run_wave_test, supported_gain
from rovid.effects.catalogue import CATALOGUE
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.trial.axis import YAW
from rovid.trial.preprocessing import Run
from tests.synthetic import LOGGED, ROSUB, clock, gauss_markov, run

WAVES = next(effect for effect in CATALOGUE if effect.is_wave)


def hump_beside(*kinds: str) -> WaveTest:
    """Test for waves in levels of thrust, next to a broad disturbance and a kind of narrow-band torque in each log."""
    rng, time, logs = np.random.default_rng(4), clock(400.0, 5.0), list[Run]()
    for kind in kinds:
        torque = 230.0 * rng.choice([-1.0, 0.0, 1.0], 41)[(time // 10.0).astype(int)]
        disturbance = gauss_markov(len(time), 0.2, 5.0, 20.0, rng)
        if kind in {"waves", "stall", "swing"}:
            drive = np.abs(torque) if kind == "stall" else np.ones(len(time))
            kicks = torque if kind == "swing" else drive * rng.normal(0.0, 1.0, len(time))
            wave = lfilter([1.0], [1.0, -1.94 * np.cos(0.2 * 1.5), 0.9409], kicks)
            disturbance += 30.0 * wave / np.std(wave)
        log = run(time, torque, disturbance=disturbance, noise=rng.normal(0.0, np.deg2rad(0.3), len(time)))
        if kind == "filtered heading":
            share = -np.expm1(-0.2 / 1.0)
            rest = (1.0 - share) * log.trial.position[:1]
            heading = lfilter([share], [1.0, share - 1.0], log.trial.position, zi=rest)[0]
            log = replace(log, trial=replace(log.trial, position=heading))
        logs.append(replace(log, trial=replace(log.trial, name=f"log {len(logs)}")))
    data = InnovationData(logs, LOGGED, ROSUB)
    objective = InnovationLikelihood(data, 0.05)
    beside = FitResult.at(objective, objective.parametrization.initial())
    return run_wave_test(data, beside, WAVES, ())


def test_what_shows_in_one_of_two_logs_is_no_wave() -> None:
    assert hump_beside("waves", "calm").fitted is None


def test_the_noise_of_a_filtered_heading_is_no_wave() -> None:
    assert hump_beside("filtered heading").fitted is None


def test_what_the_thrust_makes_swing_is_no_wave() -> None:
    assert hump_beside("swing", "swing").fitted is None


@pytest.mark.parametrize("kind", ["waves", "stall"])
def test_noise_that_thrust_makes_is_no_wave(kind: str) -> None:
    found = hump_beside(kind)
    assert found.fitted is not None
    power = power_of_waves(found.fitted)
    assert (power.beside > 4.8) == (power.drive > power.heading + 4.8) == (kind == "stall")
    assert found.is_broad == (kind == "stall")


@pytest.mark.parametrize(
    ("damping", "error", "rate", "heading", "is_broad"),
    [
        (0.05, 0.02, 0.0, 0.0, False),
        (0.25, 0.02, 0.0, 0.0, False),
        (0.3, 0.1, 0.0, 9.0, False),
        (0.3, 0.1, 0.0, 0.0, True),
        (0.36, 0.04, 0.0, 9.0, True),
        # A turn at half of their frequency widens the band of waves: 0.56. Then their power depends on the heading.
        (0.36, 0.04, 0.6, 9.0, False),
        (0.36, 0.04, 0.6, 0.0, True),
        (0.7, 0.04, 0.6, 9.0, True),
    ],
)
def test_a_band_wider_than_that_of_a_sea_is_no_wave(
    damping: float, error: float, rate: float, heading: float, is_broad: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = SimpleNamespace(names=("wave_torque.damping",), wave_parameters=np.array([1.0, 1.2, damping]))
    data = SimpleNamespace(scales=SimpleNamespace(rate=rate), axis=YAW)
    fitted: Any = SimpleNamespace(
        model=model, data=data, effects=(WAVES,), is_white=True, covariance=lambda **_: np.array([[error**2]])
    )
    monkeypatch.setattr(WaveTest, "held_out_gain", 60.0)
    monkeypatch.setattr(wave_test, "power_of_waves", lambda _: PowerOfWaves(heading=heading, drive=0.0, beside=0.0))
    tested = WaveTest(fitted, (), fitted=fitted, bic_gain=30.0)
    assert tested.is_broad == is_broad
    assert not replace(tested, bic_gain=3.0).is_broad
    assert (tested.probability < THRESHOLDS.likely) == is_broad


def test_a_gain_that_never_scatters_is_supported_far_beyond_one_that_does() -> None:
    steady = np.tile([0.9, 1.1], 50)
    rare = np.zeros(100)
    rare[40] = 100.0
    assert supported_gain(steady) > 100.0
    assert supported_gain(rare) == pytest.approx(0.5, abs=0.05)
    assert supported_gain(-steady) < -100.0


@pytest.mark.parametrize("autocorrelation", [0.0, 0.5, -0.3])
def test_chance_gains_support_as_much_as_theory_says(autocorrelation: float) -> None:
    """Twice the supported gain of gains with the mean 0 follows chi-square with one degree of freedom: mean 1."""
    random = np.random.default_rng(1)
    supported = []
    for _ in range(2000):
        gains = random.standard_normal(150)
        for at in range(1, len(gains)):
            gains[at] += autocorrelation * gains[at - 1]
        supported.append(abs(supported_gain(gains)))
    mean = 2.0 * float(np.mean(supported))
    # Negative autocorrelation is not used, so less is supported than could be.
    assert mean < 1.35
    assert mean > 0.85 or autocorrelation < 0.0


def test_correlated_gains_support_no_more_than_their_longer_blocks() -> None:
    """Each gain four times in a row is no more evidence than one gain."""
    once = np.random.default_rng(2).standard_normal(60) + 1.0
    in_long_blocks, repeated = supported_gain(once), supported_gain(np.repeat(once, 4) / 4.0)
    assert in_long_blocks == pytest.approx(0.5 * 60 * math.log1p(once.sum() ** 2 / (60 * 60 * once.var(ddof=1))), 0.2)
    assert repeated < 1.5 * in_long_blocks


@pytest.mark.parametrize("gains", [[], [3.0]])
def test_fewer_than_two_blocks_support_nothing(gains: list[float]) -> None:
    assert supported_gain(np.array(gains)) == 0.0
