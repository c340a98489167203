"""Water of the tank that swings to and fro once a run has set it off."""

from __future__ import annotations

from dataclasses import replace

from rovid.effects.base import Effect, EffectParameter, Instant, Numbers, Term, Values, compiled


@compiled
def _ring(drive: float, p: Numbers, x: Numbers) -> float:
    """Rate of change of q; the mode's equation integrated once, as rdot is not known here: the states are ∫q and q."""
    return drive - 2.0 * p[2] * p[1] * x[1] - p[1] * p[1] * x[0]


@compiled
def _term(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float, float]:
    change = _ring(at.rate, p, x)
    return -p[0] * at.body.inertia * p[1] * change, x[1], change


@compiled
def _following(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float, float]:
    return -p[0] * at.body.inertia * p[1] * p[1] * x[1], x[1], _ring(at.rate, p, x)


@compiled
def _by_thrust(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float, float]:
    return -p[0] * at.body.inertia * p[1] * x[1], x[1], _ring(at.thruster_torque / at.body.inertia, p, x)


def _fastest(values: Values) -> float:
    return values["frequency"]


# A weakly damped ring shows only close to its frequency.
_FREQUENCIES = tuple(0.15 * 1.12**k for k in range(36))

EFFECT: Effect = Effect(
    id="tank_seiche",
    environmental=True,
    axes=("yaw", "surge", "sway"),
    title="tank seiche",
    parameters=(
        # Water that pulls by more than the vehicle's own inertia is no tank's that swings.
        EffectParameter(name="gain", unit="1", neutral=0.0, low=0.0, high=1.0, initial_values=(0.1,)),
        # A tank of length l and depth h has ω² = g·k·tanh(k·h), k = nπ/l: 1.4 rad/s in 15 m by 7 m, 8 in half a metre.
        EffectParameter(name="frequency", unit="rad/s", neutral=1.0, low=0.05, high=8.0, initial_values=_FREQUENCIES),
        EffectParameter(name="damping", unit="1", neutral=0.05, low=0.005, high=0.5, initial_values=(0.08,)),
    ),
    equation="− g·I·ω·dq/dt, d²q/dt² + 2ζω·dq/dt + ω²·q = dr/dt",
    fingerprint="a ring of one frequency that decays after each start and stop, whatever the rate",
    experiment="stops at full speed, left alone until the water is still; the same at depth",
    rivals=("wave_torque", "added_mass_memory"),
    acts=Term(_term, states=2, fastest=_fastest, oscillatory=True),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="following",
        equation="− g·I·ω²·q, q as above: water that follows the vehicle and pulls by its own acceleration",
        acts=Term(_following, states=2, fastest=_fastest, oscillatory=True),
    ),
    replace(
        EFFECT,
        form="thrust",
        equation="− g·I·ω·dq/dt, d²q/dt² + 2ζω·dq/dt + ω²·q = T/I: set off by the jets",
        # Known thrust sets it off.
        acts=Term(_by_thrust, states=2, fastest=_fastest),
    ),
)
