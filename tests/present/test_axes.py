"""The page along other axes than yaw: it speaks of their motion, in their units."""

from __future__ import annotations

import html
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from rovid.core.output_files import OutputSet
from rovid.effects import restoring_effect
from rovid.estimate.steady_drag import fit_drag
from rovid.estimate.steady_points import SteadyPoint
from rovid.model.parameter_names import base_names
from rovid.present.page import build
from rovid.present.page.render import write_report
from rovid.present.page.viewer_data import viewer_document
from rovid.present.plots import models, trials
from rovid.present.report_data import ReportData
from rovid.present.residuals import residual_torques, rms_sizes
from rovid.store.parameter_file import Parameters
from rovid.store.study import open_study
from rovid.trial.axis import AXES
from tests.conftest import SAMPLES, blank_plots

LOGS = {
    "surge": ("surge_tank", ("hold_02", "hold_03", "hold_04", "sine_30s", "steps")),
    "pitch": ("pitch_tank", ("hold_02", "hold_04", "release_01", "sine_10s", "steps")),
}
UNITS = {"surge": ("m/s", "kg", "N s²/m²"), "pitch": ("rad/s", "kg m²", "N m/rad", "deg")}
# Of yaw, and units of the other kind of axis. How drag was found has one name along all axes.
FOREIGN = {
    "surge": r"[Yy]aw|[Hh]eading|[Tt]orque|steady turn(?!s, weighted)|N m\b|rad\b|kg m|\bdeg\b",
    "pitch": r"[Yy]aw|[Hh]eading|[Ff]orce\b|m/s",
}


@pytest.fixture(scope="module", params=LOGS)
def shown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[ReportData, str]:
    """What a short day along an axis gave, and what a reader of its page sees and hears."""
    axis, folder = AXES[request.param], tmp_path_factory.mktemp("page")
    sample, names = LOGS[axis.name]
    logs = folder / "logs"
    logs.mkdir()
    for name in ("rovid.toml", "thrust_curve.csv", *(f"{name}.csv" for name in names)):
        shutil.copy(SAMPLES / sample / name, logs)
    kept: list[ReportData] = []

    def write(target: Path, evidence: ReportData, *, claim: OutputSet, journal: Sequence[str] = ()) -> Path:
        kept.append(evidence)
        return write_report(target, evidence, claim=claim)

    with pytest.MonkeyPatch.context() as patch, blank_plots():
        patch.setattr(build, "write_report", write)
        stored = Parameters(path=folder / "parameters.toml", axis=axis)
        page, _ = build.build_report(stored, open_study([logs], axis=axis), folder, diagnosed=False)
    body = re.sub(r"<(style|script)\b.*?</\1>", "", page.read_text(), flags=re.DOTALL)
    text = " ".join([*re.findall(r'alt="([^"]*)"', body), re.sub(r"<[^>]+>", " ", body)])
    return kept[0], re.sub(r"\s+", " ", html.unescape(text))


def test_the_page_speaks_of_its_axis_and_of_no_other(shown: tuple[ReportData, str]) -> None:
    evidence, text = shown
    axis = evidence.axis
    assert f"{axis.name.capitalize()}, {len(evidence.simulations)} trials" in text
    assert axis.rate_words in text
    assert all(unit in text for unit in UNITS[axis.name])
    assert re.findall(FOREIGN[axis.name], text) == []


def test_every_base_parameter_is_in_the_table(shown: tuple[ReportData, str]) -> None:
    evidence, text = shown
    assert set(evidence.parameters.entries) == set(base_names(evidence.axis))
    assert "not determined" not in text
    assert ("restoring stiffness K" in text) == evidence.axis.self_righting
    assert ("trim θ0" in text) == evidence.axis.self_righting


def test_the_plots_speak_of_their_axis(shown: tuple[ReportData, str]) -> None:
    evidence, _ = shown
    axis = evidence.axis
    for figure in figures(evidence):
        labels = [text for panel in figure.axes for text in (panel.get_xlabel(), panel.get_ylabel(), panel.get_title())]
        legends = [text for panel in figure.axes for text in panel.get_legend_handles_labels()[1]]
        around = [str(text.get_text()) for text in figure.texts]
        assert not re.findall(FOREIGN[axis.name], " ".join([*labels, *legends, *around]))


def test_the_viewer_speaks_of_its_axis(shown: tuple[ReportData, str]) -> None:
    evidence, _ = shown
    axis = evidence.axis
    words = " ".join(f"{panel['title']}, {panel['unit']}" for panel in viewer_document(evidence)["panels"])
    assert axis.rate_words in words
    assert re.findall(FOREIGN[axis.name], words) == []


def figures(evidence: ReportData) -> list[Figure]:
    """Those that every axis has, and those of drag and sines where it has them."""
    assert evidence.runs is not None
    assert evidence.inertia is not None
    model = evidence.parameters.model()
    left = residual_torques(evidence.runs.items, model, evidence.vehicle)
    curves = models.plot_thrust_curves(evidence.vehicle, evidence.runs.items)
    assert curves is not None
    drawn = [
        curves,
        models.plot_inertia_methods(evidence.inertia, None),
        trials.plot_overview([(item, item) for item in evidence.simulations]),
        trials.plot_trial(evidence.simulations[0]),
        trials.plot_residuals(left, evidence.runs.cutoff),
    ]
    if evidence.drag is None:
        assert evidence.axis.self_righting
        return drawn
    return [
        *drawn,
        models.plot_steady_states(evidence.drag),
        models.plot_sine_runs(evidence.inertia.trials, model, evidence.axis),
    ]


def test_what_brings_the_vehicle_back_is_not_left_over(shown: tuple[ReportData, str]) -> None:
    evidence, text = shown
    restoring = restoring_effect(evidence.axis)
    assert ("+ DL·r +" in text) == (restoring is not None)
    assert evidence.runs is not None
    left, torque, _ = rms_sizes(residual_torques(evidence.runs.items, evidence.parameters.model(), evidence.vehicle))
    # Without the restoring torque about half of the thrusters' would be left in pitch.
    assert left < 0.2 * torque


def test_the_curve_of_steady_states_holds_the_net_buoyancy() -> None:
    rates = np.array([-0.5, -0.4, -0.3, 0.25, 0.35, 0.45])
    points = [point(rate, 2000.0 * abs(rate) * rate + 100.0 * rate + 60.0) for rate in rates]
    figure = models.plot_steady_states(fit_drag(points, AXES["heave"]))
    curve = next(line for line in figure.axes[0].get_lines() if str(line.get_label()).startswith("fit"))
    assert curve.get_label() == "fit: DQ·|r|·r + DL·r + B"
    x, y = (np.asarray(values, dtype=np.float64) for values in curve.get_data())
    # Noise-free; 300 points of a curve drawn straight between them.
    assert np.interp(rates, x, y) == pytest.approx([each.torque for each in points], abs=0.1)


def point(rate: float, force: float) -> SteadyPoint:
    return SteadyPoint(
        source="hold.csv",
        start=0.0,
        stop=30.0,
        command=(1.0,),
        torque=force,
        rate=rate,
        square_rate=abs(rate) * rate,
        rate_error=1e-3,
        drift=0.0,
        drift_error=1e-3,
    )
