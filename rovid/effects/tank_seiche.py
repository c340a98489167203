"""A standing wave of the tank, which a run excites."""

import math
from dataclasses import replace

from rovid.effects.base import Effect, EffectParameter, Instant, Numbers, Term, Values, compiled


@compiled
def _mode(excitation: float, p: Numbers, x: Numbers) -> float:
    """Derivative dq/dt of the mode q, with the states x = (∫q, q).

    The equation of the mode is integrated once, because a term does not know the acceleration of the vehicle.
    """
    return excitation - 2.0 * p[2] * p[1] * x[1] - p[1] * p[1] * x[0]


@compiled
def _term(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float, float]:
    change = _mode(at.rate, p, x)
    return -p[0] * at.body.inertia * p[1] * change, x[1], change


@compiled
def _following(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float, float]:
    return -p[0] * at.body.inertia * p[1] * p[1] * x[1], x[1], _mode(at.rate, p, x)


@compiled
def _by_thrust(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float, float]:
    return -p[0] * at.body.inertia * p[1] * x[1], x[1], _mode(at.thruster_torque / at.body.inertia, p, x)


def _fastest(values: Values) -> float:
    return values["frequency"]


def _ringing(values: Values, excitation: float) -> tuple[float, float]:
    """Standard deviations of both states after an excitation of this size that varies as fast as the mode.

    A mode with the damping ratio ζ has the variance of the excitation, as a static load, times 1/(4ζ).
    """
    frequency, growth = values["frequency"], 0.5 / math.sqrt(values["damping"])
    return growth * excitation / frequency**2, growth * excitation / frequency


def _after_motion(values: Values, rate: float, acceleration: float) -> tuple[float, float]:
    return _ringing(values, rate)


def _after_thrust(values: Values, rate: float, acceleration: float) -> tuple[float, float]:
    return _ringing(values, acceleration)


# Over the time constant of the vehicle. A weakly damped mode has an effect only near its frequency, so many initial
# values are needed.
_FREQUENCIES = tuple(0.2 * 1.12**k for k in range(36))

EFFECT: Effect = Effect(
    id="tank_seiche",
    environmental=True,
    axes=("yaw", "surge", "sway"),
    title="tank seiche",
    parameters=(
        # A standing wave does not pull by more than the vehicle's own inertia.
        EffectParameter(name="gain", unit="1", high=1.0, initial_values=(0.1,)),
        # ω² = g·k·tanh(k·h) with k = nπ/l for length l and depth h: 1.4 rad/s for 15 m by 7 m, 8 rad/s for half a
        # metre.
        EffectParameter(
            name="frequency",
            unit="rad/s",
            neutral=1.0,
            low=0.03,
            high=30.0,
            initial_values=_FREQUENCIES,
            scale="one/time",
        ),
        # A standing wave rings. At a damping ratio of 0.3 it loses 86 % of its amplitude in a period, as a memory does.
        EffectParameter(name="damping", unit="1", neutral=0.05, low=0.005, high=0.3, initial_values=(0.08,)),
    ),
    equation="− g·I·ω·dq/dt, d²q/dt² + 2ζω·dq/dt + ω²·q = dr/dt",
    fingerprint="an oscillation of one frequency that decays after each start and stop, whatever the rate",
    experiment="stops from full speed, then no command until the water is still; the same at depth",
    rivals=("wave_torque", "added_mass_memory"),
    acts=Term(_term, states=2, fastest=_fastest, oscillatory=True, unknown_start=_after_motion),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="following",
        equation="− g·I·ω²·q, q as above: water that follows the vehicle and acts by its acceleration",
        acts=Term(_following, states=2, fastest=_fastest, oscillatory=True, unknown_start=_after_motion),
    ),
    replace(
        EFFECT,
        form="thrust",
        equation="− g·I·ω·dq/dt, d²q/dt² + 2ζω·dq/dt + ω²·q = T/I: excited by the jets",
        # Not `oscillatory`, because the known thrust alone excites the mode: a filter need not estimate its states.
        acts=Term(_by_thrust, states=2, fastest=_fastest, unknown_start=_after_thrust),
    ),
)
