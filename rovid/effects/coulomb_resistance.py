"""A resistance that hardly depends on the rate: rubbing tether, seals."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from rovid.effects.base import Effect, EffectParameter, compiled


@compiled
def _rate(torque: float, quadratic: float, linear: float) -> float:
    """Rate in rad/s at which the drag is as large as ``torque``; the sign is smoothed over a share of it."""
    size = abs(torque)
    return 2.0 * size / (linear + math.sqrt(linear * linear + 4.0 * abs(quadratic) * size) + 1e-12) + 1e-9


@compiled
def _term(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any) -> Any:
    return -p[0] * math.tanh(rate / (0.05 * _rate(p[0], base[1], base[2])))


@compiled
def _wide(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any) -> Any:
    return -p[0] * math.tanh(rate / (0.2 * _rate(p[0], base[1], base[2])))


@compiled
def _stiction(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any) -> Any:
    share = rate / _rate(p[0], base[1], base[2])
    # Half as much again near rest (Stribeck).
    return -p[0] * math.tanh(20.0 * share) * (1.0 + 0.5 * math.exp(-25.0 * share * share))


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
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(EFFECT, form="wide", equation="− c·tanh(5 r/rc), rc where the drag is c", term=_wide),
    replace(
        EFFECT, form="stiction", equation="− c·sign(r)·(1 + ½·exp(−25 r²/rc²)), rc where the drag is c", term=_stiction
    ),
)
