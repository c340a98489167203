"""``rovid fit-drag``, ``rovid fit-inertia`` and ``rovid fit``."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rovid.cli.context import compile_in_background, is_planar
from rovid.cli.options import add_effects
from rovid.cli.sessions import fit_and_store, open_planar_session, open_session, print_result, store_planar_fit
from rovid.cli.streams import progress

if TYPE_CHECKING:
    from rovid.cli.sessions import FitSession
    from rovid.store.study import Study


def fit_drag(
    logs: list[Path],
    *,
    axis: str | None = None,
    parameters: Path | None = None,
    cutoff: float | None = None,
    force: bool = False,
    json: bool = False,
) -> None:
    """Fit drag from steady turns."""
    from rovid.preflight.check import drag_without_feedback

    session = open_session(logs, parameters, axis, cutoff, force=force)
    if session.stored.axis.self_righting:
        # Under a constant torque such an axis comes to rest, so drag is found together with the inertia.
        _fit_inertia(session, json=json)
        return
    fit_and_store(session, "Fitting drag …", partial(drag_without_feedback, session.study), json=json)


def fit_inertia(
    logs: list[Path] | None = None,
    *,
    axis: str | None = None,
    parameters: Path | None = None,
    cutoff: float | None = None,
    force: bool = False,
    json: bool = False,
) -> None:
    """Fit inertia from sines by four methods."""
    _fit_inertia(open_session(logs, parameters, axis, cutoff, force=force), json=json)


def _fit_inertia(session: FitSession[Study], *, json: bool) -> None:
    drag = session.stored.independent_drag()
    fit_and_store(session, "Fitting inertia …", lambda: session.study.inertia(drag), json=json)


def fit(
    logs: list[Path] | None = None,
    *,
    effect: list[str] | None = None,
    gyro: bool = False,
    axis: str | None = None,
    axes: str | None = None,
    parameters: Path | None = None,
    cutoff: float | None = None,
    force: bool = False,
    effects_from: list[Path] | None = None,
    json: bool = False,
) -> None:
    """Fit all parameters by maximum likelihood."""
    add_effects(effects_from)
    names = list(dict.fromkeys(effect or ()))
    if is_planar(axes, axis, gyro=gyro, cutoff=cutoff):
        from rovid.present.documents.planar import planar_fit_document
        from rovid.present.terminal.planar import show_planar_fit
        from rovid.store.planar_study import planar_effect

        chosen = tuple(dict.fromkeys(map(planar_effect, names)))
        coupled = open_planar_session(logs, parameters, force=force)
        with progress("Fitting surge, sway and yaw …"):
            result = coupled.study.fit(chosen)
        warnings = (*result.estimate.warnings, *coupled.notes)
        result = replace(result, estimate=replace(result.estimate, warnings=warnings))
        stored = store_planar_fit(coupled, result)
        print_result(result, coupled.study, stored, planar_fit_document, show_planar_fit, json=json)
        return
    compile_in_background()
    from rovid.effects import effect_named

    effects = tuple(map(effect_named, names))
    session = open_session(logs, parameters, axis, cutoff, force=force, with_history=True)
    fit_and_store(
        session,
        "Maximising the likelihood …",
        lambda: session.study.likelihood(effects, gyro=gyro),
        *["--gyro"] * gyro,
        json=json,
    )
