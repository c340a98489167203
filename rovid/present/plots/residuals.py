"""The torque that the model leaves over, seen from five sides."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from rovid.core.array_types import FloatArray
from rovid.present.page.residual_torque import (
    ResidualTorque,
    all_rates,
    all_residuals,
    all_thruster_torques,
    autocorrelation,
    binned_means,
    spectrum,
)
from rovid.present.plots.canvas import BLACK, BLUE, GREY, ORANGE, decimate_min_max, panel_grid, report_style
from rovid.trial.axis import Axis

_DOTS = 6000
_LONGEST_LAG = 60.0  # s


@report_style
def plot_residuals(items: Sequence[ResidualTorque], cutoff: float) -> Figure:
    """Residual torque against rate, torque and time, its autocorrelation and its spectrum."""
    figure, ((by_rate, by_torque), (course,), (lags, frequencies)) = panel_grid(
        [(2.2, 2), (1.6, 1), (1.9, 2)], top=0.4, across=0.95
    )
    axis = items[0].run.trial.axis
    left = all_residuals(items)
    _against(by_rate, all_rates(items), left)
    _against(by_torque, all_thruster_torques(items), left)
    residual = f"residual {axis.force_name}, {axis.force_unit}"
    by_rate.set(xlabel=f"{axis.rate_words}, {axis.rate_unit}", ylabel=residual)
    by_torque.set(xlabel=f"{axis.force_name}, {axis.force_unit}", ylabel=residual)
    legend = by_rate.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.2)
    legend.get_lines()[0].set(markersize=7, alpha=1.0)
    over_time(course, items, (BLUE, GREY))
    memory(lags, items, color=BLUE)
    density(frequencies, items, cutoff, color=BLUE)
    return figure


def _squared(axis: Axis) -> str:
    return f"({axis.force_unit})²" if " " in axis.force_unit else f"{axis.force_unit}²"


def _against(panel: Axes, driver: FloatArray, left: FloatArray) -> None:
    """Some of the points, and their mean in bins, of what is ``left`` over its ``driver``."""
    known = np.flatnonzero(np.isfinite(driver) & np.isfinite(left))
    step = max(len(known) // _DOTS, 1)
    rows = known[::step]
    panel.plot(
        driver[rows],
        left[rows],
        linestyle="none",
        marker=".",
        markersize=2.6,
        markeredgewidth=0.0,
        color=BLUE,
        alpha=0.55,
        rasterized=True,
        label="samples",
    )
    panel.axhline(0.0, color=BLACK, linewidth=0.8)
    panel.plot(*binned_means(driver, left), color=ORANGE, marker="o", markersize=4, label="mean")


def over_time(panel: Axes, items: Sequence[ResidualTorque], colours: Sequence[str]) -> None:
    """Residual torque of all runs one after another, in these colours by turns."""
    clock, samples = 0.0, sum(len(item.residual) for item in items)
    for item, colour in zip(items, cycle(colours), strict=False):
        time = clock + item.run.rates.time - item.run.rates.time[0]
        count = max(2400 * len(item.residual) // samples, 20)
        panel.plot(*decimate_min_max(time, item.residual, count), color=colour, linewidth=0.7)
        clock = float(time[-1])
    axis = items[0].run.trial.axis
    panel.set(xlabel="time, all trials one after another, s", ylabel=f"residual {axis.force_name}, {axis.force_unit}")
    panel.margins(x=0.01)


def memory(panel: Axes, items: Sequence[ResidualTorque], **look: Any) -> None:
    """Autocorrelation of what is left."""
    longest = _longest_lag(items)
    panel.plot(*autocorrelation(items, longest), **look)
    panel.axhline(0.0, color=BLACK, linewidth=0.8)
    panel.set(xlabel="lag, s", ylabel="autocorrelation", xlim=(0.0, longest), ylim=(-0.6, 1.05))


def _longest_lag(items: Sequence[ResidualTorque]) -> float:
    """In s: of more than half a run too few pairs of samples are left."""
    durations = [float(np.ptp(item.run.rates.time)) for item in items]
    return min(_LONGEST_LAG, 0.5 * max(durations))


def density(panel: Axes, items: Sequence[ResidualTorque], cutoff: float, **look: Any) -> None:
    """Spectrum of what is left, over any that was drawn before."""
    panel.semilogy(*spectrum(items, cutoff), **look)
    panel.set(xlabel="frequency, Hz", ylabel=f"density, {_squared(items[0].run.trial.axis)}/Hz", xlim=(0.0, cutoff))
    drawn = np.concatenate([np.asarray(line.get_ydata(), dtype=np.float64) for line in panel.get_lines()])
    # Within two decades the powers of ten alone would label too few places.
    wide = np.nanmax(drawn) > 100.0 * np.nanmin(drawn)
    labelled = (1.0,) if wide else (1.0, 3.0)
    panel.yaxis.set_major_locator(LogLocator(subs=labelled, numticks=7))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.yaxis.set_minor_locator(NullLocator())
