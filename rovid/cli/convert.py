"""``rovid convert``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from rovid.cli.context import claim_of, print_json
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Force, Json
from rovid.core.errors import LINE_LENGTH, display_text

PAGE = Page(
    text="""
    Reads one log as rovid.toml beside it says and writes it as CSV, MCAP or Parquet, by the suffix of the output.
    Angles, rates and times are converted to the units that the new names say; commands keep theirs. Prints the
    lines of rovid.toml that read the new file.

    Use it to look at a log with other tools, or to pass a trial on without its recorder's format.
    """,
    examples=(
        ("An ArduPilot log as CSV", "rovid convert ardupilot_logs/dive.BIN -o dive.csv"),
        ("An MCAP recording as CSV", "rovid convert my_logs/steps.mcap -o steps.csv"),
        ("A CSV log as MCAP, for Foxglove", "rovid convert my_logs/hold_01.csv -o hold_01.mcap"),
    ),
    see=("rovid init", "rovid simulate --mcap", "rovid help logs"),
)


def convert(
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="A log of any format that rovid reads; see rovid help logs.")
    ],
    *,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where it goes: a .csv, .mcap or .parquet file.")
    ],
    axis: AxisName = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write a log in another format."""
    from rovid.readers.convert import convert as make
    from rovid.readers.convert import output_at
    from rovid.trial.axis import YAW, axis_named
    from rovid.trial.config import find_config, load_config

    target = output_at(output, log)
    config = load_config(find_config([log]), axis_named(axis) if axis else YAW)
    claim = claim_of([target], [config.path.parent, log], force=force)
    made = make(log, config, output)
    claim.write({target: made.content})
    remarks = [remark.text for remark in made.trial.remarks]
    if json:
        document = {"schema": "rovid-convert/1", "file": str(output), "configuration": made.mapping}
        print_json(document | {"warnings": remarks})
    else:
        typer.echo(made.mapping, nl=False)
        sys.stderr.writelines(f"Note: {display_text(text, LINE_LENGTH)}\n" for text in remarks)
