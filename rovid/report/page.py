"""One self-contained page and its plots beside it."""

from __future__ import annotations

import base64
import math
import re
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from rovid import __version__
from rovid.identify.estimate import Estimate
from rovid.identify.inertia import METHODS
from rovid.model import UNITS
from rovid.output import plus_minus, write_atomic
from rovid.report import plots
from rovid.report.evidence import Evidence
from rovid.simulation import HORIZONS, TrialSimulation, overall


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A plot on the page: file name without suffix, what it shows, and its PNG for embedding."""

    name: str
    caption: str
    data: str


def write_report(folder: Path, evidence: Evidence) -> Path:
    """Write ``folder``/index.html and ``folder``/plots/*.png and *.svg; return the page.

    Raises
    ------
    OutputError
        The folder cannot be written; a page that was there stays whole.
    """
    album = _Album(folder / "plots")
    text = _template().render(_context(evidence, album))
    page = folder / "index.html"
    write_atomic(page, text)
    return page


class _Album:
    """Writes each figure as PNG and SVG and keeps the PNG for the page."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def add(self, name: str, caption: str, figure: Figure | None) -> Picture | None:
        if figure is None:
            return None
        png = plots.render(figure, "png")
        write_atomic(self.folder / f"{name}.png", png)
        write_atomic(self.folder / f"{name}.svg", plots.render(figure, "svg"))
        return Picture(name=name, caption=caption, data=base64.b64encode(png).decode("ascii"))


def _template() -> Any:
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["number"] = _number
    environment.filters["degrees"] = lambda value, form=".2g": _number(
        None if value is None else math.degrees(value), form
    )
    return environment.from_string((files("rovid.report") / "templates" / "page.html.j2").read_text("utf-8"))


def _number(value: float | None, form: str = ".4g") -> str:
    return "–" if value is None or not math.isfinite(value) else format(value, form)


def _context(evidence: Evidence, album: _Album) -> dict[str, Any]:
    stored = evidence.parameters
    return {
        "evidence": evidence,
        "vehicle": evidence.vehicle,
        "parameters": _parameters(evidence),
        "missing": [name for name in UNITS if name not in stored.entries],
        "refused": _refused(evidence),
        "warnings": _warnings(evidence),
        "trials": [] if evidence.campaign is None else evidence.campaign.trials,
        "drag": evidence.drag,
        "inertia": evidence.inertia,
        "methods": METHODS,
        "plus_minus": plus_minus,
        "simulations": evidence.simulations,
        "horizons": HORIZONS,
        "overall": overall(evidence.simulations) if evidence.simulations else None,
        "sources": stored.sources,
        "runs": evidence.runs,
        "version": __version__,
        "pictures": _pictures(evidence, album),
        "trial_pictures": [_trial_picture(item, k, album) for k, item in enumerate(evidence.simulations, 1)],
    }


def _parameters(evidence: Evidence) -> list[dict[str, Any]]:
    rows = []
    for name, entry in evidence.parameters.entries.items():
        estimate = _estimate_of(evidence, name)
        if estimate is not None and estimate.value(name) == entry.value:
            low, high = estimate.interval(name)
        else:
            low, high = entry.value - 1.96 * entry.standard_error, entry.value + 1.96 * entry.standard_error
        rows.append(
            {
                "name": name.replace("_", " ").replace(".", ": "),
                "value": plus_minus(entry.value, entry.standard_error),
                "interval": f"{low:.4g} … {high:.4g}" if math.isfinite(low) else "–",
                "unit": entry.unit.replace("^2", "²"),
                "method": entry.method,
            }
        )
    return rows


def _estimate_of(evidence: Evidence, name: str) -> Estimate | None:
    estimates = [fit.estimate for fit in (evidence.drag, evidence.inertia) if fit is not None]
    return next((estimate for estimate in estimates if name in estimate.names), None)


def _refused(evidence: Evidence) -> dict[str, str]:
    found: dict[str, str] = {}
    if evidence.drag is not None:
        found |= evidence.drag.estimate.refused
    if evidence.inertia is not None:
        found |= {METHODS[name]: reason for name, reason in evidence.inertia.refused.items()}
    return found


def _warnings(evidence: Evidence) -> list[str]:
    texts = [] if evidence.campaign is None else [remark.text for remark in evidence.campaign.remarks]
    texts += [] if evidence.runs is None else [remark.text for remark in evidence.runs.remarks]
    for fit in (evidence.drag, evidence.inertia):
        texts += [] if fit is None else list(fit.estimate.warnings)
    return texts


CAPTIONS = {
    "steady_torque": "Torque of each steady turn against its yaw rate, the fitted drag with its 95 % band, and the "
    "residuals.",
    "inertia": "Inertia by each method: dots with 95 % intervals, ticks for single runs. The peak method is biased.",
    "sine_runs": "Mean period of each sine run. Left: torque, rate and acceleration, each over its own peak; their "
    "maxima (dots) do not coincide. Right: torque over rate.",
    "thrust_curves": "Bench curve of each thruster and the commands that the logs use.",
    "overview": "Measured and freely simulated yaw rate of every trial.",
    "residuals": "Torque that the model leaves over, against rate, torque and time, and its spectrum. "
    "A cloud without shape is disturbance; a curve or a loop is something the model misses. A spectrum that rises to "
    "the right is the noise of the heading, differentiated twice.",
}


def _pictures(evidence: Evidence, album: _Album) -> dict[str, Picture | None]:
    figures = _figures(evidence)
    return {name: album.add(name, caption, figures.get(name)) for name, caption in CAPTIONS.items()}


def _figures(evidence: Evidence) -> dict[str, Figure | None]:
    drag, inertia, runs = evidence.drag, evidence.inertia, evidence.runs
    figures: dict[str, Figure | None] = {}
    if drag is not None:
        figures["steady_torque"] = plots.steady_torque(drag)
    if inertia is not None:
        figures["inertia"] = plots.inertia_methods(inertia, evidence.vehicle.rigid_body_inertia)
        figures["sine_runs"] = plots.sine_runs(inertia.trials) if inertia.trials else None
    if runs is not None:
        figures["thrust_curves"] = plots.thrust_curves(evidence.vehicle, runs.items)
    if runs is not None and evidence.simulations:
        figures["overview"] = plots.overview(evidence.simulations)
        figures["residuals"] = plots.residuals(runs.items, evidence.parameters.model())
    return figures


def _trial_picture(item: TrialSimulation, number: int, album: _Album) -> Picture:
    name = f"trial_{number:02d}_{re.sub(r'[^A-Za-z0-9]+', '_', item.run.trial.name).strip('_')[:60]}"
    caption = (
        f"{item.run.trial.name}: measured and freely simulated yaw rate, their difference, and the heading's error."
    )
    picture = album.add(name, caption, plots.simulation(item))
    assert picture is not None  # noqa: S101 - there is always a figure
    return picture
