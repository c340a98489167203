"""Drag that is larger after a reversal and falls with the angle swept since."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from rovid.effects.base import WATER, Effect, EffectParameter, compiled


@compiled
def _swept(rate: float, x: Any, dx: Any, j: int) -> Any:
    """Angle swept since the last reversal; x[j, 0] holds it with the sign of the turn."""
    if rate * x[j, 0] < 0.0:
        x[j, 0] = 0.0
    dx[j, 0] = rate
    return abs(x[j, 0])


@compiled
def _exponential(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    slip = rate - base[WATER]
    return -p[j, 0] * math.exp(-_swept(rate, x, dx, j) / p[j, 1]) * base[1] * abs(slip) * slip


@compiled
def _algebraic(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    slip = rate - base[WATER]
    return -p[j, 0] / (1.0 + _swept(rate, x, dx, j) / p[j, 1]) * base[1] * abs(slip) * slip


@compiled
def _fading(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    # x[j, 0] follows the direction of turning over the swept angle: opposite to it just after a reversal.
    way = 1.0 if rate > 0.0 else -1.0
    dx[j, 0] = abs(rate) * (way - x[j, 0]) / p[j, 1]
    slip = rate - base[WATER]
    return -p[j, 0] * 0.5 * (1.0 - way * x[j, 0]) * base[1] * abs(slip) * slip


EFFECT: Effect = Effect(
    id="oscillatory_drag",
    title="oscillatory drag",
    parameters=(
        EffectParameter(name="gain", unit="1", null=0.0, low=0.0, high=10.0, starts=(0.3,)),
        EffectParameter(name="swept_angle", unit="rad", null=1.0, low=0.05, high=12.0, starts=(0.6, 2.5)),
    ),
    equation="quadratic drag times 1 + g·exp(−θ/θ0), θ swept since the last reversal",
    fingerprint="drag in sines differs from drag in steady motion; residual after each reversal",
    experiment="sines of one peak rate at several periods",
    rivals=("added_mass_memory", "entrained_swirl"),
    term=_exponential,
    remembers=True,
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="algebraic",
        equation="quadratic drag times 1 + g/(1 + θ/θ0), θ swept since the last reversal",
        term=_algebraic,
    ),
    replace(
        EFFECT,
        form="fading",
        equation="quadratic drag times 1 + g·f, f growing at a reversal by what was swept before, then as exp(−θ/θ0)",
        term=_fading,
    ),
)
