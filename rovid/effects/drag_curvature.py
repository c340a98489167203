"""Drag that rises faster, or slower, than linear and quadratic terms allow."""

from __future__ import annotations

from typing import Any

from rovid.effects.base import Effect, EffectParameter, compiled


@compiled
def _term(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any) -> Any:
    return -p[0] * rate * rate * rate


EFFECT: Effect = Effect(
    id="drag_curvature",
    title="curvature of the drag",
    parameters=(
        EffectParameter(
            name="cubic", unit="N m s^3/rad^3", null=0.0, low=-3.0, high=10.0, starts=(0.2, -0.1), scale="cubic"
        ),
    ),
    equation="− c·r³",
    fingerprint="residual torque odd in the rate, with a zero inside the range; the same with thrust and coasting",
    experiment="holds over a decade of rates, and coast-downs",
    rivals=("coulomb_resistance", "supply_sag", "thrust_curve_shape"),
    term=_term,
)
