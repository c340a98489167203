"""Simulation and measurement of each trial."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.model.simulation import TrialSimulation
from rovid.present.number_format import shorten_name
from rovid.present.plots.canvas import (
    BLACK,
    BLUE,
    ORANGE,
    PALE,
    POINTS,
    decimate_min_max,
    panel_grid,
    plot_overlay,
    report_style,
)

PER_SHEET = 24
_COLUMNS = 3
# Points of a line for each inch of the figure's width.
_POINTS_PER_INCH = 100


@report_style
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
    figure, ((rate,), (position,)) = panel_grid(
        [(height, 1) for height in rows],
        left=0.55,
        right=0.18,
        top=0.5,
        bottom=0.42,
        down=0.34,
        share_x=True,
        width=width,
    )
    trial, axis = before.run.trial, before.run.trial.axis
    unit, count = axis.display_unit[0], round(_POINTS_PER_INCH * width)
    measured = decimate_min_max(before.run.rates.time, before.measured, count)
    rate.plot(*measured, color=PALE, linewidth=4.0, label="measured")
    looks = [(before, BLACK, "-", "simulated")]
    if after is not before:
        looks = [(before, ORANGE, "--", names[0]), (after, BLACK, "-", names[1])]
    for item, colour, dashes, label in looks:
        simulated = decimate_min_max(item.run.rates.time, item.simulated, count)
        rate.plot(*simulated, dashes, color=colour, linewidth=1.3, label=label)
        _plot_position_error(position, item, count, dashes, colour, 1.3)
    rate.set_title(f"{axis.rate_words}, {axis.rate_unit}", fontsize=9, pad=4)
    position.set_title(f"{axis.position_words} error, {unit}", fontsize=9, pad=4)
    for panel, height in zip((rate, position), rows, strict=True):
        panel.locator_params(axis="y", nbins=max(round(3.0 * height), 3))
    position.set_xlabel("time, s")
    position.set_xlim(trial.time[0], trial.time[-1])
    figure.legend(
        *rate.get_legend_handles_labels(), ncols=3, loc="upper left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1
    )
    return figure


def _plot_position_error(
    panel: Axes, item: TrialSimulation, count: int, dashes: str, colour: str, linewidth: float
) -> None:
    """Error of the simulated position at the instants of the measurements."""
    trial = item.run.trial
    known = trial.measured
    error = trial.axis.display_unit[1] * (item.position - trial.position)[known]
    panel.plot(*decimate_min_max(trial.time[known], error, count), dashes, color=colour, linewidth=linewidth)


@report_style
def plot_overview(pairs: Sequence[tuple[TrialSimulation, TrialSimulation]]) -> Figure:
    """Measured and simulated rate of each trial with its R²; two simulations where causes were found."""
    columns = min(len(pairs), _COLUMNS)
    rows = -(-len(pairs) // columns)
    height = 0.95 if rows > 1 else 1.8
    figure, panels = panel_grid([(height, columns)] * rows, left=0.75, top=0.52, bottom=0.5, across=0.5, down=0.5)
    flat = list(chain(*panels))
    for panel, (before, after) in zip(flat, pairs, strict=False):
        _plot_small(panel, before, after)
    for panel in flat[len(pairs) :]:
        panel.set_axis_off()
    figure.supxlabel("time, s", y=0.06 / figure.get_figheight(), fontsize=10, va="bottom")
    axis = pairs[0][0].run.trial.axis
    figure.supylabel(f"{axis.rate_words}, {axis.rate_unit}", x=0.01, fontsize=10, ha="left")
    handles, labels = flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=3)
    return figure


def _plot_small(panel: Axes, before: TrialSimulation, after: TrialSimulation) -> None:
    plot_overlay(panel, after.run.rates.time, after.measured, after.simulated, 500)
    if before is not after:
        time, rate = decimate_min_max(after.run.rates.time, before.simulated, 500)
        panel.plot(time, rate, "--", color=ORANGE, linewidth=1.0, label="simulated by the plain model")
    panel.set_title(shorten_name(after.run.trial.name, 22), fontsize=9, pad=3)
    if math.isfinite(after.fit.r2):
        panel.set_title(f"R² {after.fit.r2:.4f}", fontsize=8, loc="right", pad=3)
    panel.tick_params(labelsize=8)
    panel.locator_params(axis="y", nbins=4)
    panel.locator_params(axis="x", nbins=5)


@report_style
def plot_trial(item: TrialSimulation) -> Figure:
    """Torque, measured and simulated rate, and errors of rate and position of one trial."""
    rows = [(0.75, 1), (2.2, 1), (0.9, 1), (0.9, 1)]
    figure, ((torque,), (rate,), (difference,), (position,)) = panel_grid(rows, left=1.05, down=0.16, share_x=True)
    trial, time, axis = item.run.trial, item.run.rates.time, item.run.trial.axis
    torque.step(*decimate_min_max(trial.time, item.run.torque), where="post", color=BLUE, linewidth=1.0)
    plot_overlay(rate, time, item.measured, item.simulated)
    difference.plot(*decimate_min_max(time, item.simulated - item.measured), color=BLUE, linewidth=0.9)
    _plot_position_error(position, item, POINTS, "-", BLUE, 0.9)
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
    figure.legend(*rate.get_legend_handles_labels(), ncols=2, loc="upper right", borderaxespad=0.1)
    position.set_xlabel("time, s")
    return figure
