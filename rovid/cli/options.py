"""Options and arguments that several commands share, each with its line of help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rovid.cli import completion


def argument(metavar: str, help: str, **settings: Any) -> Any:  # noqa: A002 - typer's word
    """A command's argument without a default in the help."""
    return typer.Argument(metavar=metavar, help=help, show_default=False, **settings)


def option(metavar: str, help: str, *names: str, **settings: Any) -> Any:  # noqa: A002 - typer's word
    """A command's option; its name is the parameter's unless ``names`` are given."""
    return typer.Option(*names, metavar=metavar, help=help, **settings)


Logs = Annotated[list[Path], argument("LOGS", "A folder of logs, or single logs.")]
OptionalLogs = Annotated[
    list[Path] | None,
    argument("LOGS", "A folder of logs, or single logs. Default: the logs named in the parameter file."),
]
ParameterFile = Annotated[
    Path | None,
    option(
        "FILE",
        "Parameter file. Default: parameters.toml, or parameters_AXIS.toml for an axis other than yaw; "
        "parameters_planar.toml with --axes planar.",
        "--parameters",
        "-p",
    ),
]
AxisName = Annotated[
    str | None,
    option(
        "AXIS",
        "Degree of freedom: yaw, surge, sway, heave, roll or pitch. Default: that of the parameter file, or yaw.",
        autocompletion=completion.axes,
    ),
]
Axes = Annotated[
    str | None,
    option(
        "AXES",
        "Degrees of freedom in one coupled model: planar, for surge, sway and yaw in a current.",
        autocompletion=completion.axis_sets,
    ),
]
AxesRefused = Annotated[str | None, typer.Option("--axes", hidden=True, help="Not for this command.")]
Cutoff = Annotated[
    float | None,
    option("HZ", "Cut-off frequency of the low-pass filter for rates, in Hz. Default: chosen from the data.", min=1e-3),
]
Force = Annotated[
    bool,
    typer.Option("--force", help="Replace files that rovid did not write. Input files are never replaced."),
]
ForceGuess = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Continue although arms or thrust curves are guesses, and replace files that rovid did not write. Input "
        "files are never replaced.",
    ),
]
TimeBudget = Annotated[
    float | None,
    option(
        "SECONDS",
        "Longest time of the diagnosis, without reading the logs; it then answers with what it has. Default: 60 for "
        "each hour of logs.",
        "--budget",
        min=1.0,
        envvar="ROVID_BUDGET",
        show_envvar=False,
    ),
]
EffectsFrom = Annotated[
    list[Path] | None,
    option(
        "FILE.py",
        "Add the effects in this Python file to the catalogue. The file is run. Repeatable. `rovid effect new` writes "
        "such a file.",
        "--effects-from",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on standard output and nothing else.")]


def add_effects(files: list[Path] | None) -> None:
    """Add the effects in ``files``, those of --effects-from, to the catalogue."""
    if files:
        from rovid.effects import load_plugins

        load_plugins(files)
