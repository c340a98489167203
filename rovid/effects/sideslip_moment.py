"""The moment of a hull that drifts sideways: its own, and Munk's of one that also goes ahead."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rovid.effects.base import SPEEDS, SURGE, SWAY, Effect, EffectParameter, compiled


@compiled
def _drift(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    return -p[j, 0] * base[SWAY]


@compiled
def _munk(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    return -p[j, 0] * base[SURGE] * base[SWAY]


@compiled
def _both(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    return -(p[j, 0] + p[j, 1] * base[SURGE]) * base[SWAY]


_DRIFT = EffectParameter(
    name="coefficient", unit="N s", null=0.0, low=-3.0, high=3.0, starts=(0.05, -0.05), scale="torque/sway"
)
_MUNK = replace(_DRIFT, name="munk", unit="kg", scale="torque/surge/sway")

EFFECT: Effect = Effect(
    id="sideslip_moment",
    axes=("yaw",),
    title="moment of sideslip",
    parameters=(_DRIFT,),
    equation="− N·v, v the logged speed to starboard",
    fingerprint="residual torque in proportion to the sideways speed, whatever the rate",
    experiment="drifts sideways without turning, both ways, at rest and with speed ahead",
    rivals=("heading_dependent_torque", "drag_asymmetry", "advance_speed_loss"),
    needs=SPEEDS[1:],
    term=_drift,
)
# Munk's: (added mass across less added mass along)·u·v, which turns a hull broadside on.
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="munk",
        parameters=(_MUNK,),
        equation="− m·u·v, u the logged speed ahead; m the added mass across less that along",
        fingerprint="residual torque in proportion to the product of the speeds ahead and sideways",
        needs=SPEEDS,
        term=_munk,
    ),
    replace(EFFECT, form="both", parameters=(_DRIFT, _MUNK), equation="− N·v − m·u·v", needs=SPEEDS, term=_both),
)
