"""``rovid fit-inertia``."""

from rovid.cli.context import FitSession, fit_and_store, open_session
from rovid.cli.options import AxisName, Cutoff, Force, Json, OptionalLogs, ParameterFile


def fit_inertia(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Fit inertia from sines by four methods."""
    estimate_inertia(open_session(logs, parameters, axis, cutoff, force=force), json=json)


def estimate_inertia(session: FitSession, *, json: bool) -> None:
    """Fit the inertia, store it and print it."""
    from rovid.present.documents.fits import inertia_document
    from rovid.present.terminal.results import show_inertia

    fit_and_store(
        session,
        "Fitting inertia …",
        lambda: session.study.inertia(session.stored.independent_drag()),
        inertia_document,
        show_inertia,
        json=json,
    )
