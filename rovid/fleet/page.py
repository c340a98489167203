"""The fleet as an HTML page: findings over time, parameter histories, changes of causes and outliers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from urllib.parse import quote

from markupsafe import Markup

from rovid import __version__
from rovid.core.errors import escape_invisible
from rovid.core.formatting import plus_minus, significant
from rovid.effects import CATALOGUE
from rovid.fleet.campaign_record import CampaignRecord
from rovid.fleet.plots import VERDICTS, history, timeline
from rovid.fleet.results import RULE, Fleet, Outlier, causes, guessed, outliers, verdict
from rovid.fleet.shrinkage import ShrunkParameter
from rovid.present.numbers import DASH, parameter_title, unit_symbol
from rovid.present.page.templating import template_environment
from rovid.present.plots.canvas import render_inline_svg
from rovid.present.sentences import join_words
from rovid.present.tables.table import ResultTable, mixed_number_column, text_column
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import axis_named

_TITLES = {effect.id: effect.title for effect in CATALOGUE}
FOUND, SUSPECTED, ABSENT = "found", "suspected", "·"
# Number of campaigns named in the caution about guesses.
_NAMED = 5


@dataclass(frozen=True, kw_only=True)
class PageFigure:
    """A figure of the page with its alternative text."""

    svg: Markup
    alt: str


def fleet_page(fleet: Fleet, means: Sequence[ShrunkParameter]) -> str:
    """The page as self-contained HTML, with links to the diagnosis of each campaign."""
    found = outliers(fleet)
    environment = template_environment("rovid.fleet")
    environment.globals["guess"] = Assumptions()
    return environment.get_template("fleet.html.j2").render(
        fleet=fleet,
        version=__version__,
        axis=axis_named(fleet.axis).name,
        span=_date_range(fleet),
        headline=headline(fleet),
        changes=list(cause_changes(fleet)),
        caution=caution(fleet),
        far=found,
        rule=RULE,
        campaigns=_campaign_table(fleet),
        timeline=_timeline(fleet),
        histories=list(_histories(fleet, found, means)),
        causes=_cause_table(fleet),
        outliers=_outlier_table(found),
        means=_mean_table(fleet, means),
    )


def headline(fleet: Fleet) -> str:
    """Summary of the verdicts in one line."""
    counts = f"{_count(len(fleet.records), 'campaign')} of {_count(len(fleet.vehicles), 'vehicle')}"
    verdicts = list(map(verdict, fleet.done))
    parts = [f"{words} in {verdicts.count(key)}" for key, (*_, words) in VERDICTS.items() if key in verdicts]
    if fleet.failed:
        parts.append(f"no diagnosis of {len(fleet.failed)}")
    return f"{counts}: {', '.join(parts)}." if parts else f"{counts}."


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def caution(fleet: Fleet) -> str:
    """Warning about campaigns with guessed arms or thrust curves; empty if there are none."""
    names = [record.campaign for record in fleet.done if guessed(record)]
    if not names:
        return ""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return (
        f"Arms or thrust curves are guesses in {', '.join(names[:_NAMED])}{more}: inertia and drag there are "
        "placeholders and are not compared with other campaigns."
    )


def cause_changes(fleet: Fleet) -> Iterator[str]:
    """Sentences on causes that appear or disappear between consecutive campaigns of a vehicle."""
    for vehicle, records in fleet.vehicles.items():
        for before, after in pairwise(records):
            old, new = set(causes(before, "findings")), set(causes(after, "findings"))
            for verb, effects in (("appeared", new - old), ("disappeared", old - new)):
                if effects:
                    names = join_words([_effect_title(fleet, effect) for effect in sorted(effects)])
                    yield f"{vehicle or 'No name'}: {names} {verb} between {before.campaign} and {after.campaign}."


def _effect_title(fleet: Fleet, effect: str) -> str:
    return axis_named(fleet.axis).reword(_TITLES[effect])


def _date_range(fleet: Fleet) -> str:
    starts = [record.start for record in fleet.done if record.start is not None]
    if not starts:
        return ""
    first, last = (f"{datetime.fromtimestamp(start, UTC):%Y-%m-%d}" for start in (min(starts), max(starts)))
    return first if first == last else f"{first} to {last}"


def _campaign_table(fleet: Fleet) -> ResultTable:
    """All campaigns by vehicle and date, then those without a diagnosis."""
    table = ResultTable(
        "All campaigns. Each name links to the full diagnosis.",
        *map(text_column, ("campaign", "vehicle", "start, UTC", "verdict", "causes", "suspects")),
    )
    for record in (*(record for records in fleet.vehicles.values() for record in records), *fleet.failed):
        key = verdict(record)
        words = VERDICTS[key][-1] if key else "no diagnosis"
        found, suspected = (
            ", ".join(_effect_title(fleet, effect) for effect in causes(record, kind)) or DASH
            for kind in ("findings", "suspects")
        )
        start = DASH if record.start is None else f"{datetime.fromtimestamp(record.start, UTC):%Y-%m-%d %H:%M}"
        table.add_row(_link(record), record.vehicle or DASH, start, words, record.error or found, suspected)
    return table


def _link(record: CampaignRecord) -> Markup:
    """The campaign's name, linked to its JSON file."""
    place = quote(f"campaigns/{record.campaign}.json")
    return Markup('<a href="{}">{}</a>').format(place, escape_invisible(record.campaign))


