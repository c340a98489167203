"""Commands that act some time after they were logged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.effects.base import Actuation, Effect, EffectParameter, Values
from rovid.effects.series import delayed, polled
from rovid.trial import FloatArray

# Shares of the mean delay, evenly over what a command may wait.
_WAITS = (0.2, 0.6, 1.0, 1.4, 1.8)


def _on_torque(where: Actuation, torque: FloatArray, values: Values) -> FloatArray:
    return delayed(where.time, torque, values["delay"])


def _polled(where: Actuation, torque: FloatArray, values: Values) -> FloatArray:
    return polled(where.time, torque, 2.0 * values["delay"])


def _scattered(where: Actuation, torque: FloatArray, values: Values) -> FloatArray:
    waits = [delayed(where.time, torque, share * values["delay"]) for share in _WAITS]
    return np.asarray(np.mean(waits, axis=0))


EFFECT: Effect = Effect(
    id="command_delay",
    title="command delay",
    parameters=(EffectParameter(name="delay", unit="s", null=0.0, low=0.0, high=10.0, starts=(0.08, 0.4)),),
    equation="T'(t) = T(t − L)",
    fingerprint="residual torque at the edges of steps, gone after the delay; none in steady turns",
    experiment="a fast pseudo-random command, 1 to 3 s a level",
    rivals=("thruster_lag", "command_hysteresis", "slew_limit"),
    on_torque=_on_torque,
    quick=True,
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="polled",
        # Each instant of reading is a threshold: there are many places to begin.
        parameters=(replace(EFFECT.parameters[0], starts=(0.05, 0.1, 0.2, 0.35)),),
        equation="the drive reads its command every 2 L: a delay of L on average",
        on_torque=_polled,
    ),
    replace(
        EFFECT,
        form="scattered",
        # A drive that reads by a clock of its own: nobody knows when, and the mean over all waits is what there is.
        equation="each command waits between nothing and 2 L: a delay of L on average",
        on_torque=_scattered,
    ),
)
