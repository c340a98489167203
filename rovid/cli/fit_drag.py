"""``rovid fit-drag``."""

from rovid.cli.context import fit_and_store, open_session
from rovid.cli.fit_inertia import estimate_inertia
from rovid.cli.options import AxisName, Cutoff, Force, Json, Logs, Page, ParameterFile

PAGE = Page(
    text="""
    Reads logs with constant commands, or a table of steady turns with the columns command, yaw_rate_rad_s and
    torque_Nm. Fits T = DQ |r| r + DL r and writes quadratic_drag (N m s^2/rad^2) and linear_drag (N m s/rad) with
    standard errors to the parameter file. The parameter file also stores the names of the logs: later commands need no
    LOGS.

    Use it as the first fit. It needs at least four levels, in both directions, each held for five time constants plus a
    minute. Roll and pitch have no steady turns; there the command fits inertia and drag together.
    """,
    examples=(
        ("Drag in yaw, into parameters.toml", "rovid fit-drag my_logs"),
        ("From a table of steady turns, into another file", "rovid fit-drag my_tables/steady_turns.csv -p tables.toml"),
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
    """Fit drag from steady turns."""
    from rovid.present.documents.fits import drag_document
    from rovid.present.terminal.results import show_drag

    session = open_session(logs, parameters, axis, cutoff, force=force)
    if session.stored.axis.self_righting:
        # Under a constant torque such an axis comes to rest, so drag is found together with the inertia.
        estimate_inertia(session, json=json)
        return
    fit_and_store(session, "Fitting drag …", session.study.drag, drag_document, show_drag, json=json)
