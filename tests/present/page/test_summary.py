"""The first screen: wrong, why, gain, next, for each thing that a diagnosis can say."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest

from rovid.effects import effect_named
from rovid.present.page.summary import PageSummary, summarize
from rovid.present.report_data import ReportData


def answered(evidence: ReportData, **changes: Any) -> PageSummary:
    assert evidence.diagnosis is not None
    return summarize(replace(evidence, diagnosis=replace(evidence.diagnosis, **changes)))


def test_what_was_found_is_wrong_why_gain_and_next(lagged: ReportData) -> None:
    diagnosis = lagged.diagnosis
    assert diagnosis is not None
    assert diagnosis.base is not None
    answer = summarize(lagged)
    assert answer.headline == "The plain model misses thruster lag."
    heading, rate = answer.gains
    assert heading.title == "heading error after 60 s"
    assert [bar.label for bar in heading.bars] == ["plain model", "extended model"]
    without, with_it = heading.bars
    assert answer.error == f"The simulated heading is {without.value} off after 60 s."
    before = lagged.axis.to_display(diagnosis.base.held_out.position_errors[60.0])
    assert float(without.value.removesuffix(" deg")) == pytest.approx(before, rel=0.02)
    assert without.share == 1.0
    assert with_it.share < 0.5
    assert 0.0 < heading.tick < with_it.share
    assert heading.floor.endswith(" deg")
    assert rate.floor.endswith(" rad/s")
    (reason,) = answer.reasons
    assert reason.title == "thruster lag"
    assert reason.size.startswith("time constant 0.8")
    assert reason.size.endswith("\u00a0s")
    assert reason.sure.startswith("confirmed: size ")
    assert reason.sure.endswith("; thrust or sensor may be late")  # no gyro is logged
    lost = [round(100 * (1 - gain.bars[1].share)) for gain in answer.gains]
    said = f"heading error {lost[0]} % smaller, yaw rate error {lost[1]} % smaller"
    assert answer.improvement == f"On trials that were not fitted: {said}."
    assert re.match(r"The causes remove (all|\d\d %) of the mean square yaw rate error that a", answer.removed)
    assert answer.next_step.run


def test_an_error_that_grew_is_called_larger(lagged: ReportData) -> None:
    assert lagged.diagnosis is not None
    side = lagged.extended
    assert side is not None
    worse = replace(side, held_out=replace(side.held_out, position_errors={10.0: 9.0, 60.0: 9.0}))
    assert re.search(
        r"heading error \d+ % larger, yaw rate error \d+ % smaller", answered(lagged, extended=worse).improvement
    )


def test_what_nothing_explains_is_said_so(lagged: ReportData) -> None:
    assert lagged.diagnosis is not None
    answer = answered(lagged, verdict="unexplained", findings=(), extended=lagged.diagnosis.base)
    assert not answer.reasons
    assert answer.no_cause.startswith("No effect of the catalogue explains")


def test_a_suspect_gains_nothing_yet(lagged: ReportData) -> None:
    assert lagged.diagnosis is not None
    suspect = replace(lagged.diagnosis.findings[0], probability=0.6)
    answer = answered(lagged, verdict="suspected", findings=(), suspects=(suspect,), extended=lagged.diagnosis.base)
    assert answer.headline == "The plain model may miss thruster lag."
    assert answer.improvement == ""
    assert [[bar.label for bar in gain.bars] for gain in answer.gains] == [["simulated"], ["simulated"]]
    assert "A perfect model's would be" in answer.error


def test_a_signal_is_a_dependence_without_a_name(lagged: ReportData) -> None:
    signal = replace(effect_named("bias_torque"), id="signal depth", title="a torque that follows depth")
    answer = answered(lagged, verdict="unexplained", findings=(), signals=((signal, 321.4),))
    assert answer.reasons[-1].title == "a torque that follows depth"
    assert "without a known cause" in answer.reasons[-1].sure


def test_without_a_diagnosis_the_simulation_of_all_trials_speaks(day: ReportData) -> None:
    answer = summarize(day)
    assert answer.headline.startswith("The model explains R² = ")
    assert "rovid diagnose" in answer.next_step.run
    assert {gain.floor for gain in answer.gains} == {""}
    assert summarize(replace(day, diagnosis_refusal="the logs hold no torque.")).no_cause == "the logs hold no torque."


def test_an_error_of_nothing_is_shown_as_nothing(day: ReportData) -> None:
    exact = [replace(item, position_errors=dict.fromkeys(item.position_errors, 0.0)) for item in day.simulations]
    assert summarize(replace(day, simulations=tuple(exact))).gains[0].bars[0].value == "0.0 deg"
