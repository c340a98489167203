"""``rovid diagnose``."""

from __future__ import annotations

from dataclasses import replace

from rovid.cli.context import (
    compile_in_background,
    console,
    diagnose_study,
    open_session,
    prefetch_logs,
    print_json,
    store_estimate,
)
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Cutoff, Force, Json, OptionalLogs, ParameterFile, TimeBudget
from rovid.cli.progress import progress

PAGE = Page(
    text="""
    Reads the logs, fits the plain model, and tests every effect of the catalogue on the remaining error. Prints the
    error of the simulation; the causes by name, with parameters, evidence and alternatives; the gain in predicting runs
    that were not fitted; the error that stays unexplained; the parameters that the data do not determine; and the next
    run to make. Writes the final model to the parameter file.

    Use it after fit-drag and fit-inertia, or directly. It takes seconds, and a minute at most for each hour of logs.
    With --budget it ends earlier or later, and says what it did not try. With four or more trials, the tests leave out
    whole trials.
    """,
    examples=(
        ("The logs named in the parameter file", "rovid diagnose"),
        ("A folder of logs, into another parameter file", "rovid diagnose my_logs -p tank.toml"),
        ("Motion along surge", "rovid diagnose surge_logs --axis surge"),
        ("Published tables", "rovid diagnose my_tables -p tables.toml"),
    ),
    see=("rovid fit --effect", "rovid plan", "rovid report", "rovid help confusion"),
)


def diagnose(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    budget: TimeBudget = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find the errors of the simulation and their causes."""
    with prefetch_logs(logs, parameters, axis, force=force) as prefetch:
        if compile_in_background():
            # The compilation already uses the second core.
            prefetch.stop()
        session = open_session(
            logs, parameters, axis, cutoff, force=force, with_history=True, require_sound=False, prefetch=prefetch
        )
    study = session.study
    with progress("Diagnosing …") as report:
        diagnosis = diagnose_study(session.stored, study, report, force=force, budget=budget)
    diagnosis = replace(diagnosis, warnings=(*diagnosis.warnings, *session.notes))
    if diagnosis.extended is not None:
        estimate, sizes = diagnosis.extended.estimate, diagnosis.detectable_sizes
        store_estimate(session.stored, session.outputs, study, estimate, detectable_sizes=sizes)
    if json:
        from rovid.present.documents.diagnosis import diagnosis_document

        print_json(diagnosis_document(diagnosis, study))
    else:
        from rovid.present.console import print_text, show_caution, show_faults, show_warnings
        from rovid.present.documents.diagnosis import all_faults
        from rovid.present.terminal.diagnosis import show_diagnosis

        show_caution(console(), study.vehicle.assumptions)
        show_faults(console(), all_faults(diagnosis, study))
        show_diagnosis(console(), diagnosis, study.vehicle)
        show_warnings(console(), [*study.remarks(), *diagnosis.warnings])
        if diagnosis.extended is not None:
            print_text(console(), f"written to {session.stored.path}")
