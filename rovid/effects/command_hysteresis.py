"""Play between command and thruster."""

from __future__ import annotations

from dataclasses import replace

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import latched, played
from rovid.effects.base import ActuatorInputs, Effect, EffectParameter, OnCommand, Values

# A sharp threshold would change the likelihood by steps, without a slope to follow: it is ten percent wide.
_RAMP = 0.1


def _play(where: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    return where.apply_per_trial(played, command, values["width"])


def _latch(where: ActuatorInputs, command: FloatArray, values: Values) -> FloatArray:
    return where.from_excess(where.apply_per_trial(latched, where.excess(command), values["width"], _RAMP))


EFFECT: Effect = Effect(
    id="command_hysteresis",
    title="command hysteresis",
    parameters=(
        EffectParameter(
            name="width", unit="command", neutral=0.0, low=0.0, high=50.0, initial_values=(2.0, 8.0), scale="command"
        ),
    ),
    equation="u' follows u within ±b/2",
    fingerprint="at one command the residual differs for rising and falling commands, however slowly they change",
    experiment="a staircase up and down, slowly",
    rivals=("command_delay", "thruster_deadband"),
    acts=OnCommand(_play),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="schmitt",
        # Commands pass the threshold one by one: there are many places to begin.
        parameters=(
            replace(EFFECT.parameters[0], initial_values=(2.0, 4.0, 6.0, 8.0, 11.0, 14.0, 18.0, 22.0, 27.0, 33.0)),
        ),
        equation="u' = u from when |u| is b beyond the bench's dead zone until it is back in it, else 0",
        acts=OnCommand(_latch),
    ),
)
