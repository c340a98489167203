"""The torque that a model misses without one cause, against what drives it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rovid.present.page.residual_drivers import MissingTorque, bin_means
from rovid.present.plots.canvas import BLACK, BLUE, ORANGE, PALE, panel_grid, report_style
from rovid.trial.axis import Axis

_WIDTH, _HEIGHT = 6.4, 2.3
_CLOUD = 4000
_MEANS = 16
# Of fewer readings no mean is drawn: it would be noise.
_FEWEST = 10
# Readings beyond these shares of all are left to the eye's imagination: a single spike would flatten the rest.
_SHOWN = (0.2, 99.8)


@report_style
def plot_missing_torque(item: MissingTorque, axis: Axis) -> Figure:
    """Readings as a cloud, their means, and the equation's line."""
    figure, ((panel,),) = panel_grid([(_HEIGHT, 1)], left=0.8, top=0.32, bottom=0.5, width=_WIDTH)
    known = np.isfinite(item.driver_values) & np.isfinite(item.measured) & np.isfinite(item.equation)
    x, y = item.driver_values[known], item.measured[known]
    every = max(len(x) // _CLOUD, 1)
    panel.plot(
        x[::every], y[::every], ".", color=PALE, markersize=2.5, alpha=0.6, label="readings", zorder=1, rasterized=True
    )
    over_time = item.driver.startswith("time in ") and item.line[0] is item.driver_values
    if not over_time:
        panel.plot(*bin_means(x, y, _MEANS, _FEWEST), "o", color=BLUE, markersize=4.5, label="their mean", zorder=3)
    line, values = item.line
    there = np.isfinite(line) & np.isfinite(values)
    panel.plot(line[there], values[there], color=ORANGE, linewidth=2.0, label="the equation", zorder=2)
    panel.axhline(0.0, color=BLACK, linewidth=0.8, zorder=0)
    low, high = np.percentile(y, _SHOWN)
    low, high = min(low, float(np.nanmin(values))), max(high, float(np.nanmax(values)))
    room = 0.08 * (high - low)
    panel.set_ylim(low - room, high + room)
    panel.set(xlabel=item.driver, ylabel=f"missing {axis.force_name}, {axis.force_unit}")
    figure.legend(*panel.get_legend_handles_labels(), ncols=3, loc="upper left", bbox_to_anchor=(0.08, 1.0))
    return figure
