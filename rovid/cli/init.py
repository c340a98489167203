"""``rovid init``."""

from __future__ import annotations

from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import console, print_json
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Json, Logs

PAGE = Page(
    text="""
    Reads the logs and guesses which column or topic is the heading, which are thruster commands, in what unit and
    of what sense. Writes rovid.toml beside the logs, each guess with its reason as a comment; where there is no
    thrust curve also thrust_guess.csv. Lever arms, and such a curve, are marked there as guessed, and so is every
    number that hangs on them until the marks are gone.

    Where an autopilot's parameters are in the logs (ArduPilot, PX4), they say which outputs are thrusters; of a type
    of vehicle that they tell, or that --vehicle names, arms, mass and thrust curve are filled in as published.

    Use it first, on a new folder of logs. Then read rovid.toml, put in what was measured, and delete the marks.
    """,
    examples=(
        ("A first my_logs/rovid.toml", "rovid init my_logs"),
        (
            "The type of vehicle and the commands by hand",
            "rovid init my_logs --vehicle tunnel-rov --command fore_V,aft_V --force",
        ),
        ("Once more, from one log alone, over the one that is there", "rovid init my_logs/hold_01.csv --force"),
    ),
    see=("rovid check", "rovid help logs (formats)", "rovid help files (rovid.toml)"),
)


def init(
    logs: Logs,
    *,
    vehicle: Annotated[
        str | None,
        typer.Option(
            "--vehicle",
            metavar="TYPE",
            help="Type of vehicle, as bluerov2-heavy, or a file of your own, as my_rov.toml: what is published.",
            autocompletion=completion.vehicles,
            show_default=False,
        ),
    ] = None,
    heading: Annotated[
        str | None,
        typer.Option(
            "--heading",
            metavar="COLUMN",
            help="Column or topic of the heading, or of what is measured along --axis.",
            show_default=False,
        ),
    ] = None,
    command: Annotated[
        str | None,
        typer.Option(
            "--command",
            metavar="COLUMN,…",
            help="Columns or topics of the thruster commands, with commas between them.",
            show_default=False,
        ),
    ] = None,
    axis: AxisName = None,
    force: Annotated[
        bool, typer.Option("--force", help="Write over a rovid.toml that is there; without it that is an error.")
    ] = False,
    json: Json = False,
) -> None:
    """Write a first rovid.toml for your logs."""
    from rovid.core.atomic_write import OutputSet
    from rovid.preflight.config_writer import write_config
    from rovid.preflight.log_survey import SurveyOptions, output_files, survey
    from rovid.present.documents.results import survey_document
    from rovid.present.terminal.results import show_survey
    from rovid.trial.axis import YAW, axis_named

    # Asked for before the logs are read.
    OutputSet([output_files(logs)[0]], force=force)
    commands = tuple(part.strip() for part in (command or "").split(",") if part.strip())
    along = axis_named(axis) if axis else YAW
    headings = (heading,) if heading else ()
    found = survey(logs, SurveyOptions(axis=along, headings=headings, commands=commands, vehicle=vehicle or ""))
    found, written = write_config(found, logs, force=force)
    if json:
        print_json(survey_document(found, written))
    else:
        show_survey(console(), found, written)
