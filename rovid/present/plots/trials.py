"""Simulation and measurement of each trial, and the torque that the model does not explain."""

import math
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from rovid.core.array_types import FloatArray
from rovid.model.simulation import TrialSimulation
from rovid.present import residuals
from rovid.present.number_format import shorten_name
from rovid.present.plots import canvas
from rovid.trial.axis import Axis

# Most points of a scatter plot: of all residuals, and of the readings without one cause.
_DOTS, _CLOUD = 6000, 4000
_LONGEST_LAG = 60.0  # s
# Number of means drawn over the readings, and the least number of readings for a mean.
_MEANS, _FEWEST = 16, 10
# Percentiles of the readings that set the vertical range, so that single spikes do not flatten the rest.
_SHOWN_PERCENTILES = (0.2, 99.8)
# Names of trials: most characters; in of a character along the name, and of a name across.
_NAME_LENGTH, _CHARACTER, _NAME_HEIGHT = 14, 0.055, 0.11
_TRIAL_NAME: dict[str, Any] = {"rotation": 90, "fontsize": 6.5, "color": canvas.GREY, "va": "top", "ha": "left"}
_MISSING_WIDTH, _MISSING_HEIGHT = 6.4, 2.3  # in
_LOOKS = (("plain model", canvas.ORANGE, "--", "s"), ("extended model", canvas.BLUE, "-", "o"))


