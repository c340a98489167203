"""A constant torque in the body's frame."""

from __future__ import annotations

from rovid.effects.base import Effect, EffectParameter, Instant, Numbers, Term, compiled


@compiled
def _term(at: Instant, p: Numbers) -> float:
    return p[0]


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
    acts=Term(_term),
)
FORMS: tuple[Effect, ...] = (EFFECT,)
