"""The heading sensor and its inverse."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.model.bound_effects import BoundEffect
from rovid.model.heading_sensor import HeadingSensor
from tests.synthetic import clock

OFF = HeadingSensor((BoundEffect(effect_named("heading_deviation"), np.array([0.08, 0.5])),))
PLAIN = HeadingSensor((BoundEffect(effect_named("bias_torque"), np.array([20.0])),))


def test_the_measured_rate_is_the_derivative_of_the_measured_heading() -> None:
    time = clock(60.0, 5.0)
    true, rate = 0.15 * time, np.full(len(time), 0.15)
    measured, shown = OFF.to_measured(true, rate)
    assert shown == pytest.approx(np.gradient(measured, time), abs=1e-3 * 0.15)


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("heading_deviation", (0.08, 0.5)),
        ("heading_deviation:two_cycles", (0.3, -2.0)),
        ("heading_deviation:mixed", (0.4, 1.0, 0.25, 2.0)),
    ],
)
def test_to_true_inverts_to_measured(key: str, values: tuple[float, ...]) -> None:
    off = HeadingSensor((BoundEffect(effect_named(key), np.array(values)),))
    true = np.linspace(-20.0, 30.0, 5000)
    measured, gain = off.to_measured(true, np.ones(5000))
    measured[7] = np.nan
    found, told = off.to_true(measured)
    assert np.isnan(found[7])
    known = np.arange(5000) != 7
    assert found[known] == pytest.approx(true[known], abs=1e-8)
    assert told[known] == pytest.approx(gain[known], rel=1e-6)


def test_a_sensor_without_deviation_changes_nothing() -> None:
    heading, rate = np.linspace(0.0, 9.0, 50), np.linspace(-0.1, 0.2, 50)
    assert not PLAIN.deviates
    assert OFF.deviates
    assert np.array_equal(PLAIN.to_measured(heading, rate), (heading, rate))
    assert np.array_equal(PLAIN.to_true(heading), (heading, np.ones(50)))
    assert not PLAIN.deviation(heading).any()
