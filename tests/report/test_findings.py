"""The section "Diagnosis": a hidden lag found by the report itself, and what is said where there is nothing to say."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rovid.diagnose.record import Diagnosis, Finding
from rovid.effects import effect_named
from rovid.ground.files import Claim
from rovid.parameters.parameters import Parameters
from rovid.parameters.reading import read_parameters
from rovid.report import build, findings
from rovid.report.album import Album, make_album
from rovid.report.evidence import Evidence
from rovid.report.page import render_page, write_report
from rovid.report.plots import canvas
from rovid.report.plots.findings import gain_over_time, rival_gains
from rovid.report.plots.left_over import left_over
from rovid.report.residual import left_by_all, sizes
from rovid.study import open_study
from tests.conftest import SAMPLES, Rovid
from tools.hidden import Hidden
from tools.programme import CAMPAIGN
from tools.trial_day import write_trial_day
from tools.truth import ROSUB

SHORT = [run for run in CAMPAIGN if run.name in {"hold_03", "hold_05", "sine_20s", "steps", "multilevel"}]
LAG = Hidden(effect="thruster_lag", form="first_order", parameters={"time_constant": 0.8})
NASTY = "<b>&\"'{{ 7 * 7 }}$"


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("diagnosed")


@pytest.fixture(scope="session")
def lagged(folder: Path) -> Evidence:
    """What `rovid report` gathers of a short day with a hidden lag; its page is in ``folder``."""
    write_trial_day(folder / "day", seed=3, formats="csv", truth=replace(ROSUB, hidden=(LAG,)), campaign=SHORT)
    kept: list[Evidence] = []

    def write(target: Path, evidence: Evidence, *, claim: Claim) -> Path:
        kept.append(evidence)
        return write_report(target, evidence, claim=claim)

    said: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "write_report", write)
        stored = Parameters(path=folder / "parameters.toml")
        build.build_report(stored, open_study([folder / "day"]), folder / "report", report=said.append)
    assert said[-1] == "Drawing and writing the page …"
    assert len(said) > 2
    return kept[0]


@pytest.fixture(scope="session")
def finding(lagged: Evidence) -> Finding:
    assert lagged.diagnosis is not None
    return lagged.diagnosis.findings[0]


def section(evidence: Evidence, album: Album | None = None) -> str:
    """The section's HTML."""
    page = render_page(evidence, album or Album(), today=date(2026, 3, 7))
    found = re.search(r'<section id="diagnosis".*?</section>', page, re.DOTALL)
    assert found is not None
    return found[0]


def text(part: str) -> str:
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", part)))


def with_diagnosis(evidence: Evidence, **changes: Any) -> Evidence:
    assert evidence.diagnosis is not None
    return replace(evidence, diagnosis=replace(evidence.diagnosis, **changes))


def test_a_hidden_lag_is_named_with_its_numbers(lagged: Evidence, finding: Finding) -> None:
    shown = text(section(lagged))
    assert "The simulation misses thruster lag." in shown
    assert finding.effect.equation in shown
    assert finding.estimate.value("thruster_lag.time_constant") == pytest.approx(0.8, abs=0.05)
    assert re.search(r"time constant 0\.8\d* ± 0\.0\d+ s", shown)
    assert f"gains {finding.gain:.0f} of log-likelihood on the fit, and {finding.held_out_gain:.0f} on trials" in shown
    assert "with what was found noise floor" in shown
    assert "thruster lag: time constant –" in shown
    assert "Never visible in yaw data: a common scale of all thrust and a constant scale of the rate." in shown
    assert "Next run: " in shown


def test_the_page_has_the_section_and_its_plots(lagged: Evidence, folder: Path) -> None:
    page = (folder / "report" / "index.html").read_text()
    assert 'href="#diagnosis"' in page
    assert lagged.diagnosis is not None
    for name in ("rivals_thruster_lag", "diagnosis_gain", "diagnosis_residuals"):
        assert f"plots/{name}.png" in page
        assert {path.suffix for path in (folder / "report" / "plots").glob(f"{name}.*")} == {".png", ".svg"}
    alts = re.findall(r'<img [^>]*alt="([^"]*)"', section(lagged, make_album(lagged)))
    assert [alt.split(" ")[0] for alt in alts] == ["Log-likelihood", "multilevel.csv:", "Five"]


