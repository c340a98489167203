"""A fleet as a page: what was found when, each parameter's history, causes that come and go, what is out of line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from rovid import __version__
from rovid.core.errors import escape_invisible
from rovid.core.formatting import plus_minus, significant
from rovid.effects import CATALOGUE
from rovid.fleet.campaign_record import CampaignRecord
from rovid.fleet.outliers import RULE, Outlier, outliers
from rovid.fleet.plots import VERDICTS, history, timeline
from rovid.fleet.results import Fleet, causes, guessed, verdict
from rovid.fleet.shrinkage import ShrunkParameter
from rovid.present.number_text import NOTHING, parameter_title, unit_symbol
from rovid.present.page.templating import template_environment
from rovid.present.plots.canvas import render_inline_svg
from rovid.present.tables.table import ResultTable, TableBuilder, mixed_number_column, text_column
from rovid.present.verdict import join_words
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import axis_named

_TITLES = {effect.id: effect.title for effect in CATALOGUE}
FOUND, SUSPECTED, ABSENT = "found", "suspected", "·"


@dataclass(frozen=True, kw_only=True)
class PageFigure:
    """A picture in the page, in words too."""

    svg: Markup
    alt: str


def fleet_page(fleet: Fleet, means: Sequence[ShrunkParameter]) -> str:
    """The page as HTML; it needs no other file, and links each campaign's own diagnosis beside it."""
    far = outliers(fleet)
    environment = template_environment("rovid.fleet")
    environment.globals["guess"] = Assumptions()
    return environment.get_template("fleet.html.j2").render(
        fleet=fleet,
        version=__version__,
        axis=axis_named(fleet.axis).name,
        span=_span(fleet),
        headline=headline(fleet),
        changes=list(cause_changes(fleet)),
        caution=caution(fleet),
        far=far,
        rule=RULE,
        campaigns=_campaigns(fleet),
        timeline=_timeline(fleet),
        histories=list(_histories(fleet, far, means)),
        causes=_causes(fleet),
        outliers=_outliers(far),
        means=_means(fleet, means),
    )


def headline(fleet: Fleet) -> str:
    """All of it in a line."""
    parts = [f"{_count(len(fleet.records), 'campaign')} of {_count(len(fleet.vehicles), 'vehicle')}"]
    said = [verdict(record) for record in fleet.done]
    for key, (*_, words) in VERDICTS.items():
        if key in said:
            parts.append(f"{words} in {said.count(key)}")
    if fleet.failed:
        parts.append(f"no diagnosis of {len(fleet.failed)}")
    return f"{parts[0]}: {', '.join(parts[1:])}." if len(parts) > 1 else f"{parts[0]}."


def caution(fleet: Fleet) -> str:
    """Which campaigns hang on guesses, as `rovid diagnose` says it of one; empty where none does."""
    names = [record.campaign for record in fleet.done if guessed(record)]
    if not names:
        return ""
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    found = f"Arms or thrust curves are guesses in {', '.join(names[:5])}{more}"
    return f"{found}: inertia and drag there are placeholders, and are compared with no other's."


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def cause_changes(fleet: Fleet) -> Iterator[str]:
    """Causes that come and go: each vehicle's, from one campaign to the next that was diagnosed."""
    for vehicle, records in fleet.vehicles.items():
        for before, after in pairwise(records):
            was, now = set(causes(before, "findings")), set(causes(after, "findings"))
            for words, those in (("came", now - was), ("went", was - now)):
                if those:
                    names = join_words([_words(fleet, effect) for effect in sorted(those)])
                    yield f"{vehicle or 'No name'}: {names} {words} between {before.campaign} and {after.campaign}."


def _words(fleet: Fleet, effect: str) -> str:
    return axis_named(fleet.axis).reword(_TITLES[effect])


def _span(fleet: Fleet) -> str:
    """From when to when."""
    starts = [record.start for record in fleet.done if record.start is not None]
    if not starts:
        return ""
    first, last = (datetime.fromtimestamp(start, UTC) for start in (min(starts), max(starts)))
    return f"{first:%Y-%m-%d}" if first.date() == last.date() else f"{first:%Y-%m-%d} to {last:%Y-%m-%d}"


