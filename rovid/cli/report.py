"""``rovid report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rovid.cli.context import (
    compile_beside,
    console,
    drafted,
    opened,
    print_json,
    remembered,
    stored_at,
    working,
)
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Cutoff, Force, Json, OptionalLogs, ParameterFile

PAGE = Page(
    text="""
    Reads the logs, fits and diagnoses them, and writes the model that it ends with to the parameter file, as rovid
    diagnose does. Writes a folder with index.html, which needs no other file and no network, and the plots as PNG and
    SVG. The first screen, and the first sheet of paper, says what is wrong, why, what it gains and what to run next;
    in the viewer below it each cause is a switch. Everything is of that one model, trials, controller and exports
    too; the model without what was found stands beside it as the one before. Prints the page's first sentence, and
    where the page is.

    Use it last, or at once on a new folder of logs. The diagnosis takes most of the time. With --no-diagnosis the
    parameters of the file are kept where they still hold, and what it lacks is fitted.
    """,
    examples=(
        ("With the logs that fit-drag remembered, into report/", "rovid report"),
        ("At once, on a folder of logs", "rovid report my_logs -p tank.toml -o tank_report"),
        ("On paper too, for the trial record", "rovid report --pdf"),
        ("Quickly: fits and simulation alone", "rovid report --no-diagnosis --no-control --no-export"),
    ),
    see=("rovid diagnose", "rovid control", "rovid export"),
)


def report(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FOLDER",
            help="Where page and plots go; report if not given, report_AXIS for another axis than yaw.",
            show_default=False,
        ),
    ] = None,
    diagnosis: Annotated[
        bool, typer.Option("--diagnosis/--no-diagnosis", help="With or without what the simulation misses, and why.")
    ] = True,
    control: Annotated[
        bool, typer.Option("--control/--no-control", help="With or without a heading controller.")
    ] = True,
    export: Annotated[
        bool, typer.Option("--export/--no-export", help="With or without what each simulator's format holds.")
    ] = True,
    pdf: Annotated[
        bool,
        typer.Option("--pdf", help="Print it too, as report.pdf, by a Chromium, Chrome or Edge of this machine."),
    ] = False,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write everything on one page."""
    compile_beside()
    from rovid.present.console import show_caution, show_warnings
    from rovid.present.documents.fits import all_warnings, axis_document, guess_document
    from rovid.present.page.build import build_report, pdf_output
    from rovid.present.page.summary import summarize
    from rovid.trial.axis import YAW

    stored = stored_at(parameters, axis, force=force)
    begun = drafted(logs, stored.axis) if logs else []
    study = opened(logs or remembered(stored), cutoff, stored.axis)
    folder = output or Path("report" if stored.axis is YAW else f"report_{stored.axis.name}")
    with working("Fitting drag and inertia …") as progress:
        page, evidence = build_report(
            stored,
            study,
            folder,
            diagnosed=diagnosis,
            controlled=control,
            exported=export,
            pdf=pdf,
            force=force,
            report=progress,
        )
    guess, diagnosed_as = study.vehicle.assumptions, evidence.diagnosis
    answer = summarize(evidence).headline
    if diagnosed_as is not None and diagnosed_as.missing:
        answer = f"{answer.removesuffix('.')}: {diagnosed_as.missing}"
    written = {"page": str(page)}
    if pdf:
        written["pdf"] = str(pdf_output(folder).path)
    if json:
        paths = {**written, "parameters": str(stored.path)}
        told = {"verdict": None if diagnosed_as is None else diagnosed_as.verdict, "answer": answer}
        said = {**guess_document(guess), "warnings": all_warnings(guess, [*begun, *evidence.notes])}
        print_json({"schema": "rovid-report/1", **axis_document(stored.axis), **told, **paths, **said})
        return
    show_caution(console(), guess)
    show_warnings(console(), [*begun, *evidence.notes])
    console().print(answer, highlight=False)
    for path in written.values():
        console().print(path, highlight=False, soft_wrap=True)
