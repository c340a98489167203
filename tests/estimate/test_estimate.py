"""Intervals, ratios and placeholders of an estimate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rovid.estimate.estimate import Estimate
from rovid.trial.assumptions import Assumptions


def test_interval_uses_students_t() -> None:
    estimate = Estimate(
        names=("inertia",),
        values=np.array([10.0]),
        covariance=np.array([[4.0]]),
        degrees_of_freedom=3.0,
        method="m",
        samples=5,
    )
    # t of 0.975 at 3 degrees of freedom is 3.182.
    assert estimate.interval("inertia") == pytest.approx((10 - 6.365, 10 + 6.365), abs=1e-3)


NAMES = ("inertia", "quadratic_drag", "linear_drag")
GUESS = Assumptions(items=("yaw_arm of fore",), thrusters=1)


def base(linear: float = 132.0, **changes: Any) -> Estimate:
    errors = np.array([9.0, 18.0, 3.0])
    correlations = np.array([[1.0, 0.5, -0.2], [0.5, 1.0, -0.9], [-0.2, -0.9, 1.0]])
    return Estimate(
        names=NAMES,
        values=np.array([5057.0, 3532.0, linear]),
        covariance=correlations * np.outer(errors, errors),
        method="m",
        samples=5,
        **changes,
    )


def test_ratios_allow_for_correlation() -> None:
    rng = np.random.default_rng(7)
    drawn = rng.multivariate_normal(base().values, base().covariance, size=200_000)
    over_quadratic, over_linear = base().ratios
    assert (over_quadratic.name, over_quadratic.symbols, over_quadratic.unit) == (
        "inertia/quadratic_drag",
        "I/DQ",
        "rad",
    )
    assert over_quadratic.value == pytest.approx(5057.0 / 3532.0)
    # Draws tell a standard deviation to 0.2 %; the slopes are of first order.
    assert over_quadratic.standard_error == pytest.approx(float(np.std(drawn[:, 0] / drawn[:, 1])), rel=0.02)
    assert over_linear.standard_error == pytest.approx(float(np.std(drawn[:, 0] / drawn[:, 2])), rel=0.02)


def test_no_ratio_to_a_parameter_near_zero() -> None:
    assert [ratio.symbols for ratio in base(linear=6.0).ratios] == ["I/DQ"]
    assert [ratio.symbols for ratio in base(refused={"inertia": "why"}).ratios] == ["DL/DQ"]


def test_parameters_that_scale_with_thrust_are_placeholders_with_a_guessed_arm() -> None:
    lag = replace(base(assumptions=GUESS), names=("inertia", "thruster_lag.time_constant", "bias_torque.torque"))
    assert [lag.is_placeholder(name) for name in lag.names] == [True, False, True]
    assert not any(base().is_placeholder(name) for name in NAMES)
