"""A thrust curve that bends more, or less, than the bench curve."""

from __future__ import annotations

import numpy as np

from rovid.effects.base import Actuation, Effect, EffectParameter, Values
from rovid.trial import FloatArray


def _on_thrust(where: Actuation, thrust: FloatArray, values: Values) -> FloatArray:
    share = np.abs(thrust) / where.full_thrust
    return np.asarray(np.sign(thrust) * where.full_thrust * share ** values["exponent"])


EFFECT: Effect = Effect(
    id="thrust_curve_shape",
    title="shape of the thrust curve",
    parameters=(EffectParameter(name="exponent", unit="1", null=1.0, low=0.4, high=2.5, starts=(0.92, 1.08)),),
    equation="T' = T0·(|T|/T0)^e·sign(T), T0 the largest thrust of the bench",
    fingerprint="residual torque odd in the thrust, of one sign at small and the other at large thrust",
    experiment="coast-downs, which know no thrust, beside holds at many levels",
    rivals=("thruster_deadband", "supply_sag", "drag_curvature"),
    on_thrust=_on_thrust,
)
