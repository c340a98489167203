"""``rovid fit``."""

from __future__ import annotations

from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import compile_in_background, fit_and_store, open_session
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Cutoff, Force, Json, OptionalLogs, ParameterFile, option

PAGE = Page(
    text="""
    Reads any logs and fits inertia, drag, disturbance and noise together, by maximum likelihood of the Kalman filter's
    innovations. Writes all parameters with their covariance to the parameter file. --effect adds a physical effect to
    the model and fits its parameters with the rest. Effects in the parameter file that are not given are removed.

    Use it for the most precise parameters, and always if an autopilot was active, because feedback biases the simpler
    methods. Use diagnose to find out which effect is missing.
    """,
    examples=(
        ("The logs named in the parameter file", "rovid fit"),
        ("With an effect in the model", "rovid fit --effect thruster_lag"),
        (
            "With one form of an effect, and one more effect",
            "rovid fit --effect thruster_lag:rotor --effect bias_torque",
        ),
        ("A dive with an active autopilot", "rovid fit rov_logs/dive.csv -p dive.toml"),
    ),
    see=("rovid diagnose", "rovid simulate", "rovid help effects"),
)


def fit(
    logs: OptionalLogs = None,
    *,
    effect: Annotated[
        list[str] | None,
        option("ID", "Add this effect to the model, as thruster_lag. Repeatable.", autocompletion=completion.effects),
    ] = None,
    gyro: Annotated[
        bool, typer.Option("--gyro", help="Also fit the logged rates, if they come from a gyro of their own.")
    ] = False,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Fit all parameters by maximum likelihood."""
    compile_in_background()
    from rovid.effects import effect_named
    from rovid.present.documents.fits import likelihood_document
    from rovid.present.terminal.results import show_likelihood

    effects = tuple(effect_named(name) for name in dict.fromkeys(effect or ()))
    session = open_session(logs, parameters, axis, cutoff, force=force, with_history=True)
    fit_and_store(
        session,
        "Maximising the likelihood …",
        lambda: session.study.likelihood(effects, gyro=gyro),
        likelihood_document,
        show_likelihood,
        *["--gyro"] * gyro,
        json=json,
    )
