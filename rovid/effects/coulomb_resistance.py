"""A resistance that hardly depends on the rate: rubbing tether, seals."""

from __future__ import annotations

import math
from typing import Any

from rovid.effects.base import Effect, EffectParameter, compiled


@compiled
def _term(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any) -> Any:
    # Quadratic drag equals this torque at some rate; well below it the sign is smoothed.
    smooth = 0.05 * math.sqrt(abs(p[0]) / (base[1] + 1e-12)) if base[1] > 0.0 else 0.05 * abs(p[0]) / (base[2] + 1e-12)
    return -p[0] * math.tanh(rate / (smooth + 1e-9))


EFFECT: Effect = Effect(
    id="coulomb_resistance",
    title="Coulomb-like resistance",
    parameters=(
        EffectParameter(name="torque", unit="N m", null=0.0, low=0.0, high=1.0, starts=(0.03,), scale="torque"),
    ),
    equation="− c·sign(r)",
    fingerprint="a coast-down that stops at a finite time; torque that does not vanish with the rate",
    experiment="coast-downs to rest and the slowest possible holds",
    rivals=("drag_curvature", "thruster_deadband"),
    term=_term,
)
