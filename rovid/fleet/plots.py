"""Plots of a fleet: findings over time and the history of each parameter."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.core.errors import escape_invisible
from rovid.core.formatting import significant
from rovid.fleet.campaign_record import CampaignRecord
from rovid.fleet.results import Fleet, ParameterValue, median_of, verdict
from rovid.fleet.shrinkage import ShrunkParameter
from rovid.present.numbers import parameter_title, unit_symbol
from rovid.present.plots.canvas import BLACK, ORANGE, PALE, RED, panel_grid, report_style, shorten_name

# Verdict -> marker, colour, fill style and words.
VERDICTS: Mapping[str, tuple[str, str, Literal["full", "none"], str]] = {
    "found": ("o", ORANGE, "full", "cause found"),
    "suspected": ("o", ORANGE, "none", "suspected"),
    "unexplained": ("s", ORANGE, "none", "unexplained"),
    "nothing_found": ("o", BLACK, "full", "nothing found"),
    "too_little_data": ("x", BLACK, "full", "too little data"),
}
# Half width of a 95 % interval in standard errors.
_INTERVAL = 1.96
# Height of a vehicle's row in the timeline, in inches.
_ROW = 0.32
# Maximum number of date labels, and of letters of the vehicles' names, across a history plot.
_DATES, _LETTERS = 9, 120


@report_style
def timeline(fleet: Fleet) -> Figure:
    """One row a vehicle with one marker for each dated campaign."""
    rows = list(fleet.vehicles.items())
    figure, ((panel,),) = panel_grid([(_ROW * (len(rows) + 1), 1)], left=2.2, top=0.45, bottom=0.5)
    for key, (marker, colour, filling, words) in VERDICTS.items():
        dated = [
            (record.start, row)
            for row, (_, records) in enumerate(rows)
            for record in records
            if record.start is not None and verdict(record) == key
        ]
        if dated:
            starts, heights = zip(*dated, strict=True)
            look: dict[str, Any] = {"color": colour, "markersize": 7.0, "label": words}
            panel.plot(np.array(starts).astype("datetime64[s]"), heights, marker, fillstyle=filling, **look)
    panel.set_yticks(range(len(rows)), [_beginning(name, 26) for name, _ in rows])
    panel.set_ylim(len(rows) - 0.3, -0.7)
    panel.margins(x=0.04)
    panel.grid(visible=True, axis="y")
    figure.legend(ncols=5, loc="upper left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1, handlelength=1.0)
    return figure


@report_style
def history(fleet: Fleet, name: str, marked: Collection[str], mean: ShrunkParameter | None) -> Figure:
    """A parameter with its 95 % intervals by vehicle and date; the campaigns in ``marked`` are red.

    If the vehicles differ too much, the deviation from each vehicle's own median is plotted, in per cent.
    """
    groups, shown = fleet.campaigns_with(name), unit_symbol(fleet.units[name])
    medians = fleet.dissimilar_medians(name) if mean is None else {}
    figure, ((panel,),) = panel_grid([(1.9, 1)], left=0.95, right=0.15, top=0.55, bottom=0.5)
    width = sum(map(len, groups.values())) + len(groups) - 1
    at, ticks = 0, []
    for vehicle, known in groups.items():
        _label_group(panel, at, vehicle, _LETTERS * len(known) // width, medians.get(vehicle))
        for record, value in known:
            plotted = _percent_deviation(value, medians[vehicle]) if medians else value
            _plot_value(panel, at, plotted, RED if record.campaign in marked else BLACK)
            if mean is not None and record.campaign in mean.values:
                _plot_value(panel, at + 0.3, mean.values[record.campaign], PALE)
            ticks.append((at, _date(record)))
            at += 1
        at += 1
    panel.axhline(
        _centre(fleet, name, medians, mean),
        color=BLACK if mean is None else PALE,
        linewidth=0.8,
        linestyle=(0, (4, 3)),
        zorder=1,
    )
    dates = ticks[:: max(1, math.ceil(len(ticks) / _DATES))]
    panel.set_xticks([place for place, _ in dates], [text for _, text in dates], fontsize=8)
    panel.set_xlim(-0.7, at - 1.0)
    panel.locator_params(axis="y", nbins=5)
    panel.grid(visible=False, axis="x")
    label = f"deviation from each vehicle's median in %, the median beside its name in {shown}" if medians else shown
    figure.text(0.005, 0.985, f"{parameter_title(name)}{', ' if label else ''}{label}", fontsize=10, va="top")
    return figure


def _label_group(panel: Axes, first: int, vehicle: str, letters: int, median: float | None) -> None:
    """Write the vehicle's name above its campaigns and separate them from the previous vehicle."""
    amount = "" if median is None else f" {significant(median, 3)}"
    words = _beginning(vehicle, max(letters - len(amount), 4)) + amount
    # x in data coordinates, y in axes coordinates.
    panel.text(first - 0.4, 1.03, words, transform=panel.get_xaxis_transform(), fontsize=9)
    if first:
        panel.axvline(first - 1.0, color="#e2e2e2", linewidth=1.0)


def _centre(fleet: Fleet, name: str, medians: Mapping[str, float], mean: ShrunkParameter | None) -> float:
    """Ordinate of the dashed line."""
    if mean is not None:
        return mean.mean.value
    if medians:
        return 0.0
    values = [value for known in fleet.campaigns_with(name).values() for _, value in known if value.is_comparable]
    return median_of(values) if values else math.nan


def _percent_deviation(value: ParameterValue, median: float) -> ParameterValue:
    return replace(value, value=100.0 * (value.value / median - 1.0), error=100.0 * value.error / abs(median))


def _plot_value(panel: Axes, at: float, value: ParameterValue, colour: str) -> None:
    if math.isfinite(value.error):
        reach = _INTERVAL * value.error
        panel.plot([at, at], [value.value - reach, value.value + reach], color=colour, linewidth=1.6, zorder=2)
    fill: Literal["full", "none"] = "none" if value.placeholder else "full"
    panel.plot([at], [value.value], "o", color=colour, markersize=4.5, fillstyle=fill, zorder=3)


def _date(record: CampaignRecord) -> str:
    # Tick labels are not escaped when the figure becomes SVG, so the name is made visible here.
    if record.start is None:
        return shorten_name(escape_invisible(record.campaign), 12)
    return f"{datetime.fromtimestamp(record.start, UTC):%Y-%m-%d}"


def _beginning(name: str, length: int) -> str:
    """The first letters of a vehicle's name."""
    whole = escape_invisible(name)
    return whole if len(whole) <= length else f"{whole[: length - 1].rstrip()}…"
