"""Thrusters that do not push near neutral, beyond what the bench curve says."""

from __future__ import annotations

import numpy as np

from rovid.effects.base import Actuation, Effect, EffectParameter, Values
from rovid.trial import FloatArray


def _on_command(where: Actuation, command: FloatArray, values: Values) -> FloatArray:
    beyond = command - where.neutral
    return np.asarray(where.neutral + np.sign(beyond) * np.maximum(np.abs(beyond) - values["deadband"], 0.0))


EFFECT: Effect = Effect(
    id="thruster_deadband",
    title="thruster dead band",
    parameters=(
        EffectParameter(
            name="deadband", unit="command", null=0.0, low=0.0, high=60.0, starts=(3.0, 15.0), scale="command"
        ),
    ),
    equation="u' = u − sign(u)·b where |u| > b, else 0",
    fingerprint="residual torque odd in the command, largest in share at small ones; flat where a sine crosses zero",
    experiment="a low-speed staircase through neutral, both ways",
    rivals=("coulomb_resistance", "thrust_curve_shape", "supply_sag"),
    on_command=_on_command,
)
