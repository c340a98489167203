"""A uniform current: hull and thrusters move relative to the water."""

import math
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import Effect, EffectParameter, WaterCurrent


def _canonical(numbers: FloatArray) -> FloatArray:
    """Speed of 0 or more, and direction from -pi to pi."""
    numbers = np.array(numbers, dtype=np.float64)
    if numbers[0] < 0.0:
        numbers[:2] = -numbers[0], numbers[1] + math.pi
    numbers[1] = math.remainder(numbers[1], 2.0 * math.pi)
    return numbers


_SPEED = EffectParameter(name="speed", unit="m/s", low=-5.0, high=5.0, initial_values=(0.2,), scale="surge")
_DIRECTION = EffectParameter(
    name="direction", unit="rad", low=-20.0, high=20.0, initial_values=(0.0, 1.57, 3.14, -1.57)
)

EFFECT: Effect = Effect(
    id="current",
    axes=("planar",),
    title="current",
    environmental=True,
    parameters=(_SPEED, _DIRECTION),
    equation="u, v through the water = u, v over ground less the current, V towards χ from north",
    fingerprint="residual forces that turn with the heading; drift of the vehicle at rest",
    experiment="the same run on four headings, and a drift without thrust",
    rivals=("heading_dependent_torque", "bias_torque"),
    canonical=_canonical,
    acts=WaterCurrent(),
)
FORMS: tuple[Effect, ...] = ()
PLANAR_FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="wandering",
        parameters=(
            _SPEED,
            _DIRECTION,
            EffectParameter(name="wander", unit="m/s", high=5.0, initial_values=(0.1,), scale="surge"),
            EffectParameter(
                name="correlation_time",
                unit="s",
                neutral=1000.0,  # A slower change is no longer one: the plain form.
                low=2.0,
                high=1000.0,
                initial_values=(20.0,),
                scale="time",
            ),
        ),
        equation="as the plain form, plus a first-order Gauss-Markov process to north and to east",
        fingerprint="as of the plain form, slowly changing during a run or from run to run",
        experiment="the same run on four headings, repeated after some minutes",
        acts=WaterCurrent(wanders=True),
    ),
)
