"""Results as the documents that other programs rely on."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rovid.estimate.candidate_runs import CandidateRun
from rovid.estimate.experiment_design import ExpectedInformation, ExperimentPlan
from rovid.export.verification import ExportLoss, Mismatch, Stability, VerifiedExport
from rovid.model.simulation import simulate_runs
from rovid.preflight.advice import Advice
from rovid.preflight.check import LogCheck
from rovid.preflight.feedback_detection import Feedback
from rovid.present.documents.results import check_document, export_document, plan_document, simulation_document
from rovid.store.parameter_file import Entry, Parameters
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import AXES
from rovid.trial.trial import Remark
from rovid.trial.vehicle import Vehicle
from tests import synthetic

GUESS = Assumptions(items=("yaw_arm of fore",), thrusters=1)
ERROR = Entry(value=5057.0, standard_error=9.8, unit="kg m^2", method="m")


def test_a_simulation_has_each_trial_and_all_together() -> None:
    time = synthetic.clock(120.0)
    runs = [synthetic.run(time, np.where(time < 60.0, level, 0.0)) for level in (100.0, 200.0)]
    simulations = simulate_runs(runs, synthetic.ROSUB, synthetic.LOGGED)
    stored = Parameters(path=runs[0].trial.path, entries={"inertia": ERROR})
    document = simulation_document(stored, simulations, ["a note"], GUESS)
    assert document["schema"] == "rovid-simulation/1"
    found = {"value": 5057.0, "standard_error": 9.8, "unit": "kg m^2", "placeholder": True}
    assert document["parameters"]["inertia"] == found
    assert [trial["samples"] for trial in document["trials"]] == [item.fit.samples for item in simulations]
    assert document["overall"]["yaw_rate_r2"] > 0.999
    assert document["guessed"] == ["yaw_arm of fore"]
    assert document["warnings"] == [GUESS.caution, "a note"]


def test_a_plan_lists_its_commands_beside_the_times_at_which_they_change_and_ends_at_rest() -> None:
    commands = np.array([[0.0, 1.0], [0.0, 1.0], [2.0, 1.0], [2.0, -1.0], [2.0, -1.0]])
    run = CandidateRun(name="step", time=np.arange(5.0), commands=commands)
    worth = ExpectedInformation(run=run, gain=3.0, rates=np.zeros((1, 5)))
    found = ExperimentPlan(
        models=(),
        parameter="inertia",
        runs=(worth,),
        thrusters=("fore", "aft"),
        disturbance_rate=0.0,
        reason="it is asked for",
    )
    document = plan_document(
        found, Vehicle(name="v", thrusters=(), axis=AXES["heave"]), "plan.csv", "plan.png", ["a note"]
    )
    assert document["axis"] == "heave"
    assert document["commands"] == {
        "time_s": [0.0, 2.0, 3.0, 4.0],
        "fore": [0.0, 2.0, 2.0, 0.0],
        "aft": [1.0, 1.0, -1.0, 1.0],
    }
    assert document["runs"] == [{"run": "step", "seconds": 4.0, "gain": 3.0, "gain_per_minute": 45.0}]
    assert (document["between"], document["narrow"], document["reason"]) == (None, "inertia", "it is asked for")


AT_REST = Stability(
    stable=True, step=0.001, largest_stable_step=None, rest_time=9.0, envelope=(0.0, 0.0, 0.3), text="Stable."
)


def test_what_a_format_does_not_hold_has_its_size() -> None:
    far, near = (
        Mismatch(percent_of_range={"yaw_rate": 5.0}, rms={"yaw_rate": 0.01}),
        Mismatch(percent_of_range={"yaw_rate": 0.01}, rms={"yaw_rate": 1e-5}),
    )
    loss = ExportLoss(what="wave_torque", why="random", percent_of_range={"yaw_rate": math.nan})
    made = VerifiedExport(
        content="",
        mismatch=far,
        kept_mismatch=near,
        losses=(loss,),
        stability=AT_REST,
        warnings=(),
        velocities={"yaw_rate": "rad/s"},
    )
    document = export_document("gz-sim", "a.sdf", made, Assumptions())
    assert document["mismatch"] == {"yaw_rate_percent_of_range": 5.0, "rms": 0.01, "unit": "rad/s"}
    assert document["mismatch_of_what_is_held"]["rms"] == 1e-5
    assert [lost["what"] for lost in document["not_held"]] == ["wave_torque"]
    assert document["stability"]["stable"]
    assert document["stability"]["from"] == {"yaw_rate": 0.3}


def test_a_check_keeps_facts_problems_and_advice_apart() -> None:
    trial = replace(synthetic.trial(synthetic.clock(1.0), np.zeros(21)), name="a.csv")
    remark = Remark(kind="gap", count=2, text="A gap.")
    checked = LogCheck(
        trials=(trial,),
        facts=({"samples": 21},),
        problems={"b.csv": "bad"},
        remarks=(remark,),
        advice=(Advice(kind="coast", text="Coast."),),
        feedback=(Feedback(name="a.csv", seen_in="flow", chance=1e-9, share=0.3),),
    )
    document = check_document(checked, synthetic.VEHICLE)
    assert document["logs"] == [{"name": "a.csv", "samples": 21}]
    assert document["unreadable"] == [{"name": "b.csv", "problem": "bad"}]
    assert document["remarks"] == [{"kind": "gap", "count": 2, "text": "A gap."}]
    assert document["advice"] == [{"kind": "coast", "text": "Coast.", "weight": "care"}]
    assert document["verdict"] == "no_go"
    assert document["feedback"][0]["seen_in"] == "flow"
