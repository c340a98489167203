"""Water that co-rotates after long turning and eases the drag."""

from __future__ import annotations

from typing import Any

from rovid.effects.base import Effect, EffectParameter, compiled


@compiled
def _term(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any) -> Any:
    dx[0] = (rate - x[0]) / p[1]
    slip = rate - p[0] * x[0]
    return (base[1] * abs(rate) + base[2]) * rate - (base[1] * abs(slip) + base[2]) * slip


EFFECT: Effect = Effect(
    id="entrained_swirl",
    title="entrained swirl",
    parameters=(
        EffectParameter(name="coupling", unit="1", null=0.0, low=0.0, high=0.9, starts=(0.1,)),
        EffectParameter(name="time_constant", unit="s", null=1.0, low=1.0, high=600.0, starts=(20.0, 90.0)),
    ),
    equation="drag of r − s·w, τ·dw/dt = r − w",
    fingerprint="a rate that creeps up during long holds; drift on after a stop; a first reversal that meets more drag",
    experiment="several turns one way, rest, and the same turns back",
    rivals=("tether_torsion", "oscillatory_drag", "added_mass_memory"),
    term=_term,
)
