"""A dead band around neutral, in addition to that of the bench curve."""

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnCommand, Values


def _shift(inputs: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    offset = command - inputs.neutral
    return np.asarray(inputs.neutral + np.sign(offset) * np.maximum(np.abs(offset) - values["deadband"], 0.0))


def _jump(inputs: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    deadband, excess = values["deadband"], inputs.excess(command)
    if deadband <= 0.0:
        return command
    on = np.clip((np.abs(excess) / deadband - 1.0) / values["edge"] + 0.5, 0.0, 1.0)
    return inputs.from_excess(on * excess)


# The likelihood has a local maximum for each command near the threshold.
_JUMPS = (4.0, 6.0, 8.0, 11.0, 14.0, 18.0, 22.0, 27.0, 33.0, 40.0)

EFFECT: Effect = Effect(
    id="thruster_deadband",
    title="thruster dead band",
    parameters=(
        EffectParameter(name="deadband", unit="command", high=60.0, initial_values=(3.0, 15.0), scale="command"),
    ),
    equation="u' = u − sign(u)·b where |u| > b, else 0",
    fingerprint="residual torque odd in the command, relatively largest near zero; flat where a sine crosses zero",
    experiment="a low-speed staircase through neutral, both ways",
    rivals=("coulomb_resistance", "thrust_curve_shape", "supply_sag"),
    acts=OnCommand(_shift),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="jump",
        parameters=(
            replace(EFFECT.parameters[0], initial_values=_JUMPS, step=0.02),
            # A sharp threshold makes the likelihood piecewise constant: the search begins with a wide one.
            EffectParameter(name="edge", unit="1", neutral=0.02, low=0.02, high=0.5, initial_values=(0.1,), step=0.1),
        ),
        equation="u' = u where |u| is b or more beyond the bench's dead zone, else 0: thrust sets in within e·b",
        acts=OnCommand(_jump),
    ),
)
# Of rudders and azimuth thrusters: an angle about neutral without lift, or one that the gear does not follow.
ANGLE_FORMS: tuple[Effect, ...] = (
    replace(
        EFFECT,
        form="angle",
        title="dead band of the angle",
        axes=("planar", "yaw"),
        parameters=(replace(EFFECT.parameters[0], unit="rad", high=0.4, initial_values=(0.02, 0.1), scale="one"),),
        equation="δ' = δ − sign(δ)·b where |δ| > b, else 0, δ the angle of each rudder and azimuth thruster",
        acts=OnCommand(_shift, of_angles=True),
    ),
)
