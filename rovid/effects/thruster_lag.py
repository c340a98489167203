"""Thrust that follows the command with a first-order lag."""

from __future__ import annotations

from rovid.effects.base import Actuation, Effect, EffectParameter, Values
from rovid.effects.series import lagged
from rovid.trial import FloatArray


def _on_torque(where: Actuation, torque: FloatArray, values: Values) -> FloatArray:
    return lagged(where.time, torque, values["time_constant"])


EFFECT: Effect = Effect(
    id="thruster_lag",
    title="thruster lag",
    parameters=(EffectParameter(name="time_constant", unit="s", null=0.0, low=0.0, high=30.0, starts=(0.1, 0.8)),),
    equation="τ·dT'/dt + T' = T",
    fingerprint="residual torque at the edges of steps and ahead of the peaks of a sine, none in steady turns",
    experiment="a fast pseudo-random command, 1 to 3 s a level",
    rivals=("command_delay", "added_mass_memory", "slew_limit"),
    on_torque=_on_torque,
)
