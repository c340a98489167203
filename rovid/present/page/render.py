"""One self-contained page and its plots beside it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np

from rovid import __version__
from rovid.core.atomic_write import OutputFile, OutputSet
from rovid.core.formatting import plus_minus
from rovid.core.signatures import PAGE, png_signature
from rovid.diagnose.result import Diagnosis, discriminating_experiment, next_experiment
from rovid.effects import effect_named, restoring_effect
from rovid.estimate.inertia import METHODS, InertiaFit
from rovid.model.parameter_names import base_names
from rovid.present.number_text import arm_words, parameter_title, steady_state_words, unit_symbol
from rovid.present.page import controller_tables, correlations
from rovid.present.page.assets import read_assets
from rovid.present.page.figures import ReportFigures, draw_figures, existing_plots
from rovid.present.page.report_data import ReportData
from rovid.present.page.residual_torque import rms_sizes, unexplained_torques
from rovid.present.page.summary import size_words, summarize
from rovid.present.page.templating import template_environment
from rovid.present.page.viewer_data import viewer_document
from rovid.present.tables import diagnosis, drag, exports, model
from rovid.present.verdict import confidence_words
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle, box_inertia

# Which side of a box lies along the axis that it turns about.
_ALONG = {"roll": "long", "pitch": "wide", "yaw": "high"}


def claim_report(folder: Path, *, force: bool = False, protected: Iterable[Path] = ()) -> OutputSet:
    """Leave to write a report into ``folder``, where other files may be as long as none is called like one of its own.

    Raises
    ------
    OutputError
        One is, or the folder cannot be written.
    """
    plots = folder / "plots"
    # Which plots there will be is not known yet; one stands for all that are not there.
    outputs = dict.fromkeys(
        (_page(folder), *existing_plots(plots), OutputFile(plots / "inertia.png", png_signature("report")))
    )
    return OutputSet(list(outputs), force=force, protected=protected)


def _page(folder: Path) -> OutputFile:
    return OutputFile(folder / "index.html", PAGE)


def write_report(
    folder: Path, evidence: ReportData, *, claim: OutputSet | None = None, today: date | None = None
) -> Path:
    """Write ``folder``/index.html and ``folder``/plots/*.png and *.svg; return the page.

    They change together: a page never shows what its plots do not. Plots of an older report that this one does not have
    are taken away.

    Parameters
    ----------
    claim
        Leave to write there, where that was asked for before.
    today
        The date on the page; today's, UTC, if not given.

    Raises
    ------
    OutputError
        The folder cannot be written; a page that was there stays whole.
    """
    claim = claim or claim_report(folder)
    album = draw_figures(evidence)
    text = render_page(evidence, album, today=today or datetime.now(UTC).date())
    page = _page(folder)
    plots = album.files(folder / "plots")
    older = [plot for plot in existing_plots(folder / "plots") if plot not in plots]
    stale = [plot.path for plot in older if plot.path.is_file() and plot.signature.matches(plot.path)]
    claim.write({**plots, page: text}, stale=stale)
    return page.path


def render_page(evidence: ReportData, album: ReportFigures, *, today: date) -> str:
    """The page as HTML, with the plots of ``album``."""
    environment = template_environment()
    # Every table asks for it: those of macros too, which see no other context.
    environment.globals["guess"] = evidence.vehicle.assumptions
    return environment.get_template("page.html.j2").render(_context(evidence, album, today))


def _context(evidence: ReportData, album: ReportFigures, today: date) -> dict[str, Any]:
    simulations = evidence.simulations
    return {
        "evidence": evidence,
        "axis": evidence.axis,
        "steady": steady_state_words(evidence.axis),
        "arm": arm_words(evidence.axis)[0],
        "restoring": restoring_effect(evidence.axis),
        "vehicle": evidence.vehicle,
        "stored": evidence.parameters,
        "drag": evidence.drag,
        "inertia": evidence.inertia,
        "runs": evidence.runs,
        "trials": _trials(evidence),
        "simulations": simulations,
        "answer": summarize(evidence),
        "added": _added(evidence),
        "together": correlations.correlation_table(evidence.parameters),
        "invisible": diagnosis.invisible_words(evidence.vehicle),
        "left": _left(evidence),
        "effects": [effect_named(name) for name in evidence.parameters.effects],
        "missing": list(_missing(evidence)),
        "warnings": list(_warnings(evidence)),
        "remarked": sum(bool(trial.remarks) for trial in _trials(evidence)),
        "refused": list(_refused(evidence)),
        "rate_range": _rate_range(evidence),
        "rate_from": _rate_from(evidence),
        "noise": _noise(evidence),
        "box": _box(evidence.vehicle),
        "methods": METHODS,
        "diagnosed": _looked_for(evidence.diagnosis),
        "controlled": evidence.control is not None or bool(evidence.control_refusal),
        "exported": bool(evidence.exports) or bool(evidence.export_refusal),
        "findings": diagnosis,
        "size_of": size_words,
        "sureness": confidence_words,
        "correlations": correlations,
        "controller": controller_tables,
        "exporting": exports,
        "decides": discriminating_experiment,
        "next_experiment": next_experiment,
        "grids": model,
        "drag_grids": drag,
        "album": album,
        "viewer": viewer_document(evidence) if simulations else None,
        "assets": read_assets(),
        "today": f"{today:%d %B %Y}".lstrip("0"),
        "version": __version__,
    }


def _trials(evidence: ReportData) -> tuple[Trial, ...]:
    if evidence.campaign is None:
        return ()
    return evidence.campaign.trials


def _looked_for(diagnosis: Diagnosis | None) -> bool:
    """Whether there is more to say of causes than the first screen does."""
    return diagnosis is not None and (diagnosis.base is not None or diagnosis.from_tables is not None)


def _missing(evidence: ReportData) -> Iterator[tuple[str, str]]:
    """Each parameter that the file lacks, with the reason."""
    entries, drag = evidence.parameters.entries, evidence.drag
    for name in base_names(evidence.axis):
        if name in entries:
            continue
        # Where no torque keeps the vehicle turning all come with the inertia.
        if name == "inertia" or evidence.axis.self_righting:
            yield parameter_title(name), evidence.inertia_refusal
        elif drag is None:
            yield parameter_title(name), evidence.drag_refusal
        else:
            yield parameter_title(name), drag.estimate.refused.get(name, "")


def _warnings(evidence: ReportData) -> Iterator[str]:
    """What a reader has to know before using the numbers, the gravest first; each thing once."""
    said = tuple(reason for _, reason in _missing(evidence) if reason)
    for text in dict.fromkeys(_noticed(evidence)):
        if not text.endswith(said):
            yield text


def _noticed(evidence: ReportData) -> Iterator[str]:
    """As `_warnings`, some more than once."""
    campaign, diagnosis = evidence.campaign, evidence.diagnosis
    yield from evidence.notes
    if diagnosis is not None:
        yield from diagnosis.warnings
    for fit in (evidence.drag, evidence.inertia):
        if fit is not None and model.is_source_of_model(evidence, fit.estimate):
            yield from fit.estimate.warnings
    for remarked in (campaign, evidence.runs):
        if remarked is not None:
            yield from (remark.text for remark in remarked.remarks)


def _refused(evidence: ReportData) -> Iterator[tuple[str, str]]:
    """What could not be determined, each with the reason."""
    yield from _missing(evidence)
    if evidence.drag is None and "quadratic_drag" in evidence.parameters.entries and not evidence.axis.self_righting:
        yield f"Drag from {steady_state_words(evidence.axis)}s", evidence.drag_refusal
    if evidence.inertia is None and "inertia" in evidence.parameters.entries:
        yield "Inertia from these logs", evidence.inertia_refusal
    if evidence.inertia is not None:
        yield from _refused_methods(evidence.inertia)


def _refused_methods(fit: InertiaFit) -> Iterator[tuple[str, str]]:
    """The methods that gave no inertia; those of one reason together."""
    methods: dict[str, list[str]] = {}
    for name, reason in fit.refused.items():
        methods.setdefault(reason, []).append(METHODS[name])
    for reason, together in methods.items():
        yield "Inertia by " + ", by ".join(together), reason


def _rate_range(evidence: ReportData) -> tuple[float, float] | None:
    """Slowest and fastest steady state in rad/s or m/s."""
    if evidence.drag is None:
        return None
    speeds = np.abs([point.rate for point in evidence.drag.points])
    return float(speeds.min()), float(speeds.max())


def _rate_from(evidence: ReportData) -> str:
    """Which signal the rate comes from, in words."""
    if evidence.runs is None:
        return ""
    logged, position = f"the logged {evidence.axis.rate_words}", evidence.axis.position_words
    gyro = [run.rates.from_gyro for run in evidence.runs.items]
    if all(gyro):
        return logged
    if any(gyro):
        return f"{logged} where there is one, else from the {position}"
    return f"the {position}"


def _noise(evidence: ReportData) -> dict[str, Any] | None:
    """What is measured, its unit and noise; that of rate and acceleration behind the filter. Standard deviations."""
    if evidence.runs is None:
        return None
    measured, rate, acceleration = evidence.runs.noise()
    name, shown, factor = evidence.axis.measured_quantity(integrated=evidence.runs.rate_only)
    return {"name": name, "unit": shown, "measured": factor * measured, "rate": rate, "acceleration": acceleration}


def _left(evidence: ReportData) -> tuple[float, float, float] | None:
    """Root mean square in N m or N of residual torque, torque, and sensor noise; None where nothing was simulated."""
    if evidence.runs is None or not evidence.simulations:
        return None
    return rms_sizes(unexplained_torques(evidence.runs, evidence.parameters.model(), evidence.vehicle))


def _added(evidence: ReportData) -> str:
    """What the water adds to the rigid body's inertia, by the model; nothing where one is not known or is guessed."""
    entry, rigid = evidence.parameters.entries.get("inertia"), evidence.vehicle.rigid_body_inertia
    if entry is None or rigid is None or evidence.vehicle.assumptions:
        return ""
    return f"{plus_minus(entry.value - rigid, entry.standard_error)} {unit_symbol(entry.unit)}"


def _box(vehicle: Vehicle) -> list[tuple[str, float]]:
    """Sides of the uniform box whose inertia is taken for the rigid body's; none where it is not one's."""
    sides = {"long": vehicle.length, "wide": vehicle.width, "high": vehicle.height}
    if vehicle.axis.name not in _ALONG or vehicle.mass is None or vehicle.rigid_body_inertia is None:
        return []
    # A box's inertia about an axis depends on the two sides across it.
    sides.pop(_ALONG[vehicle.axis.name])
    across = [(word, side) for word, side in sides.items() if side is not None]
    if len(across) < 2:
        return []
    (_, one), (_, other), *_ = across
    inertia = box_inertia(vehicle.mass, one, other)
    return across if math.isclose(vehicle.rigid_body_inertia, inertia) else []
