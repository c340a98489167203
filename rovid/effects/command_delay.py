"""Commands that act some time after they were logged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.effects.base import Actuation, Effect, EffectParameter, Values
from rovid.effects.series import delayed
from rovid.trial import FloatArray

# Evenly over what a command may wait beside the mean, as shares of the most.
_WAITS = (-0.8, -0.4, 0.0, 0.4, 0.8)


def _on_torque(where: Actuation, torque: FloatArray, values: Values) -> FloatArray:
    return delayed(where.time, torque, values["delay"])


def _jitter(values: Values) -> float:
    """How much a command may wait more or less than the mean, s; none acts before it is given."""
    return min(values["jitter"], values["delay"])


def _scattered(where: Actuation, torque: FloatArray, values: Values) -> FloatArray:
    waits = [values["delay"] + share * _jitter(values) for share in _WAITS]
    return np.asarray(np.mean([delayed(where.time, torque, wait) for wait in waits], axis=0))


def _scatter(where: Actuation, torque: FloatArray, values: Values) -> FloatArray:
    """Variance of the impulse: of a change that waits anything from L - J to L + J it is (change J)^2 / 3 in all."""
    time, jitter = where.time, _jitter(values)
    early, late = (
        torque[np.maximum(np.searchsorted(time, time - wait, side="right") - 1, 0)]
        for wait in (values["delay"] - jitter, values["delay"] + jitter)
    )
    return np.asarray((early - late) ** 2 * (jitter / 6.0) * np.diff(time, append=time[-1]))


def _within(own: FloatArray) -> FloatArray:
    return np.array([own[0], min(own[1], own[0])])


# The ends of what a command may wait are no better known.
_WINDOW = 0.1

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
        form="scattered",
        # A drive that reads by a clock of its own, or a busy link: nobody knows when, and what there is are the mean
        # over all waits and how far it may be off.
        parameters=(
            replace(EFFECT.parameters[0], starts=(0.08, 0.2, 0.4), step=_WINDOW),
            EffectParameter(
                name="jitter", unit="s", null=0.0, low=0.0, high=10.0, starts=(0.08, 0.1, 0.2), step=_WINDOW
            ),
        ),
        equation="each command waits between L − J and L + J, J ≤ L",
        on_torque=_scattered,
        scatter=_scatter,
        canonical=_within,
    ),
)