def test_the_page_and_the_parameter_file_are_of_the_diagnosed_model(lagged: Evidence, folder: Path) -> None:
    written = read_parameters(folder / "parameters.toml")
    assert lagged.diagnosis is not None
    assert lagged.diagnosis.extended is not None
    found = lagged.diagnosis.extended.estimate
    assert {name: entry.value for name, entry in written.entries.items()} == dict(
        zip(found.names, found.values.tolist(), strict=True)
    )
    assert lagged.parameters.entries == written.entries
    assert all(not item.run.trial.name.endswith("part 1") for item in lagged.simulations)


def test_the_trial_that_gains_most_is_shown(lagged: Evidence) -> None:
    assert lagged.compared is not None
    base, extended = lagged.compared
    assert base.run.trial.name == extended.run.trial.name
    assert extended.fit.rmse < 0.5 * base.fit.rmse
    figure = gain_over_time(base, extended)
    assert [label.get_text() for label in figure.legends[0].get_texts()] == [
        "measured",
        "without",
        "with what was found",
    ]
    rate, residual = figure.axes
    assert "rad/s" in rate.get_ylabel()
    assert "rad/s" in residual.get_ylabel()
    assert residual.get_xlabel() == "time, s"


def test_rivals_that_are_not_ruled_out_stand_out(lagged: Evidence, finding: Finding) -> None:
    rival = finding.rivals[0].effect
    unsure = replace(finding, undecided=(rival,))
    figure = rival_gains(unsure)
    labels = [label.get_text() for label in figure.legends[0].get_texts()]
    assert labels == ["found", "not ruled out", "ruled out"]
    assert figure.axes[0].get_yticklabels()[0].get_text() == "thruster lag"
    assert finding.worth > finding.rivals[0].worth
    canvas.png(figure)
    box = figure.get_tightbbox()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.get_figwidth()
    shown = text(section(with_diagnosis(lagged, findings=(unsure,))))
    assert f"The simulation misses thruster lag or {rival.title}." in shown
    assert f"cannot tell it from {rival.title}. The likeliest to tell: " in shown


def test_rivals_stand_in_a_table_with_what_the_data_say_of_them(lagged: Evidence, finding: Finding) -> None:
    rival = finding.rivals[0].effect
    table = findings.rivals_grid(replace(finding, undecided=(rival,)))
    cause, gain, behind, said = (column.cells for column in table.columns)
    assert cause[:2] == ("thruster lag", findings.name_of(rival))
    assert len(cause) == 1 + min(len(finding.rivals), findings.RIVALS)
    assert said[:2] == ("found", "not ruled out")
    assert set(said[2:]) == {"ruled out"}
    assert behind[0] == "–"
    assert int(gain[0]) - int(gain[1]) == pytest.approx(int(behind[1]), abs=1)  # each rounded by itself
    assert table.caption in text(section(lagged))


def test_the_summary_has_verdict_and_gain(lagged: Evidence) -> None:
    assert lagged.diagnosis is not None
    page = render_page(lagged, Album(), today=date(2026, 3, 7))
    summary = text(page.split('<section id="summary"')[1].split("</section>")[0])
    assert "The simulation misses thruster lag. With what was found the simulated yaw rate of trials" in summary
    numbers = re.search(r"is off by ([\d.]+) in place of ([\d.]+) rad/s", summary)
    assert numbers is not None
    assert float(numbers[1]) < 0.5 * float(numbers[2])
    nothing = with_diagnosis(lagged, verdict="nothing_found", findings=(), extended=lagged.diagnosis.base)
    assert findings.gained(nothing.diagnosis or lagged.diagnosis) == ""


def test_every_trial_is_simulated_with_what_was_found(lagged: Evidence) -> None:
    pairs = list(zip(lagged.before, lagged.simulations, strict=True))
    assert all(one.run is other.run for one, other in pairs)
    assert sum(other.fit.rmse for _, other in pairs) < 0.5 * sum(one.fit.rmse for one, _ in pairs)


def test_nothing_found_says_what_would_have_been_seen(lagged: Evidence) -> None:
    assert lagged.diagnosis is not None
    sizes = ((effect_named("thruster_lag"), 0.0512), (effect_named("bias_torque"), 2.34))
    quiet = with_diagnosis(
        lagged, verdict="nothing_found", findings=(), extended=lagged.diagnosis.base, detectable=sizes
    )
    shown = text(section(replace(quiet, compared=None, before=())))
    assert "Nothing was found: the model explains these data." in shown
    assert "with what was found" not in shown
    assert "The smallest that would have been seen" in shown
    assert "thruster lag time constant 0.051 s" in shown
    assert effect_named("bias_torque").title in shown


