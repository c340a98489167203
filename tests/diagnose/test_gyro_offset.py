"""Causes in logs of a rate alone, against an offset of the gyro."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.core.budget import Budget
from rovid.diagnose.log_rivals import without_gyro_offset
from rovid.diagnose.result import Diagnosis
from rovid.effects import effect_named
from rovid.trial.preprocessing import PreparedRuns, prepare
from rovid.trial.trial import Campaign
from tests.conftest import slow
from tests.diagnose.findings import finding
from tests.faults.days import day
from tests.synthetic import LOGGED

BIAS = finding(effect_named("bias_torque"), [0.01])


def rate_alone(seed: int, *, offset: float, torque: float) -> PreparedRuns:
    """A day of which only a gyro's rates are logged, with its ``offset`` in rad/s and a constant ``torque`` in N m."""
    rng, trials = np.random.default_rng(seed), []
    for run in day("small", seed, disturbance=0.01):
        trial = run.trial
        rate = np.gradient(trial.position, trial.time) + offset + rng.normal(0.0, 2e-3, len(trial.time))
        position = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(trial.time) * (rate[1:] + rate[:-1]))))
        unknown = trial.commands - torque
        trials.append(replace(trial, rate=rate, position=position, commands=unknown, rate_only=True))
    return prepare(Campaign(trials=tuple(trials), sources=()), LOGGED)


@pytest.mark.parametrize("seed", [1, slow(2)])
def test_an_offset_of_the_gyro_is_no_torque(seed: int) -> None:
    found = Diagnosis(verdict="found", findings=(BIAS,))
    left = without_gyro_offset(rate_alone(seed, offset=0.02, torque=0.0), found, LOGGED, lambda _: None, Budget())
    assert (left.verdict, left.findings, [one.effect.id for one in left.suspects]) == ("suspected", (), ["bias_torque"])
    assert left.suspects[0].probability == pytest.approx(0.5 * BIAS.probability)
    (said,) = left.warnings
    # 0.02 rad/s are 1.15 deg/s.
    assert "off by 1.1 deg/s" in said or "off by 1.2 deg/s" in said


@pytest.mark.parametrize("seed", [1, slow(2)])
def test_a_torque_is_no_offset_of_the_gyro(seed: int) -> None:
    found = Diagnosis(verdict="found", findings=(BIAS,))
    left = without_gyro_offset(rate_alone(seed, offset=0.0, torque=0.05), found, LOGGED, lambda _: None, Budget())
    assert left is found


def test_without_time_the_offset_is_said_to_be_untried() -> None:
    found, budget = Diagnosis(verdict="found", findings=(BIAS,)), Budget(0.0)
    assert without_gyro_offset(rate_alone(1, offset=0.02, torque=0.0), found, LOGGED, lambda _: None, budget) is found
    assert budget.not_tried
