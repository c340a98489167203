"""``rovid fit-drag``."""

from rovid.cli.context import fit_and_store, open_session
from rovid.cli.fit_inertia import estimate_inertia
from rovid.cli.options import AxisName, Cutoff, Force, Json, Logs, ParameterFile


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
