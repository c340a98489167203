"""Thrust that falls as the thruster moves through the water."""

from __future__ import annotations

import math
from typing import Any

from rovid.effects.base import Effect, EffectParameter, compiled


@compiled
def _term(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any) -> Any:
    # Loss goes as rotor speed times speed of advance; the rotor's speed as the root of thrust.
    return -p[0] * math.sqrt(abs(push)) * rate


EFFECT: Effect = Effect(
    id="advance_speed_loss",
    title="loss of thrust with speed of advance",
    parameters=(
        EffectParameter(
            name="coefficient", unit="(N m)^0.5 s/rad", null=0.0, low=0.0, high=2.0, starts=(0.05,), scale="advance"
        ),
    ),
    equation="− a·√|T|·r",
    fingerprint="more damping with thrust on than coasting",
    experiment="coast-downs beside holds at the same rates",
    rivals=("drag_curvature", "supply_sag"),
    term=_term,
)
