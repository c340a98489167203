"""Water that is set in motion with a delay: added inertia with memory."""

from __future__ import annotations

from typing import Any

from rovid.effects.base import Effect, EffectParameter, compiled


@compiled
def _term(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any) -> Any:
    dx[0] = (rate - x[0]) / p[1]
    return -p[0] * dx[0]


EFFECT: Effect = Effect(
    id="added_mass_memory",
    title="added mass with memory",
    parameters=(
        EffectParameter(name="inertia", unit="kg m^2", null=0.0, low=-0.5, high=20.0, starts=(1.0,), scale="inertia"),
        EffectParameter(name="time_constant", unit="s", null=1.0, low=0.2, high=120.0, starts=(2.0, 10.0)),
    ),
    equation="− Im·dw/dt, τ·dw/dt = r − w",
    fingerprint="inertia that falls with frequency; an exponential tail after steps",
    experiment="sines over a decade of periods",
    rivals=("thruster_lag", "oscillatory_drag", "entrained_swirl"),
    term=_term,
)
