"""Which run would tell what these data cannot."""

from __future__ import annotations

from typing import Any

from rovid.design.experiment_design import commands_by_name
from rovid.diagnose.result import Diagnosis, Finding
from rovid.diagnose.signal_regressors import signal_name
from rovid.effects import Effect, effect_named

# Runs that separate two causes best (EFFECTS.md 3.1); where none stands here, the run that reveals either.
DISCRIMINATING_RUNS = {
    frozenset({"thruster_lag", "command_delay"}): "a fast pseudo-random command, 1 to 3 s a level",
    frozenset({"entrained_swirl", "tether_torsion"}): "six turns one way, rest, and six turns back",
    frozenset({"coulomb_resistance", "drag_curvature"}): "coast-downs to rest and the slowest possible holds",
    frozenset({"bias_torque", "thrust_asymmetry"}): "a coast-down left alone at rest, and holds of both signs",
    frozenset({"bias_torque", "drag_asymmetry"}): "a coast-down left alone at rest",
    frozenset({"thrust_asymmetry", "drag_asymmetry"}): "sines from 10 to 80 s and coast-downs both ways",
    frozenset({"oscillatory_drag", "added_mass_memory"}): "coast-downs from a long turn; sines from 10 to 160 s",
    frozenset({"added_mass_memory", "thruster_lag"}): "a fast pseudo-random command; sines from 5 to 160 s",
    frozenset({"thruster_deadband", "supply_sag"}): "a low-speed staircase through neutral, both ways",
    frozenset({"oscillatory_drag", "entrained_swirl"}): "coast-downs from turns of different length",
    frozenset({"command_hysteresis", "command_delay"}): "a slow staircase up and down through neutral",
    frozenset({"speed_dependent_damping", "advance_speed_loss"}): "coast-downs of the rate at several speeds ahead",
    frozenset({"sideslip_moment", "bias_torque"}): "the same drift sideways both ways",
    frozenset({"restoring_curve", "drag_curvature"}): "releases from a large and from a small tilt",
    frozenset({"drag_curvature", "supply_sag"}): "coast-downs beside holds, with the supply's voltage in the log",
}


def discriminating_experiment(finding: Finding) -> dict[str, Any] | None:
    """The run that would tell ``finding`` from what it cannot be told from; None where it is decided.

    With its commands, each held until the next, where one is expected to decide.
    """
    if not finding.indistinguishable:
        return None
    other = finding.indistinguishable[0]
    untried = all(rival.effect is not other for rival in finding.alternatives)
    told = _separating(finding.effect, other, untried=untried)
    plan = finding.plan
    if plan is None or not plan.is_decisive:
        return told
    return told | {
        "run": plan.best.run.name,
        "minutes": plan.best.run.seconds / 60.0,
        "expected_log_likelihood_ratio": plan.best.gain,
        "commands": commands_by_name(plan),
    }


def _separating(one: Effect, other: Effect, *, untried: bool = False) -> dict[str, Any]:
    """The run that tells two causes apart; that which shows the ``other`` where it was not tried as a rival."""
    pair = [one.id, other.id]
    run = other.experiment if untried else DISCRIMINATING_RUNS.get(frozenset(pair), one.experiment)
    return {"run": run, "separates": pair}


def next_experiment(diagnosis: Diagnosis) -> dict[str, Any]:
    """What to run next: what decides between rivals, then what shows the least certain, then what was not excited."""
    for finding in (*diagnosis.findings, *diagnosis.suspects):
        decides = discriminating_experiment(finding)
        if decides is not None:
            return decides | {"reason": "more than one cause explains these data equally well"}
    if diagnosis.from_tables is not None and len(diagnosis.from_tables.causes) > 1:
        first, second, *_ = (cause.model.effects[0] for cause in diagnosis.from_tables.causes)
        return _separating(first, second) | {"reason": "the tables allow either"}
    if diagnosis.missing:
        return {
            "run": "holds of several levels both ways, sines of 20 to 80 s, and coast-downs to rest",
            "reason": "they excite all that a diagnosis looks at",
        }
    if diagnosis.verdict == "unexplained":
        return {"run": _repeated(diagnosis), "reason": "something acts that no effect of the catalogue explains"}
    for finding in (*diagnosis.suspects, *diagnosis.findings):
        return {"run": finding.effect.experiment, "reason": f"it shows {finding.effect.title} by itself"}
    return {
        "run": effect_named("thruster_lag").experiment,
        "reason": "nothing is missing; fast commands narrow the inertia and show timing errors first",
    }


def _repeated(diagnosis: Diagnosis) -> str:
    """The run that shows whether what is left changes with time, or with the signal that it follows most."""
    if not diagnosis.signals:
        return "a hold repeated first, in the middle and last"
    strongest, _ = diagnosis.signals[0]
    return f"the same hold with {signal_name(strongest)} at two values"
