"""The first screen: wrong, why, gain, next, for each thing that a diagnosis can say."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest

from rovid.effects import effect_named
from rovid.present.page.report_data import Evidence
from rovid.present.page.summary import Answer, answer_of


def answered(evidence: Evidence, **changes: Any) -> Answer:
    assert evidence.diagnosis is not None
    return answer_of(replace(evidence, diagnosis=replace(evidence.diagnosis, **changes)))


def test_what_was_found_is_wrong_why_gain_and_next(lagged: Evidence) -> None:
    diagnosis = lagged.diagnosis
    assert diagnosis is not None
    assert diagnosis.base is not None
    answer = answer_of(lagged)
    assert answer.headline == "The plain model misses thruster lag."
    heading, rate = answer.gains
    assert heading.title == "heading error after 60 s"
    assert [bar.label for bar in heading.bars] == ["without", "with"]
    without, with_it = heading.bars
    assert answer.wrong == f"The simulated heading is {without.value} off after 60 s."
    before = lagged.axis.in_shown(diagnosis.base.held_out.position_errors[60.0])
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
    assert reason.sure == "established: odds 32 to 1"
    lost = [round(100 * (1 - gain.bars[1].share)) for gain in answer.gains]
    said = f"{lost[0]} % of the heading error and {lost[1]} % of the yaw rate error gone"
    assert answer.gained == f"{said}, on data that the fit never saw."
    assert answer.run


def test_an_error_that_grew_is_called_larger(lagged: Evidence) -> None:
    assert lagged.diagnosis is not None
    side = lagged.found
    assert side is not None
    worse = replace(side, held_out=replace(side.held_out, position_errors={10.0: 9.0, 60.0: 9.0}))
    assert re.search(
        r"\d+ % of the yaw rate error gone, the heading error \d+ % larger", answered(lagged, extended=worse).gained
    )


def test_what_nothing_explains_is_said_so(lagged: Evidence) -> None:
    assert lagged.diagnosis is not None
    answer = answered(lagged, verdict="unexplained", findings=(), extended=lagged.diagnosis.base)
    assert not answer.reasons
    assert answer.why.startswith("No effect of the catalogue explains")


def test_a_suspect_gains_nothing_yet(lagged: Evidence) -> None:
    assert lagged.diagnosis is not None
    suspect = replace(lagged.diagnosis.findings[0], confidence=0.6)
    answer = answered(lagged, verdict="suspected", findings=(), suspects=(suspect,), extended=lagged.diagnosis.base)
    assert answer.headline == "The plain model may miss thruster lag."
    assert answer.gained == ""
    assert [[bar.label for bar in gain.bars] for gain in answer.gains] == [["simulated"], ["simulated"]]
    assert "A perfect model's would be" in answer.wrong


def test_a_signal_is_a_dependence_without_a_name(lagged: Evidence) -> None:
    signal = replace(effect_named("bias_torque"), id="signal depth", title="a torque that follows depth")
    answer = answered(lagged, verdict="unexplained", findings=(), signals=((signal, 321.4),))
    assert answer.reasons[-1].title == "a torque that follows depth"
    assert "no name" in answer.reasons[-1].sure


def test_without_a_diagnosis_the_simulation_of_all_trials_speaks(day: Evidence) -> None:
    answer = answer_of(day)
    assert answer.headline.startswith("The model explains R² = ")
    assert "rovid diagnose" in answer.run
    assert {gain.floor for gain in answer.gains} == {""}
    assert answer_of(replace(day, diagnosis_refusal="the logs hold no torque.")).why == "the logs hold no torque."


def test_an_error_of_nothing_is_shown_as_nothing(day: Evidence) -> None:
    exact = [replace(item, position_errors=dict.fromkeys(item.position_errors, 0.0)) for item in day.simulations]
    assert answer_of(replace(day, simulations=tuple(exact))).gains[0].bars[0].value == "0.0 deg"
