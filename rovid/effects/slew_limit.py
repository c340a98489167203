"""A limit to how fast the applied command may change."""

from __future__ import annotations

import numpy as np

from rovid.effects.base import Actuation, Effect, EffectParameter, Values
from rovid.effects.series import slewed
from rovid.trial import FloatArray


def _on_command(where: Actuation, command: FloatArray, values: Values) -> FloatArray:
    return np.column_stack([slewed(where.time, np.ascontiguousarray(u), values["rate"]) for u in command.T])


EFFECT: Effect = Effect(
    id="slew_limit",
    title="slew limit",
    parameters=(
        EffectParameter(
            name="rate", unit="command/s", null=1e6, low=0.5, high=1e6, starts=(300.0, 40.0), scale="command"
        ),
    ),
    equation="|du'/dt| ≤ R",
    fingerprint="steps answered by a ramp whose length goes with the size of the step; slow sines untouched",
    experiment="steps of different sizes",
    rivals=("thruster_lag", "command_delay"),
    on_command=_on_command,
)
