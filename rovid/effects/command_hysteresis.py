"""Play between command and thruster."""

from __future__ import annotations

import numpy as np

from rovid.effects.base import Actuation, Effect, EffectParameter, Values
from rovid.effects.series import played
from rovid.trial import FloatArray


def _on_command(_: Actuation, command: FloatArray, values: Values) -> FloatArray:
    return np.column_stack([played(np.ascontiguousarray(u), values["width"]) for u in command.T])


EFFECT: Effect = Effect(
    id="command_hysteresis",
    title="command hysteresis",
    parameters=(
        EffectParameter(name="width", unit="command", null=0.0, low=0.0, high=50.0, starts=(2.0, 8.0), scale="command"),
    ),
    equation="u' follows u within ±b/2",
    fingerprint="at one command the residual differs for rising and falling commands, however slowly they change",
    experiment="a staircase up and down, slowly",
    rivals=("command_delay", "thruster_deadband"),
    on_command=_on_command,
)
