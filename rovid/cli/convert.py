"""``rovid convert``."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from rovid.cli.context import named_axis, print_json, reserve_outputs
from rovid.cli.options import AxisName, Force, Json, argument, option
from rovid.core.errors import LINE_LENGTH, display_text


def convert(
    log: Annotated[Path, argument("LOG", "A log in any supported format; see rovid help logs.")],
    *,
    output: Annotated[Path, option("FILE", "The new file: .csv, .mcap or .parquet.", "--output", "-o")],
    axis: AxisName = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Convert a log to another format."""
    from rovid.readers.convert import convert as convert_log
    from rovid.readers.convert import output_at
    from rovid.trial.config import find_config, load_config

    target = output_at(output, log)
    config = load_config(find_config([log]), named_axis(axis))
    outputs = reserve_outputs([target], [config.path.parent, log], force=force)
    converted = convert_log(log, config, output)
    outputs.write({target: converted.content})
    remarks = [remark.text for remark in converted.trial.remarks]
    if json:
        document = {"schema": "rovid-convert/1", "file": str(output), "configuration": converted.mapping}
        print_json(document | {"warnings": remarks})
    else:
        typer.echo(converted.mapping, nl=False)
        sys.stderr.writelines(f"Note: {display_text(text, LINE_LENGTH)}\n" for text in remarks)
