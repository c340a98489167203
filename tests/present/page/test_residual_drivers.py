"""What drives the torque that is missing without a cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.effects import Effect, effect_named
from rovid.model.model import Model
from rovid.present.page import residual_drivers
from rovid.present.page.report_data import ReportData
from rovid.present.page.residual_drivers import MissingTorque, missing_without
from rovid.present.plots import canvas
from rovid.present.plots.missing import plot_missing_torque
from rovid.signals.preprocessing import PreparedRuns, prepare
from rovid.trial.trial import Campaign
from tests.present.conftest import INERTIA, LINEAR, QUADRATIC

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
    monkeypatch.setattr(residual_drivers, "_FOLLOWS", 2.0)  # which no share reaches
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
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["readings", "their mean", "the equation"]
    assert panel.get_xlabel() == "torque of the thrusters, N m"
    assert panel.get_ylabel() == "missing torque, N m"
    canvas.render_png(figure)
    box = figure.get_tightbbox()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.get_figwidth()
    assert len(canvas.render_svg(figure)) < 300_000  # the cloud is a picture in it
