"""Coulomb friction of a rubbing tether or of seals."""

import math
from dataclasses import replace

from rovid.effects.base import (
    REFERENCE_RATE,
    Effect,
    EffectParameter,
    Instant,
    Numbers,
    Term,
    Values,
    compiled,
    where_nonnegative,
)


@compiled
def _term(at: Instant, p: Numbers) -> float:
    return -p[0] * math.tanh(at.rate / (p[1] + 1e-150))


@compiled
def _stribeck(at: Instant, p: Numbers) -> float:
    share = at.rate / (p[3] + 1e-150)
    return -p[0] * math.tanh(at.rate / (p[1] + 1e-150)) * (1.0 + p[2] * math.exp(-share * share))


@compiled
def _stiction(at: Instant, p: Numbers) -> float:
    return _stribeck(at, (p[0], 0.2 * p[1], 0.5, p[1]))


@compiled
def _unequal(at: Instant, p: Numbers) -> float:
    share = math.tanh(at.rate / (p[3] + 1e-150))
    return where_nonnegative(at.rate, -p[0] * share, -p[1] * share - p[2] * at.rate)


# State: the deflection as a share of that at which the friction is complete (Dahl 1968).
@compiled
def _deflected(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    return -p[0] * x[0], (at.rate - abs(at.rate) * x[0]) / (p[1] + 1e-150)


def _fastest(values: Values) -> float:
    """Rate at twice the reference rate."""
    return 2.0 * REFERENCE_RATE / values["angle"]


def _unknown_start(values: Values, rate: float, acceleration: float) -> tuple[float, ...]:
    """The friction may be complete to either side."""
    return (1.0,)


_TORQUE = EffectParameter(name="torque", unit="N m", high=1.0, initial_values=(0.03,), scale="torque")
# Rate over which the friction changes its sign.
_RATE = EffectParameter(
    name="rate", unit="rad/s", neutral=0.03, low=0.03, high=1.0, initial_values=(0.03, 0.12), scale="rate"
)
_WIDE = replace(_RATE, neutral=0.15, low=0.15, initial_values=(0.15, 0.4))

EFFECT: Effect = Effect(
    id="coulomb_resistance",
    title="Coulomb-like resistance",
    parameters=(_TORQUE, _RATE),
    equation="− c·tanh(r/r0)",
    fingerprint="a coast-down that stops at a finite time; torque that does not vanish with the rate",
    experiment="coast-downs to rest and the slowest possible holds",
    rivals=("drag_curvature", "thruster_deadband"),
    acts=Term(_term),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="stiction",
        parameters=(_TORQUE, _WIDE),
        equation="− c·tanh(5 r/r0)·(1 + ½·exp(−r²/r0²))",
        acts=Term(_stiction),
    ),
    # Stribeck effect: static friction is larger.
    replace(
        EFFECT,
        form="stribeck",
        parameters=(
            _TORQUE,
            _RATE,
            EffectParameter(name="excess", unit="1", neutral=0.0, low=0.0, high=3.0, initial_values=(0.5,)),
            replace(_WIDE, name="slow_rate"),
        ),
        equation="− c·tanh(r/r0)·(1 + s·exp(−r²/r1²))",
        acts=Term(_stribeck),
    ),
    replace(
        EFFECT,
        form="unequal",
        parameters=(
            _TORQUE,
            replace(_TORQUE, name="back_torque"),
            EffectParameter(
                name="back_linear",
                unit="N m s/rad",
                low=-0.5,
                high=1.0,
                initial_values=(0.0, 0.05, -0.05),
                scale="torque/rate",
            ),
            _RATE,
        ),
        equation="− c·tanh(r/r0) where r > 0, − c2·tanh(r/r0) − d2·r where r < 0",
        fingerprint="a torque that does not vanish with the rate, different in each direction",
        experiment="coast-downs to rest and the slowest possible holds, both ways",
        rivals=("drag_asymmetry", "bias_torque", "thrust_asymmetry"),
        acts=Term(_unequal),
    ),
    replace(
        EFFECT,
        form="presliding",
        parameters=(
            _TORQUE,
            EffectParameter(name="angle", unit="rad", neutral=1.0, low=0.02, high=6.0, initial_values=(0.15, 0.8)),
        ),
        equation="− c·w, θ0·dw/dt = r − |r|·w: a friction that first stretches the tether by the angle θ0",
        fingerprint="a torque that holds against small turns, and after a reversal grows with the angle turned",
        experiment="small turns to and fro, and slow holds to both sides",
        rivals=("drag_curvature", "sideslip_moment", "entrained_swirl"),
        acts=Term(_deflected, states=1, fastest=_fastest, unknown_start=_unknown_start),
    ),
)
