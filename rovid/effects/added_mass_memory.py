"""Water that is set in motion with a delay: added inertia with memory.

Cummins' convolution with one state, torque -m, dm/dt = k*r - m/tau, is no form of its own: it is the plain one with
Im = -k*tau^2 and k*tau more linear drag.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rovid.effects.base import REFERENCE_RATE, Effect, EffectParameter, Values, compiled

# s; water in a frame follows no faster, however large the slip, which keeps the steps of the integration stable.
_FASTEST = 0.1


@compiled
def _linear(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    dx[j, 0] = (rate - x[j, 0]) / p[j, 1]
    return -p[j, 0] * dx[j, 0]


@compiled
def _porous(rate: float, angle: float, push: float, base: Any, p: Any, x: Any, dx: Any, j: int) -> Any:
    slip = rate - x[j, 0]
    dx[j, 0] = abs(slip) * slip / (REFERENCE_RATE * p[j, 1] + _FASTEST * abs(slip))
    return -p[j, 0] * dx[j, 0]


def _fastest(values: Values) -> float:
    return 1.0 / max(values["time_constant"], _FASTEST)


def _added(values: Values) -> float:
    return values["inertia"]


EFFECT: Effect = Effect(
    id="added_mass_memory",
    title="added mass with memory",
    parameters=(
        EffectParameter(
            name="inertia", unit="kg m^2", null=0.0, low=-3.0, high=20.0, starts=(1.0,), scale="torque/rate"
        ),
        EffectParameter(name="time_constant", unit="s", null=1.0, low=0.2, high=120.0, starts=(2.0, 10.0)),
    ),
    equation="− Im·dw/dt, τ·dw/dt = r − w",
    fingerprint="inertia that falls with frequency; an exponential tail after steps",
    experiment="sines over a decade of periods",
    rivals=("thruster_lag", "oscillatory_drag", "entrained_swirl"),
    term=_linear,
    fastest=_fastest,
    added_inertia=_added,
    remembers=True,
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="porous",
        parameters=(
            EffectParameter(
                name="inertia", unit="kg m^2", null=0.0, low=0.0, high=20.0, starts=(1.0,), scale="torque/rate"
            ),
            # At a slip of 0.3 rad/s; three times as long at 0.1.
            EffectParameter(name="time_constant", unit="s", null=1.0, low=0.02, high=120.0, starts=(0.7, 4.0)),
        ),
        equation="− Im·dw/dt, τ·r0·dw/dt = |r − w|·(r − w), r0 = 0.3 rad/s: water in a frame with holes",
        term=_porous,
    ),
)