def test_unexplained_signals_and_warnings_are_shown(lagged: Evidence) -> None:
    signal = replace(effect_named("bias_torque"), id="signal depth", title="torque that follows depth")
    odd = with_diagnosis(
        lagged, verdict="unexplained", findings=(), signals=((signal, 321.4),), warnings=("something is left",)
    )
    shown = text(section(odd))
    assert "no effect of the catalogue explains" in shown
    assert "torque that follows depth 321" in shown
    assert "It is a dependence, not a cause" in shown
    assert "Something is left." in text(
        render_page(odd, Album(), today=date(2026, 3, 7)).split('<section id="trials"')[0]
    )


def test_too_little_data_is_one_sentence(day: Evidence) -> None:
    little = replace(day, diagnosis=Diagnosis(verdict="too_little_data", missing="there is 1 trial of 9 s."))
    shown = text(section(little))
    assert "There is no diagnosis: there is 1 trial of 9 s." in shown
    assert "Next run: holds of several levels" in shown


def test_tables_alone_make_a_page_that_says_why_there_is_no_diagnosis(rovid: Rovid) -> None:
    assert rovid("report", SAMPLES / "rosub_paper").code == 0
    page = Path("report/index.html").read_text()
    assert "No single inertia fits all sine trials" in page
    assert "there are tables, no logs" in page
    assert "There is no diagnosis: no plain model agrees with the tables" in page
    assert "Each of these, alone, would explain the tables" in page
    assert "0.204" in page


def test_without_a_diagnosis_there_is_no_section(day: Evidence) -> None:
    page = render_page(day, Album(), today=date(2026, 3, 7))
    assert 'id="diagnosis"' not in page
    assert "#diagnosis" not in page


def test_names_are_shown_as_they_are(lagged: Evidence, finding: Finding) -> None:
    # The form of this effect is a thruster's name, which the user gives.
    effect = replace(finding.effect, id="thruster_imbalance", form=NASTY, title=NASTY)
    effect = replace(effect, equation=NASTY, experiment=NASTY, fingerprint=NASTY)
    names = tuple(f"{effect.key}.{parameter.name}" for parameter in effect.parameters)
    strange = replace(
        finding,
        effect=effect,
        estimate=replace(finding.estimate, names=names),
        rivals=(replace(finding.rivals[0], effect=effect),),
        undecided=(effect,),
    )
    evidence = with_diagnosis(lagged, findings=(strange,), signals=((effect, 1.0),), warnings=(NASTY,))
    picture = make_album(replace(evidence, simulations=(), runs=None, drag=None, inertia=None))
    part = section(evidence, picture)
    assert "<b>" not in part
    assert "49" not in re.sub(r"base64,[^\"]+", "", part).split("<h3")[1].split("</h3>")[0]
    assert "&lt;b&gt;" in part
    assert all(re.fullmatch(r"[A-Za-z0-9_]+", name) for name in re.findall(r"plots/([^.]+)\.png", part))


def test_less_torque_is_left_over_with_what_was_found(lagged: Evidence) -> None:
    assert lagged.diagnosis is not None
    assert lagged.diagnosis.base is not None
    assert lagged.diagnosis.extended is not None
    assert lagged.runs is not None
    before, after = (
        left_by_all(lagged.runs, side.model, lagged.vehicle)
        for side in (lagged.diagnosis.base, lagged.diagnosis.extended)
    )
    assert sizes(after)[0] < 0.5 * sizes(before)[0]
    figure = left_over(before, after, lagged.runs.cutoff)
    canvas.png(figure)
    box = figure.get_tightbbox()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.get_figwidth()
    assert box.y1 <= figure.get_figheight()


def test_a_change_is_given_in_percent_where_there_is_one(lagged: Evidence) -> None:
    assert lagged.diagnosis is not None
    assert lagged.diagnosis.base is not None
    base = lagged.diagnosis.base.estimate
    doubled = replace(base, values=np.where(np.arange(len(base.values)) == 0, 2.0, 1.0) * base.values)
    vague = replace(base, values=np.zeros(len(base.values)))
    change = {column.title: column for column in findings.sides_grid(base, doubled, ()).columns}["change"]
    assert change.cells[0].startswith("+100.0")
    assert {column.title: column for column in findings.sides_grid(vague, base, ()).columns}["change"].cells[0] == "–"
