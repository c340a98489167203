"""A fleet's pictures: what was found when, and how each parameter went from campaign to campaign."""

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
from rovid.present.number_text import parameter_title, unit_symbol
from rovid.present.plots.canvas import BLACK, ORANGE, PALE, RED, panel_grid, report_style, shorten_name

# Verdict -> marker, its colour and filling, and its words.
VERDICTS: Mapping[str, tuple[str, str, Literal["full", "none"], str]] = {
    "found": ("o", ORANGE, "full", "cause found"),
    "suspected": ("o", ORANGE, "none", "suspected"),
    "unexplained": ("s", ORANGE, "none", "unexplained"),
    "nothing_found": ("o", BLACK, "full", "nothing found"),
    "too_little_data": ("x", BLACK, "full", "too little data"),
}
# Standard errors to either side of a 95 % interval.
_INTERVAL = 1.96
_ROW = 0.32  # in, of a vehicle
# Dates below the points of a history, and letters of a vehicle's name above them, in the width of the page.
_DATES, _LETTERS = 9, 120


@report_style
def timeline(fleet: Fleet) -> Figure:
    """A row for each vehicle, a mark for each of its campaigns that has a date."""
    rows = list(fleet.vehicles.items())
    figure, ((panel,),) = panel_grid([(_ROW * (len(rows) + 1), 1)], left=2.2, top=0.45, bottom=0.5)
    for said, (marker, colour, filling, words) in VERDICTS.items():
        dated = [
            (record.start, place)
            for place, (_, records) in enumerate(rows)
            for record in records
            if record.start is not None and verdict(record) == said
        ]
        if dated:
            when = np.array([start for start, _ in dated]).astype("datetime64[s]")
            look: dict[str, Any] = {"color": colour, "markersize": 7.0, "label": words}
            panel.plot(when, [place for _, place in dated], marker, fillstyle=filling, **look)
    panel.set_yticks(range(len(rows)), [_begun(name, 26) for name, _ in rows])
    panel.set_ylim(len(rows) - 0.3, -0.7)
    panel.margins(x=0.04)
    panel.grid(visible=True, axis="y")
    figure.legend(ncols=5, loc="upper left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1, handlelength=1.0)
    return figure


@report_style
def history(fleet: Fleet, name: str, out_of_line: Collection[str], mean: ShrunkParameter | None) -> Figure:
    """A parameter with its 95 % intervals, vehicle by vehicle, each in the order of time.

    Of vehicles that are unlike it is how far each campaign is from its own vehicle's median, in per cent.
    """
    groups, shown = fleet.campaigns_with(name), unit_symbol(fleet.units[name])
    own = fleet.dissimilar_medians(name) if mean is None else {}
    figure, ((panel,),) = panel_grid([(1.9, 1)], left=0.95, right=0.15, top=0.55, bottom=0.5)
    at, ticks = 0, []
    for vehicle, known in groups.items():
        first = at
        for record, one in known:
            here = _from(own[vehicle], one) if own else one
            _mark(panel, at, here, RED if record.campaign in out_of_line else BLACK)
            if mean is not None and record.campaign in mean.values:
                _mark(panel, at + 0.3, mean.values[record.campaign], PALE)
            ticks.append((at, _date(record)))
            at += 1
        share = _LETTERS * (at - first) // (sum(map(len, groups.values())) + len(groups) - 1)
        # Along x by the data, along y by the panel.
        above = panel.get_xaxis_transform()
        amount = f" {significant(own[vehicle], 3)}" if own else ""
        words = _begun(vehicle, max(share - len(amount), 4)) + amount
        panel.text(first - 0.4, 1.03, words, transform=above, fontsize=9)
        if first:
            panel.axvline(first - 1.0, color="#e2e2e2", linewidth=1.0)
        at += 1
    some = [one for known in groups.values() for _, one in known if one.is_comparable]
    middle = mean.mean.value if mean is not None else 0.0 if own else median_of(some) if some else math.nan
    panel.axhline(middle, color=BLACK if mean is None else PALE, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
    dates = ticks[:: max(1, math.ceil(len(ticks) / _DATES))]
    panel.set_xticks([place for place, _ in dates], [text for _, text in dates], fontsize=8)
    panel.set_xlim(-0.7, at - 1.0)
    panel.locator_params(axis="y", nbins=5)
    panel.grid(visible=False, axis="x")
    label = f"% from each vehicle's own median, which stands beside its name, {shown}" if own else shown
    figure.text(0.005, 0.985, f"{parameter_title(name)}{', ' if label else ''}{label}", fontsize=10, va="top")
    return figure


def _from(median: float, one: ParameterValue) -> ParameterValue:
    """How far it is from the ``median``, in per cent of that."""
    return replace(one, value=100.0 * (one.value / median - 1.0), error=100.0 * one.error / abs(median))


def _mark(panel: Axes, at: float, one: ParameterValue, colour: str) -> None:
    if math.isfinite(one.error):
        reach = _INTERVAL * one.error
        panel.plot([at, at], [one.value - reach, one.value + reach], color=colour, linewidth=1.6, zorder=2)
    fill: Literal["full", "none"] = "none" if one.placeholder else "full"
    panel.plot([at], [one.value], "o", color=colour, markersize=4.5, fillstyle=fill, zorder=3)


def _date(record: CampaignRecord) -> str:
    return _shown(record.campaign, 12) if record.start is None else f"{_instant(record.start):%Y-%m-%d}"


def _shown(name: str, length: int) -> str:
    """A name from elsewhere; labels of ticks are not looked through when the figure is made into SVG."""
    return shorten_name(escape_invisible(name), length)


def _begun(name: str, length: int) -> str:
    """As `_shown`, but of a vehicle, which its first letters tell."""
    whole = escape_invisible(name)
    return whole if len(whole) <= length else f"{whole[: length - 1].rstrip()}…"


def _instant(start: float) -> datetime:
    return datetime.fromtimestamp(start, UTC)
