"""Reverse thrust that differs from the bench curve, while forward thrust does not."""

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnThrust, Values


def _constant(_: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    return np.asarray(np.where(thrust < 0.0, values["reverse_gain"] * thrust, thrust))


def _growing(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    gain = np.maximum(1.0 - (1.0 - values["reverse_gain"]) * np.abs(thrust) / inputs.reference_thrust, 0.0)
    return np.asarray(np.where(thrust < 0.0, gain * thrust, thrust))


EFFECT: Effect = Effect(
    id="thrust_asymmetry",
    title="asymmetric thrust",
    parameters=(
        EffectParameter(name="reverse_gain", unit="1", neutral=1.0, low=-0.2, high=3.0, initial_values=(0.9, 1.1)),
    ),
    equation="T' = g·T where T < 0",
    fingerprint="residual torque in proportion to thrust, in reverse only; a symmetric sine has a mean rate",
    experiment="holds both ways at several levels, and a coast-down from each",
    rivals=("bias_torque", "drag_asymmetry"),
    acts=OnThrust(_constant),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="growing",
        equation="F' = F·(1 − (1 − g)·|F|/F0) where F < 0, F0 a tenth of full thrust",
        acts=OnThrust(_growing),
    ),
)