def _campaigns(fleet: Fleet) -> ResultTable:
    """Every campaign, vehicle by vehicle in the order of time, and those that failed."""
    table = TableBuilder(
        "Every campaign; its name leads to its whole diagnosis.",
        *map(text_column, ("campaign", "vehicle", "start, UTC", "verdict", "causes", "suspects")),
    )
    for record in _in_order(fleet):
        said = verdict(record)
        words = VERDICTS[said][-1] if said else "no diagnosis"
        why = record.error or ", ".join(_words(fleet, effect) for effect in causes(record, "findings")) or NOTHING
        may_be = ", ".join(_words(fleet, effect) for effect in causes(record, "suspects")) or NOTHING
        table.add(_link(record), record.vehicle or NOTHING, _start(record), words, why, may_be)
    return table.grid()


def _in_order(fleet: Fleet) -> list[CampaignRecord]:
    return [*(record for records in fleet.vehicles.values() for record in records), *fleet.failed]


def _start(record: CampaignRecord) -> str:
    return NOTHING if record.start is None else f"{datetime.fromtimestamp(record.start, UTC):%Y-%m-%d %H:%M}"


def _link(record: CampaignRecord) -> Markup:
    """A campaign's name, which leads to its file."""
    place = quote(f"campaigns/{record.campaign}.json")
    return Markup('<a href="{}">{}</a>').format(place, escape_invisible(record.campaign))


def _timeline(fleet: Fleet) -> PageFigure | None:
    if all(record.start is None for record in fleet.done):
        return None
    alt = "A row for each vehicle, a mark for each campaign at its date; the table below says the same."
    return PageFigure(svg=render_inline_svg(timeline(fleet), "timeline"), alt=alt)


def _histories(fleet: Fleet, far: Sequence[Outlier], means: Sequence[ShrunkParameter]) -> Iterator[PageFigure]:
    by_name = {one.name: one for one in means}
    for place, name in enumerate(fleet.parameters):
        out_of_line = {one.campaign for one in far if one.name == name}
        alt = f"{parameter_title(name)} of each campaign with its 95 % interval, vehicle by vehicle."
        yield PageFigure(
            svg=render_inline_svg(history(fleet, name, out_of_line, by_name.get(name)), f"history{place}"), alt=alt
        )


def _causes(fleet: Fleet) -> ResultTable | None:
    """Which cause was named where; None where none was anywhere."""
    kinds = ("findings", "suspects")
    effects = sorted({effect for record in fleet.done for kind in kinds for effect in causes(record, kind)})
    if not effects:
        return None
    heads = [text_column(_words(fleet, effect)) for effect in effects]
    table = TableBuilder(
        "Causes by campaign, in the order of time.", text_column("vehicle"), text_column("campaign"), *heads
    )
    for vehicle, records in fleet.vehicles.items():
        for record in records:
            found, suspected = (causes(record, kind) for kind in kinds)
            cells = [FOUND if one in found else SUSPECTED if one in suspected else ABSENT for one in effects]
            table.add(vehicle, _link(record), *cells)
    return table.grid()


def _outliers(far: Sequence[Outlier]) -> ResultTable:
    table = TableBuilder(
        "Out of line with the fleet, the farthest first.",
        text_column("campaign"),
        text_column("vehicle"),
        text_column("parameter"),
        mixed_number_column("value"),
        mixed_number_column("median"),
        mixed_number_column("distance"),
    )
    for one in far:
        value = f"{plus_minus(one.value.value, one.value.error)} {unit_symbol(one.value.unit)}".strip()
        table.add(
            one.campaign,
            one.vehicle,
            parameter_title(one.name),
            value,
            significant(one.median, 4),
            f"{one.distance:+.1f}",
        )
    return table.grid()


def _means(fleet: Fleet, means: Sequence[ShrunkParameter]) -> ResultTable | None:
    """The hierarchical means; None where none was asked for, or can be had."""
    if not means:
        return None
    table = TableBuilder(
        "The fleet's means, and how its vehicles scatter about them.",
        text_column("parameter"),
        mixed_number_column("mean"),
        mixed_number_column("between vehicles"),
        mixed_number_column("between a vehicle's campaigns"),
    )
    for one in means:
        table.add(
            parameter_title(one.name),
            f"{plus_minus(one.mean.value, one.mean.error)} {unit_symbol(fleet.units[one.name])}".strip(),
            *(
                f"{100.0 * each:.2g} %" if one.logarithmic else significant(each, 2)
                for each in (one.between, one.within)
            ),
        )
    return table.grid()


def summary(fleet: Fleet) -> dict[str, Any]:
    """What `rovid fleet --json` says of the fleet as a whole."""
    return {
        "changes": list(cause_changes(fleet)),
        "outliers": [
            {"campaign": one.campaign, "parameter": one.name, "distance": one.distance} for one in outliers(fleet)
        ],
    }
