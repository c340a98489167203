"""``rovid init``."""

from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import console, named_axis, print_json
from rovid.cli.options import Axes, AxisName, Json, Logs, Page, option
from rovid.cli.planar_session import is_planar

PAGE = Page(
    text="""
    Reads the logs and guesses which column or topic is the heading, which columns are thruster commands, and their
    units and signs. Writes rovid.toml next to the logs, with the reason for each guess as a comment, and also
    thrust_guess.csv if there is no thrust curve. Lever arms and a guessed thrust curve are marked as guessed there.
    Results that depend on them are marked as guesses until you delete the marks.

    If the logs contain an autopilot's parameters (ArduPilot, PX4), these show which outputs are thrusters. For a known
    type of vehicle, recognised there or given by --vehicle, rovid fills in published arms, mass and thrust curve.

    With --axes planar it also writes the velocities and positions that it finds, and the share of each thrust along
    surge and sway with the sign that the logs show. Otherwise these lines are comments.

    Use it first on a new folder of logs. Then read rovid.toml, enter measured values, and delete the marks.
    """,
    examples=(
        ("A first my_logs/rovid.toml", "rovid init my_logs"),
        (
            "With the type of vehicle and the commands given",
            "rovid init my_logs --vehicle tunnel-rov --command fore_V,aft_V --force",
        ),
        ("For surge, sway and yaw together", "rovid init my_logs --axes planar --force"),
        ("From one log only, replacing the existing file", "rovid init my_logs/hold_01.csv --force"),
    ),
    see=("rovid check", "rovid help logs (formats)", "rovid help files (rovid.toml)"),
)


def init(
    logs: Logs,
    *,
    vehicle: Annotated[
        str | None,
        option(
            "TYPE",
            "Type of vehicle, as bluerov2-heavy, or your own preset file, as my_rov.toml.",
            autocompletion=completion.vehicles,
        ),
    ] = None,
    heading: Annotated[
        str | None, option("COLUMN", "Column or topic of the heading, or of the position along --axis.")
    ] = None,
    command: Annotated[
        str | None, option("COLUMN,…", "Columns or topics of the thruster commands, separated by commas.")
    ] = None,
    axis: AxisName = None,
    axes: Axes = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing rovid.toml.")] = False,
    json: Json = False,
) -> None:
    """Write a first rovid.toml for your logs."""
    from rovid.core.output_files import OutputSet
    from rovid.preflight.config_writer import write_config
    from rovid.preflight.log_survey import SurveyOptions, output_files, survey
    from rovid.present.documents.results import survey_document
    from rovid.present.terminal.results import show_survey

    planar = is_planar(axes, axis)
    # An existing file is an error before the logs are read.
    OutputSet([output_files(logs)[0]], force=force)
    commands = tuple(part.strip() for part in (command or "").split(",") if part.strip())
    headings = (heading,) if heading else ()
    options = SurveyOptions(
        axis=named_axis(axis), headings=headings, commands=commands, vehicle=vehicle or "", planar=planar
    )
    found, written = write_config(survey(logs, options), logs, force=force)
    if json:
        print_json(survey_document(found, written))
    else:
        show_survey(console(), found, written)
