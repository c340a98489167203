"""A tether that winds up."""

from __future__ import annotations

from typing import Any

from rovid.effects.base import Effect, EffectParameter, compiled


@compiled
def _term(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any) -> Any:
    return -p[0] * angle


EFFECT: Effect = Effect(
    id="tether_torsion",
    title="tether torsion",
    parameters=(
        EffectParameter(
            name="stiffness", unit="N m/rad", null=0.0, low=0.0, high=1.0, starts=(0.004, 0.04), scale="torque"
        ),
    ),
    equation="− k·(ψ − ψ at the start of the trial)",
    fingerprint="residual torque in proportion to the turns made; recoil after a stop",
    experiment="six turns one way, rest, six turns back",
    rivals=("entrained_swirl", "bias_torque"),
    term=_term,
)
