"""A resistance that hardly depends on the rate: rubbing tether, seals."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from rovid.effects.base import Effect, EffectParameter, compiled


@compiled
def _term(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    return -p[j, 0] * math.tanh(rate / (p[j, 1] + 1e-9))


@compiled
def _stiction(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    share = rate / (p[j, 1] + 1e-9)
    # Half as much again near rest (Stribeck).
    return -p[j, 0] * math.tanh(5.0 * share) * (1.0 + 0.5 * math.exp(-share * share))


EFFECT: Effect = Effect(
    id="coulomb_resistance",
    title="Coulomb-like resistance",
    parameters=(
        EffectParameter(name="torque", unit="N m", null=0.0, low=0.0, high=1.0, starts=(0.03,), scale="torque"),
        # Nothing turns its sign at once: the rate over which this does.
        EffectParameter(name="rate", unit="rad/s", null=0.03, low=0.03, high=0.5, starts=(0.03, 0.12), scale="rate"),
    ),
    equation="− c·tanh(r/r0)",
    fingerprint="a coast-down that stops at a finite time; torque that does not vanish with the rate",
    experiment="coast-downs to rest and the slowest possible holds",
    rivals=("drag_curvature", "thruster_deadband"),
    term=_term,
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(EFFECT, form="stiction", equation="− c·tanh(5 r/r0)·(1 + ½·exp(−r²/r0²))", term=_stiction),
)
