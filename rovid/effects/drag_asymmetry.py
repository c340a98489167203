"""More drag turning one way than the other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rovid.effects.base import WATER, Effect, EffectParameter, compiled


@compiled
def _whole(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    slip = rate - base[WATER]
    return 0.0 if slip >= 0.0 else -(p[j, 0] - 1.0) * (base[1] * abs(slip) + base[2]) * slip


@compiled
def _quadratic(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    slip = rate - base[WATER]
    return 0.0 if slip >= 0.0 else -(p[j, 0] - 1.0) * base[1] * abs(slip) * slip


EFFECT: Effect = Effect(
    id="drag_asymmetry",
    title="asymmetric drag",
    parameters=(EffectParameter(name="ratio", unit="1", null=1.0, low=0.3, high=3.0, starts=(1.1, 0.9)),),
    equation="drag times a where r < 0",
    fingerprint="residual torque as |r|·r in one direction only, with thrust and coasting alike",
    experiment="coast-downs from both directions",
    rivals=("thrust_asymmetry", "bias_torque"),
    term=_whole,
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(EFFECT, form="quadratic", equation="quadratic drag alone times a where r < 0", term=_quadratic),
)
