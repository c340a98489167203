"""Prepared runs: a common filter, and remarks on trials that are left out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, DataError
from rovid.trial.preprocessing import prepare, shared_channels
from rovid.trial.trial import Campaign, Trial
from tests import synthetic

TIME = synthetic.clock(120.0)
TORQUE = np.where(TIME < 60.0, 100.0, -100.0)


def turning(gain: float = 1.0, offset: float = 0.0, **extras: FloatArray) -> Trial:
    """A log of a turn one way and the other, with a gain and an offset (rad/s) of the gyro."""
    run = synthetic.run(TIME, TORQUE)
    gyro = gain * np.gradient(run.trial.position, TIME) + offset
    return replace(run.trial, rate=gyro, extras=extras)


def campaign(*trials: Trial) -> Campaign:
    return Campaign(trials=trials, sources=(Path(),))


def test_torque_and_rate_go_through_one_filter() -> None:
    runs = prepare(campaign(turning()), synthetic.LOGGED, cutoff=1.0)
    run = runs.items[0]
    assert (runs.cutoff, runs.chosen, runs.remarks) == (1.0, False, ())
    assert run.filtered_torque.shape == run.rates.rate.shape
    model, rates = synthetic.ROSUB, run.rates
    balance = model.inertia * rates.acceleration + model.drag(rates.rate) - run.filtered_torque
    # But for what the drag's bend makes of the low pass where the torque changes.
    assert np.abs(balance[run.valid]).max() < 1.0


def test_a_cutoff_beyond_the_sampling_rate_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"--cutoff: is 50 Hz; .* up to"):
        prepare(campaign(turning()), synthetic.LOGGED, cutoff=50.0)


def test_a_trial_too_short_for_the_filter_is_left_out_with_a_remark() -> None:
    short = synthetic.trial(TIME[:20], TORQUE[:20], name="short")
    runs = prepare(campaign(turning(), short), synthetic.LOGGED, cutoff=0.2)
    assert len(runs.items) == 1
    assert [remark.kind for remark in runs.remarks] == ["left out"]
    with pytest.raises(DataError, match="short"):
        prepare(campaign(short), synthetic.LOGGED, cutoff=0.2)


def test_a_gyro_that_is_off_gives_a_remark() -> None:
    assert not prepare(campaign(turning()), synthetic.LOGGED).remarks
    for off in (turning(gain=1.1), turning(offset=0.01)):
        (remark,) = prepare(campaign(off), synthetic.LOGGED).remarks
        assert remark.kind == "gyro"
        assert "Check its unit and sign" in remark.text


def test_the_noise_of_a_heading_is_no_scale_of_the_gyro() -> None:
    rng = np.random.default_rng(5)
    run = turning()
    noisy = replace(run, position=run.position + 0.06 * rng.standard_normal(len(TIME)))
    runs = prepare(campaign(noisy), synthetic.LOGGED, cutoff=1.0)
    assert runs.items[0].rates.gyro_gain == pytest.approx(1.0, abs=0.03)
    assert not runs.remarks


def test_a_shared_channel_is_in_every_trial_and_has_readings() -> None:
    some, none = np.ones(len(TIME)), np.full(len(TIME), np.nan)
    runs = prepare(campaign(turning(a=some, b=none, c=some), turning(a=none, b=none)), synthetic.LOGGED)
    assert shared_channels(runs.items) == {"a"}
