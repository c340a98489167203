"""The next step, the cautions and the verdicts that terminal and page share."""

from __future__ import annotations

import io
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rovid.control.control_law import paper_runs
from rovid.control.design import ControllerDesign
from rovid.core.budget import BudgetUse
from rovid.core.formatting import SafeConsole
from rovid.diagnose.result import next_experiment
from rovid.present.page.summary import summarize
from rovid.present.report_data import ReportData
from rovid.present.sentences import cause_title, cautions, control_verdict, fit_verdict, next_step, verdict_sentence
from rovid.present.terminal.watch import show_watch_event
from rovid.store.watch_session import LogsDiagnosed
from rovid.trial.vehicle import Steering


def test_no_cause_has_its_id_for_a_title() -> None:
    assert cause_title("clocks_apart") == "clock offset of the commands"


def test_where_every_cause_is_confirmed_nothing_more_is_to_run(lagged: ReportData) -> None:
    diagnosis = lagged.diagnosis
    assert diagnosis is not None
    assert next_step(diagnosis, next_experiment(diagnosis), lagged.vehicle).run == "nothing more to run for the causes"
    nothing = replace(diagnosis, verdict="nothing_found", findings=())
    step = next_step(nothing, next_experiment(nothing), lagged.vehicle)
    assert step.run == "nothing more to run for the causes"
    assert step.reason.startswith("none was found; `rovid plan` designs")
    wheel = Steering(speed="surge_velocity", size=2.0, wheels=False)
    steered = replace(lagged.vehicle, thrusters=(replace(lagged.vehicle.thrusters[0], steering=wheel),))
    assert "rovid plan" not in str(next_step(nothing, next_experiment(nothing), steered))
    guessed = replace(lagged.vehicle.thrusters[0], name="aft", curve_guessed=True)
    guess = replace(lagged.vehicle, thrusters=(guessed,))
    assert next_step(diagnosis, next_experiment(diagnosis), guess).run == "measure curve of aft"
    (finding,) = diagnosis.findings
    suspect = replace(finding, probability=0.5)
    doubtful = replace(diagnosis, verdict="suspected", findings=(), suspects=(suspect,))
    open_question = next_step(doubtful, next_experiment(doubtful), lagged.vehicle)
    assert open_question.run == finding.effect.experiment
    assert not open_question.command


@pytest.mark.parametrize("verdict", ["nothing_found", "unexplained"])
def test_a_search_that_the_budget_ended_claims_nothing_about_what_it_did_not_try(
    lagged: ReportData, verdict: str
) -> None:
    assert lagged.diagnosis is not None
    used_up = BudgetUse(seconds=5.0, used=4.0, not_tried=("thruster_lag",))
    diagnosis = replace(lagged.diagnosis, verdict=verdict, findings=(), suspects=(), budget=used_up)
    assert verdict_sentence(diagnosis, lagged.vehicle.assumptions).startswith("Cannot tell yet.")
    assert "larger --budget" in next_step(diagnosis, next_experiment(diagnosis), lagged.vehicle).run
    screen = summarize(replace(lagged, diagnosis=diagnosis))
    assert "Cannot tell yet" in screen.headline
    assert "before every cause was tried" in screen.no_cause
    endless = replace(diagnosis, is_endless=True)
    said = verdict_sentence(endless, lagged.vehicle.assumptions)
    assert "each addition asked for another one" in said
    assert "--budget" not in said + str(next_step(endless, next_experiment(endless), lagged.vehicle))
    named = replace(lagged.diagnosis, budget=used_up)
    assert any("before every cause was tried" in text for text in cautions(named, (), lagged.vehicle))
    study = cast("Any", SimpleNamespace(vehicle=lagged.vehicle))
    stream = io.StringIO()
    show_watch_event(
        SafeConsole(file=stream, width=200), LogsDiagnosed(study=study, diagnosis=named, fit=None, criteria=())
    )
    assert "before every cause was tried" in stream.getvalue()


