"""Added inertia with memory: water that is set in motion with a delay.

Cummins' convolution with one state, torque -m, dm/dt = k*r - m/tau, is the plain form with Im = -k*tau^2 and k*tau more
linear drag.
"""

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
    maximum,
)

# Smallest time constant of water in a frame over that of the vehicle at the same relative rate, which keeps the
# integration stable.
_SHORTEST = 0.02
# s; smallest time constant that the integration resolves, which bounds the steps. It is far below that of any vehicle.
_RESOLVED = 1e-3


@compiled
def _linear(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    change = (at.rate - x[0]) / maximum(p[1], _RESOLVED)
    return -p[0] * change, change


@compiled
def _porous(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    relative = at.rate - x[0]
    slope = 2.0 * at.body.quadratic_drag * abs(relative) + at.body.linear_drag
    shortest = _SHORTEST * at.body.inertia / (slope + 1e-150)
    change = abs(relative) * relative / (REFERENCE_RATE * p[1] + shortest * abs(relative))
    return -p[0] * change, change


def _fastest(values: Values) -> float:
    return 1.0 / max(values["time_constant"], _RESOLVED)


def _fastest_in_frame(values: Values) -> float:
    """Rate at twice the reference rate."""
    return 2.0 / max(values["time_constant"], _RESOLVED)


def _added(values: Values) -> float:
    return values["inertia"]


def _unknown_start(values: Values, rate: float, acceleration: float) -> tuple[float, ...]:
    """The water moves as fast as the vehicle."""
    return (rate,)


_INERTIA = EffectParameter(name="inertia", unit="kg m^2", low=-0.5, high=4.0, initial_values=(0.2,), scale="inertia")
_TIME_CONSTANT = EffectParameter(
    name="time_constant", unit="s", neutral=1.0, low=0.02, high=60.0, initial_values=(0.5, 3.0), scale="time"
)
EFFECT: Effect = Effect(
    id="added_mass_memory",
    title="added mass with memory",
    parameters=(_INERTIA, _TIME_CONSTANT),
    equation="− Im·dw/dt, τ·dw/dt = r − w",
    fingerprint="inertia that falls with frequency; an exponential tail after steps",
    experiment="sines over a decade of periods",
    rivals=("thruster_lag", "oscillatory_drag", "entrained_swirl"),
    acts=Term(_linear, states=1, fastest=_fastest, added_inertia=_added, unknown_start=_unknown_start),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="porous",
        parameters=(
            replace(_INERTIA, low=0.0),
            # At a relative rate of 0.3 rad/s; three times as long at 0.1.
            replace(_TIME_CONSTANT, initial_values=(0.4, 2.5), scale="time_at_reference"),
        ),
        equation="− Im·dw/dt, τ·r0·dw/dt = |r − w|·(r − w), r0 = 0.3 rad/s: water in a frame with holes",
        acts=Term(_porous, states=1, fastest=_fastest_in_frame, added_inertia=_added, unknown_start=_unknown_start),
    ),
)
