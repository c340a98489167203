"""A restoring torque that is not proportional to the sine of the tilt, as of a hull with inclined sides."""

from __future__ import annotations

import math

from rovid.effects.base import Effect, EffectParameter, Instant, Numbers, Term, compiled


@compiled
def _term(at: Instant, p: Numbers) -> float:
    tilt = at.angle + at.start - at.body.trim
    return -at.body.stiffness * p[0] * tilt * tilt * math.sin(tilt)


EFFECT: Effect = Effect(
    id="restoring_curve",
    axes=("roll", "pitch"),
    title="bent restoring torque",
    parameters=(
        EffectParameter(name="cubic", unit="1/rad^2", neutral=0.0, low=-5.0, high=20.0, initial_values=(1.0, -1.0)),
    ),
    equation="K·(sin x + c·x²·sin x) in place of K·sin x, x = θ − θ0",
    fingerprint="residual torque in proportion to the cube of the tilt; a period that changes while a swing decays",
    experiment="releases from a large and from a small tilt",
    rivals=("drag_curvature", "oscillatory_drag"),
    acts=Term(_term),
)
FORMS: tuple[Effect, ...] = (EFFECT,)
