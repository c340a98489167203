"""``rovid init``."""

from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import console, named_axis, print_json
from rovid.cli.options import Axes, AxisName, Json, Logs, option
from rovid.cli.planar_session import is_planar


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
