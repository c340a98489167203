"""Torque inputs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from rovid.effects.base import SPEEDS
from rovid.model.torque_input import Intervals, TorqueInput

TIME = np.array([0.0, 0.1, 0.3, 0.4, 0.8, 1.0, 1.3])
AT = np.array([0, 2, 4, 6])
STEPS = Intervals.from_times([TIME], [AT])


def test_a_held_torque_has_no_timing_moment_and_no_effect_inputs() -> None:
    drive = TorqueInput.held(np.ones(7))
    assert not drive.timing_moment.any()
    assert drive.effect_inputs.shape == (7, 1 + len(SPEEDS))


def test_averaging_preserves_impulse_and_moment() -> None:
    torque = np.array([1.0, -2.0, 5.0, 0.5, 3.0, 4.0, 7.0])
    coarse = TorqueInput.averaged_over(STEPS, torque)
    spans = np.diff(TIME[AT])
    impulse = [np.sum((torque[:-1] * np.diff(TIME))[a:b]) for a, b in itertools.pairwise(AT)]
    assert coarse.torque[:-1] * spans == pytest.approx(impulse)
    # Rate and angle of a unit inertia from rest, by each: the angle feels when within an interval the torque acted.
    for drive, time in ((TorqueInput.held(torque), TIME), (coarse, TIME[AT])):
        rate = angle = 0.0
        for k, step in enumerate(np.diff(time)):
            angle += rate * step + 0.5 * drive.torque[k] * step**2 + drive.timing_moment[k]
            rate += drive.torque[k] * step
        assert rate == pytest.approx(sum(impulse))
        assert angle == pytest.approx(np.sum(torque[:-1] * np.diff(TIME) * (TIME[-1] - 0.5 * (TIME[1:] + TIME[:-1]))))


def test_concatenated_trials_are_averaged_separately() -> None:
    """Whatever is held at the end of one, and before the first step of the next."""
    rng = np.random.default_rng(1)
    others = TIME + 0.05 * np.arange(7.0), np.array([1, 2, 5])
    torque, beside, scatter = rng.normal(size=14), rng.normal(size=(14, 1 + len(SPEEDS))), rng.random(14)
    both = TorqueInput.averaged_over(Intervals.from_times([TIME, others[0]], [AT, others[1]]), torque, beside, scatter)
    assert both.offsets.tolist() == [0, 4, 7]
    for found, (time, at), rows in zip(both.by_trial, ((TIME, AT), others), (slice(7), slice(7, 14)), strict=True):
        alone = TorqueInput.averaged_over(Intervals.from_times([time], [at]), torque[rows], beside[rows], scatter[rows])
        for name in ("torque", "timing_moment", "effect_inputs", "impulse_variance", "offsets"):
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))


def test_mapped_applies_to_each_series() -> None:
    drive = TorqueInput.held(np.arange(3.0), effect_inputs=np.ones((3, 1 + len(SPEEDS)))).mapped(
        lambda values: 2.0 * values
    )
    assert drive.torque.tolist() == [0.0, 2.0, 4.0]
    assert (drive.effect_inputs == 2.0).all()
