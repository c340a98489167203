"""``rovid fit-inertia``."""

from rovid.cli.context import FitSession, fit_and_store, open_session
from rovid.cli.options import AxisName, Cutoff, Force, Json, OptionalLogs, Page, ParameterFile

PAGE = Page(
    text="""
    Reads logs with sines or other changing commands, or a table of sine trials with the columns period_s,
    torque_amplitude_Nm and peak_yaw_rate_rad_s, and the drag of the parameter file if there is one. Prints the inertia
    by the orbit integral, harmonic balance, regression and the peak method, chooses one of them, and writes that value
    to the parameter file (kg m^2, or kg along surge, sway and heave). The added inertia is printed as well.

    Use it after fit-drag. If the methods differ by more than their errors, the model lacks an effect: run diagnose.
    """,
    examples=(
        ("The logs named in the parameter file", "rovid fit-inertia"),
        (
            "From a table of sine trials, with the drag in tables.toml",
            "rovid fit-inertia my_tables/sine_trials.csv -p tables.toml",
        ),
        ("With a low-pass filter at 1 Hz", "rovid fit-inertia --cutoff 1"),
    ),
    see=("rovid fit-drag", "rovid fit", "rovid simulate"),
)


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
