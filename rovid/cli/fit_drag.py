"""``rovid fit-drag``."""

from __future__ import annotations

from dataclasses import replace

from rovid.cli.context import busy, claim_of, compared, console, opened, print_json, put, standing_now, stored_at
from rovid.cli.fit_inertia import estimate_inertia
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Cutoff, Force, Json, Logs, ParameterFile

PAGE = Page(
    text="""
    Reads logs with held commands, or a table of steady turns with the columns command, yaw_rate_rad_s and
    torque_Nm. Fits T = DQ |r| r + DL r and writes quadratic_drag (N m s^2/rad^2) and linear_drag (N m s/rad), with
    standard errors, to the parameter file, which from then on remembers the logs: later commands need no LOGS.

    Use it first of the fits. It wants four levels or more, both ways, each held for five time constants and a
    minute. Roll and pitch have no steady turns; there it finds inertia and drag together.
    """,
    examples=(
        ("Drag in yaw, into parameters.toml", "rovid fit-drag my_logs"),
        (
            "From a table of steady turns, into another file",
            "rovid fit-drag my_tables/steady_turns.csv -p tables.toml",
        ),
        ("Drag in surge, into parameters_surge.toml", "rovid fit-drag surge_logs --axis surge"),
    ),
    see=("rovid check", "rovid fit-inertia", "rovid fit"),
)


def fit_drag(
    logs: Logs,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find drag from steady turns."""
    from rovid.present.documents.fits import drag_document
    from rovid.present.terminal.results import show_drag, show_fit

    stored = stored_at(parameters, axis, force=force)
    claim = claim_of([stored.output], logs, force=force)
    study = opened(logs, cutoff, stored.axis)
    if stored.axis.self_righting:
        # No constant torque turns what rights itself steadily: drag comes with the inertia.
        estimate_inertia(study, stored, claim, json=json)
        return
    stored, notes = standing_now(stored, study)
    with busy("Fitting drag …"):
        result = study.drag()
    result = replace(result, estimate=compared(stored, study, result.estimate, notes))
    stored = put(stored, claim, study, result.estimate)
    if json:
        print_json(drag_document(result, study))
    else:
        show_fit(console(), result, show_drag, study, stored)
