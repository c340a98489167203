"""Water that co-rotates after long turning and eases the drag."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rovid.effects.base import REFERENCE_RATE, WATER, Effect, EffectParameter, Values, compiled


@compiled
def _linear(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    dx[j, 0] = (rate - x[j, 0]) / p[j, 1]
    base[WATER] = p[j, 0] * x[j, 0]
    slip = rate - base[WATER]
    return (base[1] * abs(rate) + base[2]) * rate - (base[1] * abs(slip) + base[2]) * slip


@compiled
def _annulus(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    dx[j, 0], base[WATER] = 0.0, x[j, 0]
    if p[j, 0] <= 0.0:
        return 0.0
    # The walls' friction that balances the drag when the hull turns at the reference rate and the water at its share.
    water, slip = p[j, 0] * REFERENCE_RATE, (1.0 - p[j, 0]) * REFERENCE_RATE
    friction = (base[1] * slip + base[2]) * slip / (water * water)
    inertia = p[j, 1] * (2.0 * base[1] * slip + base[2] + 2.0 * friction * water)
    slip = rate - x[j, 0]
    drag = (base[1] * abs(slip) + base[2]) * slip
    dx[j, 0] = (drag - friction * abs(x[j, 0]) * x[j, 0]) / (inertia + 1e-12)
    return (base[1] * abs(rate) + base[2]) * rate - drag


def _fastest(values: Values) -> float:
    return 1.0 / values["time_constant"]


EFFECT: Effect = Effect(
    id="entrained_swirl",
    axes=("yaw",),
    title="entrained swirl",
    parameters=(
        EffectParameter(name="coupling", unit="1", null=0.0, low=0.0, high=0.9, starts=(0.1,)),
        EffectParameter(name="time_constant", unit="s", null=1.0, low=1.0, high=600.0, starts=(20.0, 90.0)),
    ),
    equation="all drag of r − s·w in place of r, τ·dw/dt = r − w",
    fingerprint="a rate that creeps up during long holds; drift on after a stop; a first reversal that meets more drag",
    experiment="several turns one way, rest, and the same turns back",
    rivals=("tether_torsion", "oscillatory_drag", "added_mass_memory"),
    term=_linear,
    moves_water=True,
    fastest=_fastest,
    remembers=True,
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="annulus",
        equation="all drag of r − w in place of r, If·dw/dt = drag − C·|w|·w; s = w/r and τ as at r = 0.3 rad/s",
        term=_annulus,
    ),
)
