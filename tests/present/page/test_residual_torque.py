"""What is left over: numbers that are known beforehand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from rovid.effects import effect_named
from rovid.model.model import Model
from rovid.present.page.report_data import ReportData
from rovid.present.page.residual_torque import (
    ResidualTorque,
    autocorrelation,
    binned_means,
    residual_torques,
    rms_sizes,
    spectrum,
    unexplained_torques,
)
from tests.present.conftest import INERTIA, LINEAR, PERIOD, QUADRATIC

TRUTH = Model(inertia=INERTIA, quadratic_drag=QUADRATIC, linear_drag=LINEAR)
Series = np.ndarray[tuple[int], np.dtype[np.float64]]


def left_over(day: ReportData, left: Series) -> ResidualTorque:
    assert day.runs is not None
    return ResidualTorque(
        run=day.runs.items[0], thruster_torque=left, beside=np.zeros((len(left), 3)), residual=left, noise_sd=0.0
    )


def test_residual_under_the_true_model_is_the_disturbance(day: ReportData) -> None:
    assert day.runs is not None
    left, torque, noise = rms_sizes(residual_torques(day.runs.items, TRUTH, day.vehicle))
    # The disturbance has a standard deviation of 0.05/sqrt(1 - 0.95^2) = 0.16 N m before the filter.
    assert left == pytest.approx(np.hypot(0.16, noise), rel=0.3)
    assert torque > 5.0
    assert 0.0 < noise < left


def test_residual_is_unknown_where_the_rate_is(day: ReportData) -> None:
    assert day.runs is not None
    (item,) = residual_torques(day.runs.items[:1], TRUTH, day.vehicle)
    assert (np.isfinite(item.residual) == item.run.valid).all()


def test_an_effect_between_command_and_torque_acts_on_the_torque(day: ReportData) -> None:
    assert day.runs is not None
    half = replace(TRUTH, effects=(effect_named("thrust_asymmetry"),), effect_values=(0.5,))
    plain, weaker = (
        residual_torques(day.runs.items[5:6], model, day.vehicle)[0] for model in (TRUTH, half)
    )  # a hold in reverse
    known = np.isfinite(plain.thruster_torque)
    assert weaker.thruster_torque[known] == pytest.approx(0.5 * plain.thruster_torque[known], abs=1e-9)


def test_means_follow_a_curve() -> None:
    driver = np.linspace(-1.0, 1.0, 4_000)
    across, up = binned_means(driver, 3.0 * np.abs(driver))
    assert up == pytest.approx(3.0 * np.abs(across), abs=1e-9)
    assert len(across) == 16


def test_means_of_few_samples_are_not_shown() -> None:
    driver = np.concatenate((np.zeros(4_000), [1.0]))
    across, up = binned_means(driver, np.zeros(4_001))
    assert np.isfinite(across).sum() == 1
    assert np.isnan(up[-1])
    assert binned_means(np.ones(100), np.ones(100))[0].size == 0


def test_spectrum_finds_a_wave(day: ReportData) -> None:
    wave = np.sin(2.0 * np.pi * 0.7 * PERIOD * np.arange(4_000))
    frequency, density = spectrum([left_over(day, wave)], 2.0)
    assert frequency[np.argmax(density)] == pytest.approx(0.7, abs=0.03)  # the window's resolution


def test_autocorrelation_knows_the_memory(day: ReportData) -> None:
    rng = np.random.default_rng(5)
    values = np.zeros(60_000)
    for k in range(1, len(values)):
        values[k] = np.exp(-PERIOD / 2.0) * values[k - 1] + rng.normal()
    lags, correlation = autocorrelation([left_over(day, values)], 10.0)
    assert correlation[0] == 1.0
    assert np.interp(2.0, lags, correlation) == pytest.approx(np.exp(-1.0), abs=0.05)  # 3000 s of a 2 s memory


def test_short_stretches_give_no_spectrum(day: ReportData) -> None:
    item = left_over(day, np.full(40, 1.0))
    assert np.isnan(spectrum([item], 2.0)[1]).all()
    assert np.isnan(autocorrelation([item], 1.0)[1]).all()


def test_terms_are_taken_out_of_what_is_left(day: ReportData) -> None:
    assert day.runs is not None
    torque, stiffness = 3.0, 0.7
    effects = (effect_named("bias_torque"), effect_named("tether_torsion"))
    model = replace(TRUTH, effects=effects, effect_values=(torque, stiffness))
    plain = residual_torques(day.runs.items, TRUTH, day.vehicle)[0]
    less = unexplained_torques(day.runs, model, day.vehicle)[0]
    # The angle is behind the same filter as the rest.
    turned = plain.run.rates.position - plain.run.trial.position[0]
    known = np.isfinite(plain.residual)
    expected = (torque - stiffness * turned)[known]
    np.testing.assert_allclose((less.residual - plain.residual)[known], expected, atol=1e-6)


def test_a_state_follows_the_measured_rate(day: ReportData) -> None:
    assert day.runs is not None
    inertia, constant = 5.0, 4.0
    effects = (effect_named("added_mass_memory"),)
    model = replace(TRUTH, effects=effects, effect_values=(inertia, constant))
    plain = residual_torques(day.runs.items, TRUTH, day.vehicle)[0]
    less = unexplained_torques(day.runs, model, day.vehicle)[0]
    known = np.flatnonzero(np.isfinite(plain.residual))
    rate, period = plain.run.rates.rate, plain.run.rates.kernel.period
    # The hold's rate settles, and the water with it.
    water = signal.lfilter([period / constant], [1.0, period / constant - 1.0], np.nan_to_num(rate, nan=0.0))
    expected = -inertia * (rate - water) / constant
    np.testing.assert_allclose(
        (less.residual - plain.residual)[known], expected[known], atol=0.03 * np.nanmax(abs(expected))
    )
