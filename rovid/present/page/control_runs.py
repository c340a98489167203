"""Closed-loop runs to be drawn: the steps of the founding paper, without noise and disturbance."""

from __future__ import annotations

from rovid.control.closed_loop import ClosedLoopRun
from rovid.control.design import ControllerDesign
from rovid.control.specs import paper_runs

# Whether effects act, whether the model aids, whether the aid knows of the effects.
_WITH_EFFECTS = {
    "aid of drag and effects": (True, True, True),
    "aid of drag alone": (True, True, False),
    "the same without effects": (False, True, False),
}
_WITHOUT = {"aided by the model": (False, True, False), "PD alone": (False, False, False)}


def paper_step_runs(control: ControllerDesign) -> dict[str, dict[str, ClosedLoopRun]]:
    """Name of each step -> what controller and plant are -> the run."""
    ways = _WITH_EFFECTS if control.model.effects else _WITHOUT
    quiet = {}
    for run in control.runs:
        quiet[run.name, bool(run.effects), run.model_aid, run.effects_known] = run.noise_free_run
    courses = {}
    for step in paper_runs():
        courses[step.name] = {way: quiet[step.name, *which] for way, which in ways.items()}
    return courses
