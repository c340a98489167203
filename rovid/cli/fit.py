"""``rovid fit``."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import compile_in_background, console, fit_and_store, open_session, print_json
from rovid.cli.options import (
    Axes,
    AxisName,
    Cutoff,
    EffectsFrom,
    Force,
    Json,
    OptionalLogs,
    ParameterFile,
    add_effects,
    option,
)
from rovid.cli.planar_session import is_planar, open_planar_session, store_planar_fit
from rovid.cli.streams import progress


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
    axes: Axes = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    effects_from: EffectsFrom = None,
    json: Json = False,
) -> None:
    """Fit all parameters by maximum likelihood."""
    add_effects(effects_from)
    if is_planar(axes, axis, gyro=gyro, cutoff=cutoff):
        _fit_planar(logs, effect or [], parameters, force=force, json=json)
        return
    compile_in_background()
    from rovid.effects import effect_named
    from rovid.present.documents.fits import likelihood_document
    from rovid.present.terminal.results import show_likelihood

    effects = tuple(map(effect_named, dict.fromkeys(effect or ())))
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


def _fit_planar(
    logs: Sequence[Path] | None, effects: Sequence[str], parameters: Path | None, *, force: bool, json: bool
) -> None:
    """Fit surge, sway and yaw together, store the parameters and print them."""
    from rovid.present.console import print_text
    from rovid.present.documents.planar import planar_fit_document
    from rovid.present.terminal.planar import show_planar_fit
    from rovid.store.planar_study import planar_effect

    chosen = tuple(dict.fromkeys(map(planar_effect, effects)))
    session = open_planar_session(logs, parameters, force=force)
    with progress("Fitting surge, sway and yaw …"):
        fit = session.study.fit(chosen)
    warnings = (*fit.estimate.warnings, *session.notes)
    fit = replace(fit, estimate=replace(fit.estimate, warnings=warnings))
    stored = store_planar_fit(session, fit)
    if json:
        print_json(planar_fit_document(fit, session.study))
    else:
        show_planar_fit(console(), fit, session.study)
        print_text(console(), f"written to {stored.path}")
