"""``rovid fit``."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import (
    busy,
    claim_of_model,
    compared,
    compile_beside,
    console,
    opened,
    print_json,
    put,
    remembered,
    standing_now,
    stored_at,
)
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Cutoff, Force, Json, OptionalLogs, ParameterFile

PAGE = Page(
    text="""
    Reads logs of any kind and fits inertia, drag, the disturbance and the noise at once by maximum likelihood of
    the Kalman filter's innovations. Writes all parameters, with their covariance, to the parameter file. --effect
    puts a physical effect into the model and fits its parameters with the rest; without it, effects that the file
    held are dropped.

    Use it for the sharpest numbers, and always where an autopilot was on: under feedback the simple methods are
    biased. To find out which effect is missing use diagnose.
    """,
    examples=(
        ("Everything from the logs that fit-drag remembered", "rovid fit"),
        ("With an effect in the model", "rovid fit --effect thruster_lag"),
        (
            "With one form of an effect, and one more effect",
            "rovid fit --effect thruster_lag:rotor --effect bias_torque",
        ),
        ("A real dive with its autopilot on", "rovid fit rov_logs/dive.csv -p dive.toml"),
    ),
    see=("rovid diagnose", "rovid simulate", "rovid help effects"),
)


def fit(
    logs: OptionalLogs = None,
    *,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID",
            help="Put this effect into the model, as thruster_lag; may be given again.",
            autocompletion=completion.effects,
            show_default=False,
        ),
    ] = None,
    gyro: Annotated[
        bool, typer.Option("--gyro", help="Fit logged rates too, where an instrument of their own measured them.")
    ] = False,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Fit all parameters by maximum likelihood."""
    compile_beside()
    from rovid.effects import effect_named
    from rovid.present.documents.fits import likelihood_document
    from rovid.present.terminal.results import show_fit, show_likelihood

    effects = tuple(effect_named(name) for name in dict.fromkeys(effect or ()))
    stored = stored_at(parameters, axis, force=force)
    paths = logs or remembered(stored)
    claim = claim_of_model(stored, paths, force=force)
    study = opened(paths, cutoff, stored.axis)
    stored, notes = standing_now(stored, study)
    with busy("Maximising the likelihood …"):
        result = study.likelihood(effects, gyro=gyro)
    result = replace(result, estimate=compared(stored, study, result.estimate, notes))
    stored = put(stored, claim, study, result.estimate, "--gyro" * gyro)
    if json:
        print_json(likelihood_document(result, study))
    else:
        show_fit(console(), result, show_likelihood, study, stored)
