"""Conclusions in words that terminal and page share: the next step, cautions, and verdicts on fit and controller."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rovid.control.design import ClosedLoopResult, ControllerDesign
from rovid.control.specs import paper_runs
from rovid.diagnose.result import Conclusion, Diagnosis
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.preflight.feedback_detection import detect_feedback
from rovid.present.number_format import format_number
from rovid.present.sentences import CUT_SHORT
from rovid.trial.axis import PLANAR, YAW, Axis
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

PLAIN_MODEL = "The plain model has inertia and drag alone."
EXTENDED_MODEL = "The extended model also has the causes that were found."
# s, total length of a single trial below which it is called short; a decision.
_SHORT = 600.0


@dataclass(frozen=True, kw_only=True)
class NextStep:
    """What to do next, its reason, and the command that writes the run; empty texts where there is none."""

    run: str
    reason: str = ""
    command: str = ""

    def __str__(self) -> str:
        sentence = f"{self.run} ({self.reason})" if self.reason else self.run
        return f"{sentence}; `{self.command}` writes its commands" if self.command else sentence


def plan_command(file: Path, axis: Axis) -> str:
    """`rovid plan` with the parameter ``file`` of ``axis``, unless it finds this file by itself."""
    found = {"parameters.toml"} if axis is YAW else {f"parameters_{axis.name}.toml"}
    axes = ["--axes", "planar"] if axis is PLANAR else []
    return shlex.join(["rovid", "plan", *axes, *([] if str(file) in found else ["-p", str(file)])])


def next_step(diagnosis: Conclusion, run: Mapping[str, Any], plan: str = "rovid plan") -> NextStep:
    """The next ``run`` of a diagnosis, or that none is needed; ``plan`` is the command that designs a run."""
    if diagnosis.is_settled:
        return NextStep(
            run="nothing more to run for the causes",
            reason=f"each is confirmed; `{plan}` designs a run for the least certain parameter",
        )
    command = ""
    if "commands" in run:
        command = " ".join([plan, *(f"--between {cause}" for cause in run["separates"])])
    return NextStep(run=run["run"], reason=run["reason"], command=command)


def cautions(diagnosis: Diagnosis, trials: Sequence[Trial], vehicle: Vehicle) -> Iterator[str]:
    """Reasons to distrust a diagnosis that its causes do not show, a sentence each."""
    if diagnosis.is_cut_short and diagnosis.causes:
        yield f"{CUT_SHORT} Other causes may act in place of those that were found."
    if len(trials) == 1 and trials[0].duration < _SHORT:
        minutes = format_number(trials[0].duration / 60.0, 2)
        yield f"The data are one run of {minutes} min. A second run may give other causes and values."
    if trials and trials[0].has_actuators:
        closed = list(dict.fromkeys(one.name for one in detect_feedback(trials, vehicle) if one.seen_in != "reversals"))
        if closed:
            logs = closed[0] if len(closed) == 1 else f"{len(closed)} of {len(trials)} trials"
            yield (
                f"The commands follow the motion in {logs}, by an autopilot or a pilot. Drag from steady states and "
                "inertia from sines are biased by this feedback."
            )
    if diagnosis.base is None or diagnosis.extended is None or not diagnosis.extended.model.effects:
        return
    one, other = diagnosis.base.held_out, diagnosis.extended.held_out
    pairs = {f"{vehicle.axis.rate_words} error": (one.rate_rmse, other.rate_rmse)}
    for horizon, before in one.position_errors.items():
        name = f"{vehicle.axis.position_words} error after {horizon:.0f} s"
        pairs[name] = (before or math.nan, other.position_errors.get(horizon) or math.nan)
    grown = [name for name, (before, after) in pairs.items() if after > before]
    if grown:
        yield f"With the causes the {' and the '.join(grown)} of trials that were not fitted is larger than without."


def fit_verdict(fit: LikelihoodFit) -> tuple[str, str]:
    """Verdict on a fit in one sentence, and its kind: pass or warn."""
    if fit.white and not fit.at_limit:
        return "The model explains these logs: its one-step prediction errors are white.", "pass"
    return "The model misses something: run `rovid diagnose`.", "warn"


def control_verdict(design: ControllerDesign) -> Iterator[tuple[str, str]]:
    """Sentences on stability and on the benefit of the model aid, each with its kind: pass, warn or fail."""
    margins = design.margins
    if not margins.stable:
        yield "The loop is unstable about rest with these gains.", "fail"
        return
    margin = f"{margins.gain_db:.1f} dB" if math.isfinite(margins.gain_db) else "without limit"
    yield f"Stable: phase margin {margins.phase_deg:.0f} deg, gain margin {margin}.", "pass"
    effects = bool(design.model.effects)
    aided, plain = (_steps(design, effects=effects, aided=each) for each in (True, False))
    if not aided or not plain:
        return
    settling, overshoot = (
        (_largest(run.metrics.settling_time for run in aided), _largest(run.metrics.settling_time for run in plain)),
        (_largest(run.metrics.overshoot_deg for run in aided), _largest(run.metrics.overshoot_deg for run in plain)),
    )
    sizes = (
        f"slowest step settled after {_settled(settling[0])} with the aid and {_settled(settling[1])} without it, "
        f"largest overshoot {overshoot[0]:.1f} and {overshoot[1]:.1f} deg"
    )
    if settling[0] < settling[1]:
        yield f"The model aid is of use: {sizes}.", "pass"
    elif overshoot[0] > overshoot[1]:
        yield f"Use the controller without the model aid. With it the steps are worse: {sizes}.", "warn"
    else:
        yield f"The model aid makes little difference: {sizes}.", "pass"


def _steps(design: ControllerDesign, *, effects: bool, aided: bool) -> list[ClosedLoopResult]:
    """Runs of the paper on the full model, with the best or without any aid."""
    names = {step.name for step in paper_runs()}
    known = effects and aided
    return [
        run
        for run in design.runs
        if run.name in names
        and bool(run.effects) == effects
        and run.model_aid == aided
        and run.effects_known == known
        and run.metrics.overshoot_deg is not None
    ]


def _largest(values: Iterator[float | None]) -> float:
    """The largest value; infinite where one is not known."""
    return max((math.inf if value is None else value for value in values), default=math.inf)


def _settled(seconds: float) -> str:
    return f"{seconds:.1f} s" if math.isfinite(seconds) else "the end of the run"