@canvas.report_style
def plot_residuals(items: Sequence[residuals.ResidualTorque], cutoff: float) -> Figure:
    """Residual torque against rate, torque and time, its autocorrelation and its spectrum."""
    figure, drivers, (course, lags, frequencies) = _residual_panels(items)
    residual = residuals.all_residuals(items)
    share = residuals.independent_share([item.run for item in items], cutoff)
    look: dict[str, Any] = {"linestyle": "none", "marker": ".", "markersize": 2.6, "markeredgewidth": 0.0}
    for panel, driver in drivers:
        # A part of the points, and their means in bins.
        known = np.flatnonzero(np.isfinite(driver) & np.isfinite(residual))
        rows = known[:: max(len(known) // _DOTS, 1)]
        panel.plot(
            driver[rows], residual[rows], color=canvas.BLUE, alpha=0.55, rasterized=True, label="samples", **look
        )
        panel.axhline(0.0, color=canvas.BLACK, linewidth=0.8)
        means = residuals.bin_means(driver, residual, _MEANS, _FEWEST, share)
        _plot_means(panel, means, color=canvas.ORANGE, marker="o", label="mean ± standard error")
    legend = _label_residuals(drivers, items[0].run.trial.axis, "residual")
    legend.get_lines()[0].set(markersize=7, alpha=1.0)
    _plot_course(course, items, (canvas.BLUE, canvas.GREY))
    _name_trials(course, items)
    _plot_autocorrelation(lags, items, cutoff, color=canvas.BLUE)
    _plot_spectrum(frequencies, items, cutoff, color=canvas.BLUE)
    return figure


@canvas.report_style
def plot_residual_comparison(
    before: Sequence[residuals.ResidualTorque], after: Sequence[residuals.ResidualTorque], cutoff: float
) -> Figure:
    """The panels of `plot_residuals` without and with the causes; means in place of the points."""
    figure, drivers, (course, lags, frequencies) = _residual_panels(before)
    share = residuals.independent_share([item.run for item in before], cutoff)
    for items, (label, colour, dashes, marker) in zip((before, after), _LOOKS, strict=True):
        line: dict[str, Any] = {"color": colour, "linestyle": dashes}
        for panel, driver in drivers:
            means = residuals.bin_means(driver, residuals.all_residuals(items), _MEANS, _FEWEST, share)
            _plot_means(panel, means, **line, marker=marker, label=label)
        _plot_course(course, items, (colour,))
        _plot_autocorrelation(lags, items, cutoff, **line)
        _plot_spectrum(frequencies, items, cutoff, **line)
    _name_trials(course, before)
    for panel, _ in drivers:
        panel.axhline(0.0, color=canvas.BLACK, linewidth=0.8)
    _label_residuals(drivers, before[0].run.trial.axis, "mean residual")
    return figure


_Drivers = list[tuple[Axes, FloatArray]]


def _residual_panels(items: Sequence[residuals.ResidualTorque]) -> tuple[Figure, _Drivers, list[Axes]]:
    """Panels against rate and, if thrusters push, torque, each with these; panels of course, lags and frequencies."""
    rates = np.concatenate([item.run.rates.rate for item in items])
    torques = residuals.all_thruster_torques(items)
    drivers = [rates, torques] if np.any(np.nan_to_num(torques)) else [rates]
    rows = [(2.2, len(drivers)), (2.2, 1), (1.9, 2)]
    figure, (top, *others) = canvas.panel_grid(rows, top=0.4, across=0.95)
    return figure, list(zip(top, drivers, strict=True)), [panel for row in others for panel in row]


def _label_residuals(drivers: _Drivers, axis: Axis, quantity: str) -> Legend:
    label = f"{quantity} {axis.force_name}, {axis.force_unit}"
    words = (f"{axis.rate_words}, {axis.rate_unit}", f"{axis.force_name}, {axis.force_unit}")
    for (panel, _), name in zip(drivers, words, strict=False):
        panel.set(xlabel=name, ylabel=label)
    by_rate, _ = drivers[0]
    return by_rate.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.2)


def _plot_means(panel: Axes, means: residuals.BinMeans, **look: Any) -> None:
    driver, mean, error = means
    panel.errorbar(driver, mean, yerr=error, markersize=4, elinewidth=1.0, capsize=2, **look)


def _plot_course(panel: Axes, items: Sequence[residuals.ResidualTorque], colours: Sequence[str]) -> None:
    """Residual torque of all runs one after another, in alternating colours."""
    clock, samples = 0.0, sum(len(item.residual) for item in items)
    for item, colour in zip(items, cycle(colours), strict=False):
        time = clock + item.run.rates.time - item.run.rates.time[0]
        count = max(2400 * len(item.residual) // samples, 20)
        panel.plot(*canvas.decimate_min_max(time, item.residual, count), color=colour, linewidth=0.7)
        clock = float(time[-1])
    axis = items[0].run.trial.axis
    panel.set(xlabel="time, all trials one after another, s", ylabel=f"residual {axis.force_name}, {axis.force_unit}")
    panel.margins(x=0.01)


def _name_trials(panel: Axes, items: Sequence[residuals.ResidualTorque]) -> None:
    """The beginning of each trial, and above all lines the names of those that are long enough in print."""
    lengths = [float(np.ptp(item.run.rates.time)) for item in items]
    box = panel.get_window_extent().transformed(panel.figure.dpi_scale_trans.inverted())
    names = [shorten_name(Path(item.run.trial.name).stem, _NAME_LENGTH) for item in items]
    for clock, length, name in zip(np.cumsum([0.0, *lengths]), lengths, names, strict=False):
        if length * box.width >= _NAME_HEIGHT * sum(lengths):
            panel.text(clock, 0.99, f" {name}", transform=panel.get_xaxis_transform(), **_TRIAL_NAME)
            panel.axvline(clock, color=canvas.GREY, linewidth=0.5)
    share = min(_CHARACTER * (1 + max(map(len, names))) / box.height, 0.8)
    low, high = panel.get_ylim()
    panel.set_yticks([tick for tick in panel.get_yticks() if low <= tick <= high])
    panel.set_ylim(low, high + (high - low) * share / (1.0 - share))


def _plot_autocorrelation(panel: Axes, items: Sequence[residuals.ResidualTorque], cutoff: float, **look: Any) -> None:
    """Autocorrelation, with the 95 % band of white noise."""
    # Lags beyond half a run leave too few pairs of samples.
    longest = min(_LONGEST_LAG, 0.5 * max(float(np.ptp(item.run.rates.time)) for item in items))
    panel.plot(*residuals.autocorrelation(items, longest), **look)
    band = residuals.white_band(items, cutoff)
    if not panel.patches:
        panel.axhspan(-band, band, color=canvas.GREY, alpha=0.25, linewidth=0.0, label="white noise, 95 %")
        panel.axhline(0.0, color=canvas.BLACK, linewidth=0.8)
        panel.legend(handles=[panel.patches[0]], loc="upper right")
    panel.set(xlabel="lag, s", ylabel="autocorrelation", xlim=(0.0, longest), ylim=(-0.6, 1.05))


def _plot_spectrum(panel: Axes, items: Sequence[residuals.ResidualTorque], cutoff: float, **look: Any) -> None:
    unit = items[0].run.trial.axis.force_unit
    squared = f"({unit})²" if " " in unit else f"{unit}²"
    panel.semilogy(*residuals.spectrum(items, cutoff), **look)
    panel.set(xlabel="frequency, Hz", ylabel=f"density, {squared}/Hz", xlim=(0.0, cutoff))
    drawn = np.concatenate([np.asarray(line.get_ydata(), dtype=np.float64) for line in panel.get_lines()])
    # Within two decades powers of ten alone would give too few labels.
    wide = np.nanmax(drawn) > 100.0 * np.nanmin(drawn)
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0,) if wide else (1.0, 3.0), numticks=7))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.yaxis.set_minor_locator(NullLocator())


