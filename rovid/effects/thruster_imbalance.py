"""One thruster with less thrust than its bench curve."""

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import HOUR, INSTANT, UNTIL, ActuatorInputs, Effect, EffectParameter, OnThrust, Values


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

# Suffixes of a form; part of the effect keys in files.
WITH_OTHERS, FROM_INSTANT, BETWEEN = " beside others", " from an instant", " between instants"
SUFFIXES = ("", WITH_OTHERS, FROM_INSTANT, BETWEEN)


def thruster_of(form: str) -> str:
    """Name of the thruster in the name of a ``form``."""
    return next((form.removesuffix(suffix) for suffix in SUFFIXES if suffix and form.endswith(suffix)), form)


def for_thruster(form: str) -> Effect:
    """The form for a thruster, named without a suffix; ``WITH_OTHERS``: only while another thruster pushes.

    ``FROM_INSTANT``: From an instant of the day on, as with weed or a broken blade. ``BETWEEN``: Until another instant.
    """
    thruster = thruster_of(form)

    def weakened(inputs: ActuatorInputs, thrust: FloatArray, values: Values) -> FloatArray:
        changed, at, share = thrust.copy(), inputs.names.index(thruster), np.ones(len(thrust))
        if form.endswith(WITH_OTHERS):
            share = np.any(np.delete(thrust, at, axis=1) != 0.0, axis=1).astype(np.float64)
        elif INSTANT.name in values:
            share = inputs.share_after(HOUR * values[INSTANT.name])
            if UNTIL.name in values:
                share = np.maximum(share - inputs.share_after(HOUR * values[UNTIL.name]), 0.0)
        changed[:, at] *= 1.0 - (1.0 - values["gain"]) * share
        return changed

    own = replace(EFFECT, form=form, acts=OnThrust(weakened))
    if form.endswith(WITH_OTHERS):
        return replace(own, equation="F' = g·F of the named thruster while another one pushes")
    if form.endswith((FROM_INSTANT, BETWEEN)):
        returns = form.endswith(BETWEEN)
        until = "between the instants" if returns else "from the instant on"
        return replace(
            own,
            title="thruster that loses thrust for a time" if returns else "thruster that loses thrust",
            parameters=(*EFFECT.parameters, INSTANT, *[UNTIL] * returns),
            equation=f"F' = g·F of the named thruster {until}, in h since the first log began",
            fingerprint="residual torque in proportion to one thruster's share of the thrust, in some logs only",
            experiment="the first runs again; each thruster alone; look for weed and at the blades",
        )
    return own