def test_cautions_name_what_makes_a_diagnosis_doubtful(lagged: ReportData) -> None:
    diagnosis, campaign = lagged.diagnosis, lagged.campaign
    assert diagnosis is not None
    assert diagnosis.extended is not None
    assert campaign is not None
    assert list(cautions(diagnosis, campaign.trials, lagged.vehicle)) == []
    alone = list(cautions(diagnosis, campaign.trials[:1], lagged.vehicle))
    assert alone[0].startswith("The data are one run of ")
    worse = replace(diagnosis.extended, held_out=replace(diagnosis.extended.held_out, rate_rmse=1.0))
    (grown,) = cautions(replace(diagnosis, extended=worse), campaign.trials, lagged.vehicle)
    assert grown.startswith("With the causes the yaw rate error of trials that were not fitted is larger")


def test_a_fit_is_judged_by_its_innovations_and_its_disturbance() -> None:
    for faults in ({}, {"white": False}, {"at_limit": True}, {"lacks_torque": True}):
        estimate = SimpleNamespace(lacks_torque=faults.pop("lacks_torque", False))
        fit = cast("Any", SimpleNamespace(estimate=estimate, **({"white": True, "at_limit": False} | faults)))
        kind = "warn" if estimate.lacks_torque or faults else "pass"
        text, judged = fit_verdict(fit)
        assert judged == kind
        assert ("rovid diagnose" in text) == (kind == "warn")


def designed(
    *, aided: tuple[float, float], plain: tuple[float, float], stable: bool = True, phase: float = 46.0
) -> ControllerDesign:
    """A design with (settling time, overshoot) of every step of the paper, with and without the model aid."""
    runs = [
        SimpleNamespace(
            name=step.name,
            effects=(),
            model_aid=aid,
            effects_known=False,
            metrics=SimpleNamespace(settling_time=settling, overshoot_deg=overshoot),
        )
        for step in paper_runs()
        for aid, (settling, overshoot) in ((True, aided), (False, plain))
    ]
    margins = SimpleNamespace(stable=stable, phase_deg=phase, gain_db=20.3, sensitivity_peak=1.5)
    return cast("ControllerDesign", SimpleNamespace(runs=runs, margins=margins, model=SimpleNamespace(effects=())))


@pytest.mark.parametrize(
    ("aided", "plain", "words", "kind"),
    [
        ((4.9, 1.7), (6.4, 0.0), "The model aid is of use", "pass"),
        ((17.8, 8.3), (17.8, 1.2), "Use the controller without the model aid", "warn"),
        ((6.4, 0.0), (6.4, 0.0), "The model aid makes little difference", "pass"),
        ((213.1, 22.8), (213.2, 3.9), "Use the controller without the model aid", "warn"),
        ((60.0, 9.0), (math.inf, 1.0), "The model aid improves one measure of the steps and worsens the other", "warn"),
    ],
)
def test_the_model_aid_is_recommended_where_it_is_of_use(
    aided: tuple[float, float], plain: tuple[float, float], words: str, kind: str
) -> None:
    (first, stable), (second, judged) = control_verdict(designed(aided=aided, plain=plain))
    assert (first, stable) == ("Stable: phase margin 46 deg, gain margin 20.3 dB.", "pass")
    assert second.startswith(words)
    assert judged == kind


def test_small_margins_are_a_warning() -> None:
    (text, kind), _ = control_verdict(designed(aided=(1.0, 1.0), plain=(1.0, 1.0), phase=17.0))
    assert text.startswith("Stable, but with small margins: phase margin 17 deg")
    assert kind == "warn"


def test_a_margin_that_is_printed_as_sufficient_is_no_warning() -> None:
    (text, kind), _ = control_verdict(designed(aided=(1.0, 1.0), plain=(1.0, 1.0), phase=44.88))
    assert (text, kind) == ("Stable: phase margin 45 deg, gain margin 20.3 dB.", "pass")


def test_an_unstable_loop_fails() -> None:
    ((text, kind),) = control_verdict(designed(aided=(1.0, 1.0), plain=(1.0, 1.0), stable=False))
    assert "unstable" in text
    assert kind == "fail"