def _timeline(fleet: Fleet) -> PageFigure | None:
    if all(record.start is None for record in fleet.done):
        return None
    alt = "A row for each vehicle and a mark for each campaign at its date. The table below shows the same."
    return PageFigure(svg=render_inline_svg(timeline(fleet), "timeline"), alt=alt)


def _histories(fleet: Fleet, found: Sequence[Outlier], means: Sequence[ShrunkParameter]) -> Iterator[PageFigure]:
    by_name = {mean.name: mean for mean in means}
    for number, name in enumerate(fleet.parameters):
        marked = {outlier.campaign for outlier in found if outlier.name == name}
        alt = f"{parameter_title(name)} of each campaign with its 95 % interval, vehicle by vehicle."
        yield PageFigure(
            svg=render_inline_svg(history(fleet, name, marked, by_name.get(name)), f"history{number}"), alt=alt
        )


def _cause_table(fleet: Fleet) -> ResultTable | None:
    """Causes found or suspected in each campaign; None if there are none."""
    kinds = ("findings", "suspects")
    effects = sorted({effect for record in fleet.done for kind in kinds for effect in causes(record, kind)})
    if not effects:
        return None
    heads = [text_column(_effect_title(fleet, effect)) for effect in effects]
    table = ResultTable(
        "Causes by campaign, in order of time.", text_column("vehicle"), text_column("campaign"), *heads
    )
    for vehicle, records in fleet.vehicles.items():
        for record in records:
            cells = dict.fromkeys(effects, ABSENT)
            cells |= dict.fromkeys(causes(record, "suspects"), SUSPECTED)
            cells |= dict.fromkeys(causes(record, "findings"), FOUND)
            table.add_row(vehicle, _link(record), *cells.values())
    return table


def _outlier_table(found: Sequence[Outlier]) -> ResultTable:
    table = ResultTable(
        "Outliers, the farthest first.",
        *map(text_column, ("campaign", "vehicle", "parameter")),
        *map(mixed_number_column, ("value", "median", "distance")),
    )
    for one in found:
        value = f"{plus_minus(one.value.value, one.value.error)} {unit_symbol(one.value.unit)}".strip()
        table.add_row(
            one.campaign,
            one.vehicle,
            parameter_title(one.name),
            value,
            significant(one.median, 4),
            f"{one.distance:+.1f}",
        )
    return table


def _mean_table(fleet: Fleet, means: Sequence[ShrunkParameter]) -> ResultTable | None:
    """Hierarchical means and scatters; None if there are none."""
    if not means:
        return None
    table = ResultTable(
        "Fleet means and scatter of the vehicles about them.",
        text_column("parameter"),
        *map(mixed_number_column, ("mean", "between vehicles", "between a vehicle's campaigns")),
    )
    for one in means:
        mean = f"{plus_minus(one.mean.value, one.mean.error)} {unit_symbol(fleet.units[one.name])}".strip()
        scatters = [
            f"{100.0 * scatter:.2g} %" if one.logarithmic else significant(scatter, 2)
            for scatter in (one.between, one.within)
        ]
        table.add_row(parameter_title(one.name), mean, *scatters)
    return table
