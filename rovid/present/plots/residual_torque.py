"""The torque that is left over without and with what the diagnosis found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from rovid.present.page.residual_torque import (
    ResidualTorque,
    all_rates,
    all_residuals,
    all_thruster_torques,
    binned_means,
)
from rovid.present.plots.canvas import BLACK, BLUE, ORANGE, panel_grid, report_style
from rovid.present.plots.residuals import density, memory, over_time

_LOOKS = (("without", ORANGE, "--", "s"), ("with what was found", BLUE, "-", "o"))


@report_style
def plot_residual_comparison(
    before: Sequence[ResidualTorque], after: Sequence[ResidualTorque], cutoff: float
) -> Figure:
    """Mean residual torque against rate and torque, its course, its autocorrelation and its spectrum, twice each."""
    figure, ((by_rate, by_torque), (course,), (lags, frequencies)) = panel_grid(
        [(2.2, 2), (1.6, 1), (1.9, 2)], top=0.4, across=0.95
    )
    axis = before[0].run.trial.axis
    rate, torque = all_rates(before), all_thruster_torques(before)
    for items, (label, colour, dashes, marker) in zip((before, after), _LOOKS, strict=True):
        left = all_residuals(items)
        line: dict[str, Any] = {"color": colour, "linestyle": dashes}
        for panel, driver in ((by_rate, rate), (by_torque, torque)):
            panel.plot(*binned_means(driver, left), **line, marker=marker, markersize=4, label=label)
        over_time(course, items, (colour,))
        memory(lags, items, **line)
        density(frequencies, items, cutoff, **line)
    residual = f"mean residual {axis.force_name}, {axis.force_unit}"
    by_rate.set(xlabel=f"{axis.rate_words}, {axis.rate_unit}", ylabel=residual)
    by_torque.set(xlabel=f"{axis.force_name}, {axis.force_unit}", ylabel=residual)
    for panel in (by_rate, by_torque):
        panel.axhline(0.0, color=BLACK, linewidth=0.8)
    by_rate.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.2)
    return figure
