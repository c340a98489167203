"""The heading sensor and its inverse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.multi_step import MultiStepData, prediction_errors
from rovid.model.bound_effects import BoundEffect
from rovid.model.model import HeadingSensor
from rovid.model.simulation import simulate_runs
from rovid.model.torque_input import TorqueInput
from rovid.signals.rates import compute_rates
from tests import synthetic
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


@pytest.mark.parametrize("gyro", [False, True])
def test_a_gyro_has_no_deviation(*, gyro: bool) -> None:
    """The true model predicts both a logged rate and the derivative of a deviating heading."""
    deviation = effect_named("heading_deviation:two_cycles")
    model = replace(synthetic.ROSUB, effects=(deviation,), effect_values=(0.1, 0.5))
    time = clock(120.0)
    torque = 400.0 * np.sign(np.sin(2.0 * np.pi * time / 40.0))
    true = synthetic.run(time, torque)
    rate, angle = synthetic.ROSUB.simulate(true.trial, TorqueInput.held(torque))
    heading, _ = model.heading_sensor.to_measured(angle, rate)
    trial = synthetic.trial(time, torque, heading, rate=rate if gyro else None)
    run = replace(true, trial=trial, rates=compute_rates(trial, cutoff=1.0))
    (simulated,) = simulate_runs([run], model, synthetic.LOGGED)
    assert simulated.fit.r2 > 0.9999
    data = InnovationData([run], synthetic.LOGGED, synthetic.ROSUB)
    errors = prediction_errors(MultiStepData.from_data(data, synthetic.ROSUB), model)
    # Rounding by the filter and by the grid; the deviation is 0.1 rad.
    assert np.sqrt(np.mean(errors**2)) < 0.003
