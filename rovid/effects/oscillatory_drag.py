"""Drag that is larger after a reversal and falls with the angle swept since."""

import math
from dataclasses import replace

from rovid.effects.base import Effect, EffectParameter, Instant, Numbers, Term, Values, compiled, where_nonnegative


# State: the angle swept since the last reversal, with the sign of the rate.
@compiled
def _reversed(rate: float, x: Numbers) -> float:
    return where_nonnegative(rate * x[0], x[0], 0.0)


@compiled
def _exponential(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    swept = abs(_reversed(at.rate, x))
    return -p[0] * math.exp(-swept / p[1]) * at.body.quadratic_drag * abs(at.relative_rate) * at.relative_rate, at.rate


@compiled
def _algebraic(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    swept = abs(_reversed(at.rate, x))
    return -p[0] / (1.0 + swept / p[1]) * at.body.quadratic_drag * abs(at.relative_rate) * at.relative_rate, at.rate


@compiled
def _fading(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    # State: the direction of turning behind a first-order lag in the swept angle; opposite just after a reversal.
    way = where_nonnegative(-at.rate, -1.0, 1.0)
    relative_rate = at.relative_rate
    torque = -p[0] * 0.5 * (1.0 - way * x[0]) * at.body.quadratic_drag * abs(relative_rate) * relative_rate
    return torque, abs(at.rate) * (way - x[0]) / p[1]


def _swept_before(values: Values, rate: float, acceleration: float) -> tuple[float, ...]:
    """Twice the angle over which the drag falls: little is left of it then."""
    return (2.0 * values["swept_angle"],)


def _settled(values: Values, rate: float, acceleration: float) -> tuple[float, ...]:
    """The water may have followed the turn completely."""
    return (1.0,)


EFFECT: Effect = Effect(
    id="oscillatory_drag",
    title="oscillatory drag",
    parameters=(
        EffectParameter(name="gain", unit="1", high=10.0, initial_values=(0.3,)),
        EffectParameter(
            name="swept_angle", unit="rad", neutral=1.0, low=0.02, high=15.0, initial_values=(0.6, 2.5), scale="angle"
        ),
    ),
    equation="quadratic drag times 1 + g·exp(−θ/θ0), θ swept since the last reversal",
    fingerprint="drag in sines differs from drag in steady motion; residual torque after each reversal",
    experiment="sines of one peak rate at several periods",
    rivals=("added_mass_memory", "entrained_swirl"),
    acts=Term(_exponential, states=1, reset=_reversed, unknown_start=_swept_before),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="algebraic",
        equation="quadratic drag times 1 + g/(1 + θ/θ0), θ swept since the last reversal",
        acts=Term(_algebraic, states=1, reset=_reversed, unknown_start=_swept_before),
    ),
    replace(
        EFFECT,
        form="fading",
        equation="quadratic drag times 1 + g·f, f grows at a reversal by the angle swept, then decays as exp(−θ/θ0)",
        acts=Term(_fading, states=1, unknown_start=_settled),
    ),
)
