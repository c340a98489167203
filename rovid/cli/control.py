"""``rovid control``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rovid.cli.context import (
    busy,
    claim_of,
    console,
    guess_of,
    known_at,
    of_yaw,
    opened,
    print_json,
    remembered,
    require_holding,
    require_measured,
)
from rovid.cli.help_format import Page
from rovid.cli.options import ForceGuess, Json, OptionalLogs, ParameterFile

PAGE = Page(
    text="""
    Reads the parameter file, and the logs if they are there for noise and the torque in use. Designs a model-aided
    PD controller of heading: drag and inertia from the model, PD on heading and yaw rate. Prints gains, margins
    with the spread that the parameters' uncertainty leaves, and closed-loop runs with and without every effect
    that the file holds. --c and --python write the controller as source.

    Use it for gains, or to judge your own. The damping ratio is that of the identified yaw inertia. Yaw alone.
    Parameters that no longer hold are refused, and those that rest on guessed arms or curves without --force.
    """,
    examples=(
        ("Gains, margins and runs for the identified vehicle", "rovid control"),
        ("Judge gains of your own, with a step from 0 to 45 deg", "rovid control --kp 100 --kd 710 --step 0:45"),
        ("For a controller at 5 Hz behind 0.3 s of delay", "rovid control --period 0.2 --delay 0.3"),
        ("As source", "rovid control --c heading.c --python heading.py"),
    ),
    see=("rovid fit", "rovid export", "rovid help control"),
)


def control(
    logs: OptionalLogs = None,
    *,
    kp: Annotated[
        float | None,
        typer.Option(metavar="GAIN", help="Gain on heading, in N m/rad; together with --kd.", show_default=False),
    ] = None,
    kd: Annotated[
        float | None,
        typer.Option(metavar="GAIN", help="Gain on yaw rate, in N m s/rad; together with --kp.", show_default=False),
    ] = None,
    damping: Annotated[
        float, typer.Option(metavar="RATIO", help="Damping ratio of the gains, where --kp and --kd do not say them.")
    ] = 0.7,
    bandwidth: Annotated[
        float | None,
        typer.Option(
            metavar="RAD/S",
            help="Natural frequency of the gains, in rad/s. If not given the largest with a phase margin of 45 deg, a "
            "sensitivity peak of 1.6 and room for twice the delay there is, that noise and actuators allow.",
            show_default=False,
        ),
    ] = None,
    period: Annotated[
        float, typer.Option(metavar="S", help="Time from one command of the controller to the next, in s.")
    ] = 0.1,
    delay: Annotated[
        float, typer.Option(metavar="S", help="Time from a heading to the command that it leads to, in s.")
    ] = 0.0,
    rate_filter: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Time constant of the low pass of the rate, in s; chosen if not given.",
            show_default=False,
        ),
    ] = None,
    step: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FROM:TO", help="A further run, headings in deg, as 350:40; may be given again.", show_default=False
        ),
    ] = None,
    c: Annotated[
        Path | None,
        typer.Option("--c", metavar="FILE", help="Write the controller as C into this file.", show_default=False),
    ] = None,
    python: Annotated[
        Path | None,
        typer.Option("--python", metavar="FILE", help="Write it as Python into this file.", show_default=False),
    ] = None,
    parameters: ParameterFile = None,
    force: ForceGuess = False,
    json: Json = False,
) -> None:
    """Design a heading controller."""
    from rovid.control.codegen import c_source, python_source
    from rovid.control.design import design_controller
    from rovid.control.specs import ControllerOptions, loop_conditions
    from rovid.core.atomic_write import OutputFile
    from rovid.core.signatures import C_SOURCE, PYTHON_SOURCE
    from rovid.present.console import show_caution, show_warnings
    from rovid.present.documents.results import control_document
    from rovid.present.terminal.diagnosis import show_control

    options = ControllerOptions(
        kp=kp,
        kd=kd,
        damping=damping,
        bandwidth=bandwidth,
        period=period,
        delay=delay,
        rate_filter=rate_filter,
        steps=tuple(step or ()),
    )
    stored = of_yaw(known_at(parameters))
    model = stored.model()
    paths = logs or remembered(stored)
    makers = {
        OutputFile(path, form): source
        for path, form, source in ((c, C_SOURCE, c_source), (python, PYTHON_SOURCE, python_source))
        if path is not None
    }
    claim = claim_of(list(makers), paths, stored.path, force=force)
    study = opened(paths, None, stored.axis)
    study.require_effects(model.effects)
    remarks, guess = require_holding(stored, study), guess_of(stored, study)
    require_measured(stored, guess, force=force)
    setting = loop_conditions(options, model, study.position_noise(), study.median_torque())
    with busy("Closing the loop …"):
        result = design_controller(stored, study.vehicle, setting, options)
    if makers:
        claim.write({output: source(result.law, guess) for output, source in makers.items()})
    warnings = [*study.remarks(), *remarks]
    if json:
        print_json(control_document(result, warnings, guess))
    else:
        show_caution(console(), guess)
        show_control(console(), result, guess)
        show_warnings(console(), warnings)