@canvas.report_style
def plot_missing_torque(item: residuals.MissingTorque, axis: Axis) -> Figure:
    """Torque that the model misses without one cause: readings, their means, and the equation."""
    rows = [(_MISSING_HEIGHT, 1)]
    figure, ((panel,),) = canvas.panel_grid(rows, left=0.8, top=0.32, bottom=0.5, width=_MISSING_WIDTH)
    known = np.isfinite(item.driver_values) & np.isfinite(item.measured) & np.isfinite(item.equation)
    x, y = item.driver_values[known], item.measured[known]
    every = max(len(x) // _CLOUD, 1)
    look: dict[str, Any] = {"color": canvas.PALE, "markersize": 2.5, "alpha": 0.6, "zorder": 1, "rasterized": True}
    panel.plot(x[::every], y[::every], ".", label="readings", **look)
    line, values = item.line
    over_time = item.driver.startswith("time in ") and line is item.driver_values
    if not over_time:
        means = residuals.bin_means(x, y, _MEANS, _FEWEST, item.independent)
        _plot_means(panel, means, fmt="o", color=canvas.BLUE, label="their mean ± standard error", zorder=3)
    finite = np.isfinite(line) & np.isfinite(values)
    panel.plot(line[finite], values[finite], color=canvas.ORANGE, linewidth=2.0, label="the equation", zorder=2)
    panel.axhline(0.0, color=canvas.BLACK, linewidth=0.8, zorder=0)
    low, high = np.percentile(y, _SHOWN_PERCENTILES)
    low, high = min(low, float(np.nanmin(values))), max(high, float(np.nanmax(values)))
    margin = 0.08 * (high - low)
    panel.set_ylim(low - margin, high + margin)
    panel.set(xlabel=item.driver, ylabel=f"missing {axis.force_name}, {axis.force_unit}")
    canvas.legend_above(figure, *panel.get_legend_handles_labels(), 3, loc="upper left", bbox_to_anchor=(0.08, 1.0))
    return figure


PER_SHEET, _COLUMNS = 24, 3
# Points of a line for each inch of the figure's width.
_POINTS_PER_INCH = 100


@canvas.report_style
def plot_before_after(
    before: TrialSimulation,
    after: TrialSimulation,
    *,
    width: float,
    rows: tuple[float, float],
    names: tuple[str, str] = ("plain model", "extended model"),
) -> Figure:
    """Rate above, error of the position below, by two models; by one where ``before`` is ``after``.

    ``width`` of the figure and heights of the two ``rows`` are in inches; ``names`` are those of the models.
    """
    margins = {"left": 0.55, "right": 0.18, "top": 0.5, "bottom": 0.42, "down": 0.34, "width": width}
    figure, ((rate,), (position,)) = canvas.panel_grid([(height, 1) for height in rows], share_x=True, **margins)
    trial, axis = before.run.trial, before.run.trial.axis
    unit, count = axis.display_unit[0], round(_POINTS_PER_INCH * width)
    measured = canvas.decimate_min_max(before.run.rates.time, before.measured, count)
    rate.plot(*measured, color=canvas.PALE, linewidth=4.0, label="measured")
    looks = [(before, canvas.BLACK, "-", "simulated")]
    if after is not before:
        looks = [(before, canvas.ORANGE, "--", names[0]), (after, canvas.BLACK, "-", names[1])]
    for item, colour, dashes, label in looks:
        simulated = canvas.decimate_min_max(item.run.rates.time, item.simulated, count)
        rate.plot(*simulated, dashes, color=colour, linewidth=1.3, label=label)
        _plot_position_error(position, item, count, dashes, colour, 1.3)
    rate.set_title(f"{axis.rate_words}, {axis.rate_unit}", fontsize=9, pad=4)
    position.set_title(f"{axis.position_words} error, {unit}", fontsize=9, pad=4)
    for panel, height in zip((rate, position), rows, strict=True):
        panel.locator_params(axis="y", nbins=max(round(3.0 * height), 3))
    position.set(xlabel="time, s", xlim=(trial.time[0], trial.time[-1]))
    handles, labels = rate.get_legend_handles_labels()
    where: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (0.0, 1.0)}
    # One row on a telephone.
    canvas.legend_above(figure, handles, labels, 3, handlelength=1.3, columnspacing=1.0, **where)
    return figure


