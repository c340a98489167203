"""The section "Causes": a hidden lag found by the report itself, and what is said where there is nothing to say."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rovid.diagnose.result import Diagnosis, Finding
from rovid.effects import effect_named
from rovid.effects.further_terms import form_name
from rovid.present.page.figures import ReportFigures, draw_figures
from rovid.present.page.render import render_page
from rovid.present.plots import canvas
from rovid.present.plots.results import plot_alternatives
from rovid.present.plots.trials import plot_before_after, plot_residual_comparison
from rovid.present.report_data import ReportData, worst_first
from rovid.present.residuals import rms_sizes, unexplained_torques
from rovid.present.tables import diagnosis
from rovid.store.load import read_parameters
from tests.conftest import SAMPLES, Rovid

NASTY = "<b>&\"'{{ 7 * 7 }}$"


@pytest.fixture(scope="session")
def finding(lagged: ReportData) -> Finding:
    assert lagged.diagnosis is not None
    return lagged.diagnosis.findings[0]


def part_of(evidence: ReportData, key: str, album: ReportFigures | None = None) -> str:
    """The HTML of one section of the page."""
    page = render_page(evidence, album or ReportFigures(), today=date(2026, 3, 7))
    found = re.search(rf'<section id="{key}".*?</section>', page, re.DOTALL)
    assert found is not None
    return found[0]


def section(evidence: ReportData, album: ReportFigures | None = None) -> str:
    """The HTML of what is said of causes."""
    return part_of(evidence, "diagnosis", album)


def text(part: str) -> str:
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", part)))


def with_diagnosis(evidence: ReportData, **changes: Any) -> ReportData:
    assert evidence.diagnosis is not None
    return replace(evidence, diagnosis=replace(evidence.diagnosis, **changes))


def test_a_hidden_lag_is_named_with_its_numbers(
    lagged: ReportData, lagged_album: ReportFigures, finding: Finding
) -> None:
    shown = text(section(lagged, lagged_album))
    assert finding.effect.equation in shown
    assert finding.estimate.value("thruster_lag.time_constant") == pytest.approx(0.8, abs=0.05)
    assert f"gain {finding.held_out_gain:.0f} on trials that were not fitted." in shown
    assert "extended model noise floor" in shown
    assert "No other cause explains these data as well" in shown
    model = text(part_of(lagged, "model"))
    assert re.search(r"thruster lag: time constant, s – 0\.8\d* ± 0\.0\d+", model)


def test_the_page_has_the_section_and_its_plots(
    lagged: ReportData, lagged_album: ReportFigures, lagged_folder: Path
) -> None:
    page = (lagged_folder / "report" / "index.html").read_text()
    assert 'href="#diagnosis"' in page
    assert lagged.diagnosis is not None
    for name in ("rivals_thruster_lag", "missing_thruster_lag", "diagnosis_gain", "diagnosis_residuals"):
        assert {path.suffix for path in (lagged_folder / "report" / "plots").glob(f"{name}.*")} == {".png", ".svg"}
    alts = re.findall(r'<img [^>]*alt="([^"]*)"', section(lagged, lagged_album))
    assert [alt.split(" ")[0] for alt in alts] == ["Missing", "Log-likelihood"]


def test_the_page_and_the_parameter_file_are_of_the_diagnosed_model(lagged: ReportData, lagged_folder: Path) -> None:
    written = read_parameters(lagged_folder / "parameters.toml")
    assert lagged.diagnosis is not None
    assert lagged.diagnosis.extended is not None
    found = lagged.diagnosis.extended.estimate
    assert {name: entry.value for name, entry in written.entries.items()} == dict(
        zip(found.names, found.values.tolist(), strict=True)
    )
    assert lagged.parameters.entries == written.entries
    assert all(not item.run.trial.name.endswith("part 1") for item in lagged.simulations)


def test_the_worst_trial_is_shown_before_and_after(lagged: ReportData) -> None:
    worst = worst_first(lagged.simulations_without)[0]
    before, after = lagged.simulations_without[worst], lagged.simulations_with[worst]
    assert before.run is after.run
    assert before.fit.rmse == max(item.fit.rmse for item in lagged.simulations_without)
    assert after.fit.rmse < 0.5 * before.fit.rmse
    figure = plot_before_after(before, after, width=5.0, rows=(1.5, 1.0))
    assert [label.get_text() for label in figure.legends[0].get_texts()] == [
        "measured",
        "plain model",
        "extended model",
    ]
    rate, heading = figure.axes
    assert rate.get_title(loc="left") == "yaw rate, rad/s"
    assert heading.get_title(loc="left") == "heading error, deg"
    alone = plot_before_after(before, before, width=5.0, rows=(1.5, 1.0))
    assert [label.get_text() for label in alone.legends[0].get_texts()] == ["measured", "simulated"]


def test_rivals_that_are_not_ruled_out_stand_out(lagged: ReportData, finding: Finding) -> None:
    rival = finding.alternatives[0].effect
    # The longest name: of a cause that has a size of its own in each of several trials.
    trials = [f"campaign_of_november_{number}.csv" for number in range(4)]
    long = replace(finding.alternatives[-1], effect=replace(rival, form=form_name(trials)))
    unsure = replace(finding, indistinguishable=(rival,), alternatives=(*finding.alternatives[:2], long))
    figure = plot_alternatives(unsure)
    name = figure.axes[0].get_yticklabels()[-1].get_text()
    assert name.replace("\n", " ").startswith(f"{rival.title} (trials {trials[0]}, ")
    assert name.endswith(" …")
    assert name.count("\n") == 1
    labels = [label.get_text() for label in figure.legends[0].get_texts()]
    assert labels == ["found", "not ruled out", "ruled out"]
    assert figure.axes[0].get_yticklabels()[0].get_text() == "thruster lag"
    assert finding.bic_gain > finding.alternatives[0].bic_gain
    canvas.render_png(figure)
    box = figure.get_tightbbox()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.get_figwidth()
    undecided = with_diagnosis(lagged, findings=(unsure,))
    shown = text(section(undecided))
    assert f"The plain model misses thruster lag or {rival.title}." in text(part_of(undecided, "summary"))
    assert f"do not distinguish it from {rival.title}. The run most likely to decide: " in shown


def test_every_trial_is_simulated_with_what_was_found(lagged: ReportData) -> None:
    assert [[effect.id for effect in stage.model.effects] for stage in lagged.nested] == [[], ["thruster_lag"]]
    pairs = list(zip(lagged.simulations_without, lagged.simulations_with, strict=True))
    assert all(one.run is other.run for one, other in pairs)
    assert sum(other.fit.rmse for _, other in pairs) < 0.5 * sum(one.fit.rmse for one, _ in pairs)


def test_nothing_found_says_what_would_have_been_seen(lagged: ReportData) -> None:
    assert lagged.diagnosis is not None
    sizes = ((effect_named("thruster_lag"), 0.0512), (effect_named("bias_torque"), 2.34))
    quiet = with_diagnosis(
        lagged, verdict="nothing_found", findings=(), extended=lagged.diagnosis.base, detectable=sizes
    )
    quiet = replace(quiet, nested=lagged.nested[:1])
    shown = text(section(quiet))
    assert "None was needed." in shown
    assert "extended model" not in shown
    assert "The smallest that would have been seen" in shown
    assert re.search(r"thruster lag time constant 0\.051\ss", shown)
    first = text(part_of(quiet, "summary"))
    assert "Nothing was found: the model explains these data." in first
    assert "These would have shown: thruster lag from 0.051 s and constant torque from 2.3 N m." in first
    assert effect_named("bias_torque").title in shown


def test_unexplained_signals_and_warnings_are_shown(lagged: ReportData) -> None:
    signal = replace(effect_named("bias_torque"), id="signal depth", title="torque that follows depth")
    odd = with_diagnosis(
        lagged, verdict="unexplained", findings=(), signals=((signal, 321.4),), warnings=("something is left",)
    )
    shown = text(section(odd))
    assert "no effect of the catalogue explains" in text(part_of(odd, "summary"))
    assert "torque that follows depth 321" in shown
    assert "A dependence, not a cause" in shown
    assert "Something is left." in text(part_of(odd, "model"))


def test_too_little_data_is_one_sentence(day: ReportData) -> None:
    little = replace(day, diagnosis=Diagnosis(verdict="too_little_data", missing="there is 1 trial of 9 s."))
    shown = text(part_of(little, "summary"))
    assert "There is too little data for a diagnosis." in shown
    assert "Why There is 1 trial of 9 s." in shown
    assert "Next Holds of several levels" in shown


@pytest.mark.slow
@pytest.mark.usefixtures("blank")
def test_tables_alone_make_a_page_that_says_why_there_is_no_diagnosis(rovid: Rovid) -> None:
    assert rovid("report", SAMPLES / "rosub_paper").code == 0
    page = Path("report/index.html").read_text()
    assert "No single inertia fits all sine trials" in page
    assert "there are tables, no logs" in page
    assert "No plain model agrees with the tables" in page
    assert "Each of these, alone, would explain the tables" in page
    assert "0.204" in page


def test_without_a_diagnosis_there_is_no_section(day: ReportData) -> None:
    page = render_page(day, ReportFigures(), today=date(2026, 3, 7))
    assert 'id="diagnosis"' not in page
    assert "#diagnosis" not in page


@pytest.mark.slow
def test_names_are_shown_as_they_are(lagged: ReportData, finding: Finding) -> None:
    # The form of this effect is a thruster's name, which the user gives.
    effect = replace(finding.effect, id="thruster_imbalance", form=NASTY, title=NASTY)
    effect = replace(effect, equation=NASTY, experiment=NASTY, fingerprint=NASTY)
    names = tuple(f"{effect.key}.{parameter.name}" for parameter in effect.parameters)
    strange = replace(
        finding,
        effect=effect,
        estimate=replace(finding.estimate, names=names),
        alternatives=(replace(finding.alternatives[0], effect=effect),),
        indistinguishable=(effect,),
    )
    evidence = with_diagnosis(lagged, findings=(strange,), signals=((effect, 1.0),), warnings=(NASTY,))
    picture = draw_figures(replace(evidence, simulations=(), runs=None, drag=None, inertia=None, control=None))
    part = section(evidence, picture)
    assert "<b>" not in part
    assert "49" not in re.sub(r"base64,[^\"]+", "", part).split("<h3")[1].split("</h3>")[0]
    assert "&lt;b&gt;" in part
    assert all(re.fullmatch(r"[A-Za-z0-9_]+", name) for name in re.findall(r"plots/([^.]+)\.png", part))


def test_less_torque_is_left_over_with_what_was_found(lagged: ReportData) -> None:
    assert lagged.diagnosis is not None
    assert lagged.diagnosis.base is not None
    assert lagged.diagnosis.extended is not None
    assert lagged.runs is not None
    before, after = (
        unexplained_torques(lagged.runs, side.model, lagged.vehicle)
        for side in (lagged.diagnosis.base, lagged.diagnosis.extended)
    )
    assert rms_sizes(after)[0] < 0.5 * rms_sizes(before)[0]
    figure = plot_residual_comparison(before, after, lagged.runs.cutoff)
    canvas.render_png(figure)
    box = figure.get_tightbbox()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.get_figwidth()
    assert box.y1 <= figure.get_figheight()


def test_a_change_is_given_in_percent_where_there_is_one(lagged: ReportData) -> None:
    assert lagged.diagnosis is not None
    assert lagged.diagnosis.base is not None
    base = lagged.diagnosis.base.estimate
    doubled = replace(base, values=np.where(np.arange(len(base.values)) == 0, 2.0, 1.0) * base.values)
    vague = replace(base, values=np.zeros(len(base.values)))
    change = {column.title: column for column in diagnosis.models_table(base, doubled).columns}["change"]
    assert change.cells[0].startswith("+100.0")
    assert {column.title: column for column in diagnosis.models_table(vague, base).columns}["change"].cells[0] == "–"


def test_a_horizon_that_no_trial_reaches_has_no_row(lagged: ReportData) -> None:
    told = lagged.diagnosis
    assert told is not None
    assert told.base is not None
    assert told.extended is not None
    held_out = replace(told.base.held_out, position_errors={10.0: 0.1, 60.0: None})
    table = diagnosis.held_out_table(told, replace(told.base, held_out=held_out), told.extended)
    assert [row[0][1] for row in table.rows][1:3] == ["heading after 10 s, deg", "yaw rate R²"]
