"""A torque that goes with the heading: current, side pull of the tether."""

from __future__ import annotations

import math
from typing import Any

from rovid.effects.base import Effect, EffectParameter, compiled


@compiled
def _term(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any) -> Any:
    # base[3] is the heading at the start of the trial.
    return p[0] * math.sin(angle + base[3] + p[1])


EFFECT: Effect = Effect(
    id="heading_dependent_torque",
    title="torque that depends on heading",
    parameters=(
        EffectParameter(name="amplitude", unit="N m", null=0.0, low=0.0, high=1.0, starts=(0.03,), scale="torque"),
        EffectParameter(name="phase", unit="rad", null=0.0, low=-6.3, high=6.3, starts=(0.0, 2.1, -2.1)),
    ),
    equation="+ a·sin(ψ + φ)",
    fingerprint="a residual torque that repeats with every turn",
    experiment="slow full turns, both ways, from different headings",
    rivals=("bias_torque", "tether_torsion"),
    term=_term,
)
