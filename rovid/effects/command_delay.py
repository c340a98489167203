"""Commands that act some time after they were logged."""

from __future__ import annotations

from rovid.effects.base import Actuation, Effect, EffectParameter, Values
from rovid.effects.series import delayed
from rovid.trial import FloatArray


def _on_torque(where: Actuation, torque: FloatArray, values: Values) -> FloatArray:
    return delayed(where.time, torque, values["delay"])


EFFECT: Effect = Effect(
    id="command_delay",
    title="command delay",
    parameters=(EffectParameter(name="delay", unit="s", null=0.0, low=0.0, high=10.0, starts=(0.08, 0.4)),),
    equation="T'(t) = T(t − L)",
    fingerprint="residual torque at the edges of steps, gone after the delay; none in steady turns",
    experiment="a fast pseudo-random command, 1 to 3 s a level",
    rivals=("thruster_lag", "command_hysteresis", "slew_limit"),
    on_torque=_on_torque,
)
