"""One thruster that pushes less than its bench curve says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnThrust, Values


def _each(_: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    """Before a thruster is named."""
    return values["gain"] * thrust


EFFECT: Effect = Effect(
    id="thruster_imbalance",
    title="one weak thruster",
    # Two thrusters alone cannot tell one that lost thrust from another that gained it: weakness is the likelier.
    # A dead one gives nothing, to within noise on either side; one wired the wrong way round -1.
    parameters=(EffectParameter(name="gain", unit="1", neutral=1.0, low=-1.5, high=1.0, initial_values=(0.9,)),),
    equation="F' = g·F of the named thruster",
    fingerprint="residual torque in proportion to one thruster's share of the thrust",
    experiment="each thruster alone, at the same levels",
    rivals=("thrust_asymmetry", "supply_sag"),
    acts=OnThrust(_each),
    per_thruster=True,
)
FORMS: tuple[Effect, ...] = (EFFECT,)


WITH_OTHERS = " beside others"


def for_thruster(name: str) -> Effect:
    """The effect on the thruster of this name; with ``BESIDE`` after it, only while another one pushes."""
    thruster, beside = name.removesuffix(WITH_OTHERS), name.endswith(WITH_OTHERS)

    def weakened(where: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
        changed, at = thrust.copy(), where.names.index(thruster)
        others = np.any(np.delete(thrust, at, axis=1) != 0.0, axis=1)
        changed[:, at] *= np.where(others, values["gain"], 1.0) if beside else values["gain"]
        return changed

    equation = "F' = g·F of the named thruster while another one pushes" if beside else EFFECT.equation
    return replace(EFFECT, form=name, equation=equation, acts=OnThrust(weakened))
