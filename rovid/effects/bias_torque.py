"""A constant torque in the body's frame."""

from __future__ import annotations

from typing import Any

from rovid.effects.base import Effect, EffectParameter, compiled


@compiled
def _term(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    return p[j, 0]


EFFECT: Effect = Effect(
    id="bias_torque",
    axes=("yaw", "surge", "sway"),
    title="constant torque",
    parameters=(
        EffectParameter(name="torque", unit="N m", null=0.0, low=-1.0, high=1.0, starts=(0.02, -0.02), scale="torque"),
    ),
    equation="+ b",
    fingerprint="slow rotation without command; one direction faster than the other by a constant torque",
    experiment="a coast-down to rest from each direction",
    rivals=("thrust_asymmetry", "drag_asymmetry", "heading_dependent_torque"),
    term=_term,
)
FORMS: tuple[Effect, ...] = (EFFECT,)
