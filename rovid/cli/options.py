"""What several commands take: the options and arguments, each with its line of help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rovid.cli import completion

Logs = Annotated[
    list[Path], typer.Argument(metavar="LOGS", help="A folder of logs, or logs one by one.", show_default=False)
]
OptionalLogs = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="LOGS",
        help="A folder of logs, or logs one by one; those that the parameter file remembers if not given.",
        show_default=False,
    ),
]
ParameterFile = Annotated[
    Path | None,
    typer.Option(
        "--parameters",
        "-p",
        metavar="FILE",
        help="Parameter file; parameters.toml if not given, parameters_AXIS.toml for another axis than yaw.",
        show_default=False,
    ),
]
AxisName = Annotated[
    str | None,
    typer.Option(
        "--axis",
        metavar="AXIS",
        help="Degree of freedom: yaw, surge, sway, heave, roll or pitch; yaw if neither this nor -p says another.",
        autocompletion=completion.axes,
        show_default=False,
    ),
]
Cutoff = Annotated[
    float | None,
    typer.Option(
        metavar="HZ",
        min=1e-3,
        help="Cut-off of the low pass that rates come from, in Hz; chosen from the data if not given.",
        show_default=False,
    ),
]
Force = Annotated[
    bool,
    typer.Option("--force", help="Write over files that rovid did not write; never over what it reads here."),
]
ForceGuess = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Go on where arms or thrust curves are guesses; write over files that rovid did not write, never over "
        "what it reads here.",
    ),
]
Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on standard output, and nothing else there.")
]
