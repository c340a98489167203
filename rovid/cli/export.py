"""``rovid export``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import (
    busy,
    claim_of,
    console,
    guess_of,
    known_at,
    of_yaw,
    opened,
    print_json,
    require_holding,
    require_measured,
)
from rovid.cli.help_format import Page
from rovid.cli.options import ForceGuess, Json, ParameterFile
from rovid.export import FORMATS

PAGE = Page(
    text="""
    Reads the parameter file and writes the model in a simulator's own format. Then it puts the numbers of the file
    into that simulator's equation, with its signs and time step, runs it beside rovid's model, and prints the
    largest difference of the yaw rate in percent of its range. What the format cannot hold is listed with its
    size. Yaw alone.

    Thrusters and the largest rate come from the logs that the parameter file remembers, where they are there.
    Parameters that no longer hold are refused, and those that rest on guessed arms or curves without --force.
    """,
    examples=(
        ("For Gazebo", "rovid export gz-sim -o model.sdf"),
        ("For uuv_simulator, as YAML", "rovid export uuv -o uuv.yaml"),
        ("As JSON, from another parameter file", "rovid export json -p tables.toml -o tables.json"),
    ),
    see=("rovid fit", "rovid control", "rovid help export"),
)


def export(
    format: Annotated[  # noqa: A002 - the word that the help shows
        str,
        typer.Argument(
            metavar="FORMAT",
            help=f"One of {', '.join(FORMATS)}.",
            autocompletion=completion.formats,
        ),
    ],
    *,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Where it goes; gz_sim.sdf and the like if not given. uuv writes .xacro or .yaml.",
            show_default=False,
        ),
    ] = None,
    parameters: ParameterFile = None,
    force: ForceGuess = False,
    json: Json = False,
) -> None:
    """Write the model in the format of a simulator."""
    from rovid.export.interface import export_input
    from rovid.export.run_export import select_exporter
    from rovid.export.run_export import verified_export as make
    from rovid.present.console import show_caution
    from rovid.present.documents.results import export_document
    from rovid.present.terminal.results import show_export

    function, target = select_exporter(format, output)
    stored = of_yaw(known_at(parameters))
    stored.model()
    claim = claim_of([target], stored.logs, stored.path, force=force)
    there = bool(stored.logs) and all(path.exists() for path in stored.logs)
    study = opened(stored.logs, None, stored.axis) if there else None
    remarks, guess = require_holding(stored, study), guess_of(stored, study)
    require_measured(stored, guess, force=force)
    with busy("Simulating …"):
        made = make(function, replace(export_input(stored, study), guess=guess))
    made = replace(made, warnings=(*made.warnings, *remarks))
    claim.write({target: made.content})
    if json:
        print_json(export_document(format, str(target.path), made, guess))
    else:
        show_caution(console(), guess)
        show_export(console(), target.path, made)
