"""``rovid report``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from rovid.cli.context import (
    compile_in_background,
    console,
    open_logs,
    parameters_at,
    print_json,
    stored_logs,
    write_missing_config,
)
from rovid.cli.options import (
    Axes,
    AxisName,
    Cutoff,
    EffectsFrom,
    Force,
    Json,
    OptionalLogs,
    ParameterFile,
    TimeBudget,
    add_effects,
    option,
)
from rovid.cli.planar_session import is_planar, open_planar_session, store_planar_fit
from rovid.cli.streams import progress
from rovid.core.errors import ConfigError

_JOURNAL_WIDTHS = ("84mm", "174mm")


def report(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    axes: Axes = None,
    parameters: ParameterFile = None,
    output: Annotated[
        Path | None,
        option(
            "FOLDER",
            "Folder for page and plots. Default: report, or report_AXIS for another axis, or report_planar.",
            "--output",
            "-o",
        ),
    ] = None,
    diagnosis: Annotated[bool, typer.Option("--diagnosis/--no-diagnosis", help="Include the diagnosis.")] = True,
    control: Annotated[bool, typer.Option("--control/--no-control", help="Include a heading controller.")] = True,
    export: Annotated[
        bool, typer.Option("--export/--no-export", help="Include what each simulator's format can hold.")
    ] = True,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Also print report.pdf, with the Chromium, Chrome or Edge of this machine.")
    ] = False,
    journal: Annotated[
        list[str] | None,
        option(
            "WIDTH",
            "Also write the plots for a journal, 84 or 174 mm wide at 300 dpi, into plots/WIDTH. Repeatable.",
            "--journal",
        ),
    ] = None,
    cutoff: Cutoff = None,
    budget: TimeBudget = None,
    force: Force = False,
    effects_from: EffectsFrom = None,
    json: Json = False,
) -> None:
    """Write all results on one page."""
    add_effects(effects_from)
    widths = list(map(_journal_width, journal or ()))
    if is_planar(axes, axis, cutoff=cutoff):
        _report_planar(
            logs, parameters, output or Path("report_planar"), diagnosed=diagnosis, pdf=pdf, journal=widths,
            budget=budget, force=force, json=json,
        )  # fmt: skip
        return
    compile_in_background()
    from rovid.present.console import show_caution, show_faults, show_warnings
    from rovid.present.documents.fits import all_warnings, axis_document, fault_documents, guess_document
    from rovid.present.page.build import build_report, pdf_output
    from rovid.present.page.summary import summarize
    from rovid.trial.axis import YAW

    stored = parameters_at(parameters, axis, force=force)
    notes = write_missing_config(logs, stored.axis) if logs else []
    study = open_logs(logs or stored_logs(stored), cutoff, stored.axis)
    if not force:
        study.require_sound()
    folder = output or Path("report" if stored.axis is YAW else f"report_{stored.axis.name}")
    with progress("Fitting drag and inertia …") as show_progress:
        page, data = build_report(
            stored,
            study,
            folder,
            diagnosed=diagnosis,
            budget=budget,
            controlled=control,
            exported=export,
            pdf=pdf,
            journal=widths,
            force=force,
            report=show_progress,
        )
    assumptions, found = study.vehicle.assumptions, data.diagnosis
    answer = summarize(data).headline
    if found is not None and found.missing:
        answer = f"{answer.removesuffix('.')}: {found.missing}"
    files = {"page": str(page)}
    if pdf:
        files["pdf"] = str(pdf_output(folder).path)
    notes = [*notes, *data.notes]
    if json:
        results = {"verdict": None if found is None else found.verdict, "answer": answer}
        warnings = {**guess_document(assumptions), "warnings": all_warnings(assumptions, notes)}
        paths = {**files, "parameters": str(stored.path)}
        faults = {"faults": fault_documents(study.faults)}
        print_json({"schema": "rovid-report/1", **axis_document(stored.axis), **results, **paths, **faults, **warnings})
        return
    show_caution(console(), assumptions)
    show_faults(console(), study.faults)
    show_warnings(console(), notes)
    console().print(answer, highlight=False)
    for path in files.values():
        console().print(path, highlight=False, soft_wrap=True)


def _journal_width(text: str) -> str:
    """The width of a plot in print as "84mm": one column, or the page, of most journals."""
    width = f"{text.removesuffix('mm').strip()}mm"
    if width not in _JOURNAL_WIDTHS:
        raise ConfigError(f"is {text!r}; {' or '.join(_JOURNAL_WIDTHS)} was expected.", where="--journal")
    return width


def _report_planar(
    logs: Sequence[Path] | None,
    parameters: Path | None,
    folder: Path,
    *,
    diagnosed: bool,
    pdf: bool,
    journal: Sequence[str],
    budget: float | None,
    force: bool,
    json: bool,
) -> None:
    """Write the page of the coupled model."""
    from rovid.present.console import show_caution, show_faults, show_warnings
    from rovid.present.documents.fits import all_warnings, fault_documents, guess_document
    from rovid.present.documents.planar import measures_document
    from rovid.present.page.planar import build_planar_report

    session = open_planar_session(logs, parameters, force=force)
    study = session.study
    with progress("Fitting surge, sway and yaw …") as show_progress:
        page, report = build_planar_report(
            study,
            session.stored,
            folder,
            lambda fit: store_planar_fit(session, fit),
            diagnosed=diagnosed,
            budget=budget,
            pdf=pdf,
            journal=journal,
            force=force,
            report=show_progress,
        )
    files = {"page": str(page)} | ({"pdf": str(page.with_name("report.pdf"))} if pdf else {})
    faults, guess, notes = study.logs.faults, study.vehicle.assumptions, [*session.notes, *report.notes]
    if json:
        document: dict[str, Any] = {
            "schema": "rovid-report/1",
            "axes": "planar",
            "verdict": None if report.diagnosis is None else report.diagnosis.verdict,
            "answer": report.headline,
        }
        document |= {**files, "parameters": str(session.stored.path), "faults": fault_documents(faults)}
        document["standard_manoeuvres"] = measures_document(report.manoeuvres)
        print_json(document | guess_document(guess) | {"warnings": all_warnings(guess, notes)})
        return
    show_caution(console(), guess)
    show_faults(console(), faults)
    show_warnings(console(), notes)
    console().print(report.headline, highlight=False)
    for path in files.values():
        console().print(path, highlight=False, soft_wrap=True)
