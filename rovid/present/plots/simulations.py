"""The simulation over the measurement: every trial small, and each one large."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.model.simulation import TrialSimulation
from rovid.present.plots.canvas import (
    BLUE,
    ORANGE,
    decimate_min_max,
    panel_grid,
    plot_overlay,
    report_style,
    shorten_name,
)
from rovid.trial.axis import Axis

PER_SHEET = 24
_COLUMNS = 3
_LABEL = -0.085  # of the axes' width


@report_style
def plot_overview(pairs: Sequence[tuple[TrialSimulation, TrialSimulation]]) -> Figure:
    """Measured and simulated rate of each trial, with its R²; two simulations where something was found."""
    columns = min(len(pairs), _COLUMNS)
    rows = -(-len(pairs) // columns)
    height = 0.95 if rows > 1 else 1.8
    figure, panels = panel_grid([(height, columns)] * rows, left=0.75, top=0.52, bottom=0.5, across=0.5, down=0.5)
    flat = [panel for row in panels for panel in row]
    for panel, (before, after) in zip(flat, pairs, strict=False):
        _small(panel, before, after)
    for panel in flat[len(pairs) :]:
        panel.set_axis_off()
    figure.supxlabel("time, s", y=0.06 / figure.get_figheight(), fontsize=10, va="bottom")
    axis = pairs[0][0].run.trial.axis
    figure.supylabel(f"{axis.rate_words}, {axis.rate_unit}", x=0.01, fontsize=10, ha="left")
    handles, labels = flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=3)
    return figure


def _small(panel: Axes, before: TrialSimulation, after: TrialSimulation) -> None:
    item = after
    plot_overlay(panel, item.run.rates.time, item.measured, item.simulated, 500)
    if before is not after:
        time, rate = decimate_min_max(item.run.rates.time, before.simulated, 500)
        panel.plot(time, rate, "--", color=ORANGE, linewidth=1.0, label="simulated without what was found")
    panel.set_title(shorten_name(item.run.trial.name, 22), fontsize=9, pad=3)
    if math.isfinite(item.fit.r2):
        panel.set_title(f"R² {item.fit.r2:.4f}", fontsize=8, loc="right", pad=3)
    panel.tick_params(labelsize=8)
    panel.locator_params(axis="y", nbins=4)
    panel.locator_params(axis="x", nbins=5)


@report_style
def plot_trial(item: TrialSimulation) -> Figure:
    """One trial: the torque, measured and simulated rate, and the simulation's error in rate and position."""
    rows = [(0.75, 1), (2.2, 1), (0.9, 1), (0.9, 1)]
    figure, ((torque,), (rate,), (difference,), (position,)) = panel_grid(rows, left=1.05, down=0.16, share_x=True)
    trial, time = item.run.trial, item.run.rates.time
    torque.step(*decimate_min_max(trial.time, item.run.torque), where="post", color=BLUE, linewidth=1.0)
    plot_overlay(rate, time, item.measured, item.simulated)
    difference.plot(*decimate_min_max(time, item.simulated - item.measured), color=BLUE, linewidth=0.9)
    _position_error(position, item)
    for panel, label in zip((torque, rate, difference, position), _labels(trial.axis), strict=True):
        panel.set_ylabel(label)
        panel.yaxis.set_label_coords(_LABEL, 0.5)
    for panel in (torque, difference, position):
        panel.locator_params(axis="y", nbins=4)
    torque.set_title(f"{shorten_name(trial.name, 48)}{_quality(item)}")
    figure.legend(*rate.get_legend_handles_labels(), ncols=2, loc="upper right", borderaxespad=0.1)
    position.set_xlabel("time, s")
    return figure


def _position_error(panel: Axes, item: TrialSimulation) -> None:
    trial = item.run.trial
    known = trial.measured
    _, factor = trial.axis.display_unit
    error = factor * (item.position - trial.position)[known]
    panel.plot(*decimate_min_max(trial.time[known], error), color=BLUE, linewidth=0.9)


def _labels(axis: Axis) -> Iterator[str]:
    """Of each panel from the top."""
    shown, _ = axis.display_unit
    yield f"{axis.force_name},\n{axis.force_unit}"
    yield f"{axis.rate_words},\n{axis.rate_unit}"
    yield f"rate error,\n{axis.rate_unit}"
    yield f"{axis.position_words}\nerror, {shown}"


def _quality(item: TrialSimulation) -> str:
    if not math.isfinite(item.fit.r2):
        return ""
    return f"   R² {item.fit.r2:.4f}, fit {item.fit.fit_percent:.1f} %"
