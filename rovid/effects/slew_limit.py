"""A limit on the rate of change of the applied command."""

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import slewed, soft_started
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnCommand, Values


def _both_ways(inputs: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    return inputs.apply_per_trial(slewed, command, values["rate"])


def _growth(inputs: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    return np.asarray(inputs.apply_per_trial(soft_started, command - inputs.neutral, values["rate"]) + inputs.neutral)


def _size(inputs: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    away = command - inputs.neutral
    size = inputs.apply_per_trial(soft_started, np.abs(away), values["rate"])
    return np.asarray(np.sign(away) * size + inputs.neutral)


def _ramp_time(values: Values, change: float) -> float:
    return change / values["rate"]


EFFECT: Effect = Effect(
    id="slew_limit",
    title="slew limit",
    parameters=(
        EffectParameter(
            name="rate",
            unit="command/s",
            neutral=1e8,
            low=1.0,
            high=1e8,
            initial_values=(600.0, 80.0, 20.0),
            scale="command/time",
        ),
    ),
    equation="|du'/dt| ≤ R",
    fingerprint="a ramp after each step, longer for larger steps; slow sines unchanged",
    experiment="steps of different sizes",
    rivals=("thruster_lag", "command_delay"),
    acts=OnCommand(_both_ways, settling_time=_ramp_time),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="soft_start",
        equation="d|u'|/dt ≤ R; falls at once",
        acts=OnCommand(_growth, settling_time=_ramp_time),
    ),
    # A drive with a size and a direction: a reversal needs no ramp.
    replace(
        EFFECT,
        form="size",
        equation="d|u'|/dt ≤ R; falls, and changes its sign, at once",
        acts=OnCommand(_size, settling_time=_ramp_time),
    ),
)
# Of rudders and azimuth thrusters: a gear turns them at a limited rate.
ANGLE_FORMS: tuple[Effect, ...] = (
    replace(
        EFFECT,
        form="angle",
        title="slew limit of the angle",
        axes=("planar", "yaw"),
        parameters=(
            replace(EFFECT.parameters[0], unit="rad/s", low=0.006, initial_values=(3.6, 0.5, 0.12), scale="one/time"),
        ),
        equation="|dδ/dt| ≤ R, δ the angle of each rudder and azimuth thruster",
        acts=OnCommand(_both_ways, settling_time=_ramp_time, of_angles=True),
    ),
)
