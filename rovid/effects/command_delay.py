"""Commands that act some time after they were logged."""

from __future__ import annotations

from dataclasses import replace

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import delayed, delayed_anyhow, open_changes
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnTorque, Values


def _late(where: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
    return where.apply_per_trial(delayed, torque, values["delay"])


def _scattered(where: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
    return where.apply_per_trial(delayed_anyhow, torque, *_ends(values))


def _scatter(where: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
    """Variance of the impulse: of each change that waits anything from (1 - J) L to (1 + J) L, (change J L)^2 / 3."""
    jitter = values["jitter"] * values["delay"]
    return where.apply_per_trial(open_changes, torque, *_ends(values)) * (jitter / 6.0) * where.intervals


def _ends(values: Values) -> tuple[float, float]:
    """The shortest and the longest that a command waits, in s."""
    delay, jitter = values["delay"], values["jitter"]
    return delay * (1.0 - jitter), delay * (1.0 + jitter)


# The ends of what a command may wait are no better known.
_WINDOW = 0.1

EFFECT: Effect = Effect(
    id="command_delay",
    title="command delay",
    parameters=(EffectParameter(name="delay", unit="s", neutral=0.0, low=0.0, high=10.0, initial_values=(0.08, 0.4)),),
    equation="T'(t) = T(t − L)",
    fingerprint="residual torque at the edges of steps, gone after the delay; none in steady motion",
    experiment="a fast pseudo-random command, 1 to 3 s a level",
    rivals=("thruster_lag", "command_hysteresis", "slew_limit"),
    acts=OnTorque(_late, settling_time=lambda values, _: values["delay"]),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="scattered",
        # A drive that reads by a clock of its own, or a busy link: nobody knows when, and what there is are the mean
        # over all waits and how far it may be off.
        parameters=(
            replace(EFFECT.parameters[0], initial_values=(0.08, 0.2, 0.4), step=_WINDOW),
            # All of the mean is what a drive makes of it that reads by its clock, and at no edge.
            EffectParameter(
                name="jitter", unit="1", neutral=1.0, low=0.0, high=1.0, initial_values=(1.0, 0.5, 0.5), step=_WINDOW
            ),
        ),
        equation="each command waits between (1 − J)·L and (1 + J)·L",
        acts=OnTorque(_scattered, settling_time=lambda values, _: _ends(values)[1], impulse_variance=_scatter),
    ),
)
