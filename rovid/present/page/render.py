"""One self-contained page and its plots beside it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np

from rovid import __version__
from rovid.core.atomic_write import Claim, Output
from rovid.core.formatting import plus_minus
from rovid.core.signatures import PAGE, png_form
from rovid.diagnose.next_experiment import deciding_experiment, next_experiment
from rovid.diagnose.result import Diagnosis
from rovid.effects import effect_named, restoring_of
from rovid.estimate.inertia import METHODS, InertiaFit
from rovid.model.parameter_names import base_names
from rovid.present.number_text import arm, steady_state, title, unit
from rovid.present.page import controller_tables, correlations
from rovid.present.page.assets import read_assets
from rovid.present.page.figures import Album, make_album, plots_in
from rovid.present.page.report_data import Evidence
from rovid.present.page.residual_torque import left_by_all, sizes
from rovid.present.page.summary import answer_of, size_of
from rovid.present.page.templating import environment_of
from rovid.present.page.viewer_data import viewer_document
from rovid.present.tables import diagnosis, drag, exports, model
from rovid.present.verdict import sureness
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle, box_inertia

# Which side of a box lies along the axis that it turns about.
_ALONG = {"roll": "long", "pitch": "wide", "yaw": "high"}


def claim_report(folder: Path, *, force: bool = False, protected: Iterable[Path] = ()) -> Claim:
    """Leave to write a report into ``folder``, where other files may be as long as none is called like one of its own.

    Raises
    ------
    OutputError
        One is, or the folder cannot be written.
    """
    plots = folder / "plots"
    # Which plots there will be is not known yet; one stands for all that are not there.
    outputs = dict.fromkeys((_page(folder), *plots_in(plots), Output(plots / "inertia.png", png_form("report"))))
    return Claim(list(outputs), force=force, protected=protected)


def _page(folder: Path) -> Output:
    return Output(folder / "index.html", PAGE)


def write_report(folder: Path, evidence: Evidence, *, claim: Claim | None = None, today: date | None = None) -> Path:
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
    album = make_album(evidence)
    text = render_page(evidence, album, today=today or datetime.now(UTC).date())
    page = _page(folder)
    plots = album.files(folder / "plots")
    older = [plot for plot in plots_in(folder / "plots") if plot not in plots]
    stale = [plot.path for plot in older if plot.path.is_file() and plot.form.marks(plot.path)]
    claim.write({**plots, page: text}, stale=stale)
    return page.path


def render_page(evidence: Evidence, album: Album, *, today: date) -> str:
    """The page as HTML, with the plots of ``album``."""
    environment = environment_of()
    # Every table asks for it: those of macros too, which see no other context.
    environment.globals["guess"] = evidence.vehicle.guess
    return environment.get_template("page.html.j2").render(_context(evidence, album, today))


def _context(evidence: Evidence, album: Album, today: date) -> dict[str, Any]:
    simulations = evidence.simulations
    return {
        "evidence": evidence,
        "axis": evidence.axis,
        "steady": steady_state(evidence.axis),
        "arm": arm(evidence.axis)[0],
        "restoring": restoring_of(evidence.axis),
        "vehicle": evidence.vehicle,
        "stored": evidence.parameters,
        "drag": evidence.drag,
        "inertia": evidence.inertia,
        "runs": evidence.runs,
        "trials": _trials(evidence),
        "simulations": simulations,
        "answer": answer_of(evidence),
        "added": _added(evidence),
        "together": correlations.of_parameters(evidence.parameters),
        "invisible": diagnosis.invisible(evidence.vehicle),
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
        "size_of": size_of,
        "sureness": sureness,
        "correlations": correlations,
        "controller": controller_tables,
        "exporting": exports,
        "decides": deciding_experiment,
        "next_experiment": next_experiment,
        "grids": model,
        "drag_grids": drag,
        "album": album,
        "viewer": viewer_document(evidence) if simulations else None,
        "assets": read_assets(),
        "today": f"{today:%d %B %Y}".lstrip("0"),
        "version": __version__,
    }


def _trials(evidence: Evidence) -> tuple[Trial, ...]:
    if evidence.campaign is None:
        return ()
    return evidence.campaign.trials


def _looked_for(diagnosis: Diagnosis | None) -> bool:
    """Whether there is more to say of causes than the first screen does."""
    return diagnosis is not None and (diagnosis.base is not None or diagnosis.amplitudes is not None)


def _missing(evidence: Evidence) -> Iterator[tuple[str, str]]:
    """Each parameter that the file lacks, with the reason."""
    entries, drag = evidence.parameters.entries, evidence.drag
    for name in base_names(evidence.axis):
        if name in entries:
            continue
        # Where no torque keeps the vehicle turning all come with the inertia.
        if name == "inertia" or evidence.axis.rights:
            yield title(name), evidence.inertia_refusal
        elif drag is None:
            yield title(name), evidence.drag_refusal
        else:
            yield title(name), drag.estimate.refused.get(name, "")


def _warnings(evidence: Evidence) -> Iterator[str]:
    """What a reader has to know before using the numbers, the gravest first; each thing once."""
    said = tuple(reason for _, reason in _missing(evidence) if reason)
    for text in dict.fromkeys(_noticed(evidence)):
        if not text.endswith(said):
            yield text


def _noticed(evidence: Evidence) -> Iterator[str]:
    """As `_warnings`, some more than once."""
    campaign, diagnosis = evidence.campaign, evidence.diagnosis
    yield from evidence.notes
    if diagnosis is not None:
        yield from diagnosis.warnings
    for fit in (evidence.drag, evidence.inertia):
        if fit is not None and model.is_behind(evidence, fit.estimate):
            yield from fit.estimate.warnings
    for remarked in (campaign, evidence.runs):
        if remarked is not None:
            yield from (remark.text for remark in remarked.remarks)


def _refused(evidence: Evidence) -> Iterator[tuple[str, str]]:
    """What could not be determined, each with the reason."""
    yield from _missing(evidence)
    if evidence.drag is None and "quadratic_drag" in evidence.parameters.entries and not evidence.axis.rights:
        yield f"Drag from {steady_state(evidence.axis)}s", evidence.drag_refusal
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


def _rate_range(evidence: Evidence) -> tuple[float, float] | None:
    """Slowest and fastest steady state in rad/s or m/s."""
    if evidence.drag is None:
        return None
    speeds = np.abs([point.rate for point in evidence.drag.points])
    return float(speeds.min()), float(speeds.max())


def _rate_from(evidence: Evidence) -> str:
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


def _noise(evidence: Evidence) -> dict[str, Any] | None:
    """What is measured, its unit and noise; that of rate and acceleration behind the filter. Standard deviations."""
    if evidence.runs is None:
        return None
    measured, rate, acceleration = evidence.runs.noise()
    name, shown, factor = evidence.axis.measured(integrated=evidence.runs.integrated)
    return {"name": name, "unit": shown, "measured": factor * measured, "rate": rate, "acceleration": acceleration}


def _left(evidence: Evidence) -> tuple[float, float, float] | None:
    """Root mean square in N m or N of residual torque, torque, and sensor noise; None where nothing was simulated."""
    if evidence.runs is None or not evidence.simulations:
        return None
    return sizes(left_by_all(evidence.runs, evidence.parameters.model(), evidence.vehicle))


def _added(evidence: Evidence) -> str:
    """What the water adds to the rigid body's inertia, by the model; nothing where one is not known or is guessed."""
    entry, rigid = evidence.parameters.entries.get("inertia"), evidence.vehicle.rigid_body_inertia
    if entry is None or rigid is None or evidence.vehicle.guess:
        return ""
    return f"{plus_minus(entry.value - rigid, entry.standard_error)} {unit(entry.unit)}"


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
