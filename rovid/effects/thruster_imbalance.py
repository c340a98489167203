"""One thruster with less thrust than its bench curve."""

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnThrust, Values


def _unnamed(_: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
    """Placeholder in the form without a thruster."""
    return values["gain"] * thrust


EFFECT: Effect = Effect(
    id="thruster_imbalance",
    title="one weak thruster",
    # With two thrusters a loss of one looks like a gain of the other. A loss is more likely, so gains end at 1. A dead
    # thruster has a gain of 0 within noise, a reversed one has -1.
    parameters=(EffectParameter(name="gain", unit="1", neutral=1.0, low=-1.5, high=1.0, initial_values=(0.9,)),),
    equation="F' = g·F of the named thruster",
    fingerprint="residual torque in proportion to one thruster's share of the thrust",
    experiment="each thruster alone, at the same levels",
    rivals=("thrust_asymmetry", "supply_sag"),
    acts=OnThrust(_unnamed),
    per_thruster=True,
)
FORMS: tuple[Effect, ...] = (EFFECT,)

# Suffix of a form; part of the effect keys in files.
WITH_OTHERS = " beside others"


def for_thruster(name: str) -> Effect:
    """The form for the thruster ``name``; with the suffix ``WITH_OTHERS``, only while another thruster pushes."""
    thruster, with_others = name.removesuffix(WITH_OTHERS), name.endswith(WITH_OTHERS)

    def weakened(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
        changed, at = thrust.copy(), inputs.names.index(thruster)
        others = np.any(np.delete(thrust, at, axis=1) != 0.0, axis=1)
        changed[:, at] *= np.where(others, values["gain"], 1.0) if with_others else values["gain"]
        return changed

    equation = "F' = g·F of the named thruster while another one pushes" if with_others else EFFECT.equation
    return replace(EFFECT, form=name, equation=equation, acts=OnThrust(weakened))
