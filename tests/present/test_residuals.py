"""Residual torque, its statistics, and the signals that drive it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from rovid.core.array_types import FloatArray
from rovid.effects import Effect, effect_named
from rovid.model.model import Model
from rovid.present import residuals
from rovid.present.plots import canvas
from rovid.present.plots.trials import plot_missing_torque
from rovid.present.report_data import ReportData
from rovid.present.residuals import (
    MissingTorque,
    ResidualTorque,
    _smooth_curve,
    autocorrelation,
    bin_means,
    missing_without,
    residual_torques,
    rms_sizes,
    spectrum,
    unexplained_torques,
    white_band,
)
from rovid.trial.preprocessing import PreparedRuns, prepare
from rovid.trial.trial import Campaign
from tests.present.conftest import INERTIA, LINEAR, PERIOD, QUADRATIC

TRUTH = Model(inertia=INERTIA, quadratic_drag=QUADRATIC, linear_drag=LINEAR)
Series = np.ndarray[tuple[int], np.dtype[np.float64]]


def left_over(day: ReportData, left: Series) -> ResidualTorque:
    assert day.runs is not None
    return ResidualTorque(
        run=day.runs.items[0], thruster_torque=left, effect_inputs=np.zeros((len(left), 3)), residual=left, noise_sd=0.0
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
    driver = np.linspace(-1.0, 1.0, 4_001)
    place, mean, _ = bin_means(driver, 3.0 * np.abs(driver), 16)
    # The mean of a straight line in a bin is its value at the mean of the bin; one bin holds the kink.
    assert np.sum(np.abs(mean - 3.0 * np.abs(place)) > 1e-9) <= 1
    assert len(place) == 8  # edges at equal distances and at quantiles coincide


def test_errors_of_means_depend_on_the_independent_samples() -> None:
    rng = np.random.default_rng(4)
    driver, values = rng.uniform(0.0, 1.0, 40_000), rng.normal(0.0, 2.0, 40_000)
    (_, mean, error), (_, _, of_fewer) = (bin_means(driver, values, 16, independent=share) for share in (1.0, 0.25))
    assert np.sum((2.0 / error) ** 2) == pytest.approx(40_000, rel=0.05)  # the number of values in all bins
    assert of_fewer == pytest.approx(2.0 * error)
    assert np.mean(np.abs(mean) < 1.96 * error) > 0.8  # 0.95 is expected; fixed seed


def test_means_of_few_samples_are_not_shown() -> None:
    driver = np.concatenate((np.zeros(4_000), [1.0]))
    assert bin_means(driver, np.zeros(4_001), 16, 3)[0].tolist() == [0.0]
    assert bin_means(np.ones(100), np.ones(100))[0].size == 0


def test_a_curve_goes_through_bins_that_differ_by_rounding_only() -> None:
    """A held command gives one torque; its mean in two bins may even decrease."""
    held = 494.96388
    driver = np.array([0.0, held, np.nextafter(held, 0.0), 500.0])
    smooth, curve = _smooth_curve(driver, np.array([1.0, 2.0, 2.5, 3.0]))
    assert np.all(np.diff(smooth) > 0.0)
    assert (curve[0], curve[-1]) == (1.0, 3.0)
    assert np.interp(held, smooth, curve) == pytest.approx(2.0, abs=0.01)


def test_white_noise_stays_in_its_band(day: ReportData) -> None:
    values = np.random.default_rng(6).normal(0.0, 1.0, 20_000)
    items = [left_over(day, values)]
    _, correlation = autocorrelation(items, 60.0)
    band = white_band(items, 0.5 / PERIOD)
    assert band == pytest.approx(1.96 / np.sqrt(20_000), rel=1e-3)
    inside = np.mean(np.abs(correlation[1:]) < band)
    # Between its samples the autocorrelation is interpolated, which makes it smaller there.
    assert 0.93 < inside <= 1.0


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


PLAIN = Model(inertia=INERTIA, quadratic_drag=QUADRATIC, linear_drag=LINEAR)
# Effect, its size, what the torque that is missing without it follows.
CAUSES = [
    ("thrust_asymmetry", (0.7,), "torque of the thrusters, N m"),
    ("bias_torque", (3.0,), "torque of the thrusters, N m"),
    ("drag_curvature", (20.0,), "yaw rate, rad/s"),
    ("coulomb_resistance", (2.0,), "yaw rate, rad/s"),
    ("thruster_lag", (0.3,), "change of the torque, N m/s"),
    ("tether_torsion", (0.3,), "heading from the start, deg"),
]


def moved(day: ReportData, model: Model) -> PreparedRuns:
    """The trials of the day as ``model`` would have moved, without noise."""
    assert day.runs is not None
    trials = []
    for run in day.runs.items:
        _, heading = model.simulate(run.trial, model.torque_input(day.vehicle, run.trial))
        trials.append(replace(run.trial, position=heading))
    return prepare(Campaign(trials=tuple(trials), sources=()), day.vehicle, cutoff=day.runs.cutoff)


def missing(day: ReportData, effect: Effect, values: tuple[float, ...]) -> MissingTorque:
    model = replace(PLAIN, effects=(effect,), effect_values=values)
    found = missing_without(effect, moved(day, model), model, day.vehicle)
    assert found is not None
    return found


def known(*columns: FloatArray) -> list[FloatArray]:
    """The rows in which all is known."""
    rows = np.all([np.isfinite(column) for column in columns], axis=0)
    return [column[rows] for column in columns]


@pytest.mark.parametrize(("name", "values", "driver"), CAUSES, ids=[name for name, _, _ in CAUSES])
def test_the_plainest_driver_that_the_equation_follows_is_shown(
    day: ReportData, name: str, values: tuple[float, ...], driver: str
) -> None:
    found = missing(day, effect_named(name), values)
    assert found.driver == driver
    measured, equation = known(found.measured, found.equation)
    # The logs are without noise: what is left is of the filter, most where a friction turns round at rest.
    assert np.std(measured - equation) < 0.25 * np.sqrt(np.mean(equation**2))


def test_weak_reverse_thrust_is_missing_in_reverse_alone(day: ReportData) -> None:
    found = missing(day, effect_named("thrust_asymmetry"), (0.7,))
    torque, equation = known(found.driver_values, found.equation)
    # The low pass rounds the corner off where the torque changes its sign.
    assert equation == pytest.approx(np.where(torque < 0.0, -0.3 * torque, 0.0), abs=1.0)
    line, values = known(*found.line)
    # Drawn through means: within a bin they round the corner off.
    assert values == pytest.approx(np.where(line < 0.0, -0.3 * line, 0.0), abs=0.02 * np.ptp(line))


def test_what_follows_nothing_is_shown_over_time(day: ReportData, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(residuals, "_FOLLOWS", 2.0)  # which no share reaches
    found = missing(day, effect_named("bias_torque"), (3.0,))
    assert found.driver.startswith("time in ")
    assert found.line[1] is found.equation
    assert known(found.equation)[0] == pytest.approx(3.0)
    labels = [text.get_text() for text in plot_missing_torque(found, day.axis).legends[0].get_texts()]
    assert labels == ["readings", "the equation"]


def test_of_what_has_no_size_or_phase_there_is_nothing_to_show(day: ReportData) -> None:
    runs, none = moved(day, PLAIN), effect_named("bias_torque")
    assert missing_without(none, runs, replace(PLAIN, effects=(none,), effect_values=(0.0,)), day.vehicle) is None
    assert missing_without(effect_named("wave_torque"), runs, PLAIN, day.vehicle) is None


def test_the_picture_has_readings_means_and_the_equations_line(day: ReportData) -> None:
    figure = plot_missing_torque(missing(day, effect_named("thrust_asymmetry"), (0.7,)), day.axis)
    (panel,) = figure.axes
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "readings",
        "the equation",
        "their mean ± standard error",
    ]
    assert panel.get_xlabel() == "torque of the thrusters, N m"
    assert panel.get_ylabel() == "missing torque, N m"
    canvas.render_png(figure)
    box = figure.get_tightbbox()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.get_figwidth()
    assert len(canvas.render_svg(figure)) < 300_000  # the cloud is a picture in it
