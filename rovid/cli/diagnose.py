"""``rovid diagnose``."""

from __future__ import annotations

from rovid.cli.context import (
    claim_of_model,
    compile_beside,
    console,
    diagnosed,
    opened,
    print_json,
    put,
    read_ahead,
    remembered,
    stored_at,
    working,
)
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Cutoff, Force, Json, OptionalLogs, ParameterFile

PAGE = Page(
    text="""
    Reads the logs, fits the plain model, and tries every effect of the catalogue on what it misses. Prints what
    the simulation gets wrong; the cause by name, with its parameters, the evidence and its rivals; by how much
    runs that were not fitted are predicted better; what is left unexplained; what the data cannot determine; and
    which run to do next. Writes the model that it ends with to the parameter file.

    Use it after fit-drag and fit-inertia, or at once. It is the slowest command: seconds to minutes, by the
    length of the logs. Four trials or more let it test on whole trials.
    """,
    examples=(
        ("What the model misses, with the logs that fit-drag remembered", "rovid diagnose"),
        ("At once, on a folder of logs, into another file", "rovid diagnose my_logs -p tank.toml"),
        ("Along surge", "rovid diagnose surge_logs --axis surge"),
        ("What the published tables contradict", "rovid diagnose my_tables -p tables.toml"),
    ),
    see=("rovid fit --effect", "rovid plan", "rovid report", "rovid help confusion"),
)


def diagnose(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Say what the simulation gets wrong, and why."""
    with read_ahead(logs, parameters, axis, force=force) as reading:
        if compile_beside():
            # Both cores have more to do than that.
            reading.stop()
        stored = stored_at(parameters, axis, force=force)
        paths = logs or remembered(stored)
        claim = claim_of_model(stored, paths, force=force)
        study = opened(paths, cutoff, stored.axis, reading)
    with working("Diagnosing …") as report:
        diagnosis = diagnosed(stored, study, report)
    if diagnosis.extended is not None:
        put(stored, claim, study, diagnosis.extended.estimate, seen=diagnosis.detectable_sizes)
    if json:
        from rovid.present.documents.diagnosis import diagnosis_document

        print_json(diagnosis_document(diagnosis, study))
    else:
        from rovid.present.console import show_caution, show_warnings
        from rovid.present.terminal.diagnosis import show_diagnosis

        show_caution(console(), study.vehicle.assumptions)
        show_diagnosis(console(), diagnosis, study.vehicle)
        show_warnings(console(), [*study.remarks(), *diagnosis.warnings])