def _plot_position_error(
    panel: Axes, item: TrialSimulation, count: int, dashes: str, colour: str, linewidth: float
) -> None:
    """Error of the simulated position at the instants of the measurements."""
    trial = item.run.trial
    known = trial.measured
    error = trial.axis.display_unit[1] * (item.position - trial.position)[known]
    panel.plot(*canvas.decimate_min_max(trial.time[known], error, count), dashes, color=colour, linewidth=linewidth)


@canvas.report_style
def plot_overview(pairs: Sequence[tuple[TrialSimulation, TrialSimulation]]) -> Figure:
    """Measured and simulated rate of each trial with its R²; two simulations where causes were found."""
    height, margins = 0.95 if len(pairs) > _COLUMNS else 1.8, {"left": 0.75, "top": 0.52, "bottom": 0.5}
    figure, panels = canvas.panel_sheet(len(pairs), min(len(pairs), _COLUMNS), height, across=0.5, down=0.5, **margins)
    for panel, (before, after) in zip(panels, pairs, strict=True):
        canvas.plot_overlay(panel, after.run.rates.time, after.measured, after.simulated, 500)
        if before is not after:
            time, rate = canvas.decimate_min_max(after.run.rates.time, before.simulated, 500)
            panel.plot(time, rate, "--", color=canvas.ORANGE, linewidth=1.0, label="simulated by the plain model")
        panel.set_title(shorten_name(after.run.trial.name, 22), fontsize=9, pad=3)
        if math.isfinite(after.fit.r2):
            panel.set_title(f"R² {after.fit.r2:.4f}", fontsize=8, loc="right", pad=3)
        panel.tick_params(labelsize=8)
        panel.locator_params(axis="y", nbins=4)
        panel.locator_params(axis="x", nbins=5)
    figure.supxlabel("time, s", y=0.06 / figure.get_figheight(), fontsize=10, va="bottom")
    axis = pairs[0][0].run.trial.axis
    figure.supylabel(f"{axis.rate_words}, {axis.rate_unit}", x=0.01, fontsize=10, ha="left")
    canvas.legend_above(figure, *panels[0].get_legend_handles_labels(), 3, loc="upper left", bbox_to_anchor=(0.07, 1.0))
    return figure


@canvas.report_style
def plot_trial(item: TrialSimulation) -> Figure:
    """Torque, measured and simulated rate, and errors of rate and position of one trial."""
    rows = [(0.75, 1), (2.2, 1), (0.9, 1), (0.9, 1)]
    figure, ((torque,), (rate,), (difference,), (position,)) = canvas.panel_grid(
        rows, left=1.05, down=0.16, share_x=True
    )
    trial, time, axis = item.run.trial, item.run.rates.time, item.run.trial.axis
    torque.step(*canvas.decimate_min_max(trial.time, item.run.torque), where="post", color=canvas.BLUE, linewidth=1.0)
    canvas.plot_overlay(rate, time, item.measured, item.simulated)
    difference.plot(*canvas.decimate_min_max(time, item.simulated - item.measured), color=canvas.BLUE, linewidth=0.9)
    _plot_position_error(position, item, canvas.POINTS, "-", canvas.BLUE, 0.9)
    labels = {
        torque: f"{axis.force_name},\n{axis.force_unit}",
        rate: f"{axis.rate_words},\n{axis.rate_unit}",
        difference: f"rate error,\n{axis.rate_unit}",
        position: f"{axis.position_words}\nerror, {axis.display_unit[0]}",
    }
    for panel, label in labels.items():
        panel.set_ylabel(label)
        if panel is not rate:
            panel.locator_params(axis="y", nbins=4)
    figure.align_ylabels()
    title = shorten_name(trial.name, 48)
    if math.isfinite(item.fit.r2):
        title += f"   R² {item.fit.r2:.4f}, fit {item.fit.fit_percent:.1f} %"
    torque.set_title(title)
    canvas.legend_above(figure, *rate.get_legend_handles_labels(), 2)
    position.set_xlabel("time, s")
    return figure
