"""``rovid compare``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rovid.cli.context import (
    claim_of,
    compile_beside,
    console,
    known_at,
    opened,
    print_json,
    remembered,
    require_holding,
    working,
)
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Cutoff, Force, Json, ParameterFile
from rovid.core.errors import ConfigError

if TYPE_CHECKING:
    from rovid.compare.campaign_fit import CampaignFit
    from rovid.trial.assumptions import Assumptions
    from rovid.trial.axis import Axis

PAGE = Page(
    text="""
    Holds two campaigns of one vehicle against each other, before and after a refit, a season or another payload.
    Prints which parameter changed, by how much and at what odds; which cause came or went; whether the model of each
    predicts the runs of the other; and the parameters that both together say, where they share what did not change.
    The verdict is same, changed, or cannot tell; where nothing changed it says how small a change it would have seen.

    A and B are a folder of logs each, or a parameter file. Folders are diagnosed, both then fitted with the causes of
    either. Of parameter files what stands in them is compared, which takes no time. Without B the parameter file at
    hand is B, and of a folder A the logs that this file remembers. Without A as well it is compared with the last
    model in its history that rests on other logs. -o writes a page with both over each other; nothing else is written.
    """,
    examples=(
        ("Before and after", "rovid compare my_logs surge_logs"),
        ("What two parameter files say", "rovid compare spring.toml autumn.toml"),
        ("The parameter file with what it held before", "rovid compare"),
        ("With a page to show", "rovid compare my_logs surge_logs -o compare.html"),
    ),
    see=("rovid diagnose", "rovid fit", "rovid help compare"),
)


def compare(
    campaigns: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="A B",
            help="Two folders of logs or parameter files; one or none to compare with the parameter file at hand.",
            show_default=False,
        ),
    ] = None,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="PAGE", help="Write a page that needs no other file.", show_default=False
        ),
    ] = None,
    matters: Annotated[
        float, typer.Option(metavar="PERCENT", min=0.1, max=100.0, help="Change of drag or inertia that has to show.")
    ] = 10.0,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Say what changed between two campaigns."""
    given = campaigns or []
    if len(given) > 2:
        raise ConfigError(
            f"{len(given)} campaigns were given; two were expected, or fewer.",
            mend="Give each campaign's folder, not its logs one by one.",
        )
    compile_beside()
    from rovid.compare.comparison import compare as compared
    from rovid.present.documents.diagnosis import comparison_document
    from rovid.present.terminal.diagnosis import show_comparison
    from rovid.trial.axis import YAW, axis_named

    wanted = axis_named(axis) if axis else YAW
    page = None
    if output is not None:
        from rovid.present.page.comparison import comparison_page

        page = comparison_page(output)
    claim = claim_of(
        [page] if page else [], [path for path in given if path.exists()], *_read(parameters, axis), force=force
    )
    with working("Reading …") as report:
        (a, b), notes = _asked_for(given, parameters, axis, wanted, cutoff)
        comparison = compared(a, b, matters=matters / 100.0, report=report)
        a, b = comparison.a, comparison.b
        guess = _guess(a, b)
        if page is not None:
            from rovid.present.page.comparison import write_comparison

            report("Drawing and writing the page …")
            write_comparison(claim, page, comparison, guess, notes)
    written = {} if page is None else {"page": str(page.path)}
    if json:
        print_json(comparison_document(comparison, guess, notes) | written)
        return
    show_comparison(console(), comparison, guess, notes)
    for path in written.values():
        console().print(path, highlight=False, soft_wrap=True)


def _read(parameters: Path | None, axis: str | None) -> list[Path]:
    """The parameter file at hand and its history, where there are any: no page goes over them."""
    from rovid.cli.context import stored_at
    from rovid.store.history import history_output

    path = stored_at(parameters, axis).path
    return [path, history_output(path).path]


def _asked_for(
    given: list[Path], parameters: Path | None, axis: str | None, wanted: Axis, cutoff: float | None
) -> tuple[tuple[CampaignFit, CampaignFit], list[str]]:
    """A and B, and what has to be said of them."""
    from rovid.compare.baseline import campaign_from_file, previous_campaign

    if len(given) == 2:
        one, other = (_day(path, name, wanted, cutoff) for path, name in zip(given, _apart(given), strict=True))
        return (one, other), []
    stored = known_at(parameters, axis)
    notes = require_holding(stored, None)
    at_hand = str(stored.path)
    if not given:
        return (previous_campaign(stored), campaign_from_file(stored.path, at_hand)), notes
    first = given[0]
    if _is_parameters(first):
        return (campaign_from_file(first, str(first)), campaign_from_file(stored.path, at_hand)), notes
    logs = remembered(stored)
    named = ", ".join(path.name for path in logs)
    return (_logs([first], first.resolve().name, stored.axis, cutoff), _logs(logs, named, stored.axis, cutoff)), notes


def _apart(given: list[Path]) -> list[str]:
    """What the two are called: their names, or as much of their paths as tells them apart."""
    names = [path.resolve().name for path in given]
    return [str(path) for path in given] if names[0] == names[1] else names


def _is_parameters(path: Path) -> bool:
    from rovid.core.signatures import PARAMETERS

    return path.is_file() and (path.suffix == ".toml" or PARAMETERS.matches(path))


def _day(path: Path, name: str, axis: Axis, cutoff: float | None) -> CampaignFit:
    from rovid.compare.baseline import campaign_from_file

    return campaign_from_file(path, name) if _is_parameters(path) else _logs([path], name, axis, cutoff)


def _logs(paths: list[Path], name: str, axis: Axis, cutoff: float | None) -> CampaignFit:
    from rovid.compare.campaign_fit import campaign_from_study

    return campaign_from_study(opened(paths, cutoff, axis), name)


def _guess(a: CampaignFit, b: CampaignFit) -> Assumptions:
    """What is guessed of either vehicle."""
    from rovid.trial.assumptions import Assumptions

    guess = Assumptions()
    for day in (a, b):
        if day.settings is not None:
            guess = guess | day.settings.assumptions
    return guess
