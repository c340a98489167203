"""The fleet as an HTML page: findings over time, parameter histories, changes of causes and outliers."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any, Literal
from urllib.parse import quote

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid import __version__
from rovid.core.errors import escape_invisible, join_words, shortened_list
from rovid.core.formatting import plus_minus, significant
from rovid.effects import CATALOGUE
from rovid.fleet import results
from rovid.fleet.campaigns import CampaignRecord
from rovid.present.console import ResultTable, mixed_number_column, text_column
from rovid.present.number_format import DASH, parameter_title, shorten_name, unit_symbol
from rovid.present.page.page_files import template_environment
from rovid.present.plots.canvas import BLACK, ORANGE, PALE, RED, panel_grid, render_inline_svg, report_style
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import axis_named

_TITLES = {effect.id: effect.title for effect in CATALOGUE}
FOUND, SUSPECTED, ABSENT = "found", "suspected", "·"
# Verdict -> marker, colour, fill style and words.
VERDICTS: Mapping[str, tuple[str, str, Literal["full", "none"], str]] = {
    "found": ("o", ORANGE, "full", "cause found"),
    "suspected": ("o", ORANGE, "none", "suspected"),
    "unexplained": ("s", ORANGE, "none", "unexplained"),
    "nothing_found": ("o", BLACK, "full", "nothing found"),
    "too_little_data": ("x", BLACK, "full", "too little data"),
}
# Half width of a 95 % interval in standard errors; height of a vehicle's row in the timeline, in inches.
_INTERVAL, _ROW = 1.96, 0.32
# Maximum number of date labels, and of letters of the vehicles' names, across a history plot.
_DATES, _LETTERS = 9, 120


@dataclass(frozen=True, kw_only=True)
class PageFigure:
    """A figure of the page with its alternative text."""

    svg: Markup
    alt: str


def fleet_page(fleet: results.Fleet, means: Sequence[results.ShrunkParameter]) -> str:
    """The page as self-contained HTML, with links to the diagnosis of each campaign."""
    found = results.outliers(fleet)
    timeline_figure, dates = None, [f"{datetime.fromtimestamp(start, UTC):%Y-%m-%d}" for start in fleet.starts]
    if dates:
        alt = "A row for each vehicle and a mark for each campaign at its date. The table below shows the same."
        timeline_figure = PageFigure(svg=render_inline_svg(timeline(fleet), "timeline"), alt=alt)
    histories, by_name = [], {mean.name: mean for mean in means}
    for number, name in enumerate(fleet.parameters):
        marked = {outlier.campaign for outlier in found if outlier.name == name}
        alt = f"{parameter_title(name)} of each campaign with its 95 % interval, vehicle by vehicle."
        figure = render_inline_svg(history(fleet, name, marked, by_name.get(name)), f"history{number}")
        histories.append(PageFigure(svg=figure, alt=alt))
    environment = template_environment("rovid.fleet")
    environment.globals["guess"] = Assumptions()
    table = ResultTable(
        "Outliers, the farthest first.",
        *map(text_column, ("campaign", "vehicle", "parameter")),
        *map(mixed_number_column, ("value", "median", "distance")),
    )
    for one in found:
        value = f"{plus_minus(one.value.value, one.value.error)} {unit_symbol(one.value.unit)}".strip()
        numbers = value, significant(one.median, 4), f"{one.distance:+.1f}"
        table.add_row(one.campaign, one.vehicle, parameter_title(one.name), *numbers)
    return environment.get_template("fleet.html.j2").render(
        fleet=fleet,
        version=__version__,
        axis=axis_named(fleet.axis).name,
        span=" to ".join(dict.fromkeys((dates[0], dates[-1]))) if dates else "",
        headline=headline(fleet),
        changes=list(cause_changes(fleet)),
        caution=caution(fleet),
        far=found,
        rule=results.RULE,
        campaigns=_campaign_table(fleet),
        timeline=timeline_figure,
        histories=histories,
        causes=_cause_table(fleet),
        outliers=table,
        means=_mean_table(fleet, means),
    )


def headline(fleet: results.Fleet) -> str:
    """Summary of the verdicts in one line."""
    campaigns, vehicles = len(fleet.records), len(fleet.vehicles)
    counts = f"{campaigns} campaign{'s' * (campaigns != 1)} of {vehicles} vehicle{'s' * (vehicles != 1)}"
    verdicts = list(map(results.verdict, fleet.done))
    parts = [f"{words} in {verdicts.count(key)}" for key, (*_, words) in VERDICTS.items() if key in verdicts]
    if fleet.failed:
        parts.append(f"no diagnosis of {len(fleet.failed)}")
    return f"{counts}: {', '.join(parts)}." if parts else f"{counts}."


def caution(fleet: results.Fleet) -> str:
    """Warning about campaigns with guessed arms or thrust curves; empty if there are none."""
    names = [record.campaign for record in fleet.done if results.guessed(record)]
    if not names:
        return ""
    text = f"Arms or thrust curves are guesses in {shortened_list(names)}: inertia and drag there are "
    return f"{text}placeholders and are not compared with other campaigns."


def cause_changes(fleet: results.Fleet) -> Iterator[str]:
    """Sentences on causes that appear or disappear between consecutive campaigns of a vehicle."""
    for vehicle, records in fleet.vehicles.items():
        for before, after in pairwise(records):
            old, new = set(results.causes(before, "findings")), set(results.causes(after, "findings"))
            for verb, effects in (("appeared", new - old), ("disappeared", old - new)):
                if effects:
                    names = join_words([_effect_title(fleet, effect) for effect in sorted(effects)])
                    yield f"{vehicle or 'No name'}: {names} {verb} between {before.campaign} and {after.campaign}."


def _effect_title(fleet: results.Fleet, effect: str) -> str:
    return axis_named(fleet.axis).reword(_TITLES[effect])


def _campaign_table(fleet: results.Fleet) -> ResultTable:
    """All campaigns by vehicle and date, then those without a diagnosis."""
    text = "All campaigns. Each name links to the full diagnosis."
    table = ResultTable(text, *map(text_column, ("campaign", "vehicle", "start, UTC", "verdict", "causes", "suspects")))
    for record in (*(record for records in fleet.vehicles.values() for record in records), *fleet.failed):
        key = results.verdict(record)
        words = VERDICTS[key][-1] if key else "no diagnosis"
        found, suspected = (_cause_titles(fleet, record, kind) for kind in ("findings", "suspects"))
        start = DASH if record.start is None else f"{datetime.fromtimestamp(record.start, UTC):%Y-%m-%d %H:%M}"
        table.add_row(_link(record), record.vehicle or DASH, start, words, record.error or found, suspected)
    return table


def _cause_titles(fleet: results.Fleet, record: CampaignRecord, kind: str) -> str:
    return ", ".join(_effect_title(fleet, effect) for effect in results.causes(record, kind)) or DASH


def _link(record: CampaignRecord) -> Markup:
    place = quote(f"campaigns/{record.campaign}.json")
    return Markup('<a href="{}">{}</a>').format(place, escape_invisible(record.campaign))


def _cause_table(fleet: results.Fleet) -> ResultTable | None:
    """Causes found or suspected in each campaign; None if there are none."""
    kinds = ("findings", "suspects")
    effects = sorted({effect for record in fleet.done for kind in kinds for effect in results.causes(record, kind)})
    if not effects:
        return None
    heads = [text_column(_effect_title(fleet, effect)) for effect in effects]
    text = "Causes by campaign, in order of time."
    table = ResultTable(text, text_column("vehicle"), text_column("campaign"), *heads)
    for vehicle, records in fleet.vehicles.items():
        for record in records:
            cells = dict.fromkeys(effects, ABSENT)
            cells |= dict.fromkeys(results.causes(record, "suspects"), SUSPECTED)
            cells |= dict.fromkeys(results.causes(record, "findings"), FOUND)
            table.add_row(vehicle, _link(record), *cells.values())
    return table


def _mean_table(fleet: results.Fleet, means: Sequence[results.ShrunkParameter]) -> ResultTable | None:
    """Hierarchical means and scatters; None if there are none."""
    if not means:
        return None
    columns = map(mixed_number_column, ("mean", "between vehicles", "between a vehicle's campaigns"))
    table = ResultTable("Fleet means and scatter of the vehicles about them.", text_column("parameter"), *columns)
    for one in means:
        mean = f"{plus_minus(one.mean.value, one.mean.error)} {unit_symbol(fleet.units[one.name])}".strip()
        scatters = [
            f"{100.0 * scatter:.2g} %" if one.logarithmic else significant(scatter, 2)
            for scatter in (one.between, one.within)
        ]
        table.add_row(parameter_title(one.name), mean, *scatters)
    return table


@report_style
def timeline(fleet: results.Fleet) -> Figure:
    """One row a vehicle with one marker for each dated campaign."""
    rows = list(fleet.vehicles.items())
    figure, ((panel,),) = panel_grid([(_ROW * (len(rows) + 1), 1)], left=2.2, top=0.45, bottom=0.5)
    for key, (marker, colour, filling, words) in VERDICTS.items():
        starts, heights = [], []
        for row, (_, records) in enumerate(rows):
            same = [one.start for one in records if one.start is not None and results.verdict(one) == key]
            starts += same
            heights += [row] * len(same)
        if starts:
            look: dict[str, Any] = {"color": colour, "markersize": 7.0, "label": words}
            panel.plot(np.array(starts).astype("datetime64[s]"), heights, marker, fillstyle=filling, **look)
    panel.set_yticks(range(len(rows)), [_beginning(name, 26) for name, _ in rows])
    panel.set_ylim(len(rows) - 0.3, -0.7)
    panel.margins(x=0.04)
    panel.grid(visible=True, axis="y")
    figure.legend(ncols=5, loc="upper left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1, handlelength=1.0)
    return figure


@report_style
def history(fleet: results.Fleet, name: str, marked: Collection[str], mean: results.ShrunkParameter | None) -> Figure:
    """A parameter with its 95 % intervals by vehicle and date; the campaigns in ``marked`` are red.

    If the vehicles differ too much, the deviation from each vehicle's own median is plotted, in per cent.
    """
    groups, shown = fleet.campaigns_with(name), unit_symbol(fleet.units[name])
    medians = fleet.dissimilar_medians(name) if mean is None else {}
    figure, ((panel,),) = panel_grid([(1.9, 1)], left=0.95, right=0.15, top=0.55, bottom=0.5)
    width = sum(map(len, groups.values())) + len(groups) - 1
    at, ticks = 0, []
    for vehicle, known in groups.items():
        median = medians.get(vehicle)
        _label_group(panel, at, vehicle, _LETTERS * len(known) // width, median)
        for record, value in known:
            plotted = value
            if median is not None:
                error = 100.0 * value.error / abs(median)
                plotted = replace(value, value=100.0 * (value.value / median - 1.0), error=error)
            _plot_value(panel, at, plotted, RED if record.campaign in marked else BLACK)
            if mean is not None and record.campaign in mean.values:
                _plot_value(panel, at + 0.3, mean.values[record.campaign], PALE)
            ticks.append((at, _date(record)))
            at += 1
        at += 1
    look: dict[str, Any] = {"linewidth": 0.8, "linestyle": (0, (4, 3)), "zorder": 1}
    panel.axhline(_centre(fleet, name, medians, mean), color=BLACK if mean is None else PALE, **look)
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


def _centre(
    fleet: results.Fleet, name: str, medians: Mapping[str, float], mean: results.ShrunkParameter | None
) -> float:
    """Ordinate of the dashed line."""
    if mean is not None:
        return mean.mean.value
    if medians:
        return 0.0
    values = [value for known in fleet.campaigns_with(name).values() for _, value in known if value.is_comparable]
    return results.median_of(values) if values else math.nan


def _plot_value(panel: Axes, at: float, value: results.ParameterValue, colour: str) -> None:
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
