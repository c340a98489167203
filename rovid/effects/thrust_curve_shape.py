"""A thrust curve with another curvature than the bench curve."""

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnCommand, OnThrust, Values


def _power(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    share = np.abs(thrust) / inputs.reference_thrust
    return np.asarray(np.sign(thrust) * inputs.reference_thrust * share ** values["exponent"])


def _saturating(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    loss, share = values["loss"], np.abs(thrust) / inputs.reference_thrust
    gain = (1.0 + abs(loss)) / (1.0 + abs(loss) * share)
    # A negative loss uses the reciprocal, which has no pole. The derivative at zero is continuous.
    return np.asarray(thrust * (gain if loss >= 0.0 else 1.0 / gain))


def _parabola(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    gain = 1.0 - values["loss"] * np.abs(thrust) / inputs.full_thrust
    return np.asarray(thrust * gain / (1.0 - values["loss"] * inputs.reference_thrust / inputs.full_thrust))


def _knee(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    beyond = np.maximum(np.abs(thrust) - values["knee"] * inputs.full_thrust, 0.0)
    return np.asarray(thrust - values["loss"] * np.sign(thrust) * beyond)


def _in_command(inputs: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    excess = inputs.excess(command)
    largest = np.abs(inputs.command_range - inputs.dead_zone)
    full = np.where(excess > 0.0, largest[:, 1], largest[:, 0])
    return inputs.from_excess(np.sign(excess) * full * (np.abs(excess) / full) ** values["exponent"])


EFFECT: Effect = Effect(
    id="thrust_curve_shape",
    title="shape of the thrust curve",
    parameters=(
        EffectParameter(name="exponent", unit="1", neutral=1.0, low=0.4, high=2.5, initial_values=(0.92, 1.08)),
    ),
    equation="F' = F0·(|F|/F0)^e·sign(F), F0 a tenth of the bench's largest thrust",
    fingerprint="residual torque odd in the thrust, with opposite signs at small and large thrust",
    experiment="coast-downs, where no thrust acts, and holds at many levels",
    rivals=("thruster_deadband", "supply_sag", "drag_curvature"),
    acts=OnThrust(_power, anchored=True),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="saturating",
        parameters=(EffectParameter(name="loss", unit="1", low=-0.5, high=5.0, initial_values=(0.1,)),),
        equation="F' = F·(1 + a)/(1 + a·|F|/F0), F0 a tenth of the bench's largest thrust",
        acts=OnThrust(_saturating, anchored=True),
    ),
    # A supply sag without a lag is the same law where the thrusters share their load in one way only.
    replace(
        EFFECT,
        form="parabola",
        parameters=(
            EffectParameter(name="loss", unit="1", low=-0.6, high=0.6, initial_values=(0.1, -0.1), scale="one/load"),
        ),
        equation="F' = F·(1 − a·|F|/Fm)/(1 − a/10), Fm the bench's largest thrust",
        acts=OnThrust(_parabola, anchored=True),
    ),
    replace(
        EFFECT,
        form="knee",
        parameters=(
            EffectParameter(name="loss", unit="1", low=-1.0, high=1.0, initial_values=(0.3,)),
            EffectParameter(name="knee", unit="1", neutral=1.0, low=0.05, high=1.0, initial_values=(0.3, 0.6)),
        ),
        equation="F' = F − a·sign(F)·(|F| − k·Fm) where |F| > k·Fm, as with cavitation or a limit of the current",
        acts=OnThrust(_knee),
    ),
    replace(
        EFFECT,
        form="command",
        equation="u' = U·(|u|/U)^e·sign(u), u the command beyond the bench's dead zone and U the largest of its sign",
        fingerprint="residual torque odd in the command, although the bench thrusts of both directions differ",
        acts=OnCommand(_in_command, anchored=True),
    ),
)
