"""The figures: units on every axis, extremes kept, nothing taken from the user's settings."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from rovid.present.number_format import shorten_name
from rovid.present.plots import canvas, models, trials
from rovid.present.report_data import ReportData
from rovid.present.residuals import residual_torques
from rovid.present.tables.fits import method_interval
from rovid.trial.axis import YAW
from rovid.trial.vehicle import Thruster

UNITS = ("N m", "rad/s", "kg m²", ", s", "Hz", "deg", ", N", "share", "command", "autocorrelation")


def figures(day: ReportData) -> dict[str, Figure]:
    assert day.drag is not None
    assert day.inertia is not None
    assert day.runs is not None
    model = day.parameters.model()
    curves = models.plot_thrust_curves(day.vehicle, day.runs.items)
    assert curves is not None
    return {
        "steady": models.plot_steady_states(day.drag),
        "sines": models.plot_sine_runs(day.inertia.trials, model, YAW),
        "inertia": models.plot_inertia_methods(day.inertia, day.vehicle.rigid_body_inertia),
        "trial": trials.plot_trial(day.simulations[0]),
        "residuals": trials.plot_residuals(residual_torques(day.runs.items, model, day.vehicle), day.runs.cutoff),
        "thrust": curves,
    }


def test_every_axis_has_a_label_with_a_unit(day: ReportData) -> None:
    for name, figure in figures(day).items():
        for axes in figure.axes:
            shown = [label for label in (axes.get_xlabel(), axes.get_ylabel()) if label]
            assert shown, name
            assert all(any(unit in label.replace("\n", " ") for unit in UNITS) for label in shown), (name, shown)


def test_residuals_of_free_swings_have_no_panel_of_torque(day: ReportData) -> None:
    assert day.runs is not None
    items = residual_torques(day.runs.items, day.parameters.model(), day.vehicle)
    free = [replace(item, thruster_torque=np.zeros_like(item.thruster_torque)) for item in items]
    shown = [[axes.get_xlabel() for axes in trials.plot_residuals(one, 1.0).axes] for one in (items, free)]
    assert len(shown[0]) == 5
    assert shown[1] == [label for label in shown[0] if label != "torque, N m"]


@pytest.mark.slow
def test_no_text_leaves_the_figure(day: ReportData) -> None:
    for name, figure in figures(day).items():
        canvas.render_png(figure)
        box = figure.get_tightbbox()
        assert box.x0 >= 0.0, name
        assert box.y0 >= 0.0, name
        assert box.x1 <= figure.get_figwidth(), name
        assert box.y1 <= figure.get_figheight(), name


@pytest.mark.parametrize("width", ["84mm", "174mm"])
@pytest.mark.slow
def test_a_journal_gets_its_width_with_all_text_within(day: ReportData, width: str) -> None:
    with canvas.journal_plots(width):
        for name, figure in figures(day).items():
            image, svg = Image.open(io.BytesIO(canvas.render_png(figure))), canvas.render_svg(figure).decode()
            assert abs(image.width - float(width[:-2]) / 25.4 * 300.0) < 1.0, name
            assert image.info["dpi"] == pytest.approx((300.0, 300.0), rel=1e-4)
            size = re.search(r'<svg[^>]* width="([^"]*)" height="([\d.]*)mm" viewBox="0 0 ([\d.]*) ([\d.]*)"', svg)
            assert size is not None
            assert size[1] == width
            assert float(size[2]) == pytest.approx(float(width[:-2]) * float(size[4]) / float(size[3]), abs=0.01)
            # Text is text, and 6 points high or more in print; the names of trials in one panel are smaller.
            least = 5.0 if name == "residuals" else 6.0
            points = [float(one) for one in re.findall(r"font(?:-size)?: ([\d.]+)px", svg)]
            assert min(points) * float(width[:-2]) / 25.4 * 72.0 / float(size[3]) > least


def test_in_one_column_no_legend_covers_a_panel_or_its_title(day: ReportData) -> None:
    assert day.drag is not None
    assert day.inertia is not None
    with canvas.journal_plots("84mm"):
        for figure in (
            models.plot_steady_states(day.drag),
            models.plot_inertia_methods(day.inertia, day.vehicle.rigid_body_inertia),
            trials.plot_overview([(item, item) for item in day.simulations]),
        ):
            (legend,) = figure.legends
            box = legend.get_window_extent()
            assert box.width <= figure.bbox.width + 1.0
            tops = [drawn.y1 for panel in figure.axes if (drawn := panel.get_tightbbox()) is not None]
            assert box.y0 > max(tops) - 1.0


def test_the_legend_of_the_first_screen_fits_a_telephone(day: ReportData) -> None:
    before, after = day.simulations[0], replace(day.simulations[0])
    figure = trials.plot_before_after(before, after, width=3.9, rows=(0.75, 0.45))
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["measured", "plain model", "extended model"]
    assert legend.get_window_extent().x1 <= figure.bbox.width


def test_names_of_trials_stand_above_the_lines(day: ReportData) -> None:
    assert day.runs is not None
    items = residual_torques(day.runs.items, day.parameters.model(), day.vehicle)
    course = trials.plot_residuals(items, day.runs.cutoff).axes[2]
    lines = [np.asarray(line.get_ydata(), dtype=np.float64) for line in course.get_lines()]
    highest = max(float(np.nanmax(values)) for values in lines if values.size > 2)
    lowest_name = min(text.get_window_extent().y0 for text in course.texts)
    assert lowest_name > course.transData.transform((0.0, highest))[1]
    assert [text.get_text().strip() for text in course.texts][:1] == [Path(items[0].run.trial.name).stem]


def test_overview_holds_every_trial(day: ReportData) -> None:
    figure = trials.plot_overview([(item, item) for item in day.simulations])
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert [title for title in titles if title] == [item.run.trial.name for item in day.simulations]


def test_steady_plot_marks_what_was_not_fitted(day: ReportData) -> None:
    assert day.drag is not None
    point = replace(day.drag.points[0], steady=False, torque=3.0)
    figure = models.plot_steady_states(replace(day.drag, unsteady=(point,)))
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert "rate still changing: not fitted" in labels
    assert "steady turn, heading growing" in labels
    assert "steady turn, heading falling" in labels


def test_band_is_left_out_where_no_error_is_known(day: ReportData) -> None:
    assert day.drag is not None
    estimate = replace(day.drag.estimate, covariance=np.full((2, 2), np.nan))
    figure = models.plot_steady_states(replace(day.drag, estimate=estimate))
    assert "95 % band" not in figure.axes[0].get_legend_handles_labels()[1]


def test_inertia_plot_marks_bias_and_rigid_body(day: ReportData) -> None:
    assert day.inertia is not None
    figure = models.plot_inertia_methods(day.inertia, day.vehicle.rigid_body_inertia)
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert day.inertia.peak_bias is not None
    assert labels[0] == f"peak method\n(biased: {100 * day.inertia.peak_bias:.0f} % of true)"
    assert "orbit integral\n(best of these)" in labels
    assert method_interval(day.inertia, "peak") is None
    assert method_interval(day.inertia, "orbit_integral") == day.inertia.estimate.interval("inertia")


def test_a_logged_torque_has_no_curve_to_show(day: ReportData) -> None:
    vehicle = replace(day.vehicle, thrusters=(Thruster(name="torque", arm=1.0, curve=None),))
    assert models.plot_thrust_curves(vehicle, ()) is None


def test_figures_ignore_the_users_settings_and_leave_them_alone(day: ReportData) -> None:
    assert day.drag is not None
    plain = canvas.render_svg(models.plot_steady_states(day.drag))
    with mpl.rc_context({"font.size": 30, "axes.facecolor": "black", "svg.hashsalt": "other"}):
        assert canvas.render_svg(models.plot_steady_states(day.drag)) == plain
        assert mpl.rcParams["font.size"] == 30


def test_png_is_white_where_nothing_is_drawn_and_small(day: ReportData) -> None:
    data = canvas.render_png(trials.plot_trial(day.simulations[0]))
    image = Image.open(io.BytesIO(data))
    assert image.convert("RGB").getpixel((1, 1)) == (255, 255, 255)
    assert image.size[0] == 1170
    assert len(data) < 60_000


def test_svg_holds_no_date(day: ReportData) -> None:
    assert day.drag is not None
    text = canvas.render_svg(models.plot_steady_states(day.drag)).decode()
    assert "dc:date" not in text
    assert "</svg>" in text


def test_decimation_keeps_extremes_ends_and_gaps() -> None:
    values = np.random.default_rng(3).normal(size=100_003)
    values[[1234, 77_777, -1]] = 50.0, -50.0, 40.0
    values[5_000:9_000] = np.nan
    time, kept = canvas.decimate_min_max(np.arange(100_003.0), values)
    assert len(kept) <= 1210
    assert (np.diff(time) >= 0).all()
    assert np.nanmax(kept) == 50.0
    assert np.nanmin(kept) == -50.0
    assert 40.0 in kept[-2:]
    assert np.isnan(kept[(time > 5_200) & (time < 8_800)]).all()
    assert np.isfinite(kept[(time < 4_800) | (time > 9_200)]).all()


def test_short_series_are_left_as_they_are() -> None:
    time, values = np.arange(50.0), np.arange(50.0) ** 2
    assert canvas.decimate_min_max(time, values)[1] is values


def test_long_names_keep_their_end() -> None:
    assert shorten_name("short.csv", 20) == "short.csv"
    assert shorten_name("2026-03-07/tank/hold_17.csv", 13) == "…/hold_17.csv"
    assert len(shorten_name("x" * 300, 22)) == 22
