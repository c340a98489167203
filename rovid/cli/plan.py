"""``rovid plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import busy, claim_of, console, opened, print_json, remembered, stored_at
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Force, Json, OptionalLogs, ParameterFile
from rovid.core.errors import ConfigError

PAGE = Page(
    text="""
    Reads the parameter file and the logs, fits them, and ranks runs that a crew can play by what each is expected
    to tell for a minute in the water. Writes the best as a command file (time_s and a column for each thruster;
    each row holds until the next) and, beside it, a picture of what each cause predicts.

    Use --between where diagnose left two causes open; otherwise the run makes a parameter surer. Does not write
    the parameter file.
    """,
    examples=(
        ("Which run tells a lag from a delay?", "rovid plan --between thruster_lag --between command_delay"),
        (
            "A run for one parameter, 5 minutes and 2 turns at most",
            "rovid plan --narrow linear_drag --minutes 5 --turns 2",
        ),
        ("At 60 % of the commands, no faster than 10 deg/s", "rovid plan --share 0.6 --max-rate 10 -o next.csv"),
    ),
    see=("rovid diagnose", "rovid check", "rovid help plan"),
)


def plan(
    logs: OptionalLogs = None,
    *,
    between: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID",
            help="Tell the effect with this id from another; to be given twice.",
            autocompletion=completion.effects,
            show_default=False,
        ),
    ] = None,
    narrow: Annotated[
        str | None,
        typer.Option(
            metavar="PARAMETER",
            help="Make this parameter surer, as linear_drag; the least sure one if not given.",
            autocompletion=completion.parameters,
            show_default=False,
        ),
    ] = None,
    share: Annotated[
        float,
        typer.Option(
            metavar="SHARE", min=0.05, max=1.0, help="Largest command, as a share of the largest in the logs."
        ),
    ] = 1.0,
    minutes: Annotated[float, typer.Option(metavar="MINUTES", min=0.1, help="Longest run, in minutes.")] = 10.0,
    max_rate: Annotated[
        float | None,
        typer.Option(
            metavar="RATE",
            help="Fastest turn, in deg/s; fastest motion, in m/s, along surge, sway and heave. No limit if not given.",
            show_default=False,
        ),
    ] = None,
    turns: Annotated[
        float | None,
        typer.Option(
            metavar="TURNS",
            help="Farthest around, in turns; farthest away, in m, along surge, sway and heave. No limit if not given.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="Where the command file goes.")] = Path(
        "plan.csv"
    ),
    axis: AxisName = None,
    parameters: ParameterFile = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Design the run to make next."""
    import math

    from rovid.core.atomic_write import OutputFile
    from rovid.core.signatures import PLAN, png_signature
    from rovid.design.candidate_runs import RunLimits
    from rovid.design.experiment_design import command_csv
    from rovid.effects import effect_named
    from rovid.present.console import show_caution, show_warnings
    from rovid.present.documents.results import plan_document
    from rovid.present.plots.results import plan_picture
    from rovid.present.terminal.results import show_plan
    from rovid.store.staleness import check_freshness

    rivals = tuple(effect_named(name) for name in between or ())
    if len({rival.id for rival in rivals}) not in {0, 2} or len(rivals) > 2:
        raise ConfigError(f"names {len(rivals)} causes; two different ones were expected.", where="--between")
    stored = stored_at(parameters, axis)
    paths = logs or remembered(stored)
    drawn = output.with_suffix(".png")
    commands, drawing = OutputFile(output, PLAN), OutputFile(drawn, png_signature("plan"))
    claim = claim_of([commands, drawing], paths, stored.path, force=force)
    study = opened(paths, None, stored.axis)
    factor = math.pi / 180.0 if stored.axis.angular else 1.0
    limits = RunLimits(
        share=share,
        seconds=60.0 * minutes,
        rate=math.inf if max_rate is None else factor * max_rate,
        travel=math.inf if turns is None else turns,
    )
    with busy("Fitting, and trying runs …"):
        runs = study.plan(tuple(effect_named(name) for name in stored.effects), rivals, limits, narrow or "")
    claim.write({commands: command_csv(runs), drawing: plan_picture(runs, stored.axis)})
    why = check_freshness(stored, study.provenance).reason if stored.effects else ""
    warnings = [f"{stored.path.name} no longer holds: {why}. Of it only which effects act was taken."] * bool(why)
    if json:
        print_json(plan_document(runs, study.vehicle, str(output), str(drawn), warnings))
    else:
        show_caution(console(), study.vehicle.assumptions)
        show_plan(console(), runs, [output, drawn])
        show_warnings(console(), warnings)
