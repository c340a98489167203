"""Drag that rises faster or slower with the rate than the linear and quadratic terms."""

import math
from dataclasses import replace

from rovid.effects.base import (
    REFERENCE_RATE,
    Effect,
    EffectParameter,
    Instant,
    Numbers,
    Term,
    compiled,
    where_nonnegative,
)


@compiled
def _cubic(at: Instant, p: Numbers) -> float:
    return -p[0] * at.relative_rate * at.relative_rate * at.relative_rate


@compiled
def _exponent(at: Instant, p: Numbers) -> float:
    share = abs(at.relative_rate) / REFERENCE_RATE
    change = at.body.quadratic_drag * REFERENCE_RATE * REFERENCE_RATE * (share * share - math.pow(share, p[0]))
    return where_nonnegative(at.relative_rate, change, -change)


@compiled
def _crisis(at: Instant, p: Numbers) -> float:
    # Sixth power: from 10 to 90 % of the loss the rate doubles, as the Reynolds number does for a cylinder.
    share = math.pow(abs(at.relative_rate) / p[1], 6.0)
    return p[0] * share / (1.0 + share) * at.body.quadratic_drag * abs(at.relative_rate) * at.relative_rate


EFFECT: Effect = Effect(
    id="drag_curvature",
    title="curvature of the drag",
    parameters=(
        EffectParameter(
            name="cubic",
            unit="N m s^3/rad^3",
            low=-3.0,
            high=10.0,
            initial_values=(0.2, -0.1),
            scale="torque/rate/rate/rate",
        ),
    ),
    equation="− c·r³",
    fingerprint="residual torque odd in the rate, with a zero inside the range, both under thrust and in coast-downs",
    experiment="holds over a decade of rates, and coast-downs",
    rivals=("coulomb_resistance", "supply_sag", "thrust_curve_shape"),
    acts=Term(_cubic),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="exponent",
        parameters=(
            EffectParameter(name="exponent", unit="1", neutral=2.0, low=1.0, high=3.5, initial_values=(1.8, 2.3)),
        ),
        equation="DQ·r0²·(|r|/r0)^e·sign(r) in place of DQ·|r|·r, r0 = 0.3 rad/s",
        acts=Term(_exponent),
    ),
    replace(
        EFFECT,
        form="crisis",
        parameters=(
            # The likelihood has a local maximum on either side of the critical rate.
            EffectParameter(name="loss", unit="1", high=0.9, initial_values=(0.3, 0.3, 0.3, 0.6, 0.6, 0.6)),
            EffectParameter(
                name="critical_rate",
                unit="rad/s",
                neutral=1.0,
                low=0.3,
                high=2.5,
                initial_values=(0.5, 0.7, 1.0, 0.5, 0.7, 1.0),
                scale="rate",
            ),
        ),
        equation="DQ·(1 − g·s/(1 + s)) in place of DQ, s = (|r|/rc)⁶",
        acts=Term(_crisis),
    ),
)
